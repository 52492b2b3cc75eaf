"""A demo: one HTML file in which the model of a scene itself runs."""

from __future__ import annotations

from collections.abc import Collection, Mapping
from dataclasses import dataclass, field
from importlib.resources import files
from pathlib import Path
from typing import Any

import numpy as np
import sympy as sp

from gsp import models
from gsp.analysis.fold_surroundings import surroundings
from gsp.demos.page import render
from gsp.demos.program import PageProgram, program_of
from gsp.demos.story import body_in, quantities_of, read_story, story_of
from gsp.errors import DeclarationError, GspError, ModelFileError, printable
from gsp.readers.toml import parsed
from gsp.results.card import Card
from gsp.results.files import write_file
from gsp.results.lettering import in_unicode, letter
from gsp.results.mathml import Typesetter, math, parts_of_name
from gsp.scenes.scene import Scene
from gsp.scenes.study import Study, study_of
from gsp.systems.arguments import check_noun, shown
from gsp.systems.region import state_sizes
from gsp.systems.tolerances import absolute_tolerance


@dataclass(frozen=True, eq=False, repr=False)
class Demo(Card):
    """A page to move: `html` is a whole file, which runs the model without a network.

    `script_hash` is the source expression, as in 'sha256-...', by which the policy of a page around it lets it run.
    """

    scene: Scene
    html: str = field(repr=False)
    script_hash: str = field(repr=False)

    def save(self, path: str | Path) -> Path:
        """Write the page to `path`, whole or not at all; raises `OutputError` when that cannot be done."""
        if not isinstance(path, (str, Path)):
            raise DeclarationError("path is the name of a file.", got=shown(path), value=path)
        return write_file(self.html.encode(), path)

    def __repr__(self) -> str:
        return (
            f"Demo({self.scene.name or self.scene.title or 'unnamed'}, {len(self.html.encode()) / 1000:.0f} kB)"
        )


def demo(scene: Scene | Study, *, story: str | Path | None = None) -> Demo:
    """The demo of a scene: a page whose sliders move epsilon, the parameters and the start, with the model inside.

    It is told by the file `story`; without one a built-in scene that has a story is told by that. Raises
    `ModelFileError` for a story that names what the page does not have, and `UnsupportedFunctionError` when the field
    holds a function that JavaScript does not have. What of the reduction cannot be had on the page, because the field
    has no standard form or the series is too long, the page says.

    >>> from gsp import models
    >>> demo(models.load("linear")).html[:15]
    '<!doctype html>'
    """
    return _demo(scene, story, verb="demo")


def write_demo(scene: Scene | Study, path: str | Path, *, story: str | Path | None = None) -> Path:
    """Write the demo of a scene to `path`, whole or not at all; returns the path. Raises what `demo` raises."""
    return _demo(scene, story, verb="write_demo").save(path)


def stories() -> tuple[str, ...]:
    """Names of the scenes that have a story."""
    folder = files("gsp.demos").joinpath("stories")
    return tuple(
        sorted(entry.name.removesuffix(".toml") for entry in folder.iterdir() if entry.name.endswith(".toml"))
    )


def _demo(scene: Scene | Study, story: str | Path | None, *, verb: str) -> Demo:
    check_noun(scene, (Scene, Study), verb=verb)
    if story is not None and not isinstance(story, (str, Path)):
        raise DeclarationError("story is the name of a file.", got=shown(story), value=story)
    study = _ready(scene)
    scene = study.scene
    document = _told(scene) if story is None else read_story(story)
    try:
        program = program_of(study, quantities_of(document, scene))
        told = story_of(document, scene, program.parts) if document else {}
    except ModelFileError as error:
        raise error.under("the story" if story is None else Path(story).name) from None
    quantities = program.parts["quantities"]
    axes = told.get("axes") or _first_plane(scene, quantities) or _axes(program.parts)
    title = told.get("title") or scene.title or scene.name or scene.system.name or "A slow-fast system"
    sizes = state_sizes(scene.region, scene.full_start)
    data = {
        "title": in_unicode(printable(title)),
        "description": in_unicode(printable(scene.description)),
        "source": printable(scene.source),
        "epsilon": scene.epsilon if scene.has_small else 1.0,
        "start": list(scene.full_start.values()),
        "span": list(scene.span),
        "sizes": [sizes.get(s.name, 1.0) for s in scene.system.states],
        "absolute": absolute_tolerance(1.0, scene.region, scene.full_start),
        "axes": axes,
        "trace": told.get("trace") or axes[1],
        "units": {name: printable(unit) for name, unit in scene.units.items()},
        "path": None if scene.path is None else list(scene.path),
        "body": told.get("body"),
        "frame": told.get("frame", {}),
        "window": told.get("window", {}),
        "logarithmic": told.get("logarithmic", []),
        "work": told.get("work", False),
        "compared": told.get("compared", True),
        "ranges": told.get("ranges", {}),
        "story": told.get("steps", []),
        "folds": _folds(study, program.parts),
        "views": [{"names": list(view.names), "ranges": dict(view.ranges)} for view in scene.views.values()],
        **_names(program),
        **_space(study, program.parts, told.get("space", True)),
    }
    return Demo(scene, *render(program, data, title=data["title"]))


