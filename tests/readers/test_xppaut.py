"""XPPAUT's files: what is understood says the same as XPPAUT, and what is not is refused with its line."""

from __future__ import annotations

import contextlib
import math
import re
import shutil
import subprocess
import tomllib
from pathlib import Path

import numpy as np
import pytest
import sympy as sp

import gsp
from gsp.errors import ModelFileError
from gsp.readers.foreign import imported
from gsp.readers.loading import import_model
from gsp.readers.toml import parsed, scene_of
from gsp.readers.xppaut import read_ode
from gsp.scenes.settings import ask_again
from gsp.scenes.study import study_of
from tests import xppaut

FILES = sorted((Path(__file__).parent / "xppaut").glob("*.ode"))
SMALL = {"hindmarsh_rose": "r", "morris_lecar": "epsilon"}
DT, STEPS = 1e-3, 5

MODEL = """
par a=0.5, eps=.01
init x=2,Y=0.1
{line}
dx/dt = (y - x^3/3 + x)/eps
Y' = a - x
@ total=10, xp=x, yp=y, xlo=-3, xhi=3, ylo=-2, yhi=2
done
what stands behind done is not read
"""


def read(folder: Path, line: str = "") -> gsp.Scene:
    path = folder / "model.ode"
    path.write_text(MODEL.format(line=line))
    return gsp.load(path)


def test_a_file_is_a_scene(tmp_path: Path) -> None:
    scene = read(tmp_path, "cub(x)=x^3 \\\n  - half\n!half=a/2\naux speed=y-cub(x)\naux X=2*x")
    x, y, a, eps = sp.symbols("x y a eps")
    assert dict(zip(scene.system.states, scene.system.rates)) == {x: (y - x**3 / 3 + x) / eps, y: a - x}
    watched = {s.name: e for s, e in scene.system.observables.items()}
    assert sp.expand(watched.pop("speed") - (y - x**3 + a / 2)) == 0
    assert list(watched.values()) == [2 * x]
    assert (scene.epsilon, scene.span, scene.path) == (0.01, (0.0, 10.0), ("x", "y"))
    assert dict(scene.start) == {"x": 2.0, "y": 0.1}
    assert dict(scene.region) == {"x": (-3.0, 3.0), "y": (-2.0, 2.0)}
    assert "renamed" in scene.description


def test_time_stays_the_files_own_where_no_rate_has_a_pole() -> None:
    path = next(file for file in FILES if file.stem == "fitzhugh_nagumo")
    scene = gsp.load(path)
    v, w, a, b, eps = sp.symbols("v w a b eps")
    assert sp.expand(scene.system.rates[1] - eps * (v + a - b * w)) == 0
    assert sp.expand(scene.system.rates[0] - (v - v**3 / 3 - w + sp.Symbol("i"))) == 0
    # At any epsilon: 200 of the file's time are 16 of the slow one at 0.08, and 2 at 0.01.
    assert scene.span == (0.0, 200.0)
    assert study_of(scene).scene.span == (0.0, 16.0)
    assert study_of(ask_again(scene, epsilon=0.01)).scene.span == (0.0, 2.0)
    # A guess about a fast state would choose a sheet.
    assert dict(scene.region) == {"w": (-2.0, 1.0)}


