"""Ctrl-C: a verb that it comes in ends with it, whatever it is at, and leaves nothing behind."""

from __future__ import annotations

import ast
import gc
import inspect
import json
import os
import signal
import subprocess
import sys
import threading
from pathlib import Path

import numpy as np
import pytest
import sympy as sp

import gsp
from gsp.analysis.fold_surroundings import uninterrupted
from gsp.critical.continuation.curve_continuation import continue_critical
from gsp.errors import Status
from gsp.integration.crossings import Search
from gsp.integration.events import Event
from gsp.integration.methods import Method
from gsp.integration.trajectory import RunOptions, integrate, trajectory_of
from gsp.results import interrupts
from gsp.systems.system import SlowFastSystem, VectorField
from tests.cases import sampled, thinned
from tests.contracts import public

ROOT = Path(__file__).parent.parent.parent
x, y, epsilon = sp.symbols("x y epsilon")
OSCILLATOR = VectorField({x: y, y: -x}, epsilon=None)
pytestmark = pytest.mark.usefixtures("interruptible")

# `gsp` with Ctrl-C after so many seconds of the processor's time, in a fresh process each; 0 measures them only.
SERVER = """
import json, os, signal, sys, time
import gsp.cli

for name in gsp.__all__:
    getattr(gsp, name)

signal.signal(signal.SIGINT, signal.default_int_handler)
signal.signal(signal.SIGVTALRM, lambda number, frame: signal.raise_signal(signal.SIGINT))

def run(arguments, after):
    reader, writer = os.pipe()
    child = os.fork()
    if not child:
        sys.argv = ["gsp", *arguments]
        status, begun = None, time.process_time()
        try:
            try:
                signal.setitimer(signal.ITIMER_VIRTUAL, after)
                gsp.cli.main()
            except SystemExit as error:
                status = error.code
            finally:
                signal.setitimer(signal.ITIMER_VIRTUAL, 0)
        except KeyboardInterrupt:
            # Behind the end of the command, unless it has no status.
            pass
        finally:
            with os.fdopen(writer, "w") as stream:
                json.dump([status, time.process_time() - begun], stream)
            os._exit(0)
    os.close(writer)
    with os.fdopen(reader) as stream:
        found = json.load(stream)
    os.waitpid(child, 0)
    return found

for line in sys.stdin:
    print("\\n" + json.dumps(run(*json.loads(line))), flush=True)
"""


class Server:
    """`gsp` in forks of one process that has loaded everything; what it prints is dropped."""

    def __init__(self) -> None:
        self.process = subprocess.Popen(
            [sys.executable, "-c", SERVER], cwd=ROOT, text=True,
            stdin=subprocess.PIPE, stdout=subprocess.PIPE, stderr=subprocess.PIPE,
        )  # fmt: skip

    def run(self, *arguments: str, after: float = 0.0) -> tuple[int, float]:
        assert self.process.stdin is not None
        assert self.process.stdout is not None
        self.process.stdin.write(json.dumps([arguments, after]) + "\n")
        self.process.stdin.flush()
        for line in self.process.stdout:
            if line.startswith("["):
                try:
                    status, seconds = json.loads(line)
                except ValueError:
                    continue
                return status, seconds
        raise AssertionError("the server has ended")


@pytest.fixture(scope="module")
def server():
    if not hasattr(os, "fork"):
        pytest.skip("fresh processes are made by fork")
    one = Server()
    yield one
    one.process.kill()
    one.process.communicate()


def small(folder: Path) -> Path:
    """A model whose whole report takes a second or two."""
    path = folder / "small.toml"
    path.write_text(
        'name = "small"\n[slow]\nx = "-x"\n[fast]\ny = "x^2 - y"\n[region]\nx = [0.2, 1]\n[start]\nx = 1\ny = 0\n'
        "[scene]\nspan = [0, 1]\nepsilon = 0.02\ntolerance = 1e-3\n"
    )
    return path


def contents(folder: Path) -> dict[str, bytes]:
    return {str(p.relative_to(folder)): p.read_bytes() for p in folder.rglob("*") if p.is_file()}


VERBS = {
    "report": ("report", "-o", "out", "--order", "1"),
    "choose": ("choose",),
    "chart": ("chart", "--failures", "-o", "out.png", "--csv", "out.csv"),
}


