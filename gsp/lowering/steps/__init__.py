"""Models as LLVM's intermediate code: expressions, linear systems, and whole steps of an integrator.

Code written for one model has its zeros, its constants and its number of states in it, and no loops. It knows nothing
of how steps are chosen: that is the kernels' part, which call it by address.
"""
