"""Writing a report to its folder.

The folder is all or nothing: everything is built beside its place and moved there at the end.
"""

from __future__ import annotations

import json
import os
import re
import shutil
import tempfile
import time
from collections.abc import Callable, Mapping
from contextlib import suppress
from pathlib import Path
from typing import Any

from gsp import charts
from gsp.analysis.analysis import Analysis
from gsp.averaging.averaging import Averaging
from gsp.demos.demo import demo
from gsp.errors import DeclarationError, OutputError
from gsp.readers.writing import as_toml
from gsp.reductions.reductions import Reductions
from gsp.report.averaged import averaged_report
from gsp.report.captions import CAPTIONS
from gsp.report.content import as_json
from gsp.report.manuscript import BIB, TEX, manuscript
from gsp.report.page import ShortReport, render
from gsp.report.three_scales import ThreeScales
from gsp.report.unreduced import unreduced_report
from gsp.results.attempts import Missing, attempt
from gsp.results.interrupts import undisturbed
from gsp.scenes.scene import Scene
from gsp.systems.arguments import check_flag, check_noun, check_progress, shown

HTML, JSON, MODEL = "report.html", "report.json", "report.toml"
_OF_A_VIEW = re.compile(r"view_[A-Za-z0-9][A-Za-z0-9_-]{0,63}\.(png|pdf)")


def write_report(
    analysis: Analysis | Averaging | Reductions,
    folder: str | Path,
    *,
    reductions: Reductions | None = None,
    latex: bool = False,
    progress: Callable[[float], object] | None = None,
) -> Path:
    """Write report.html (self-contained), report.json, figures (PNG) and report.toml to `folder`; returns the page.

    The model file report.toml is the scene as it was asked, which the Python beside each figure loads. With
    `reductions`, of a model without a small parameter, the page begins with its time scales and what may be left out.
    With `latex` a manuscript is written too: report.tex, report.bib and the figures as PDF, which
    `latexmk -pdf report.tex` compiles; all its numbers are in report.json.

    Of an `Averaging` of a scene with a fast phase the page has the averaged field and its measured errors. Of
    `Reductions` of which none is taken it has the model's time scales, why it is not reduced, its run and its ramps.

    The folder is made when it is missing; other files in it stay. `progress(share)` is called as the work goes
    on. A figure or a section that cannot be made is left out, with its reason in its place. Raises `OutputError`
    when the folder cannot be written; then, and when it is interrupted, an older report is intact and nothing new
    is left.
    """
    check_noun(analysis, (Analysis, Averaging, Reductions), verb="write_report")
    check_progress(progress)
    latex = check_flag(latex, what="latex")
    if reductions is not None:
        check_noun(reductions, Reductions, verb="write_report(reductions=...)")
    target = check_folder(folder)
    show_progress = progress or (lambda share: None)
    show_progress(0.0)
    if isinstance(analysis, Analysis):
        files = _analysed(analysis, reductions, latex, show_progress)
    elif latex:
        raise DeclarationError("a report of no analysis is a page, and has no manuscript.", "Leave latex out.")
    elif isinstance(analysis, Averaging):
        report = averaged_report(analysis, show_progress)
        assert analysis.scene is not None
        files = _short(report, analysis.scene)
    else:
        files = _short(unreduced_report(analysis, show_progress), analysis.scene)
    show_progress(0.95)
    try:
        # All or nothing: what Ctrl-C would stop from here on is done in milliseconds.
        with undisturbed():
            _install(files, target)
            show_progress(1.0)
    except OSError as error:
        raise _unwritable(target, error) from error
    return target / HTML


def _short(report: ShortReport, scene: Scene) -> dict[str, bytes]:
    """The files of a report without an analysis, the page last."""
    content, files = report.as_json(), dict(report.made)
    model = attempt("the model file", lambda: as_toml(scene))
    if isinstance(model, Missing):
        content["missing"][MODEL] = model.reason
    else:
        files[MODEL] = model.encode()
    return {**files, JSON: _text(content), HTML: report.page.encode()}


def _text(content: dict) -> bytes:
    return (json.dumps(content, indent=1, allow_nan=False, ensure_ascii=False) + "\n").encode()


