"""Systems from the literature: the command line ends well on each, and what it says of them is so.

The first correction h_1 is derived here once more from its definition, in plain SymPy from the text of the file and
at points in 40 digits; nothing of the package takes part in it.
"""

import itertools
import re
import subprocess
import sys
import tomllib

import mpmath
import numpy as np
import pytest
import sympy as sp
from scipy.optimize import brentq

from gsp import load
from gsp.analysis.fold_surroundings import surroundings
from gsp.critical.loss_kind import LossKind
from gsp.errors import BudgetError, Status
from gsp.scenes.study import study_of
from gsp.slow.series import expand
from gsp.slow.slow_points import zero_derivative
from tests.literature import FOLDER, VERBS, Ending, systems, tasks

# Slow coordinates of the files that give a raw field: what each raw state is in new ones, slow ones by their
# definition, and the fast one. Derived by hand: the fast reactions leave the slow ones alone.
COORDINATES = {
    "two_pool": ({"p": "Y + Z"}, {"Y": "p - Z"}, ["Z"]),
    "brusselator": ({"p": "x + y"}, {"y": "p - x"}, ["x"]),
    "enzyme_states": ({"p1": "s + c", "p2": "e + c"}, {"e": "p2 - p1 + s", "c": "p1 - s"}, ["s"]),
    "goldbeter_circadian": (
        {"M": "M", "P0": "P0", "P1": "P1", "p": "P2 + PN"},
        {"PN": "p - P2"},
        ["P2"],
    ),
    "battery": ({"soc": "soc", "v2": "v2"}, {}, ["v1"]),
    "icealbedo": ({"To": "To"}, {}, ["Ta"]),
    "gene_dimers": ({"p": "P + 2*D"}, {"D": "(p - P)/2"}, ["M", "P"]),
    "gene_dimers_from_nothing": ({"p": "P + 2*D"}, {"D": "(p - P)/2"}, ["M", "P"]),
    "swing": ({"delta": "delta", "w": "w", "Eq": "Eq"}, {}, ["Efd"]),
    "swing_bal": ({"delta": "delta", "w": "w", "Eq": "Eq"}, {}, ["Efd"]),
    "swing_rad": ({"delta": "delta", "w": "w", "Eq": "Eq"}, {}, ["Efd"]),
    "tmdd": ({"p1": "L + P", "p2": "P + R"}, {"P": "p1 - L", "R": "L - p1 + p2"}, ["L"]),
    "sirs": (
        {"p1": "s + i + r", "p2": "s*exp(2*r)"},
        {"s": "p2*exp(-2*r)", "i": "p1 - r - p2*exp(-2*r)"},
        ["r"],
    ),
}


def expressions(name):
    """Rates of slow and fast variables by name, with parameters put in, from the text of the file."""
    document = tomllib.loads((FOLDER / f"{name}.toml").read_text(), parse_float=sp.Rational)
    tables = ("parameters", "definitions", "slow", "fast", "states")
    small = document.get("epsilon", "epsilon")
    names = {small, *(key for table in tables for key in document.get(table, {}))}
    symbols = {f"{key}_": sp.Symbol(key) for key in names} | {"min": sp.Min, "max": sp.Max}

    def read(text):
        words = re.sub(r"[A-Za-z]\w*", lambda m: f"{m[0]}_" if m[0] in names else m[0], str(text))
        found = sp.sympify(words.replace("^", "**"), locals=symbols, rational=True)
        return found.subs(sp.Symbol(small), sp.Symbol("epsilon"))

    values = {sp.Symbol(key): read(value) for key, value in document.get("parameters", {}).items()}
    defined = {sp.Symbol(key): read(value) for key, value in document.get("definitions", {}).items()}
    for _ in defined:
        values |= {s: value.subs(values) for s, value in defined.items()}
    rates = {
        table: {key: read(value).subs(values) for key, value in document.get(table, {}).items()}
        for table in ("slow", "fast", "states")
    }
    return rates, document


def slow_and_fast(name):
    """(f, g, start): slow and fast rates by name, g of epsilon y' = g, and the start in these coordinates."""
    rates, document = expressions(name)
    start = {key: sp.sympify(value, rational=True) for key, value in document["start"].items()}
    if not rates["states"]:
        return rates["slow"], rates["fast"], start
    new, old, fast = COORDINATES[name]
    raw = {sp.Symbol(key): rate for key, rate in rates["states"].items()}
    back = {sp.Symbol(key): sp.sympify(text) for key, text in old.items()}
    definitions = {key: sp.sympify(text, locals={s.name: s for s in raw}) for key, text in new.items()}
    f = {
        key: (
            sp.cancel(sp.together(sum(e.diff(z) * rate for z, rate in raw.items())))
            if back
            else raw[sp.Symbol(key)]
        ).subs(back)
        for key, e in definitions.items()
    }
    g = {key: sp.expand(sp.Symbol("epsilon") * raw[sp.Symbol(key)]).subs(back) for key in fast}
    values = {sp.Symbol(key): value for key, value in start.items()}
    return (
        f,
        g,
        {**{key: e.subs(values) for key, e in definitions.items()}, **{key: start[key] for key in fast}},
    )


