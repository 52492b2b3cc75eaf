"""The command line: `gsp models`, `gsp split`, `gsp expand`, `gsp check`, `gsp verify`, `gsp choose`, `gsp report`,
`gsp demo`.

Exit status 0 when all is well, 1 when `check` finds that normal hyperbolicity does not hold or `verify` that a
proof does not, 2 on bad input or when the output cannot be written, 3 when `check --prove` leaves it undecided, 70 on
a defect of gsp, 130 when interrupted. Heavy modules are imported by the command that needs them, so that help is
quick.
"""

from __future__ import annotations

import json
import os
import sys
import warnings
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from functools import wraps
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from gsp import __version__
from gsp.errors import DeclarationError, GspError, OutputError, printable
from gsp.results.files import write_file
from gsp.results.interrupts import noticing, undisturbed

if TYPE_CHECKING:
    from gsp.scenes.scene import Scene

# EX_SOFTWARE of sysexits.h: no verdict of `check`, which has 1.
DEFECT = 70
# With this environment variable a defect shows its traceback, with Python's own status, 1.
DEBUG = "GSP_DEBUG"
# What Ctrl-C has to know of a command: a check that it has not come yet, and the outputs that were written.
CHECK, WRITTEN = "gsp.check", "gsp.written"
CONTEXT = {"help_option_names": ["-h", "--help"], "max_content_width": 100}


class Program(click.Group):
    """The commands; output that cannot be written, to a full disk or a closed pipe, is an error like any other."""

    def invoke(self, ctx: click.Context) -> Any:
        try:
            try:
                return super().invoke(ctx)
            finally:
                sys.stdout.flush()
        except OSError as error:
            # Errors of files have the file's name, and are told where the file is written.
            if error.filename is not None:
                raise
            raise OutputError(
                f"the output cannot be written: {error.strerror or error}. What was printed is not complete."
            ) from None


@click.group(cls=Program, context_settings=CONTEXT)
@click.version_option(__version__, prog_name="gsp")
def cli() -> None:
    """Geometric singular perturbation: slow manifolds, their hyperbolicity, and reduced flows, measured.

    MODEL is the name of a built-in scene (see `gsp models`) or the path of a model file (TOML, or XPPAUT's .ode).

    \b
    gsp report chaplygin_sleigh        the whole analysis, as a report to read
    gsp expand van_der_pol --order 5   the slow manifold as a series in epsilon
    gsp check my_model.toml            is it normally hyperbolic in its region?
    gsp choose my_model.toml           the cheapest model that meets its tolerance
    gsp demo van_der_pol               a page in which the model runs, to move and to show
    """


def _json_option(function: Any) -> Any:
    return click.option("--json", "as_json", is_flag=True, help="Print JSON instead of text.")(function)


def _orders(order: int | None) -> tuple[int, ...] | None:
    """The orders 0 to `order`."""
    if order is None:
        return None
    if order < 0:
        raise DeclarationError(f"--order is a non-negative integer. Got {order}.")
    return tuple(range(order + 1))


_OPTIONS = {
    "set": click.option(
        "--set", "settings", multiple=True, metavar="NAME=VALUE",
        help="Another value of a parameter, exact; 1/3 is allowed. May be repeated.",
    ),
    "epsilon": click.option("--epsilon", metavar="VALUE", help="Value of the small parameter [the scene's]."),
    "region": click.option(
        "--region", "intervals", multiple=True, metavar="NAME=LOW:HIGH",
        help="Another interval of a state. May be repeated.",
    ),
}  # fmt: skip


def _output_option(text: str) -> Callable[[Any], Any]:
    """Give a command the option -o, whose help is `text`."""
    return click.option("-o", "--output", type=click.Path(path_type=Path), help=text)