@pytest.mark.parametrize(
    ("line", "words"),
    [
        ("global 1 x {y=0}", "line 4: global is an event"),
        ("table w % 10 0 1 t\nz'=w(x)", "line 4: table is a table"),
        ("markov z 2", "line 4: markov"),
        ("wiener n\nz'=n", "line 4: wiener is noise"),
        ("volt u=int{x}", "line 4: volt is an integral equation"),
        ("u(t+1)=2", "line 4: a difference or integral equation"),
        ("@ total=9, METH=Discrete", "line 4: meth=discrete makes a map of the rates"),
        ("@ method=0", "line 4: method=0 makes a map of the rates"),
        ("f (u) = u^2\nz'=f(x)", "line 4: XPPAUT passes over 'f (u) = u^2', and a rate uses f"),
        ("special k=conv(even,5,2,w,x)", "line 4: special"),
        ("#include other.ode", "line 4: #include is another file"),
        ("z'=delay(x,2)", "line 4: delay is a delay"),
        ("z'=ran(1)", "line 4: ran is noise"),
        ("z'=x+1>2", "line 4: 'x + 1 > 2' reads differently in XPPAUT"),
        ("z'=x&y+1", "line 4: 'x & y + 1' has & or |"),
        ("z'=(x>1)*2&heav(y-1)", "line 4: '(x>1) * 2 & heav(y-1)' has & or |"),
        ("z'=heav(x-1)+1>2", "line 4: 'heav(x-1) + 1 > 2' reads differently"),
        ("z'=if(x>1)then(1)", "line 4: if is written if(condition)then(value)else(value)"),
        ("z'=2^x^2", "line 4: a power of a power"),
        ("z'=(1+x)^x^2", "line 4: a power of a power"),
        ("z'=x^(1+x)^2", "line 4: a power of a power"),
        ("z'=2^exp(x)^2", "line 4: a power of a power"),
        ("x'=1", "line 5: x has two rates"),
        ("par b=exp(1)", "line 4: 'b=exp(1)' is not a parameter"),
        ("f(u)=u\nf(u)=2*u", "line 5: f is defined twice"),
        ("nonsense here", "line 4: 'nonsense here' is not understood"),
        ("%z'=1", 'line 4: "%z\'=1" is no comment'),
        ("z)=1", "line 4: 'z)=1' is not understood"),
        ("par q(0)=1", "line 4: 'q(0)=1' is not a parameter"),
        ("number a=2", "line 4: the parameter a is given twice"),
        ("!k=m\n!m=2", "line 4: !k uses !m, which stands below it"),
        ("0= x-y", "line 4: an equation without a name"),
        ("init q=1", "q has an initial value and no rate"),
        ("z'=nobody", '"nobody" is not declared'),
        ("z'=__import__('os')", "line 4"),
        ("z'=9^9999", "too large"),
    ],
)
def test_what_is_not_read_is_refused_by_name(tmp_path: Path, line: str, words: str) -> None:
    with pytest.raises(ModelFileError) as caught:
        read(tmp_path, line)
    message = str(caught.value)
    assert message.startswith("model.ode: ")
    assert words in message or (words == "line 4" and "means nothing" in message), message


@pytest.mark.parametrize(
    ("method", "flows"), [("discrete", False), ("f", False), ("gear", True), ("5dp", True)]
)
def test_a_method_that_xppaut_iterates_as_a_map_is_refused(method: str, flows: bool) -> None:
    """x' = 3 x (1 - x) from 0.2 takes a map to 0.48 in a step."""
    text = f"x'=3*x*(1-x)\ninit x=.2\n@ meth={method},total=1,nout=1\n"
    rows, _ = xppaut.run(text)
    assert (abs(rows[1, 1] - 0.48) > 0.01) == flows
    with contextlib.nullcontext() if flows else pytest.raises(ModelFileError, match="a map of the rates"):
        read_ode(text)


@pytest.mark.parametrize(
    ("axes", "shown"), [("", ("x", "y")), (", axes=3", ("x", "y", "z")), (", axes=2", ("x", "y"))]
)
def test_a_view_is_in_space_where_the_axes_are_three(axes: str, shown: tuple[str, ...]) -> None:
    model = read_ode(f"x'=-x/eps\ny'=z\nz'=x\npar eps=.1\n@ xp=x,yp=y,zp=z{axes}\ndone\n")
    assert model.views["plot"][0] == shown


@pytest.mark.parametrize(
    ("line", "words"),
    [
        ("z'=" + "(" * 60_000 + "x" + ")^" * 60_000, "characters; 10000 are allowed"),
        ("z'=" + "[" * 200_000, "line 4"),
        ("z(" + " " * 200_000 + "z", "not understood"),
        ("z'=x+\\\n" * 30_000, "continued line is longer"),
        ("\n".join(f"f{i}(x,y)=x*y" for i in range(4500)), "more than 4000 names"),
        ("z'=" + "((((x^9)^9)^9)^9)", "total degree"),
        ("par " + "a" * 100_000, "is not a parameter"),
        ("g(x)=h(x)\nh(x)=g(x)", "circle"),
        ("z'=x.__class__", "means nothing"),
        ("\0" * 50, "not understood"),
        ("x" * 250_000 + "'=1", "not understood"),
    ],
    ids=range(11),
)
def test_a_hostile_file_is_refused_in_a_sentence(tmp_path: Path, line: str, words: str) -> None:
    with pytest.raises(ModelFileError) as caught:
        read(tmp_path, line)
    assert words in str(caught.value)
    assert len(str(caught.value)) < 900


def test_a_file_without_a_small_parameter_is_a_model_without_one(tmp_path: Path) -> None:
    path = next(file for file in FILES if file.stem == "hindmarsh_rose")
    scene = gsp.load(path)
    assert scene.epsilon is None
    assert {s.name: float(v) for s, v in scene.system.parameters.items()}["r"] == 0.006
    text = import_model(path, small="r").text
    assert tomllib.loads(text)["scene"]["epsilon"] == ".006"
    with pytest.raises(ModelFileError, match="no parameter 'q'"):
        import_model(path, small="q")