def _analysed(
    analysis: Analysis, reductions: Reductions | None, latex: bool, show_progress: Callable[[float], object]
) -> dict[str, bytes]:
    """The files of a report of an analysis, the page last."""
    begun = time.perf_counter()
    if reductions is not None and "choice" not in analysis.lost:
        reductions = reductions.with_costs(analysis.choice)
    drawn = dict(charts.applicable(analysis))
    if reductions is not None:
        drawn = {"time_scales": lambda _: charts.time_scales(reductions.scales), **drawn}
    three = attempt("the nested reduction", lambda: ThreeScales.of(analysis.scene))
    if isinstance(three, ThreeScales):
        drawn["three_scales"] = lambda _: charts.nesting(three.found)
    kinds = ("png", "pdf") if latex else ("png",)

    def picture(draw: Callable[[Analysis], Any]) -> Mapping[str, bytes]:
        axes = draw(analysis)
        return {kind: charts.drawn(axes, kind) for kind in kinds}

    pictures: dict[str, Mapping[str, bytes] | Missing] = {}
    for i, (name, draw) in enumerate(drawn.items()):
        pictures[name] = attempt(f"the figure {name}", lambda draw=draw: picture(draw))
        show_progress(0.9 * (i + 1) / len(drawn))
    made = {name: drawing for name, drawing in pictures.items() if not isinstance(drawing, Missing)}
    content = as_json(analysis)
    content["reductions"] = None if reductions is None else reductions.as_dict()
    content["three_scales"] = three.as_dict() if isinstance(three, ThreeScales) else None
    content["figures"] = [f"{name}.png" for name in made]
    panel = attempt("the panel", lambda: demo(analysis.study))
    model = attempt("the model file", lambda: as_toml(analysis.scene))
    parts = {"three_scales": three, **{f"{name}.png": drawing for name, drawing in pictures.items()}}
    parts |= {"panel": panel, MODEL: model}
    content["missing"] |= {name: part.reason for name, part in parts.items() if isinstance(part, Missing)}
    timings = {**analysis.timings, "report": time.perf_counter() - begun}
    timings["total"] = sum(timings.values())
    content["timings"] = timings
    name_of_model = None if isinstance(model, Missing) else MODEL
    written = {}
    if latex:
        vectors = {name: drawing["pdf"] for name, drawing in made.items()}
        written = manuscript(
            analysis,
            pictures=vectors,
            model=name_of_model,
            three=three if isinstance(three, ThreeScales) else None,
        )
    content["manuscript"] = list(written)
    files = {f"{name}.png": drawing["png"] for name, drawing in made.items()} | written
    if not isinstance(model, Missing):
        files[MODEL] = model.encode()
    files[JSON] = _text(content)
    # Last, so that who finds a new page finds all of it new.
    files[HTML] = render(
        analysis,
        pictures={
            name: drawing if isinstance(drawing, Missing) else drawing["png"]
            for name, drawing in pictures.items()
        },
        panel=panel,
        reductions=reductions,
        three=three,
        timings=timings,
        model=name_of_model,
    ).encode()
    return files


def check_folder(folder: str | Path) -> Path:
    """`folder` as a path, when a report could be written there; call it before the long work.

    Raises `OutputError` when it is a file, or when it, or where it would be made, cannot be written.
    """
    if not isinstance(folder, (str, os.PathLike)):
        raise OutputError("folder is the name of one.", got=shown(folder), value=folder)
    target = Path(folder).expanduser()
    try:
        if target.exists() and not target.is_dir():
            raise OutputError(
                "the report goes to a folder.",
                "Give another name.",
                got=f"{target}, which is a file",
                value=target,
            )
        # Permissions do not tell the whole truth (root, read-only disks): try.
        with undisturbed(), tempfile.TemporaryDirectory(prefix=".gsp-", dir=_ground(target)):
            pass
        for name in (HTML, JSON, MODEL, *(f"{figure}.png" for figure in CAPTIONS)):
            if (target / name).is_dir():
                raise OutputError(
                    f"the report writes {name}.",
                    "Rename it, or give another folder.",
                    got=f"{target / name}, which is a folder",
                )
    except OSError as error:
        raise _unwritable(target, error) from error
    return target


def _ground(target: Path) -> Path:
    """Where the report is built: inside the folder, which may be a disk of its own, or where it will be made."""
    while not target.exists():
        if target.parent == target:
            break
        target = target.parent
    return target


def _unwritable(target: Path, error: OSError) -> OutputError:
    reason = error.strerror or type(error).__name__
    return OutputError(
        f"the report cannot be written to {target}: {reason}.",
        "Give a folder that you may write to, as -o DIR.",
    )


def _install(files: Mapping[str, bytes], target: Path) -> None:
    """All of `files` in `target`, or, after any exception, `target` as it was."""
    with tempfile.TemporaryDirectory(prefix=".gsp-", dir=_ground(target)) as scratch:
        # A folder inside, because the outer one is readable by its owner only.
        built, kept = Path(scratch, "built"), Path(scratch, "kept")
        built.mkdir()
        for name, content in files.items():
            (built / name).write_bytes(content)
        if not target.exists():
            target.parent.mkdir(parents=True, exist_ok=True)
            os.rename(built, target)
            return
        kept.mkdir()
        stale = _stale(target) - set(files)
        replaced = [name for name in (*files, *stale) if (target / name).exists()]
        for name in replaced:
            shutil.copy2(target / name, kept / name)
        try:
            for name in files:
                os.replace(built / name, target / name)
            for name in stale:
                (target / name).unlink(missing_ok=True)
        except BaseException:
            for name in files:
                with suppress(OSError):
                    if name in replaced:
                        os.replace(kept / name, target / name)
                    else:
                        (target / name).unlink(missing_ok=True)
            for name in stale:
                with suppress(OSError):
                    os.replace(kept / name, target / name)
            raise


def _stale(target: Path) -> set[str]:
    """Figures and a manuscript that an older report in the folder says are its own."""
    try:
        content = json.loads((target / JSON).read_text(encoding="utf-8"))
        listed = [*content["figures"], *content.get("manuscript", [])]
        own = {f"{figure}.{kind}" for figure in CAPTIONS for kind in ("png", "pdf")} | {TEX, BIB}
        return {name for name in listed if name in own or _OF_A_VIEW.fullmatch(name)}
    except (OSError, ValueError, KeyError, TypeError):
        return set()