# A whole run of the command each.
@pytest.mark.exhaustive
@pytest.mark.parametrize(("seed", "places"), [(5, 2), (6, 5)], ids=["sample", "more"])
@pytest.mark.parametrize("verb", VERBS)
def test_wherever_it_comes_the_command_ends_with_130_and_nothing_is_written(
    verb, seed, places, server, tmp_path
):
    model = small(tmp_path)
    name, *options = VERBS[verb]
    output = tmp_path / "out"
    arguments = [name, str(model), *(str(tmp_path / o) if o.startswith("out") else o for o in options)]
    if verb == "report":
        # An older report stays as it was.
        output.mkdir()
        (output / "report.html").write_text("older")
        (output / "mine.txt").write_text("mine")
    before = contents(tmp_path)
    status, seconds = server.run(*arguments)
    assert status == 0
    whole = contents(tmp_path)
    assert (verb == "choose") == (whole == before)

    def restore():
        for extra in set(whole) - set(before):
            (tmp_path / extra).unlink()
        if verb == "report":
            (output / "report.html").write_text("older")
        assert contents(tmp_path) == before

    restore()
    # One in each part of the run.
    for share in (0.9 / places * (np.arange(places) + np.random.default_rng(seed).random(places))).tolist():
        status, took = server.run(*arguments, after=share * seconds)
        while status == 0 and seconds > 1e-3:
            # It was quicker this time, as the first run compiles what is not on disk, and is whole.
            assert contents(tmp_path).keys() == whole.keys()
            restore()
            seconds = min(0.9 * seconds, took)
            status, took = server.run(*arguments, after=share * seconds)
        assert status == 130, share
        assert contents(tmp_path) == before, share


def half(call):
    """What `call(progress)` raises when Ctrl-C comes half way."""

    def interrupt(*shares):
        if max(s for s in shares if isinstance(s, float)) > 0.3:
            signal.raise_signal(signal.SIGINT)

    with pytest.raises(KeyboardInterrupt):
        call(interrupt)


def test_a_run_inside_a_verb_ends_the_verb_and_a_run_alone_is_kept():
    options = {"start": {"x": 1, "y": 0}, "span": (0, 20000), "rtol": 1e-6, "atol": 1e-6}
    half(lambda progress: trajectory_of(OSCILLATOR, options=RunOptions(progress=progress), **options))

    def interrupt(share):
        if share > 0.3:
            signal.raise_signal(signal.SIGINT)

    kept = integrate(OSCILLATOR, progress=interrupt, **options)
    assert kept.status is Status.INTERRUPTED
    assert 6000 < kept.t[-1] < 20000


def test_no_verb_takes_half_a_run_for_a_result():
    # `integrate` returns what was made until Ctrl-C came, which is for the user alone; verbs call `trajectory_of`.
    wrong = []
    for path in (ROOT / "gsp").rglob("*.py"):
        text = path.read_text()
        if path.name == "trajectory.py" or not ("integrate(" in text or "KeyboardInterrupt" in text):
            continue
        for node in ast.walk(ast.parse(text)):
            called = (
                isinstance(node, ast.Call) and isinstance(node.func, ast.Name) and node.func.id == "integrate"
            )
            caught = isinstance(node, ast.ExceptHandler) and "KeyboardInterrupt" in ast.unparse(
                node.type or node
            )
            if called or (caught and not path.as_posix().endswith(CATCHERS)):
                wrong.append((path.name, node.lineno))
    assert wrong == []


# Where Ctrl-C may be caught: runs, ensembles, continuations, searches and proofs that return what they made; a
# sweep, which says what goes on with it; the command line, and the import of the package before it.
CATCHERS = (
    "loop.py", "parallel.py", "arclength.py", "tracing.py", "covering.py", "certify.py", "slow_tube.py",
    "solved_tube.py", "special_values.py", "sweep.py", "gsp/__init__.py", "cli/__init__.py",
    "comparing.py", "program.py",
)  # fmt: skip


@pytest.mark.parametrize("at", sampled([0.1, 0.3, 0.5, 0.7, 0.9], always=[0.3]))
def test_an_interrupt_repeats_no_crossing(at, monkeypatch):
    # It comes while the crossings of a piece are being located. The last piece holds less than a tenth of the run, as
    # steps are short at a tight tolerance.
    options = {
        "start": {"x": 1, "y": 0},
        "span": (0, 1000),
        "rtol": 1e-12,
        "atol": 1e-12,
        "method": Method.RADAU9,
    }
    events = [Event("x"), Event("y")]
    whole = integrate(OSCILLATOR, events=events, **options)
    expected = {name: whole.events[name].times for name in ("x", "y")}
    count, limit, refined = 0, int(at * sum(map(len, expected.values()))), Search.refined

    def counted(self, *arguments):
        nonlocal count
        count += 1
        if count == limit:
            signal.raise_signal(signal.SIGINT)
        return refined(self, *arguments)

    monkeypatch.setattr(Search, "refined", counted)
    cut = integrate(OSCILLATOR, events=events, **options)
    assert cut.status is Status.INTERRUPTED
    assert 0.0 < cut.t[-1] < 1000.0
    for name, times in expected.items():
        reached = times[times <= cut.t[-1]]
        assert cut.events[name].times == pytest.approx(reached, abs=1e-12)
        assert len(reached) > 0


