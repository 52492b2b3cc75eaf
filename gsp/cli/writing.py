"""Commands that write pages and text: `gsp report`, `gsp demo`, `gsp export`."""

from __future__ import annotations

import json
from pathlib import Path
from typing import TYPE_CHECKING

import click

from gsp.cli.asking import (
    OPTIONS,
    asks,
    json_option,
    keep_model,
    load_scene,
    output_option,
    scene_with_options,
    taken,
    tell_variables,
)
from gsp.cli.program import cli
from gsp.cli.telling import check_interrupt, check_parent, compiling_told, print_json, progress_bar, tell, wrote
from gsp.errors import DeclarationError
from gsp.exports import TARGETS
from gsp.results.files import write_file

if TYPE_CHECKING:
    from gsp.averaging.averaging import Averaging
    from gsp.reductions.reductions import Reductions
    from gsp.scenes.scene import Scene


@cli.command()
@asks("set", "epsilon", "region", "start", "small", "fast", by_two=True, looks=True, tells=True)
@output_option("Folder for the report [gsp-report-NAME].")
@click.option("--order", default=3, show_default=True, help="Highest power of epsilon in the series.")
@click.option("--latex", is_flag=True, help="Write a manuscript too: report.tex, report.bib, figures as PDF.")
@click.option("--open/--no-open", "opened", default=False, help="Show the report in the browser [no].")
@json_option
def report(
    scene: Scene,
    reductions: Reductions | None,
    output: Path | None,
    order: int,
    latex: bool,
    opened: bool,
    as_json: bool,
) -> None:
    """Analyse MODEL and write a report: report.html, report.json, the figures, and report.toml.

    report.toml is the model with the options given here. If the model does not say what is small, the report begins
    with its time scales and says which variables can be eliminated. If none can, it says so, with the model's run and
    its ramps. A model with a fast phase is averaged, and the report describes the average.
    """
    from gsp.analysis.analysis import STAGES, analyse
    from gsp.report import check_folder, write_report

    folder = output or Path(f"gsp-report-{scene.name or 'scene'}")
    if scene.phase is not None:
        from gsp.averaging.averaging import average

        check_folder(folder)
        _short_report(average(scene, order=order), folder, opened, as_json, latex=latex)
        return
    if reductions is not None and reductions.taken is None:
        _short_report(reductions, folder, opened, as_json, latex=latex)
        return
    with progress_bar("") as show:
        check_folder(folder)
        stages = (*STAGES, "report")

        def progress(stage: str, share: float) -> None:
            if stage == "report" and share == 1.0:
                wrote(folder)
            show((stages.index(stage) + share) / len(stages), stage)

        fast = reductions is not None and reductions.taken is not None and reductions.taken.counts_fast
        study = None if reductions is None else reductions.study
        analysis = analyse(study or scene, order=order, fast=fast, progress=progress)
        page = write_report(
            analysis,
            folder,
            reductions=reductions,
            latex=latex,
            progress=lambda share: progress("report", share),
        )
    written = json.loads((page.parent / "report.json").read_text(encoding="utf-8"))
    if as_json:
        print_json(written)
        _show(page, opened, as_json)
        return
    if "choice" not in analysis.lost:
        tell(analysis.choice.verdict)
    tell(f"{analysis.hyperbolicity.kind}, gap {analysis.hyperbolicity.shown_gap(4)} in fast time")
    for condition in analysis.hyperbolicity.conditions:
        if not condition.holds:
            tell(f"over the region as a whole: {condition}")
    if "comparison" not in analysis.lost:
        tell(analysis.comparison)
    if "series" not in analysis.lost and analysis.cut:
        tell(analysis.cut)
    for name, reason in written["missing"].items():
        tell(f"not made: {name}: {reason}")
    click.echo(f"report: {page}")
    if latex:
        click.echo(f"manuscript: {page.parent / 'report.tex'}; latexmk -pdf compiles it")
    _show(page, opened, as_json)


def _short_report(
    found: Averaging | Reductions, folder: Path, opened: bool, as_json: bool, *, latex: bool
) -> None:
    """The report of a scene with a fast phase, which is averaged, or of one in which nothing is fast."""
    from gsp.averaging.averaging import Averaging
    from gsp.report import write_report

    with progress_bar("report") as show:
        page = write_report(found, folder, latex=latex, progress=show)
        wrote(folder)
    if as_json:
        print_json(json.loads((page.parent / "report.json").read_text(encoding="utf-8")))
    else:
        # What was looked for is told already.
        if isinstance(found, Averaging):
            tell(found)
        click.echo(f"report: {page}")
    _show(page, opened, as_json)


