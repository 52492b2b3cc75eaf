"""The errors of a nested reduction, in both of its small parameters together and in each alone."""

from __future__ import annotations

from collections.abc import Callable, Sequence

from gsp.comparison.comparison import Comparison, compare
from gsp.nested.nesting import Nesting


def compare_each(
    nesting: Nesting, *, orders: Sequence[int], progress: Callable[[float], object] | None = None
) -> dict[str, Comparison]:
    """`compare` of a nesting, under the names of its two small parameters, and of each of `alone`, under its name."""
    asked = {" and ".join(s.name for s in nesting.small): nesting, **nesting.alone}
    shares = [None if progress is None else _share(progress, i, len(asked)) for i in range(len(asked))]
    return {
        name: compare(each, orders=orders, progress=show) for (name, each), show in zip(asked.items(), shares)
    }


def _share(progress: Callable[[float], object], i: int, count: int) -> Callable[[float], object]:
    return lambda share: progress((i + share) / count)