def _asks(*names: str) -> Callable[[Any], Any]:
    """Give a command the argument MODEL and the options `names`; the command takes the scene that results."""

    def decorate(function: Any) -> Any:
        @wraps(function)
        def asked(
            *,
            model: str,
            settings: tuple[str, ...] = (),
            epsilon: str | None = None,
            intervals: tuple[str, ...] = (),
            **others: Any,
        ) -> Any:
            scene = _asked(load_scene(model), settings, epsilon, intervals)
            with _compiling_told():
                return function(scene=scene, **others)

        for name in reversed(names):
            asked = _OPTIONS[name](asked)
        return click.argument("model")(asked)

    return decorate


@contextmanager
def _compiling_told() -> Iterator[None]:
    """Say so, once, when kernels are compiled: on the first run on a machine, which takes half a minute longer."""
    from gsp.kernels.compiling import told_when_compiling

    def tell() -> None:
        with suppress(OSError):
            click.echo("gsp: compiling its numerics, once on this machine; later runs begin at once", err=True)

    with told_when_compiling(tell):
        yield


def _asked(scene: Scene, settings: tuple[str, ...], epsilon: str | None, intervals: tuple[str, ...]) -> Scene:
    from gsp.readers.toml import read_number
    from gsp.scenes.settings import ask_again

    def pairs(option: str, texts: tuple[str, ...], form: str) -> Iterator[tuple[str, str]]:
        for text in texts:
            name, found, value = text.partition("=")
            if not (name.strip() and found and value.strip()):
                raise DeclarationError(f"{option} is given as {form}. Got {text[:80]!r}.")
            yield name.strip(), value.strip()

    parameters: dict[str, Any] = {
        name: read_number(value, what=f"--set {name}") for name, value in pairs("--set", settings, "NAME=VALUE")
    }
    region = {}
    for name, value in pairs("--region", intervals, "NAME=LOW:HIGH"):
        low, found, high = value.partition(":")
        if not found:
            raise DeclarationError(f"--region is given as NAME=LOW:HIGH. Got {name}={value[:80]!r}.")
        region[name] = (
            float(read_number(low.strip(), what=f"--region {name}")),
            float(read_number(high.strip(), what=f"--region {name}")),
        )
    small = None if epsilon is None else float(read_number(epsilon, what="--epsilon"))
    if not parameters and not region and small is None:
        return scene
    return ask_again(scene, parameters=parameters, epsilon=small, region=region)


@cli.command()
@_json_option
def models(as_json: bool) -> None:
    """List the built-in scenes."""
    from gsp.models import summary

    rows = summary()
    if as_json:
        _print_json([{"name": name, "title": title} for name, title in rows])
        return
    width = max(len(name) for name, _ in rows)
    for name, title in rows:
        click.echo(f"{name:{width}}  {title}")


@cli.command("import")
@click.argument("file", type=click.Path(path_type=Path))
@click.option("--small", metavar="NAME", help="The parameter that is the small one [epsilon or eps].")
@_output_option("File for the model [FILE with the suffix .toml].")
def import_(file: Path, small: str | None, output: Path | None) -> None:
    """Read FILE, an .ode file of XPPAUT, and write it as a model file; say what was understood and left out."""
    from gsp.readers.toml import import_model

    found = import_model(file, small=small)
    target = output or file.with_suffix(".toml")
    if output is None and target.exists():
        raise GspError(f"there is a file {target} already. Name another with -o, or that one to replace it.")
    write_file(found.text.encode(), target)
    _wrote(target)
    for note in found.notes:
        click.echo(note)
    click.echo(f"model: {target}")


@cli.command()
@_asks("set")
@_json_option
def split(scene: Scene, as_json: bool) -> None:
    """Find the slow and the fast variables of MODEL, and say how."""
    from gsp.scenes.study import study_of

    study = study_of(scene)
    splitting, system = study.splitting, study.system
    if as_json:
        identity = {s.name: s.name for s in system.states}
        _print_json(
            {
                "name": scene.name,
                "slow": {x.name: str(rate) for x, rate in system.slow.items()},
                "fast": {y.name: str(rate) for y, rate in system.fast.items()},
                "coordinates": identity
                if splitting is None
                else {s.name: str(e) for s, e in splitting.coordinates.items()},
                "conserved": [x.name for x, rate in system.slow.items() if rate == 0],
                "explanation": "declared in standard form" if splitting is None else splitting.explain(),
            }
        )
        return
    still = [] if splitting is not None else [x for x, rate in system.slow.items() if rate == 0]
    declared = "\n".join(["Declared in standard form.", *(f"Conserved: {x}, for {x}' = 0." for x in still)])
    click.echo((declared if splitting is None else splitting.explain()) + "\n")
    click.echo(str(system))


