"""
Two thousand sleighs
====================

How fast does a cloud of sleighs land on the slow manifold, and what does a spread of a parameter do to the end?
"""

import time

import numpy as np

import gsp

field = gsp.models.load("chaplygin_sleigh").system
splitting = gsp.split(field)
assert splitting.system is not None
series = gsp.expand(gsp.solve_critical(splitting.system).branches[0], order=3)

epsilon = 0.01
cloud = np.random.default_rng(0).uniform(-1, 1, (2000, 3))
times = epsilon * np.array([0, 1, 2, 4, 8, 16, 32])
ensemble = gsp.integrate_many(field, cloud, span=(0, times[-1]), epsilon=epsilon, at=times, rtol=1e-8)
print(ensemble)

# The slow momentum p = (I + m a^2) omega + m a w, with m = I = 1 and a = 1/5, names the point of the manifold.
v, omega, w = ensemble["v"], ensemble["omega"], ensemble["w"]
p = 1.04 * omega + 0.2 * w
slow = series.evaluate(np.stack([v.ravel(), p.ravel()], axis=1), epsilon)[:, 0].reshape(v.shape)
print("\n  t/epsilon   distance |w - h(v, p)|: median    largest")
for j, t in enumerate(times):
    distance = np.abs(w[:, j] - slow[:, j])
    print(f"  {t / epsilon:9.0f} {np.median(distance):32.1e} {distance.max():10.1e}")
print("  it falls as exp(-1.04 t/epsilon), down to what the series of order 3 leaves out")

# A parameter known to ten per cent: where the skate is mounted.
a = 0.2 * (1 + 0.1 * np.random.default_rng(1).standard_normal(2000))
spread = gsp.integrate_many(
    field, {"v": -1.5, "omega": 1, "w": 0}, span=(0, 12), epsilon=0.05, parameters={"a": a}, rtol=1e-6
)
quantiles = np.quantile(spread["v"][:, -1], [0.05, 0.5, 0.95])
print("\n  a = 0.2 +- 10 %: speed at t = 12, 5, 50 and 95 %:", *(f"{value:.4f}" for value in quantiles))

begun = time.perf_counter()
gsp.integrate_many(field, cloud, span=(0, 20), epsilon=1e-3, rtol=1e-6, atol=1e-6)
print(f"\n  {len(cloud)} runs to t = 20: {1e6 * (time.perf_counter() - begun) / len(cloud):.0f} us each")

# %%
# The distance falls at the rate of the fast eigenvalue, -(1/m + a^2/I) = -1.04 in fast time.
distances = np.abs(w - slow)
rate = np.log(np.median(distances[:, 1] / distances[:, 3]) / 1) / 3
assert abs(rate - 1.04) < 0.02
axes = gsp.charts.spread(ensemble, name="w")