def test_an_interrupt_before_a_terminal_event_does_not_hide_it(monkeypatch):
    pieces, values = 0, Search.__call__

    def counted(self, *arguments):
        nonlocal pieces
        pieces += 1
        if pieces == 1:
            raise KeyboardInterrupt
        return values(self, *arguments)

    monkeypatch.setattr(Search, "__call__", counted)
    cut = integrate(OSCILLATOR, start={"x": 1, "y": 0}, span=(0, 20), events=Event("x", terminal=True))
    assert cut.status is Status.EVENT_REACHED
    assert cut.t[-1] == pytest.approx(np.pi / 2, abs=1e-7)


def test_a_continuation_inside_a_verb_ends_it():
    system = SlowFastSystem(slow={y: -x}, fast={x: y - x**3 / 3 + x}, epsilon=epsilon)

    def interrupt(share):
        raise KeyboardInterrupt

    curve = continue_critical(system, start={"x": 2, "y": 2 / 3}, bounds={"y": (-2, 2)}, progress=interrupt)
    with pytest.raises(KeyboardInterrupt):
        uninterrupted(curve)
    done = continue_critical(system, start={"x": 2, "y": 2 / 3}, bounds={"y": (-2, 2)})
    assert uninterrupted(done) is done


CONTRACTS = public("VERBS")
OF_SCENES = [
    name for name, contract in CONTRACTS.items()
    if "Study" in contract.takes and "progress" in inspect.signature(getattr(gsp, name)).parameters
]  # fmt: skip


@pytest.mark.parametrize("verb", thinned(OF_SCENES, 2))
def test_every_verb_of_a_scene_raises_it(verb, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    scene, options = gsp.load(small(tmp_path)), CONTRACTS[verb].right()
    half(lambda progress: getattr(gsp, verb)(scene, **options, progress=lambda *told: progress(told[-1])))


# An exception raised where Python drops it


class Finalised:
    def __del__(self):
        signal.raise_signal(signal.SIGINT)


@pytest.mark.filterwarnings("ignore::pytest.PytestUnraisableExceptionWarning")
def test_one_that_is_lost_in_a_finaliser_is_noticed():
    with interrupts.noticing() as check:
        check()
        one = Finalised()
        del one
        gc.collect()
        with pytest.raises(KeyboardInterrupt):
            check()
    assert signal.getsignal(signal.SIGINT) is signal.default_int_handler


def test_where_it_is_ignored_it_stays_so():
    before = signal.signal(signal.SIGINT, signal.SIG_IGN)
    try:
        with interrupts.noticing() as check:
            signal.raise_signal(signal.SIGINT)
            check()
            with interrupts.undisturbed():
                signal.raise_signal(signal.SIGINT)
        assert signal.getsignal(signal.SIGINT) is signal.SIG_IGN
    finally:
        signal.signal(signal.SIGINT, before)


def test_nothing_is_divided_while_it_is_dropped():
    with interrupts.undisturbed():
        signal.raise_signal(signal.SIGINT)
    assert signal.getsignal(signal.SIGINT) is signal.default_int_handler
    with pytest.raises(KeyboardInterrupt), interrupts.undisturbed():
        raise KeyboardInterrupt
    assert signal.getsignal(signal.SIGINT) is signal.default_int_handler


def test_other_threads_leave_the_handlers_alone():
    seen = []

    def other():
        with interrupts.noticing() as check, interrupts.undisturbed():
            check()
            seen.append(signal.getsignal(signal.SIGINT))

    thread = threading.Thread(target=other)
    thread.start()
    thread.join()
    assert seen == [signal.default_int_handler]


def test_a_command_started_with_it_ignored_goes_on(tmp_path):
    # As nohup and scripts start it: the signal comes at once, and nothing happens.
    line = (
        "import signal, sys; signal.signal(signal.SIGINT, signal.SIG_IGN); sys.argv = ['gsp', 'models'];"
        "from gsp.cli import main; signal.raise_signal(signal.SIGINT); main()"
    )
    done = subprocess.run([sys.executable, "-c", line], capture_output=True, text=True, cwd=ROOT)
    assert done.returncode == 0
    assert "van_der_pol" in done.stdout


@pytest.mark.parametrize(("begins", "status"), [("signal.raise_signal(signal.SIGINT)", 130), ("pass", 70)])
def test_one_that_comes_out_as_an_error_ends_the_command_as_an_interrupt(begins: str, status: int) -> None:
    # As where a compiled module is being imported: its error says that its initialisation failed.
    lines = [
        "import signal, sys; signal.signal(signal.SIGINT, signal.default_int_handler)",
        "import gsp.cli, gsp.models",
        "def summary():",
        "    try:",
        f"        {begins}",
        "    except KeyboardInterrupt:",
        "        pass",
        "    raise ImportError('initialization failed')",
        "gsp.models.summary = summary; sys.argv = ['gsp', 'models']; gsp.cli.main()",
    ]
    done = subprocess.run([sys.executable, "-c", "\n".join(lines)], capture_output=True, text=True, cwd=ROOT)
    assert done.returncode == status
    assert ("interrupted; nothing was written" in done.stderr) == (status == 130)
