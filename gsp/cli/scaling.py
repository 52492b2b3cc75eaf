"""The command about time scales: `gsp scales`."""

from __future__ import annotations

from typing import TYPE_CHECKING

import click

from gsp.cli.asking import asks, json_option
from gsp.cli.program import cli
from gsp.cli.telling import check_interrupt, print_json, progress_bar
from gsp.errors import DeclarationError

if TYPE_CHECKING:
    from gsp.scales.small_parameter import SmallParameter
    from gsp.scenes.scene import Scene


@cli.command()
@asks("set", "epsilon", "start")
@click.option(
    "--parameters",
    is_flag=True,
    help="Which parameters may be called small, and what is left where they vanish.",
)
@click.option(
    "--keep", multiple=True, metavar="NAME", help="A parameter that does not vanish. May be repeated."
)
@json_option
def scales(scene: Scene, parameters: bool, keep: tuple[str, ...], as_json: bool) -> None:
    """Find the time scales of MODEL along its run, with or without a small parameter.

    The time scales of the modes, fastest first, how many of them are exhausted, and the gap to the next.
    """
    if parameters:
        _tell_parameters(scene, keep, as_json)
        return
    if keep:
        raise DeclarationError("--keep says which parameters do not vanish.", "Add --parameters.")
    from gsp.scales.time_scales import time_scales

    with progress_bar("time scales") as show:
        found = time_scales(scene, progress=show)
    check_interrupt()
    if as_json:
        print_json(found.as_json())
        return
    click.echo(str(found))


def _tell_parameters(scene: Scene, keep: tuple[str, ...], as_json: bool) -> None:
    from gsp.scales.special_values import small_parameters
    from gsp.scenes.small_parameter import without_small
    from gsp.systems.system import VectorField

    field = without_small(scene).system
    assert isinstance(field, VectorField)
    with progress_bar("special values") as show:
        found = small_parameters(field, kept=keep, progress=show)
    check_interrupt()
    if as_json:
        print_json(
            {
                "name": scene.name,
                "status": found.status.name,
                "message": found.message,
                "parameters": [_plain(each) for each in found],
            }
        )
        return
    useful = [each for each in found if each.attracts is not False and each.is_positive is not False]
    for each in useful:
        click.echo(str(each))
        for state, rate in each.reduced.items():
            click.echo(f"    {state}' = {rate}")
    if not useful:
        click.echo("No parameter of this model may be called small.")
    click.echo(found.message)
    if len(useful) < len(found):
        click.echo(
            f"{len(found) - len(useful)} more manifolds do not attract, or have no points with positive states; "
            "--json has them."
        )


def _plain(found: SmallParameter) -> dict[str, object]:
    return {
        "vanishing": list(found.vanishing),
        "kept": list(found.kept),
        "dimension": found.dimension,
        "manifold": [str(e.lhs) for e in found.manifold],
        "attracts": found.attracts,
        "is_positive": found.is_positive,
        "reduced": {state.name: str(rate) for state, rate in found.reduced.items()},
        "error": found.error,
    }
