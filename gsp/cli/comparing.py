"""Commands that compare and choose: `gsp methods`, `gsp chart`, `gsp choose`, `gsp sweep`."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from gsp.cli.asking import asks, json_option, orders_through, output_option, tell_variables
from gsp.cli.program import cli
from gsp.cli.telling import (
    check_interrupt,
    check_parent,
    compiling_told,
    give,
    print_json,
    progress_bar,
    tell,
    wrote,
)
from gsp.errors import DeclarationError
from gsp.results.files import write_file
from gsp.results.interrupts import undisturbed

if TYPE_CHECKING:
    from gsp.scenes.scene import Scene


@cli.command()
@asks("set", "epsilon", "region", "small", "fast", by_two=True, looks=True)
@click.option("--order", type=int, help="Highest order of the series [3].")
@json_option
def methods(scene: Scene, order: int | None, as_json: bool) -> None:
    """Compare the classical methods for the slow manifold of MODEL with the series: error, order in epsilon, cost."""
    from gsp.comparison.method_table import method_table

    give(method_table(scene, **orders_through(order)), as_json)


@cli.command()
@asks("set", "epsilon", "region", "small", "fast", looks=True)
@click.option("--order", type=int, help="Highest order of the reduced models.")
@click.option("--failures", is_flag=True, help="Draw where each method holds instead.")
@output_option("File for the figure, .png, .pdf or .svg [gsp-chart-NAME.png].")
@click.option("--csv", "table", type=click.Path(path_type=Path), help="Write the data to this file too.")
@json_option
def chart(
    scene: Scene, failures: bool, output: Path | None, order: int | None, table: Path | None, as_json: bool
) -> None:
    """Draw speed against accuracy for MODEL, or with --failures the map of where each method holds.

    The first chart shows every integrator of gsp, other integrators that are installed, and reduced models of orders 0
    to 4.
    """
    target = output or Path(f"gsp-{'failures' if failures else 'chart'}-{scene.name or 'scene'}.png")
    from gsp import charts

    charts.check_chart_name(target)
    for path in filter(None, (target, table)):
        check_parent(path)
    orders = orders_through(order)
    found: Any
    with progress_bar("runs") as advance:
        if failures:
            from gsp.comparison.failure_map import failure_map

            found = failure_map(scene, progress=advance, **orders)
        else:
            from gsp.comparison.work_precision import work_precision

            found = work_precision(scene, progress=advance, **orders)
    picture = charts.drawn(charts.draw(found), target.suffix[1:].lower())
    check_interrupt()
    with undisturbed():
        # Both files or neither.
        write_file(picture, target)
        wrote(target)
        if table is not None:
            found.write_csv(table)
    give(found, as_json)
    if not as_json:
        click.echo(f"chart: {target}")


@cli.command()
@asks("set", "epsilon", "region", "start", "small", "fast")
@click.option("--tolerance", type=float, help="Relative accuracy wanted [the scene's].")
@click.option("--order", type=int, help="Highest order of the reduced flows.")
@json_option
def choose(scene: Scene, tolerance: float | None, order: int | None, as_json: bool) -> None:
    """Find the cheapest model that meets the tolerance of MODEL: a reduced flow or the full system."""
    from gsp.choice.choice import choose as choose_model

    tell_variables(scene)
    asked, found, fast = scene, None, False
    if not scene.has_small:
        from gsp.reductions.reductions import find_reductions

        found = find_reductions(scene, tolerance=tolerance)
        taken = found.taken if found.recommended is not None or found.solved else None
        if taken is None:
            give(found, as_json, name=scene.name)
            return
        asked, fast = found.study or scene, taken.counts_fast
    choice = choose_model(asked, tolerance=tolerance, fast=fast, **orders_through(order))
    if found is not None:
        tell(found.with_costs(choice), err=as_json)
    give(choice, as_json)


@cli.command()
@click.argument("plan", type=click.Path(path_type=Path))
@output_option("Folder for the results [gsp-sweep-PLAN].")
@click.option("--workers", type=int, help="Processes that share the work [as many as there are cores].")
@click.option("--dask", metavar="ADDRESS", help="Share it among the workers of this Dask scheduler instead.")
@click.option("--anew", is_flag=True, help="Remove results that were made with another model.")
@click.option("--status", is_flag=True, help="Show how far it is, and compute nothing.")
@json_option
def sweep(
    plan: Path,
    output: Path | None,
    workers: int | None,
    dask: str | None,
    anew: bool,
    status: bool,
    as_json: bool,
) -> None:
    """Do a task at every point of a grid. PLAN is a plan file, or the folder of a sweep that was begun.

    Run the command again to continue where it stopped. Run it several times at once, on one machine or on several that
    share the folder, to divide the work.
    """
    from gsp.sweeps.plan_file import read_plan_file
    from gsp.sweeps.sweep import Sweep, resume
    from gsp.sweeps.sweep import sweep as do_sweep

    begun = plan.is_dir()
    folder = plan if begun else output or Path(f"gsp-sweep-{plan.stem}")
    if begun and (output is not None or anew):
        raise DeclarationError(
            f"{plan} holds a sweep with its own plan.", "Leave -o and --anew out, or give a plan file."
        )
    if status:
        if not plan.exists():
            raise DeclarationError(
                f"there is no plan file and no folder {plan}.", "A sweep makes its folder when it begins."
            )
        found = Sweep(folder)
    elif begun and ":" in Sweep(folder).plan.task:
        # The folder is untrusted: it may name any function.
        raise DeclarationError(
            f"the task of {plan} is the function {Sweep(folder).plan.task}, and a folder's word runs no code.",
            "Go on from Python, with the same call of gsp.sweep.",
        )
    else:
        arguments = {} if begun else read_plan_file(plan)
        try:
            with compiling_told(), progress_bar("sweep", left=True) as show:
                if begun:
                    found = resume(folder, workers=workers, client=dask, progress=show)
                else:
                    found = do_sweep(
                        **arguments, into=folder, workers=workers, client=dask, anew=anew, progress=show
                    )
        except KeyboardInterrupt:
            if (folder / "plan.json").is_file():
                wrote(folder)
            raise
    if as_json:
        counts = {"points": found.size, "computed": found.computed, "failed": found.failed}
        print_json({"folder": str(folder), **counts, "failures": found.failures()})
        return
    tell(found)
    click.echo(f"results: {folder}")