def euler(scene: gsp.Scene, *, scale: float) -> np.ndarray:
    """Steps (STEPS + 1, n) of Euler's method, of size DT in the file's time."""
    system = scene.system
    values = {**system.parameters, system.epsilon: scene.epsilon}
    names = system.states
    field = sp.lambdify(names, [rate.xreplace(values) for rate in system.rates], "numpy")
    rows = [np.array([scene.start[name.name] for name in names])]
    for _ in range(STEPS):
        rows.append(rows[-1] + DT * scale * np.array(field(*rows[-1]), dtype=float))
    return np.array(rows)


@pytest.mark.exhaustive
@pytest.mark.parametrize("path", FILES, ids=lambda path: path.stem)
def test_right_hand_sides_are_those_of_xppaut(path: Path, tmp_path: Path) -> None:
    if shutil.which("xppaut") is None:
        pytest.skip("xppaut is not installed")
    text = re.sub(r"(?m)^(@|set ).*$", "", path.read_text())
    setting = f"@ meth=euler,dt={DT},total={DT * STEPS},trans=0,bound=1e6,nout=1\n"
    copy = tmp_path / path.name
    copy.write_text(re.sub(r"(?m)^(done|d)$", lambda match: setting + match[0], text))
    subprocess.run(["xppaut", copy.name, "-silent"], cwd=tmp_path, capture_output=True, timeout=60, check=False)
    theirs = np.loadtxt(tmp_path / "output.dat")
    model = tmp_path / "model.toml"
    found = import_model(path, small=SMALL.get(path.stem, "eps"))
    model.write_text(found.text)
    scene = gsp.load(model)
    scale = scene.epsilon if any("fast one" in note for note in found.notes) else 1.0
    ours = euler(scene, scale=scale)
    names = [state.name for state in scene.system.states if state.name != "t"]
    assert theirs.shape[0] == STEPS + 1
    np.testing.assert_allclose(theirs[:, 1 : 1 + len(names)], ours[:, : len(names)], rtol=3e-7, atol=1e-9)
    assert np.abs(ours[-1] - ours[0]).max() > 1e-6


@pytest.mark.parametrize(
    ("formula", "meaning"),
    [
        ("1/log10(x+98)", lambda x: 1 / math.log10(x + 98)),
        ("y/log10(x)*3", lambda x: 0.1 / math.log10(x) * 3),
        ("x^log10(x+98)", lambda x: x ** math.log10(x + 98)),
        ("-log10(x)^2", lambda x: -(math.log10(x) ** 2)),
    ],
)
def test_the_decimal_logarithm_is_held_together(tmp_path: Path, formula: str, meaning) -> None:
    (value,) = read(tmp_path, f"aux q={formula}").system.observables.values()
    assert float(value.xreplace({sp.Symbol("x"): 2, sp.Symbol("y"): sp.Rational(1, 10)})) == pytest.approx(
        meaning(2)
    )


@pytest.mark.parametrize(
    "formula", ["x>1", "x<=1", "if(x>1)then(2)else(3)", "heav(x)", "not(x>1)", "(x>0)&(x<1)"]
)
def test_a_condition_on_no_number_is_no_number(tmp_path: Path, formula: str) -> None:
    # XPPAUT takes such a comparison for false, and goes on.
    scene = read(tmp_path, f"z'={formula}")
    rates = {state.name: rate for state, rate in zip(scene.system.states, scene.system.rates)}
    assert np.isnan(sp.lambdify(sp.Symbol("x"), rates["z"], "numpy")(np.nan))


def test_a_side_that_is_no_number_ends_the_run_and_says_so(tmp_path: Path) -> None:
    scene = read(tmp_path, "z'=if(x<3)then(1)else(log(y-50))")
    run = gsp.integrate(scene)
    assert not run.status.ok
    assert run.t.size == 1 or run.t[-1] < scene.span[1]


FREE = """
para a=3;  b = 2 , c=1.5*4
number q=.25
initial x=2.1,  y = -0.5
% a comment, as people write it
---------
circular structure
bdry x-1
wiener noise
table list % 10 0 1 t
f(t)=sin(t)+a
low=2*high
high=x*y
x' = -x \\ this is not read
    + f(t+1) + mod(y,b) + flr(c*x) + low
y'=q*x-mod(-7.5,2)*flr(-0.3)
aux _late=delay(x,1)
aux 0=(x-1)
measured=delay(y,2)
aux both=measured+noise
done for today
x'=3
"""


