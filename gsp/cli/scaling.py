"""The command about time scales: `gsp scales`."""

from __future__ import annotations

from math import isfinite
from typing import TYPE_CHECKING

import click

from gsp.algebra.brevity import brief
from gsp.cli.asking import asks, json_option
from gsp.cli.program import cli
from gsp.cli.telling import check_interrupt, give, print_json, progress_bar, tell
from gsp.errors import DeclarationError, GspError

if TYPE_CHECKING:
    from gsp.scales.small_parameter import SmallParameter
    from gsp.scenes.scene import Scene

# Reductions at special values that are measured: each takes a run.
MOST = 100


@cli.command()
@asks("set", "epsilon", "start")
@click.option(
    "--parameters",
    is_flag=True,
    help="Find which parameters may be called small, and what remains when they vanish.",
)
@click.option("--keep", multiple=True, metavar="NAME", help="This parameter is not small. May be repeated.")
@click.option(
    "--scalings",
    is_flag=True,
    help="Scale variables and time by powers of the small parameter so that its poles become simple.",
)
@json_option
def scales(scene: Scene, parameters: bool, keep: tuple[str, ...], scalings: bool, as_json: bool) -> None:
    """Find the time scales of MODEL along its run, with or without a small parameter.

    Prints the time scales of the modes along the run, fastest first. Says how many modes are exhausted, which means
    that they have decayed and no longer act, and how large the gap to the next mode is.
    """
    if parameters and scalings:
        raise DeclarationError("--parameters and --scalings cannot be combined.", "Give one of them.")
    if keep and not parameters:
        raise DeclarationError("--keep belongs to --parameters.", "Add --parameters, or leave --keep out.")
    if parameters:
        _tell_parameters(scene, keep, as_json)
        return
    if scalings:
        _tell_scalings(scene, as_json)
        return
    from gsp.scales.time_scales import time_scales

    with progress_bar("time scales") as show:
        found = time_scales(scene, progress=show)
    check_interrupt()
    give(found, as_json)


def _tell_scalings(scene: Scene, as_json: bool) -> None:
    from gsp.splitting.scaling import scalings

    found = scalings(scene.system.as_field())
    check_interrupt()
    if as_json:
        print_json(
            {
                "name": scene.name,
                "scalings": [
                    {
                        "states": {s.name: str(e) for s, e in each.states.items()},
                        "exponents": {s.name: float(a) for s, a in each.exponents.items()},
                        "time": float(each.time),
                        "power": float(each.power),
                        "epsilon": str(each.field.epsilon),
                        "rates": {s.name: str(e) for s, e in each.field.equations.items()},
                    }
                    for each in found
                ],
            }
        )
        return
    for each in found:
        tell(each)
        for state, rate in each.field.equations.items():
            tell(f"    {state}' = {brief(rate)}")
    if not found:
        tell(f"No other scaling by small powers of {scene.system.epsilon} brings out fast variables.")


def _tell_parameters(scene: Scene, keep: tuple[str, ...], as_json: bool) -> None:
    from gsp.integration.trajectory import trajectory_of
    from gsp.reductions.special_parts import with_errors
    from gsp.scales.special_values import small_parameters
    from gsp.scenes.small_parameter import without_small
    from gsp.scenes.study import RTOL
    from gsp.systems.region import shown_ends
    from gsp.systems.system import VectorField
    from gsp.systems.tolerances import absolute_tolerance

    plain = without_small(scene)
    field = plain.system
    assert isinstance(field, VectorField)
    with progress_bar("special values") as show:
        found = small_parameters(field, kept=keep, progress=show)
    check_interrupt()
    # A list for people leaves out what more parameters add to a manifold; nobody reads or waits for thousands.
    listed = tuple(found) if as_json else found.simplest()
    measured, told = listed[:MOST], found.message
    try:
        atol = absolute_tolerance(RTOL, {}, plain.start)
        run = trajectory_of(field, plain.start, plain.span, rtol=RTOL, atol=atol)
        with progress_bar("errors") as show:
            measured = with_errors(plain, run, measured, progress=show)
        told += "" if run.status.ok else f" Errors were not measured. {run.message}"
    except GspError as error:
        told += f" Errors were not measured: {error.reason}"
    if len(listed) > MOST:
        told += f" {len(found)} manifolds were found, and the {MOST} for which fewest parameters vanish were looked at."
    if as_json:
        print_json(
            {
                "name": scene.name,
                "status": found.status.name,
                "message": told,
                "parameters": [_plain(each) for each in measured],
            }
        )
        return
    useful = [each for each in measured if each.attracts is not False and each.is_positive is not False]
    for each in useful:
        tell(each)
        if not each.is_within_reach:
            click.echo("    the reduction has more terms than the exact algebra forms")
            continue
        for state, rate in each.reduced.items():
            tell(f"    {state}' = {brief(rate)}")
        if each.error is not None and isfinite(each.error):
            end = shown_ends(scene.span)[1]
            click.echo(f"    error at these values behind the layer, to t = {end}: {each.error:.2g}")
    if not useful:
        tell("No parameter of this model may be called small.")
    tell(told)
    if len(listed) < len(found):
        click.echo(
            f"{len(found) - len(listed)} more let further parameters vanish on the same manifolds; --json has them."
        )
    if len(useful) < len(measured):
        click.echo(
            f"{len(measured) - len(useful)} more manifolds do not attract, or have no points with positive states; "
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
        "reduced": {state.name: str(rate) for state, rate in found.reduced.items()}
        if found.is_within_reach
        else None,
        "error": None if found.error is None or not isfinite(found.error) else found.error,
    }
