"""A folder of XPPAUT's files, read here and stepped by XPPAUT too: what is read must take the same steps.

    python -m tests.ode_collection FOLDER [FOLDER ...]

Collections of published models are, for instance, misc/xpp of github.com/matthiaskoenig/sbmlutils (from ModelDB) and
github.com/artielbm/artielbm.github.io. A file is counted once, whatever its name. What the reader refuses is counted by
its reason. A model gets a small parameter that changes nothing: one more state that decays. Quantities that XPPAUT
takes from the step before are put in order in the copy that XPPAUT runs, and it has no `set`, each a run of its own.
"""

from __future__ import annotations

import argparse
import hashlib
import re
import subprocess
import sys
import tempfile
from collections import defaultdict
from pathlib import Path

import numpy as np
import sympy as sp

import gsp
from gsp.errors import GspError
from gsp.readers.foreign import WORDS, imported
from gsp.readers.loading import text_of
from gsp.readers.toml import parsed, scene_of
from gsp.readers.xppaut import read_ode

PROBE, SMALL = "probe_of_the_collection", "epsilon_of_the_collection"
DT, STEPS = 1e-4, 4


def scene_of_file(text: str) -> tuple[gsp.Scene, list[str]]:
    """The scene of a file with the small parameter that changes nothing, and the notes on it."""
    model = read_ode(text)
    model.parameters[SMALL], model.small = "0.5", SMALL
    model.states[PROBE], model.starts[PROBE] = f"-{PROBE}/{SMALL}", "1"
    found, scene = imported(model, small=None, read=lambda draft: scene_of(parsed(draft), Path("file.ode")))
    return scene, found.notes


def ordered(text: str) -> str:
    """The text with every fixed quantity behind those that it uses."""
    joined = re.sub(r"\\[^\n]*\n", "", text)
    lines = joined.splitlines()
    heads = {}
    for i, line in enumerate(lines):
        found = re.match(r"\s*([A-Za-z]\w*) *=", line)
        if found:
            heads[found[1].lower()] = i
    if "[" in joined:
        return text
    done: dict[int, None] = {}
    begun: set[int] = set()

    def place(i: int) -> None:
        if i in begun:
            return
        begun.add(i)
        if i in heads.values():
            for word in WORDS.findall(lines[i].lower().partition("=")[2]):
                if word in heads:
                    place(heads[word])
        done[i] = None

    for i in range(len(lines)):
        place(i)
    return "\n".join(lines[i] for i in done) + "\n"


def theirs(text: str, count: int) -> np.ndarray | str:
    """XPPAUT's steps of Euler's method (STEPS + 1, count), or what it said."""
    plain = re.sub(r"(?im)^(?:\s*@|only\b|set\b)(?:[^\n\\]*\\[^\n]*\n)*[^\n]*$", "", text)
    begin = "".join(f",t0={value}" for value in re.findall(r"(?im)^@.*\bt0 *= *([-+.\de]+)", text))
    settings = f"@ meth=euler,dt={DT},total={DT * STEPS},trans=0,bound=1e30,nout=1,maxstor=100000{begin}\n"
    with tempfile.TemporaryDirectory() as folder:
        Path(folder, "model.ode").write_text(settings + plain, encoding="utf-8")
        try:
            done = subprocess.run(
                ["xppaut", "model.ode", "-silent"],
                cwd=folder, capture_output=True, text=True, errors="replace", timeout=30, check=False,
            )  # fmt: skip
        except subprocess.TimeoutExpired:
            return "no answer within 30 s"
        written = next(Path(folder).glob("*.dat"), None)
        if written is None or not written.stat().st_size:
            said = (done.stdout + done.stderr).strip().splitlines()
            return next(
                (line for line in said if re.search("(?i)error|illegal|duplicate|no var", line)), said[-1]
            )
        try:
            rows = np.loadtxt(written, ndmin=2)
        except ValueError:
            return "no numbers"
    return rows[:, 1 : 1 + count] if len(rows) == STEPS + 1 else f"{len(rows)} rows"


def ours(scene: gsp.Scene) -> np.ndarray:
    """The same steps of the scene's field, without the states that are not the file's."""
    system = scene.system
    values = {**system.parameters, system.epsilon: scene.epsilon}
    field = sp.lambdify(system.states, [rate.xreplace(values) for rate in system.rates], "numpy", cse=True)
    row = np.array([scene.start[state.name] for state in system.states])
    rows = [row]
    for _ in range(STEPS):
        with np.errstate(all="ignore"):
            row = row + DT * np.array(field(*row), dtype=float)
        rows.append(row)
    own = [i for i, state in enumerate(system.states) if state.name not in (PROBE, "t")]
    return np.array(rows)[:, own]


def judged(file: Path) -> tuple[str, str]:
    """What became of a file: refused, agrees, not run by XPPAUT, or differs; and why."""
    try:
        text = text_of(file, other_bytes=True)
        scene, _ = scene_of_file(text)
    except GspError as error:
        return "refused", re.sub(r"line \d+: ", "", str(error))[:80]
    mine = ours(scene)
    found = theirs(ordered(text), mine.shape[1])
    if isinstance(found, str):
        return "not run by XPPAUT", found[:80]
    if found.shape != mine.shape:
        return "differs", f"{found.shape[1]} states and {mine.shape[1]}"
    size = np.maximum(np.abs(found), np.abs(mine))
    # XPPAUT writes single precision, and its %g eight digits.
    gap = np.abs(found - mine) - 1e-6 * size - 1e-12
    if np.isfinite(found).all() and np.isfinite(mine).all() and gap.max() <= 0:
        return "agrees", ""
    if not np.isfinite(found).all() and not np.isfinite(mine).all():
        return "agrees", "both have no number"
    if not np.isfinite(found).all() or not np.isfinite(mine).all():
        return "differs", "one of the two has no number"
    return "differs", f"by {np.nanmax(gap / (size + 1e-12)):.2g} of state {int(np.nanargmax(gap.max(axis=0)))}"


def main() -> int:
    reader = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    reader.add_argument("folders", nargs="+", type=Path)
    chosen = reader.parse_args()
    seen: set[bytes] = set()
    counts: dict[tuple[str, str], list[str]] = defaultdict(list)
    for folder in chosen.folders:
        for file in sorted(folder.rglob("*.ode")):
            mark = hashlib.sha256(file.read_bytes()).digest()
            if mark not in seen:
                seen.add(mark)
                counts[verdict := judged(file)].append(str(file))
                print(*verdict, file.name, sep=" | ", file=sys.stderr, flush=True)
    for kind in ("agrees", "differs", "not run by XPPAUT", "refused"):
        found = {why: files for (what, why), files in counts.items() if what == kind}
        print(f"{sum(map(len, found.values()))} {kind}")
        for why, files in sorted(found.items(), key=lambda item: -len(item[1])):
            print(f"  {len(files):4d} {why or 'all steps'}   e.g. {Path(files[0]).name}")
    return int(any(what == "differs" for what, _ in counts))


if __name__ == "__main__":
    sys.exit(main())