def test_lines_are_told_apart_as_xppaut_does() -> None:
    model = read_ode(FREE)
    assert model.parameters == {"a": "3", "b": "2", "c": "1.5", "q": ".25"}
    assert model.starts == {"x": "2.1", "y": "-0.5", "t": "0"}
    assert list(model.states) == ["x", "y", "t"]
    assert list(model.observables) == ["aux_0"]
    told = " ".join(model.notes)
    for words in ("c = 1.5 of '1.5*4' (line 2)", "'circular structure' (line 7)", "low (line 12) uses high"):
        assert words in told, told
    left_out = " ".join(model.left_out)
    for words in ("bdry (line 8)", "noise (line 9)", "list (line 10)", "aux aux_late (line 17: delay is a delay",
                  "measured (line 19", "aux both", "line 21 ('done for today' ends the file)"):  # fmt: skip
        assert words in left_out, left_out


def test_such_lines_have_xppauts_values() -> None:
    model = read_ode(FREE)
    model.parameters["eps"], model.states["probe"], model.starts["probe"] = "1", "-probe/eps", "1"
    scene = imported(model, small="eps", read=lambda draft: scene_of(parsed(draft), Path("free.ode")))[1]
    system = scene.system
    point = {state: scene.start[state.name] for state in system.states} | dict(system.parameters)
    ours = [float(rate.xreplace(point)) for rate in system.rates[:2]]
    rates = ["-x+f(t+1)+mod(y,b)+flr(c*x)+2*x*y", "q*x-mod(-7.5,2)*flr(-0.3)"]
    # Older ones take no blank around =.
    text = FREE.partition("done")[0].replace("b = 2 ,", "b=2,").replace("y = -0.5", "y=-0.5")
    assert ours == pytest.approx(xppaut.values(text, rates, ours), rel=1e-12)


def test_the_error_function_and_what_is_left_of_it_are_xppauts() -> None:
    text = "par a=0.3\ninit x=0.4\nx'=erf(x/a)-erfc(x-a)\n"
    system = imported(read_ode(text), small=None, read=lambda d: scene_of(parsed(d), Path("erf.ode")))[1].system
    value = float(system.rates[0].xreplace(dict(system.parameters)).subs(system.states[0], 0.4))
    assert xppaut.values(text, ["erf(x/a)-erfc(x-a)"], [value]) == pytest.approx([value], abs=1e-13)


def test_a_mod_is_that_of_a_whole_period_and_of_none_on_its_jumps_too() -> None:
    text = "par n=5\nx'=mod(x,3)\ny'=flr(x)\nz'=flr(n/2)+mod(6,3)+flr(-3)+mod(-7.5,2)\n"
    scene = imported(read_ode(text), small=None, read=lambda d: scene_of(parsed(d), Path("jumps.ode")))[1]
    system = scene.system
    (x, _, _), (mod, flr, constant) = system.states, (r.xreplace(dict(system.parameters)) for r in system.rates)
    assert constant == 2 + 0 - 3 + sp.Rational(1, 2)
    found = sp.lambdify(x, (mod, flr), "numpy")
    whole, between = np.arange(-30.0, 30.0), np.random.default_rng(0).uniform(-1e4, 1e4, 400)
    # Those beside which the line it is made of jumps are right too.
    for value in (*whole, *(whole + 0.5), *(whole + 1 - 1 / np.pi), *between, 1e5, 1e6, -1e6):
        assert found(float(value)) == pytest.approx((value % 3, np.floor(value)), abs=1e-9 * max(1, abs(value)))


def test_a_mod_by_a_negative_number_is_the_rest_with_the_sign_of_the_first_and_once_more_where_that_is_negative() -> (
    None
):
    text = "par w=-2\nx'=mod(x,w)\ny'=mod(x,-2)\nz'=mod(-3.3,-2)+10*mod(3.3,-2)+100*mod(-4,-2)\n"
    scene = imported(read_ode(text), small=None, read=lambda d: scene_of(parsed(d), Path("rests.ode")))[1]
    system = scene.system
    (x, _, _), (named, written, constant) = (
        system.states,
        (r.xreplace(dict(system.parameters)) for r in system.rates),
    )
    assert float(constant) == pytest.approx(-3.3 + 10 * 1.3)
    found = sp.lambdify(x, (named, written), "numpy")
    for value in (*np.arange(-6.0, 6.5, 0.5), *np.random.default_rng(1).uniform(-1e3, 1e3, 200)):
        rest = np.fmod(value, -2.0)
        expected = rest - 2.0 if rest < 0.0 else rest
        assert found(float(value)) == pytest.approx((expected, expected), abs=1e-9 * max(1, abs(value)))