@cli.command()
@_asks("set")
@click.option("--order", default=3, show_default=True, help="Highest power of epsilon.")
@click.option("--raw", is_flag=True, help="In the field's own variables instead of the slow and fast ones.")
@click.option(
    "--values", is_flag=True, help="Put the parameters' values in: much shorter where there are many."
)
@_json_option
def expand(scene: Scene, order: int, raw: bool, values: bool, as_json: bool) -> None:
    """Print the slow manifold h_0, h_1, ... and the reduced field f_0, f_1, ... of MODEL."""
    from gsp.scenes.study import study_of
    from gsp.slow.raw_series import carry_back
    from gsp.slow.series import READABLE

    study = study_of(scene)
    whole = study.series(order, symbolic=not values)
    through = order if as_json else next((k for k, n in enumerate(whole.sizes) if n > READABLE), order + 1) - 1
    # Only what is printed is turned into expressions: that is where the time of a long series goes.
    series: Any = whole.at_order(max(through, 0))
    if raw and study.splitting is not None:
        series = carry_back(series, study.splitting)
        if series is None:
            raise GspError(
                f"the series of {scene.name} cannot be carried back to the raw variables explicitly. "
                "Leave --raw out; the slow coordinates are given by `gsp split`."
            )
    fields = [("h", series.coefficients), ("f", series.reduced_field)]
    if as_json:
        rows = {letter: [[str(e) for e in row] for row in part] for letter, part in fields}
        names = {letter: [s.name for s in part[0].symbols] for letter, part in fields}
        _print_json(
            {
                "name": scene.name,
                "order": order,
                "slow": names["f"],
                "fast": names["h"],
                "h": rows["h"],
                "reduced_field": rows["f"],
            }
        )
        return
    if not study.branch.is_explicit:
        fast = ", ".join(y.name for y in study.system.y)
        click.echo(f"Here {fast} is the point of the critical manifold over the slow variables: {study.branch}")
    remedy = "--json prints all of it" if values else "--values is shorter, --json prints all of it"
    for letter, part in fields:
        for k, size in enumerate(whole.sizes):
            if k > through:
                click.echo(f"{letter}_{k}  has coefficients of up to {size} terms; {remedy}")
                continue
            for symbol, expression in part[k].as_dict().items():
                prime = "'" if letter == "f" else ""
                click.echo(f"{letter}_{k}  {symbol}{prime} = {expression}")


@cli.command()
@_asks("set", "epsilon", "region")
@click.option("--prove", is_flag=True, help="Prove it in ball arithmetic instead of sampling.")
@_output_option("Write the proof to this file; `gsp verify` checks it.")
@_json_option
def check(scene: Scene, prove: bool, output: Path | None, as_json: bool) -> None:
    """Check the conditions of normal hyperbolicity of MODEL over its region.

    Exit status 0 when every condition holds at the samples, 1 when one fails; with --prove 0 when it is proved, 1
    when it is refuted, 3 when it is undecided.
    """
    from gsp.scenes.study import study_of

    if output is not None and not prove:
        raise DeclarationError("-o writes a proof, and samples are none. Add --prove, or leave -o out.")
    study = study_of(scene)
    if prove:
        from gsp.slow_tubes.certify import certify

        with _progress("boxes") as advance:
            certificate = certify(study.branch, region=study.region, epsilon=scene.epsilon, progress=advance)
            if output is not None and certificate.verdict.name == "PROVED":
                certificate.save(output)
        if as_json:
            _print_json({"name": scene.name, **certificate.as_dict()})
        else:
            click.echo(str(certificate))
        click.get_current_context().exit({"PROVED": 0, "REFUTED": 1, "UNDECIDED": 3}[certificate.verdict.name])
    verdict = study.hyperbolicity
    if as_json:
        from gsp.report import hyperbolicity_as_json

        _print_json({"name": scene.name, "holds": verdict.holds, **hyperbolicity_as_json(verdict)})
    else:
        click.echo(str(verdict))
    click.get_current_context().exit(0 if verdict.holds else 1)


