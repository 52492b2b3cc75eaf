"""The command about fast phases: `gsp average`."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import click

from gsp.cli.asking import asks, json_option, output_option
from gsp.cli.program import cli
from gsp.cli.telling import check_interrupt, print_json, progress_bar, tell, tell_notes, wrote

if TYPE_CHECKING:
    from gsp.scenes.scene import Scene


@cli.command()
@asks("set", "epsilon", "region", "small alone", "start")
@click.option("--phase", metavar="NAME", help="The state that turns [the model's].")
@click.option("--pair", metavar="NAME,NAME", help="Two states that turn about one another [the model's].")
@click.option("--order", type=int, default=3, show_default=True, help="Highest power of the small parameter.")
@output_option("Draw a slow variable, averaged and not, to this file: .png, .svg or .pdf.")
@json_option
def average(
    scene: Scene, phase: str | None, pair: str | None, order: int, output: Path | None, as_json: bool
) -> None:
    """Average MODEL over its fast phase.

    The averaged field, the rate of the phase and the transformation to averaged variables, exactly, and the measured
    powers of the small parameter with which the error falls.
    """
    from gsp import charts
    from gsp.averaging.averaging import average as averaged
    from gsp.comparison.averaged import compare_averaged
    from gsp.scenes.slow_time import explain_slow_time

    if output is not None:
        charts.check_chart_name(output)
    two = None if pair is None else [name.strip() for name in pair.split(",")]
    found = averaged(scene, phase=phase, pair=two, order=order)
    if found.scene is not None and found.scene.span != scene.span:
        tell_notes([explain_slow_time(found.scene, scene)])
    with progress_bar("runs") as show:
        measured = compare_averaged(found, progress=show)
    check_interrupt()
    if output is not None:
        charts.save(charts.draw(found), output)
        wrote(output)
    if as_json:
        print_json({"name": scene.name, **found.as_dict(), "comparison": measured.as_json()})
        return
    tell(found)
    tell(f"\n{measured}")
    if output is not None:
        click.echo(f"chart: {output}")
