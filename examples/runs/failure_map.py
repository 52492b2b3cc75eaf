"""
Where each order holds
======================

For many epsilons, how far along the run does each reduced flow keep to its tolerance? Van der Pol's oscillator
runs to its fold.
"""

import numpy as np

import gsp

scene = gsp.models.load("van_der_pol")
found = gsp.failure_map(scene, epsilons=np.geomspace(1e-3, 0.1, 5))
print(found)

# %%
# Wherever the slow manifold holds, it does so before the fold at y = -2/3.
places = [row["at"] for row in found.as_rows() if row["method"] == "slow manifold" and row["holds"]]
assert len(places) > 0
assert min(places) > -2 / 3
axes = found.plot()