@cli.command()
@click.argument("file", type=click.Path(path_type=Path))
@_json_option
def verify(file: Path, as_json: bool) -> None:
    """Check the proof in FILE, which `gsp check --prove -o FILE` wrote: in whole numbers, by code of its own.

    Exit status 0 when the proof holds, 1 when it does not.
    """
    from gsp.proofs import checker

    try:
        found = checker.check(file)
    except OSError as error:
        raise GspError(f"the proof cannot be read. Got {file}: {error.strerror}. Name another file.") from None
    except checker.Rejected as error:
        if as_json:
            _print_json({"holds": False, "reason": str(error)})
        else:
            click.echo(f"the proof does not hold: {error}")
        click.get_current_context().exit(1)
    if as_json:
        _print_json({"holds": True, **found.as_dict()})
    else:
        click.echo(str(found))


@cli.command()
@_asks("set", "region")
@_json_option
def folds(scene: Scene, as_json: bool) -> None:
    """Follow the critical manifold of MODEL through its folds.

    In a box that is wider than the region by one and a half of its widths on every side. At a fold, a and b are the
    coefficients of v' = b dx + a v^2 along the null direction.
    """
    from gsp.analysis.fold_surroundings import never_folds, not_followed, surroundings
    from gsp.critical.continuation import CriticalCurve
    from gsp.scenes.study import study_of

    study = study_of(scene)
    found = surroundings(study)
    if found is None and never_folds(study.branch):
        message = not_followed(study).rstrip(".")
        if as_json:
            _print_json({"name": scene.name, "message": message, "special": [], "curves": []})
        else:
            click.echo(message)
        return
    if found is None:
        raise GspError(not_followed(study))
    curves = [found] if isinstance(found, CriticalCurve) else [*found.folds]
    if as_json:
        _print_json(
            {
                "name": scene.name,
                "message": found.message,
                "special": [
                    {"kind": str(p.kind), "point": dict(p.point), "coefficients": dict(p.coefficients)}
                    for curve in curves
                    for p in curve.special
                ],
                "curves": [
                    {
                        "kind": "critical manifold" if isinstance(curve, CriticalCurve) else "folds",
                        "points": {name: curve[name].tolist() for name in curve.names},
                    }
                    for curve in curves
                ],
            }
        )
        return
    texts = [str(curve) for curve in curves]
    click.echo("\n".join(texts if isinstance(found, CriticalCurve) else [found.message, *texts]))


@cli.command()
@_asks("set", "epsilon", "region")
@click.option("--order", type=int, help="Highest order of the series [3].")
@_json_option
def methods(scene: Scene, order: int | None, as_json: bool) -> None:
    """Compare methods for the slow manifold of MODEL: quasi-steady state, ILDM, CSP, series, solved, ..."""
    from gsp.comparison.classical_table import method_table

    orders = _orders(order)
    table = method_table(scene) if orders is None else method_table(scene, orders=orders)
    if as_json:
        from gsp.report import plain

        _print_json(plain(table.as_rows()))
        return
    click.echo(str(table))


