"""Commands that run a model and give the numbers: `gsp run`, `gsp compare`."""

from __future__ import annotations

import json
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from gsp.cli.asking import asks, found_small, json_option, orders_through, output_option, tell_variables
from gsp.cli.program import cli
from gsp.cli.telling import check_interrupt, check_parent, print_json, progress_bar, tell, tell_notes, wrote
from gsp.errors import DeclarationError
from gsp.results.files import write_file

if TYPE_CHECKING:
    from gsp.results.tabular import Tabular
    from gsp.scenes.scene import Scene

ENDINGS = (".csv", ".json")


@cli.command()
@asks("set", "epsilon", "region", "start", "small", "fast")
@click.option("--order", type=int, help="Run the reduced flow of this order instead of the full system.")
@click.option("--rtol", type=float, help="Relative error of a step [1e-8].")
@click.option(
    "--atol", type=float, help="Absolute error of a step [that of rtol in the smallest state, or less]."
)
@output_option("File for the values, .csv or .json [not written].")
@json_option
def run(
    scene: Scene,
    order: int | None,
    rtol: float | None,
    atol: float | None,
    output: Path | None,
    as_json: bool,
) -> None:
    """Run MODEL over its time span: the full system, or with --order a reduced flow.

    The full system starts at the model's start. A reduced flow of order N starts at the base point of the start: the
    point where the fast fibre through the start meets the slow manifold, computed through epsilon^N.
    """
    _check_target(output)
    from gsp.integration.trajectory import RunOptions, trajectory_of
    from gsp.systems.tolerances import RTOL, absolute_tolerance

    if order is not None and not scene.has_small:
        found = found_small(scene, needed=True).taken
        assert found is not None
        scene = found.scene
    rtol = RTOL if rtol is None else rtol
    atol = absolute_tolerance(rtol, scene.region, scene.full_start) if atol is None else atol
    with progress_bar("run") as show:
        options: Any = {"rtol": rtol, "atol": atol, "options": RunOptions(progress=show)}
        if order is None:
            flow, start, span, epsilon = scene.setting(None, None, None)
            found = trajectory_of(flow, start, span, epsilon, **options)
        else:
            from gsp.scenes.study import study_of

            tell_variables(scene)
            study = study_of(scene)
            base = study.base_point(order)
            # An error that three digits would hide is none that a run shows.
            tell_notes(
                f"the run begins at the base point of the start, of which {name} is "
                + base.how_known(name).format(f"{error:.1g}")
                for name, error in base.errors.items()
                if f"{base[name] - error:.3g}" != f"{base[name] + error:.3g}"
            )
            slow = {x.name: base[x.name] for x in study.system.x}
            best = study.series(order).optimal_order(slow, study.scene.epsilon)
            if best < order:
                tell_notes([f"there the series is past its best order, {best}: terms of higher orders grow"])
            found = trajectory_of(
                study.reduced(order),
                start=base,
                span=study.scene.span,
                epsilon=study.scene.epsilon,
                **options,
            )
    _give(found, output, as_json)


@cli.command()
@asks("set", "epsilon", "region", "start", "small", "fast", looks=True)
@click.option("--order", type=int, help="Highest order of the reduced flows [3].")
@output_option("File for the errors, .csv or .json [not written].")
@json_option
def compare(scene: Scene, order: int | None, output: Path | None, as_json: bool) -> None:
    """Compare the reduced flows of MODEL with the full system over its ladder of epsilons: errors and slopes.

    Both runs begin on the slow manifold, at the start of the slow variables, so the initial layer does not count here;
    in gsp choose it does. If the model has two small parameters, both are made smaller together, and the orders are
    those of the flow on the inner slow manifold. gsp nest gives the powers of each parameter alone.
    """
    _check_target(output)
    from gsp.comparison.comparison import compare as compare_flows
    from gsp.nested.nesting import nest

    orders = orders_through(1 if scene.second and order is None else order)
    target = nest(scene, order=orders["orders"][-1] + 1) if scene.second else scene
    with progress_bar("runs") as show:
        found = compare_flows(target, progress=show, **orders)
    _give(found, output, as_json)


def _check_target(output: Path | None) -> None:
    if output is None:
        return
    if output.suffix.lower() not in ENDINGS:
        raise DeclarationError(
            "values are written as .csv or .json.", "Give a name with one of these.", got=output.name
        )
    check_parent(output)


def _give(found: Tabular, output: Path | None, as_json: bool) -> None:
    """The table to a file, as JSON, or the result in words."""
    check_interrupt()
    if output is not None:
        if output.suffix.lower() == ".csv":
            found.write_csv(output)
        else:
            write_file(f"{json.dumps(found.as_json(), allow_nan=False)}\n".encode(), output)
        wrote(output)
    if as_json:
        print_json(found.as_json() if output is None else {"file": str(output)})
        return
    tell(found)
    if output is not None:
        click.echo(f"values: {output}")