# Where the layer from the start lands, when Newton's method goes elsewhere from there.
SHEETS = {"npz": {"P": 5.6}}


def first_correction(name, share):
    """(x, h_0(x), h_1(x)) at the point over `share` of the way from the start to the middle of the region."""
    f, g, start = slow_and_fast(name)
    x, y, epsilon = [sp.Symbol(key) for key in f], [sp.Symbol(key) for key in g], sp.Symbol("epsilon")
    F, G = sp.Matrix(list(f.values())), sp.Matrix(list(g.values()))
    at_zero = {epsilon: 0}
    parts = (F, G, G.jacobian(x), G.jacobian(y), G.diff(epsilon))
    functions = [sp.lambdify([*x, *y], part.subs(at_zero), "mpmath") for part in parts]
    region = tomllib.loads((FOLDER / f"{name}.toml").read_text())["region"]
    with mpmath.workdps(40):
        first = [mpmath.mpf(str(sp.N(start[s.name], 40))) for s in x]
        last = [
            sum(mpmath.mpf(v) for v in region[s.name]) / 2 if s.name in region else value
            for s, value in zip(x, first)
        ]
        near = start | SHEETS.get(name, {})
        root = mpmath.matrix([mpmath.mpf(str(sp.N(near[s.name], 40))) for s in y])
        # Followed in small steps: Newton's method must stay on the sheet of the start.
        for step in range(11):
            point = [a + (b - a) * share * step / 10 for a, b in zip(first, last)]
            root = mpmath.findroot(
                lambda *v, point=point: list(functions[1](*point, *v)), list(root), tol=1e-50, maxsteps=60
            )
            root = root if isinstance(root, mpmath.matrix) else mpmath.matrix([root])
        at_root = [*point, *root]
        rates, _, gx, gy, ge = (function(*at_root) for function in functions)
        Dh = -mpmath.lu_solve(gy, gx) if len(y) == 1 and len(x) == 1 else -(gy**-1) * gx
        h1 = gy**-1 * (Dh * rates - ge)
        return [float(v) for v in point], [float(v) for v in root], [float(v) for v in h1]


# The series is beyond the budget even with numbers (channel rates to the fourth power): `expand` refuses it by name,
# and the points of the slow manifold show h_1.
BEYOND_THE_BUDGET = ("chay", "plant")


@pytest.mark.exhaustive
@pytest.mark.parametrize("name", [name for name in systems() if name not in BEYOND_THE_BUDGET])
def test_the_first_correction_is_the_one_of_its_definition(name):
    series = expand(study_of(load(FOLDER / f"{name}.toml")).branch, order=1, symbolic=False)
    for share in (0, 0.5):
        x, h0, h1 = first_correction(name, share)
        got = series.terms([x], 1.0, near=[h0] if not series.branch.is_explicit else None)[0]
        assert got[0] == pytest.approx(h0, rel=1e-9, abs=1e-12)
        assert got[1] == pytest.approx(h1, rel=1e-8, abs=1e-11 * max(map(abs, h0)) + 1e-13)


@pytest.mark.exhaustive
@pytest.mark.parametrize("name", BEYOND_THE_BUDGET)
def test_where_the_series_is_a_program_it_and_the_points_of_the_manifold_show_the_first_correction(name):
    study = study_of(load(FOLDER / f"{name}.toml"))
    branch = study.branch
    with pytest.raises(BudgetError, match=r"order 1 was reached through order 0.*solve_manifold"):
        study.series(1, symbolic=False)
    series = expand(branch, order=1, symbolic=False)
    assert series.is_program
    x, h0, h1 = first_correction(name, 0.5)
    got = series.terms([x], 1.0, near=[h0] if not branch.is_explicit else None)[0]
    assert got[1] == pytest.approx(h1, rel=1e-8, abs=1e-11 * max(map(abs, h0)) + 1e-13)
    found = []
    for small in (1e-5, 5e-6):
        points = zero_derivative(branch, [x], epsilon=small, near=[h0])
        assert points.status is Status.SUCCESS
        found.append((points.y[0] - h0) / small)
    # The next term is linear in epsilon.
    assert 2 * found[1] - found[0] == pytest.approx(h1, rel=1e-5, abs=1e-8)