@cli.command()
@_asks("set", "epsilon", "region")
@click.option("--order", type=int, help="Highest order of the reduced models.")
@click.option("--failures", is_flag=True, help="Draw where each method holds instead.")
@_output_option("File for the figure, .png, .pdf or .svg [gsp-chart-NAME.png].")
@click.option("--csv", "table", type=click.Path(path_type=Path), help="Write the data to this file too.")
@_json_option
def chart(
    scene: Scene, failures: bool, output: Path | None, order: int | None, table: Path | None, as_json: bool
) -> None:
    """Chart speed against accuracy for MODEL, or with --failures where each method holds.

    Speed against accuracy: every integrator, those installed beside ours, and reduced models of orders 0 to 4.
    """
    target = output or Path(f"gsp-{'failures' if failures else 'chart'}-{scene.name or 'scene'}.png")
    from gsp import charts

    charts.check_chart_name(target)
    for path in filter(None, (target, table)):
        if not path.absolute().parent.is_dir():
            raise GspError(f"there is no folder {path.absolute().parent}. Make it, or give another path.")
    orders = _orders(order)
    found: Any
    with _progress("runs") as advance:
        if failures:
            from gsp.comparison.failures import failure_map

            found = (
                failure_map(scene, progress=advance)
                if orders is None
                else failure_map(scene, orders=orders, progress=advance)
            )
        else:
            from gsp.comparison.work_curves import work_precision

            found = (
                work_precision(scene, progress=advance)
                if orders is None
                else work_precision(scene, orders=orders, progress=advance)
            )
    axes = charts.failure_map(found) if failures else charts.work_precision(found)
    picture = charts.drawn(axes, target.suffix[1:].lower())
    _check_interrupt()
    with undisturbed():
        # Both files or neither.
        write_file(picture, target)
        _wrote(target)
        if table is not None:
            found.write_csv(table)
    if as_json:
        from gsp.report import plain

        _print_json(plain({"name": scene.name, "rows": found.as_rows()}))
        return
    click.echo(str(found))
    click.echo(f"chart: {target}")


@cli.command()
@_asks("set", "epsilon", "region")
@click.option("--tolerance", type=float, help="Relative accuracy wanted [the scene's].")
@click.option("--order", type=int, help="Highest order of the reduced flows.")
@_json_option
def choose(scene: Scene, tolerance: float | None, order: int | None, as_json: bool) -> None:
    """The cheapest of the reduced flows and the full system that meets the tolerance of MODEL, and why."""
    from gsp.choice.choice import choose as choose_model

    orders = _orders(order)
    choice = (
        choose_model(scene, tolerance=tolerance)
        if orders is None
        else choose_model(scene, tolerance=tolerance, orders=orders)
    )
    if as_json:
        from gsp.report import choice_as_json

        _print_json({"name": choice.scene.name, **choice_as_json(choice)})
        return
    click.echo(str(choice))


@cli.command()
@_asks("set", "epsilon", "region")
@_output_option("Folder for the report [gsp-report-NAME].")
@click.option("--order", default=3, show_default=True, help="Highest power of epsilon in the series.")
@_json_option
def report(scene: Scene, output: Path | None, order: int, as_json: bool) -> None:
    """Analyse MODEL and write report.html, report.json and the figures."""
    from gsp.report import check_folder

    folder = output or Path(f"gsp-report-{scene.name or 'scene'}")
    check_folder(folder)
    with _progress("") as show:
        from gsp.analysis.analysis import STAGES, analyse
        from gsp.report import write_report

        stages = (*STAGES, "report")

        def progress(stage: str, share: float) -> None:
            if stage == "report" and share == 1.0:
                _wrote(folder)
            show((stages.index(stage) + share) / len(stages), stage)

        analysis = analyse(scene, order=order, progress=progress)
        page = write_report(analysis, folder, progress=lambda share: progress("report", share))
    written = json.loads((page.parent / "report.json").read_text(encoding="utf-8"))
    if as_json:
        _print_json(written)
        return
    if "choice" not in analysis.lost:
        click.echo(str(analysis.choice.verdict))
    click.echo(f"{analysis.hyperbolicity.kind}, gap {analysis.hyperbolicity.gap:.4g} in fast time")
    for condition in analysis.hyperbolicity.conditions:
        if not condition.holds:
            click.echo(f"over the region as a whole: {condition}")
    if "comparison" not in analysis.lost:
        click.echo(str(analysis.comparison))
    for name, reason in written["missing"].items():
        click.echo(f"not made: {name}: {reason}")
    click.echo(f"report: {page}")


