"""Compiled numerics: arrays and addresses in, arrays and a code out; no SymPy, no text, no exceptions.

Only `engine` takes text, the code that `call` runs. Arguments are checked by the layer above. The disk cache of
numba does not see a change in a function that another one calls: after editing a kernel, delete
`gsp/kernels/__pycache__`.
"""
