"""The command about three time scales: `gsp nest`."""

from __future__ import annotations

from typing import TYPE_CHECKING

import click

from gsp.cli.asking import asks, json_option
from gsp.cli.program import cli
from gsp.cli.telling import check_interrupt, print_json, progress_bar, tell

if TYPE_CHECKING:
    from gsp.scenes.scene import Scene


@cli.command()
@asks("set", "epsilon", "region")
@click.option(
    "--small",
    "pair",
    metavar="NAME,NAME",
    help="The two, of the fastest scale first [the model's]; NAME+NAME for some that vanish together.",
)
@click.option("--order", type=int, default=2, show_default=True, help="Highest total power of the two.")
@json_option
def nest(scene: Scene, pair: str | None, order: int, as_json: bool) -> None:
    """Reduce MODEL twice, by two small parameters: three time scales.

    Prints the slow manifold within the slow manifold as a series in both parameters, and the flow on it. Then measures
    with which power of the parameters the error falls, for both together and for each alone.
    """
    from gsp.comparison.nested import compare_each
    from gsp.nested.nesting import nest as reduce_twice

    names = None if pair is None else [[name.strip() for name in part.split("+")] for part in pair.split(",")]
    found = reduce_twice(scene, small=names, order=order)
    with progress_bar("runs") as show:
        measured = compare_each(found, orders=tuple(range(order)), progress=show) if order else {}
    check_interrupt()
    if as_json:
        comparisons = {name: each.as_json() for name, each in measured.items()}
        print_json({"name": scene.name, **found.as_dict(), "comparisons": comparisons})
        return
    tell(found)
    for name, study in (("C1", found.first), ("C2", found.second)):
        tell(f"{name}: {study.hyperbolicity.kind}, gap {found.gaps[name]:.6g} in slow time")
        for loss in study.hyperbolicity.losses:
            tell(f"  {str(loss).splitlines()[0]}")
    kinds = {str(found.first.hyperbolicity.kind), str(found.second.hyperbolicity.kind)}
    if measured and kinds not in ({"attracting"}, {"repelling"}):
        tell(
            "Not everything attracts here, and not everything repels. Full runs leave the slow manifold in either "
            "direction of time, so the errors below say little about the series."
        )
    for name, each in measured.items():
        tell(f"\n{name}: {each}")
