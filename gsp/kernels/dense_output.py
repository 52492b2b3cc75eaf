"""Values between the recorded points of an integration."""

from __future__ import annotations

from gsp.kernels.compilation import kernel


@kernel
def interpolate_many(times, states, dense, t, out):
    """Fill column j of `out` (n, m) with the state at `t[j]`, inside the interval of `times`.

    `times` (k + 1,) is strictly monotone, `states` (k + 1, n), `dense` (k, rows, n) with rows c_1, c_2, ... of

        y = (1-s) y0 + s y1 + s (1-s) (c_1 + s (c_2 + (1-s) (c_3 + s (c_4 + ...)))),  s = (t - t0)/(t1 - t0),

    the nesting of Hairer's dense outputs, here exact at both ends. Returns the first j whose time is outside, or -1;
    there the polynomial of the nearest step goes on.
    """
    last = times.shape[0] - 1
    earliest = min(times[0], times[last])
    latest = max(times[0], times[last])
    outside = -1
    sign = 1.0 if times[last] >= times[0] else -1.0
    n = states.shape[1]
    rows = dense.shape[1]
    for j in range(t.shape[0]):
        if outside < 0 and not earliest <= t[j] <= latest:
            outside = j
        low = 0
        high = last
        while high - low > 1:
            middle = (low + high) // 2
            if sign * times[middle] <= sign * t[j]:
                low = middle
            else:
                high = middle
        if last == 0:
            for i in range(n):
                out[i, j] = states[0, i]
            continue
        s = (t[j] - times[low]) / (times[low + 1] - times[low])
        r = 1.0 - s
        for i in range(n):
            total = 0.0
            for k in range(rows - 1, -1, -1):
                total = dense[low, k, i] + (s if k % 2 == 0 else r) * total
            out[i, j] = r * states[low, i] + s * states[low + 1, i] + s * r * total
    return outside
