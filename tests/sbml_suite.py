"""The SBML Test Suite's semantic cases, run here and compared with its results within its tolerances.

    python -m tests.sbml_suite FOLDER [--only 00870,00871] [--every-level]

FOLDER holds the cases, `cases/semantic` of github.com/sbmlteam/sbml-test-suite. What the importer refuses is counted by
its reason; what it reads must agree. A model without fast reactions gets a small parameter that changes nothing: one
more state that decays. A model with some is run as its reduced flow at order 0, from the base point of its start.
"""

from __future__ import annotations

import argparse
import csv
import re
import sys
from collections import Counter
from collections.abc import Iterator
from pathlib import Path

import libsbml
import numpy as np

import gsp
from gsp.errors import GspError, ModelFileError
from gsp.readers.foreign import ForeignModel, imported
from gsp.readers.sbml import read_sbml
from gsp.readers.toml import parsed, scene_of

PROBE, SMALL = "probe_of_the_suite", "epsilon_of_the_suite"


def settings_of(case: Path) -> dict[str, str]:
    lines = (case / f"{case.name}-settings.txt").read_text().splitlines()
    return {
        key.strip(): value.strip() for key, _, value in (line.partition(":") for line in lines) if key.strip()
    }


def results_of(case: Path) -> dict[str, np.ndarray]:
    with (case / f"{case.name}-results.csv").open() as stream:
        rows = [row for row in csv.reader(stream) if row]
    names = [name.strip() for name in rows[0]]
    columns = np.array([[float(cell) for cell in row] for row in rows[1:]]).T
    return dict(zip(names, columns))


def scene_with(model: ForeignModel, span: tuple[float, float], wanted: list[str]) -> gsp.Scene:
    """The scene of a model over `span`, with observables for all that is wanted."""
    for name in wanted:
        if name in model.definitions and name not in model.observables:
            model.observables[f"{name}_of_the_suite"] = name
    if model.small is None:
        model.parameters[SMALL], model.small = "0.5", SMALL
        model.states[PROBE], model.starts[PROBE] = f"-{PROBE}/{SMALL}", "1"
    model.total = repr(span[1])
    return imported(model, small=None, read=lambda text: scene_of(parsed(text), Path("case.sbml")))[1]


def values(scene: gsp.Scene, found: gsp.Trajectory, name: str, count: int) -> np.ndarray:
    for key in (name, f"{name}_of_the_suite"):
        try:
            return found[key]
        except GspError:
            continue
    fixed = {symbol.name: float(value) for symbol, value in scene.system.parameters.items()}
    return np.full(count, fixed[name])


def run(scene: gsp.Scene, times: np.ndarray, tolerances: tuple[float, float]) -> gsp.Trajectory:
    rtol, atol = tolerances
    if scene.system.epsilon.name == SMALL:
        for method in (None, gsp.Method.DOP853):
            found = gsp.integrate(
                scene.full_flow, start=scene.full_start, span=(times[0], times[-1]), epsilon=scene.epsilon,
                at=times, rtol=rtol, atol=atol, method=method,
            )  # fmt: skip
            # A root of a species that is not there yet has no slope; the message names the other method.
            if found.status is not gsp.Status.SINGULAR_JACOBIAN:
                return found
    # The limit of fast reactions is the branch that attracts, on either side of which the start may lie.
    study = gsp.study(scene)
    slow = {x.name for x in study.system.x}
    here = {name: (study.start[name] - 1e-6, study.start[name] + 1e-6) for name in slow}
    branch = next(
        branch
        for branch in (study.branch, *study.critical.branches)
        if gsp.classify(branch, region=here, epsilon=scene.epsilon).kind == "attracting"
    )
    manifold = gsp.expand(branch, order=0)
    return gsp.integrate(
        gsp.restrict(manifold), start=gsp.project(manifold, study.start, epsilon=1e-100, order=0),
        span=(times[0], times[-1]), epsilon=1e-100, at=times, rtol=rtol, atol=atol,
    )  # fmt: skip


def compare(case: Path, text: str) -> float:
    """The largest error in units of the case's tolerance."""
    settings, expected = settings_of(case), results_of(case)
    wanted = [name.strip() for name in settings["variables"].split(",") if name.strip()]
    model = read_sbml(text)
    source = libsbml.readSBMLFromString(text)
    species = {s.getIdAttribute(): s for s in source.getModel().getListOfSpecies()}
    compartments = {c.getIdAttribute(): c for c in source.getModel().getListOfCompartments()}
    times = expected.get("time", expected.get("Time"))
    assert times is not None
    sizes = [s.getCompartment() for s in species.values()]
    scene = scene_with(model, (float(times[0]), float(times[-1])), [*wanted, *sizes])
    rtol, atol = float(settings["relative"]), float(settings["absolute"])
    found = run(scene, times, (min(1e-9, rtol / 100), min(1e-12, atol / 100)))
    if found.t.size != times.size:
        raise AssertionError(found.message)
    amounts = {name.strip() for name in settings.get("amount", "").split(",")}
    worst = 0.0
    for name in wanted:
        ours = values(scene, found, name, times.size)
        if name in species:
            kind = species[name]
            place = compartments[kind.getCompartment()]
            is_concentration = not kind.getHasOnlySubstanceUnits() and place.getSpatialDimensionsAsDouble() != 0
            size = (
                values(scene, found, kind.getCompartment(), times.size) if place.getSpatialDimensions() else 1.0
            )
            if (name in amounts) != (not is_concentration):
                ours = ours * size if is_concentration else ours / size
        theirs = expected[name]
        worst = max(worst, float(np.max(np.abs(ours - theirs) / (atol + rtol * np.abs(theirs)))))
    return worst


def files_of(case: Path, every_level: bool) -> Iterator[Path]:
    files = sorted(case.glob("*-sbml-l*.xml"), reverse=True)
    fast = [file for file in files if 'fast="true"' in file.read_text()]
    # Of a case about fast reactions one file, 01399 at level 2 version 5, has none.
    yield from (fast or files) if every_level else (fast or files)[:1]


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("folder", type=Path)
    parser.add_argument("--only", default="", help="numbers of cases, separated by commas")
    parser.add_argument("--part", default="0/1", help="k/n: every nth case from the kth")
    parser.add_argument(
        "--every-level", action="store_true", help="all files of a case, not the newest level alone"
    )
    options = parser.parse_args()
    only = set(options.only.split(",")) - {""}
    k, n = map(int, options.part.split("/"))
    counts: Counter[str] = Counter()
    refused: Counter[str] = Counter()
    cases = sorted(path for path in options.folder.iterdir() if path.is_dir())
    for case in cases[k::n]:
        if only and case.name not in only:
            continue
        for file in files_of(case, options.every_level):
            text = file.read_text()
            try:
                read_sbml(text)
            except ModelFileError as error:
                counts["refused"] += 1
                refused[re.sub(r"^line \d+: |\b[\w']*\d\w*", "", str(error))[:90]] += 1
                continue
            try:
                worst = compare(case, text)
            except Exception as error:
                counts["failed"] += 1
                print(f"{file.name}: {type(error).__name__}: {' '.join(str(error).split())[:300]}", flush=True)
                continue
            if worst <= 1.0:
                counts["agree"] += 1
            else:
                counts["disagree"] += 1
                print(f"{file.name}: {worst:.3g} tolerances off", flush=True)
    for reason, count in refused.most_common():
        print(f"{count:5} refused: {reason}")
    print(", ".join(f"{count} {what}" for what, count in sorted(counts.items())))
    return 0 if not counts["failed"] and not counts["disagree"] else 1


if __name__ == "__main__":
    sys.exit(main())