@cli.command()
@click.argument("model", required=False)
@_OPTIONS["set"]
@_OPTIONS["epsilon"]
@_output_option("File for the page [gsp-demo-NAME.html].")
@click.option("--open/--no-open", "opened", default=True, help="Show the page in the browser [yes].")
@_json_option
def demo(
    model: str | None,
    settings: tuple[str, ...],
    epsilon: str | None,
    output: Path | None,
    opened: bool,
    as_json: bool,
) -> None:
    """Write a page in which MODEL runs: drag epsilon, the parameters and the start. Without MODEL list the demos.

    The page is one HTML file that needs no network. A built-in scene with a story is told in steps.
    """
    from gsp.demos.demo import demo as make_demo
    from gsp.demos.demo import stories

    if model is None:
        if settings or epsilon is not None or output is not None:
            raise DeclarationError(
                "a demo is made of a model. Got options and no MODEL. Name a scene or a model file."
            )
        _list_demos(stories(), as_json)
        return
    scene = _asked(load_scene(model), settings, epsilon, ())
    target = output or Path(f"gsp-demo-{scene.name or 'scene'}.html")
    if not target.absolute().parent.is_dir():
        raise GspError(f"there is no folder {target.absolute().parent}. Make it, or give another path.")
    with _compiling_told():
        page = make_demo(scene)
    _check_interrupt()
    page.save(target)
    _wrote(target)
    if as_json:
        _print_json({"name": scene.name, "file": str(target), "bytes": target.stat().st_size})
    else:
        click.echo(f"demo: {target}")
    if opened and click.launch(target.absolute().as_uri()) != 0 and not as_json:
        click.echo("No browser was found here; open the file in one.")


def _list_demos(told: tuple[str, ...], as_json: bool) -> None:
    """Scenes with a story first, then the others."""
    from gsp.models import summary

    rows = sorted(summary(), key=lambda row: row[0] not in told)
    if as_json:
        _print_json([{"name": name, "title": title, "told": name in told} for name, title in rows])
        return
    width = max(len(name) for name, _ in rows)
    for name, title in rows:
        click.echo(f"{name:{width}}  {'told in steps' if name in told else '':13}  {title}")


@cli.command()
@click.argument("plan", type=click.Path(path_type=Path))
@_output_option("Folder for the results [gsp-sweep-PLAN].")
@click.option("--workers", type=int, help="Processes that share the work [as many as there are cores].")
@click.option("--dask", metavar="ADDRESS", help="Share it among the workers of this Dask scheduler instead.")
@click.option("--anew", is_flag=True, help="Remove results that were made with another model.")
@click.option("--status", is_flag=True, help="Show how far it is, and compute nothing.")
@_json_option
def sweep(
    plan: Path,
    output: Path | None,
    workers: int | None,
    dask: str | None,
    anew: bool,
    status: bool,
    as_json: bool,
) -> None:
    """Do a task at every point of a grid: PLAN is a plan file, or the folder of a sweep to go on with.

    The same command goes on where it stopped. Given several times at once, on hosts that see the folder, it shares the
    work.
    """
    from gsp.sweeps.plan_file import read_plan_file
    from gsp.sweeps.sweep import Sweep, resume
    from gsp.sweeps.sweep import sweep as do_sweep

    begun = plan.is_dir()
    folder = plan if begun else output or Path(f"gsp-sweep-{plan.stem}")
    if begun and (output is not None or anew):
        raise DeclarationError(
            f"{plan} holds a sweep with its own plan. Leave -o and --anew out, or give a plan file."
        )
    if status:
        found = Sweep(folder)
    elif begun and ":" in Sweep(folder).plan.task:
        # The folder is untrusted: it may name any function.
        raise DeclarationError(
            f"the task of {plan} is the function {Sweep(folder).plan.task}, and a folder's word runs no code. "
            "Go on from Python, with the same call of gsp.sweep."
        )
    else:
        arguments = {} if begun else read_plan_file(plan)
        with _compiling_told(), _progress("sweep", left=True) as show:
            if begun:
                found = resume(folder, workers=workers, client=dask, progress=show)
            else:
                found = do_sweep(
                    **arguments, into=folder, workers=workers, client=dask, anew=anew, progress=show
                )
    if as_json:
        counts = {"points": found.size, "computed": found.computed, "failed": found.failed}
        _print_json({"folder": str(folder), **counts, "failures": found.failures()})
        return
    click.echo(str(found))
    click.echo(f"results: {folder}")