def test_what_xppaut_takes_a_step_late_is_where_its_runs_tend() -> None:
    text = "a=b^2+1\nb=c-y\nc=x*y\nx'=-a\ny'=b\ninit x=1,y=2\n"
    scene_text = text.replace("x'=-a", "x'=-a+0*eps").replace("y'", "par eps=.1\nz'=-z/eps\ny'")
    scene = imported(read_ode(scene_text), small=None, read=lambda d: scene_of(parsed(d), Path("late.ode")))[1]
    ours = gsp.integrate(scene, span=(0.0, 0.5), rtol=1e-10, atol=1e-12)["x"][-1]
    gaps = []
    for steps in (64, 512):
        rows, _ = xppaut.run(f"{text}@ meth=euler,dt={0.5 / steps},total=0.5,nout={steps}\ndone\n")
        gaps.append(abs(rows[-1, 1] - ours))
    assert gaps[1] < gaps[0] / 6


@pytest.mark.parametrize(
    ("value", "number"),
    [("-5", -5), (" -5", 0), (" 5", 5), ("2*3", 2), ("a+1", 0), ("-5*a", -5), ("-.5e1", -5), ("0x10", 0)],
)
def test_a_start_is_what_xppaut_makes_of_it(value: str, number: float) -> None:
    text = f"par a=3\nx(0)={value}\nx'=0\n"
    model = read_ode(text)
    assert float(model.starts["x"]) == number
    told = "values that XPPAUT does not take as they stand: x(0) = " in " ".join(model.notes)
    assert told == (value not in {"-5", " 5", "-.5e1"})
    rows, _ = xppaut.run(f"{text}@ meth=euler,dt=1,total=1\ndone\n")
    assert rows[0, 1] == number


@pytest.mark.parametrize(("value", "number"), [("0x10", 16), ("-0x1.8p1", -3), ("1e3x", 1000), ("0xg", 0)])
def test_a_parameter_is_what_xppaut_makes_of_it(value: str, number: float) -> None:
    text = f"par a={value}\nx'=0\ninit x=2\naux y=a\n"
    assert float(read_ode(text).parameters["a"]) == number
    rows, _ = xppaut.run(f"{text}@ meth=euler,dt=1,total=1\ndone\n")
    assert rows[0, 2] == number


def test_a_comment_in_another_encoding_is_no_hindrance(tmp_path: Path) -> None:
    path = tmp_path / "model.ode"
    path.write_bytes(MODEL.format(line="# \u00b5M").encode("latin-1"))
    assert gsp.load(path).epsilon == 0.01
    path.write_bytes(MODEL.format(line="z'=\u00b5").encode("latin-1"))
    with pytest.raises(ModelFileError, match=r"line 4|means nothing"):
        gsp.load(path)


def test_what_a_setting_begins_with_is_its_number(tmp_path: Path) -> None:
    (tmp_path / "m.ode").write_text("x'=-x\ninit x=1\n@ total=30; t0=0\ndone\n")
    assert gsp.load(tmp_path / "m.ode").span == (0.0, 30.0)


@pytest.mark.parametrize(
    "setting", ["total = 1", "total= 1", "total =1", "dt=.1,total= 1", "total=1, t0= 2", "total=1 , dt=.1"]
)
def test_a_setting_with_a_blank_beside_its_sign_is_none(setting: str) -> None:
    """x' = 1 from 0: the last row of XPPAUT's run is the span."""
    text = f"x'=1\ny'=-y\ninit x=0\n@ {setting}\ndone\n"
    rows, _ = xppaut.run(text)
    model = read_ode(text)
    assert rows[-1, 1] == pytest.approx(float(model.total), rel=1e-6)
    assert ("nothing of" in " ".join(model.notes)) == ("= " in setting or " =" in setting)


def test_a_method_with_a_blank_beside_its_sign_makes_no_map() -> None:
    """x' = 1 from 0 is at 3 after a time of 3, and as a map at 1."""
    text = "x'=1\ninit x=0\n@ meth= discrete,total=3\ndone\n"
    rows, _ = xppaut.run(text)
    assert rows[-1, 1] == pytest.approx(3.0)
    assert list(read_ode(text).states) == ["x"]


def test_a_blank_beside_the_sign_of_a_value_is_told() -> None:
    model = read_ode("par g= 3, h=2\nx'=-g*x+h\ninit x = 1\n@ total=1\ndone\n")
    assert model.parameters == {"g": "3", "h": "2"}
    assert "XPPAUT 6 has 0 or stops: 'g= 3' (line 1), 'x = 1' (line 3)" in " ".join(model.notes)
