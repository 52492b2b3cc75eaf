"""The command about ramps: `gsp ramp`."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from gsp.cli.asking import asks, json_option, output_option
from gsp.cli.program import cli
from gsp.cli.telling import check_interrupt, print_json, progress_bar, wrote
from gsp.errors import DeclarationError, GspError

if TYPE_CHECKING:
    from gsp.scenes.scene import Scene
    from gsp.singular.ramps.rate_diagram import RateDiagram


@cli.command()
@asks("set", "epsilon", "start")
@click.option("--ramp", "name", metavar="NAME", help="One of the model's ramps [all of them].")
@click.option(
    "--amplitudes",
    metavar="LOW:HIGH",
    help="Rates against the amplitude: the changes of the ramp times factors between these two.",
)
@output_option("Draw the first that has a threshold to this file: .png, .svg or .pdf.")
@json_option
def ramp(scene: Scene, name: str | None, amplitudes: str | None, output: Path | None, as_json: bool) -> None:
    """Find the rates at which the ramps of MODEL tip.

    The tables [ramps.NAME] of the model say how its parameters move, and near which edge state. For each ramp the
    command gives the critical rates, at which the orbit from the start ends in the edge state. It also gives their
    errors, and on which side of them the ramp tips.
    """
    from gsp import charts
    from gsp.singular.ramps.critical_rate import CriticalRate, critical_rate
    from gsp.singular.ramps.rate_diagram import rate_diagram
    from gsp.systems.arguments import check_among

    if output is not None:
        charts.check_chart_name(output)
    if not scene.ramps:
        raise DeclarationError("the model has no ramp.", "Give it a table [ramps.NAME]; see docs/models.md.")
    if name is not None:
        check_among(name, scene.ramps, f"the model has no ramp {name!r}.", "They are")
    factors = None if amplitudes is None else _factors(amplitudes)
    found: dict[str, CriticalRate | RateDiagram] = {}
    refused: GspError | None = None
    for each, asked in scene.ramps.items():
        if name not in (None, each):
            continue
        question: dict[str, Any] = {
            "ramp": asked.ramp,
            "start": asked.start or {s.name: scene.start[s.name] for s in scene.system.states},
            "edge": asked.edge or None,
            "epsilon": scene.epsilon,
        }
        try:
            if factors is None:
                found[each] = critical_rate(scene.system, **question)
            else:
                with progress_bar(f"ramp {each}") as show:
                    found[each] = rate_diagram(scene.system, **question, amplitudes=factors, progress=show)
        except GspError as error:
            # What is known of the other ramps is told first.
            refused = refused or error.under(f"ramp {each}")
        check_interrupt()
    if refused is not None and not found:
        raise refused
    if as_json:
        print_json({each: answer.as_json() for each, answer in found.items()})
    else:
        for each, answer in found.items():
            click.echo(f"{each}: {answer}")
    if output is not None:
        # The first that has a threshold; where none has one, the chart of the first says why.
        answers = list(found.values())
        shown = next((a for a in answers if not isinstance(a, CriticalRate) or a.has_chart), answers[0])
        charts.save(charts.draw(shown), output)
        wrote(output)
        if not as_json:
            click.echo(f"chart: {output}")
    if refused is not None:
        raise refused


def _factors(text: str) -> tuple[float, float]:
    try:
        low, high = map(float, text.split(":"))
    except ValueError:
        raise DeclarationError("--amplitudes is given as LOW:HIGH.", got=text[:80]) from None
    return low, high