@contextmanager
def _progress(description: str, *, left: bool = False) -> Iterator[Callable[..., None]]:
    """A bar on standard error; gives what takes the fraction done, and the stage where there are several."""
    from rich.console import Console
    from rich.progress import BarColumn, Progress, TextColumn, TimeElapsedColumn, TimeRemainingColumn

    columns = (TextColumn("{task.description:>14}"), BarColumn(), TimeElapsedColumn())
    if left:
        columns = (*columns, TextColumn("left"), TimeRemainingColumn())
    with Progress(*columns, console=Console(stderr=True), transient=True) as bar:
        task = bar.add_task(description, total=1.0)

        def show(share: float, stage: str = description) -> None:
            _check_interrupt()
            bar.update(task, completed=share, description=stage)

        yield show


def load_scene(model: str) -> Scene:
    """The scene of a built-in name or of a model file."""
    from gsp import models as builtin

    path = Path(model)
    if path.suffix in (".toml", ".ode") or len(path.parts) > 1 or path.is_file():
        from gsp.readers import load

        return load(path)
    return builtin.load(model)


def _print_json(value: object) -> None:
    click.echo(json.dumps(value, indent=2, allow_nan=False))


def _tell(message: Any, category: Any, filename: Any, lineno: Any, file: Any = None, line: Any = None) -> None:
    """A warning in one line."""
    with suppress(OSError):
        click.echo(f"gsp: {printable(' '.join(str(message).split()))}", err=True)


def _stop_writing() -> None:
    """Let Python flush what is left of the output to nowhere, where there is nobody to read it."""
    try:
        sys.stdout.flush()
    except OSError:
        with suppress(OSError, ValueError):
            os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())


def _check_interrupt() -> None:
    context = click.get_current_context(silent=True)
    if context is not None and context.obj is not None:
        context.obj[CHECK]()


def _wrote(path: Path) -> None:
    context = click.get_current_context(silent=True)
    if context is not None and context.obj is not None:
        context.obj[WRITTEN].append(path)


def main() -> None:
    """Run the command line and exit with its status."""
    warnings.showwarning = _tell
    written: list[Path] = []
    try:
        with noticing() as check:
            status = cli.main(standalone_mode=False, obj={CHECK: check, WRITTEN: written})
            check()
    except GspError as error:
        with suppress(OSError):
            click.echo(f"gsp: {printable(str(error))}", err=True)
        _stop_writing()
        sys.exit(2)
    except click.ClickException as error:
        with suppress(OSError):
            error.show()
        _stop_writing()
        sys.exit(error.exit_code)
    except (click.Abort, KeyboardInterrupt):
        what = f"{written[0]} was written before" if written else "nothing was written"
        click.echo(f"gsp: interrupted; {what}", err=True)
        sys.exit(130)
    except Exception as error:
        if os.environ.get(DEBUG):
            raise
        said = " ".join(f"{type(error).__name__}: {error}".split())
        click.echo(
            f"gsp: this is a defect of gsp, not of your model: {said}. Run again with {DEBUG}=1 for the traceback, "
            "and report both.",
            err=True,
        )
        sys.exit(DEFECT)
    sys.exit(status if isinstance(status, int) else 0)


if __name__ == "__main__":
    main()