def _names(program: PageProgram) -> dict[str, Any]:
    """Every name as MathML, as letters for menus, and in the pieces that stand on a canvas."""
    parts = program.parts
    small = [] if parts["epsilon"] is None else [parts["epsilon"]]
    names = dict.fromkeys(["t", *small, *parts["parameters"], *parts["quantities"]])
    setter = Typesetter(())
    return {
        "typeset": {name: math(setter.row(sp.Symbol(name))) for name in names},
        "letters": {name: letter(name) for name in names},
        "lettered": {name: parts_of_name(name) for name in names},
    }


def _ready(scene: Scene | Study) -> Study:
    """The study in whose variables the page is; a scene without a small parameter has one all the same."""
    return scene if isinstance(scene, Study) else study_of(scene) if scene.has_small else Study(scene)


def _first_plane(scene: Scene, quantities: Collection[str]) -> list[str] | None:
    """The plane of the first view whose quantities the demo has."""
    in_space = (
        view for view in scene.views.values() if len(view.names) == 2 and set(view.names) <= {*quantities}
    )
    return next((list(view.names) for view in in_space), None)


def _axes(parts: Mapping[str, Any]) -> list[str]:
    """The plane that shows most at once: a slow variable across and a fast one up, or the first two states."""
    reduction = parts["reduction"]
    if not reduction["reason"]:
        return [reduction["slow"][0], reduction["fast"][0]]
    names = [*parts["quantities"], parts["quantities"][0]]
    return names[:2]


def _space(study: Study, parts: Mapping[str, Any], in_space: bool) -> dict[str, Any]:
    """The three quantities of the picture in space, where M0 is a surface, and the box in which it is drawn."""
    reduction = parts["reduction"]
    if not in_space or reduction["reason"] or len(reduction["slow"]) != 2:
        return {"space": None, "box": {}}
    # M0 is drawn beyond the region by half of its widths, so that folds beside it are seen.
    box = {n: (low - 0.5 * (high - low), high + 0.5 * (high - low)) for n, (low, high) in study.region.items()}
    return {"space": [*reduction["slow"], reduction["fast"][0]], "box": box}


def _told(scene: Scene) -> dict[str, Any]:
    """The story of a built-in scene as it is written; empty for any other scene, and for one that was changed."""
    if scene.name not in stories() or scene != _ready(models.load(scene.name)).scene:
        return {}
    return _document(scene.name)


def looks_of(scene: Scene) -> dict[str, Any]:
    """`axes`, `trace` and the `ranges` with which the demo of a built-in scene begins; empty for any other."""
    document = _told(scene)
    if not document:
        return {}
    held = {**document.get("frame", {}), **document.get("window", {})}
    ranges = {name: (float(low), float(high)) for name, (low, high) in held.items()}
    return {"axes": document["axes"], "trace": document["trace"], "ranges": ranges}


def body_of(scene: Scene) -> dict[str, Any] | None:
    """The body that moves along the path of a built-in scene, also at other parameters; None where there is none."""
    if scene.name not in stories():
        return None
    known = models.load(scene.name)
    if scene.path != known.path or scene.system.states != known.system.states:
        return None
    return body_in(_document(scene.name), scene)


def _document(name: str) -> dict[str, Any]:
    return parsed(files("gsp.demos").joinpath("stories", f"{name}.toml").read_text(encoding="utf-8"))


def _folds(study: Study, parts: Mapping[str, Any]) -> list[list[float | None]]:
    """Folds at the declared parameters, as rows of quantities, None where one is not known.

    They are those around the region where M0 is written over the slow variable; along a fast one the page finds them.
    """
    reduction = parts["reduction"]
    if reduction["reason"] or len(study.system.x) != 1:
        return []
    if any(place > 0 for label in ("", "Declared") for place in reduction.get(f"coordinates{label}", ())):
        return []
    try:
        found = surroundings(study)
    except (GspError, np.linalg.LinAlgError):
        return []
    if found is None:
        return []
    points: list[Mapping[str, float]] = [
        point.point for point in getattr(found, "special", ()) if point.kind.is_fold
    ]
    if study.splitting is not None:
        points = [{**point, **study.splitting.to_raw(point)} for point in points]
    return [[float(point[n]) if n in point else None for n in parts["quantities"]] for point in points]