def folds_by_scanning(name):
    """Folds (x, y) of one slow over one fast variable where g is linear in the slow one: extrema of x = X(y).

    Those on the piece through the start that stays in the box around the region, whose walls are one and a half of
    its widths away, as the command line has it.
    """
    f, g, start = slow_and_fast(name)
    ((slow,), (fast,)) = ([sp.Symbol(key) for key in side] for side in (f, g))
    over = sp.numer(sp.together(g[fast.name].subs(sp.Symbol("epsilon"), 0)))
    constant, slope = over.subs(slow, 0), over.diff(slow)
    assert slow not in slope.free_symbols
    region = tomllib.loads((FOLDER / f"{name}.toml").read_text())["region"]
    walls = {
        key: (low - 1.5 * (high - low), high + 1.5 * (high - low))
        for key, (low, high) in ((s.name, map(float, region[s.name])) for s in (slow, fast))
    }
    X = sp.lambdify(fast, -constant / slope, "mpmath")
    dX = sp.lambdify(fast, sp.diff(-constant / slope, fast), "mpmath")
    bottom, top = walls[fast.name]
    found = []
    first = float(start[fast.name])
    for wall in (bottom, top):
        line = np.linspace(first, wall, 4001)
        for a, b in itertools.pairwise(line):
            if not walls[slow.name][0] <= X(b) <= walls[slow.name][1]:
                break
            if dX(a) != 0 and dX(a) * dX(b) <= 0:
                y = brentq(lambda y: float(dX(y)), a, b, xtol=1e-15)
                found.append((float(X(y)), y))
    return sorted(found)


# Written down from the sources or by hand; scanned once more below. (slow, fast) of each fold.
KNOWN_FOLDS = {
    "tunnel_diode": None,
    "truscott_brindley": None,
    "chemostat": [],
    "thermal_explosion": [(1 - 4 / np.e, 1.0)],
    "rosenzweig_macarthur": [(0.390625, 0.375)],
    "bazykin": [(0.4225, 0.35)],
    "holling_tanner": [(0.3025, 0.45)],
    "selkov": [(-2.5, -0.2), (2.5, 0.2)],
    "autocatalator": [(-0.5, -1.0), (0.5, 1.0)],
}


@pytest.mark.exhaustive
@pytest.mark.parametrize("name", KNOWN_FOLDS)
def test_folds_are_where_a_scan_of_the_equation_and_the_source_have_them(name):
    scanned = folds_by_scanning(name)
    if KNOWN_FOLDS[name] is not None:
        assert scanned == [pytest.approx(fold) for fold in sorted(KNOWN_FOLDS[name])]
    found = surroundings(study_of(load(FOLDER / f"{name}.toml")))
    assert found is not None
    folds = [tuple(p.point.values()) for p in found.special if p.kind is LossKind.FOLD]
    assert sorted(folds) == [pytest.approx(fold, rel=1e-7) for fold in scanned]


@pytest.mark.parametrize(
    "words",
    [
        pytest.param(("selkov", "check", "expand"), marks=pytest.mark.exhaustive),
        pytest.param(
            ("selkov", "hindmarsh_rose", "brusselator", "check", "expand", "folds", "choose"),
            marks=pytest.mark.exhaustive,
        ),
        pytest.param(("selkov", "report"), marks=pytest.mark.exhaustive),
    ],
)
def test_the_command_line_ends_with_a_result_or_a_reason(words):
    # In a process of its own: what runs the verbs is forked from it, which no process with threads should be.
    done = subprocess.run(
        [sys.executable, "-m", "tests.literature", "--processes", "2", *words],
        cwd=FOLDER.parent.parent,
        capture_output=True,
        text=True,
    )
    assert done.returncode == 0, done.stdout + done.stderr


def test_a_sample_of_the_systems_is_the_same_for_every_verb_and_named_by_its_rule():
    asked = tasks(["report", "check"], every=5)
    assert [name for name, verb in asked if verb == "report"] == systems()[::5]
    assert [name for name, verb in asked if verb == "check"] == systems()[::5]
    assert len(tasks([], every=1)) == len(systems()) * len(VERBS)
    assert tasks(["selkov", "folds"], every=1) == [("selkov", "folds")]


def ending(**changes):
    values = {"status": 0, "output": "attracting\n", "errors": "", "seconds": 1.0, "memory": 2**28}
    return Ending("selkov", "check", **{**values, **changes})


@pytest.mark.parametrize(
    ("changes", "complaint"),
    [
        ({}, ""),
        ({"status": 1}, ""),
        ({"status": 2, "output": "", "errors": "gsp: the region gives no interval for x. Bound x."}, ""),
        ({"status": 2, "output": "", "errors": "gsp: no"}, "refused without a reason"),
        ({"status": -24}, "status -24"),
        ({"status": 70}, "status 70"),
        ({"errors": "Traceback (most recent call last):"}, "traceback"),
        ({"output": ""}, "printed nothing"),
        ({"seconds": 61.0}, "61 s"),
        ({"memory": 2**31}, "2048 MB"),
    ],
)
def test_an_ending_is_a_result_or_a_refusal_within_bounds(changes, complaint):
    got = ending(**changes).complaint
    assert complaint in got
    assert bool(got) == bool(complaint)