@cli.command()
@click.argument("model", required=False)
@OPTIONS["set"]
@OPTIONS["epsilon"]
@OPTIONS["small"]
@OPTIONS["fast"]
@output_option("File for the page [gsp-demo-NAME.html].")
@click.option(
    "--story", type=click.Path(path_type=Path), metavar="FILE", help="TOML file that tells a story in steps."
)
@click.option("--open/--no-open", "opened", default=True, help="Show the page in the browser [yes].")
@json_option
def demo(
    model: str | None,
    settings: tuple[str, ...],
    epsilon: str | None,
    small: str | None,
    fast: str | None,
    output: Path | None,
    story: Path | None,
    opened: bool,
    as_json: bool,
) -> None:
    """Write a page in which MODEL runs: drag epsilon, the parameters and the start. Without MODEL list the demos.

    The page is one HTML file that needs no network. Some built-in scenes come with a story that is told in steps. With
    --story FILE you can tell one about any model.
    """
    from gsp.demos.demo import demo as make_demo
    from gsp.demos.demo import stories

    if model is None:
        if settings or any(option is not None for option in (epsilon, small, fast, output, story)):
            raise DeclarationError(
                "a demo is made of a model.", "Name a scene or a model file.", got="options and no MODEL"
            )
        _list_demos(stories(), as_json)
        return
    keep_model(model, output, story)
    scene = taken(scene_with_options(load_scene(model), settings, None, ()), small, fast)
    scene = scene_with_options(scene, (), epsilon, ())
    tell_variables(scene)
    target = output or Path(f"gsp-demo-{scene.name or 'scene'}.html")
    check_parent(target)
    with compiling_told(), progress_bar("page"):
        page = make_demo(scene, story=story)
    check_interrupt()
    page.save(target)
    wrote(target)
    if as_json:
        print_json({"name": scene.name, "file": str(target), "bytes": target.stat().st_size})
    else:
        click.echo(f"demo: {target}")
    _show(target, opened, as_json)


def _show(page: Path, opened: bool, as_json: bool) -> None:
    """Open a page in the browser where that is wanted."""
    if opened and click.launch(page.absolute().as_uri()) != 0 and not as_json:
        click.echo("No browser was found here; open the file in one.")


def _list_demos(with_story: tuple[str, ...], as_json: bool) -> None:
    """Scenes with a story first, then the others."""
    from gsp.models import summary

    rows = sorted(summary(), key=lambda row: row[0] not in with_story)
    if as_json:
        print_json([{"name": name, "title": title, "told": name in with_story} for name, title in rows])
        return
    width = max(len(name) for name, _ in rows)
    for name, title in rows:
        click.echo(f"{name:{width}}  {'told in steps' if name in with_story else '':13}  {title}")


@cli.command()
@asks("set", "epsilon", "small", "fast")
@output_option("File for the picture, .gif or .mp4 [gsp-NAME.gif].")
@click.option("--view", metavar="NAME", help="One of the model's views [its path, or its first plane view].")
@click.option("--seconds", default=5.0, show_default=True, help="How long the picture moves.")
def animate(scene: Scene, output: Path | None, view: str | None, seconds: float) -> None:
    """Write a moving picture of MODEL for slides: its path, a view, or its run past the critical manifold."""
    from gsp.demos.animation import animate as make_animation

    tell_variables(scene)
    target = output or Path(f"gsp-{scene.name or 'scene'}.gif")
    check_parent(target)
    with progress_bar("frames") as show:
        make_animation(scene, target, view=view, seconds=seconds, progress=show)
    wrote(target)
    click.echo(f"picture: {target}")


@cli.command()
@asks("set", "epsilon", "region", "small", "fast", looks=True)
@click.option("--order", default=1, show_default=True, help="Highest power of epsilon in the reduced flow.")
@click.option(
    "--to",
    default="python",
    show_default=True,
    metavar="FORMAT",
    help=f"{', '.join(TARGETS[:-1])} or {TARGETS[-1]}.",
)
@output_option("File for the text [printed].")
@json_option
def export(scene: Scene, order: int, to: str, output: Path | None, as_json: bool) -> None:
    """Write the reduced flow of MODEL for another tool.

    The text needs nothing else to run, and a comment gives its measured error.
    """
    from gsp.exports.export import export as export_scene

    if output is not None:
        check_parent(output)
    text = export_scene(scene, order=order, to=to)
    check_interrupt()
    if output is not None:
        write_file(text.encode(), output)
        wrote(output)
    if as_json:
        written = {"text": text} if output is None else {"file": str(output)}
        print_json({"name": scene.name, "order": order, "format": to, **written})
    elif output is None:
        click.echo(text, nl=False)
    else:
        click.echo(f"export: {output}")
