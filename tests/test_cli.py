"""The command line: what it prints, what it writes, and its exit status."""

import gc
import json
import math
import re
import subprocess
import sys
from pathlib import Path

import pytest
from click.testing import CliRunner

from gsp import models
from gsp.algebra import ring
from gsp.cli import cli, main
from gsp.errors import BudgetError, DeclarationError, GspError

FOLD = """
slow = { y = "-x" }
fast = { x = "y - x^3/3 + x" }
region = { y = [-2, 2], x = [-3, 3] }
start = { y = 1, x = 2.1 }
scene = { span = [0, 0.1], epsilon = 0.01 }
"""


def run(*arguments: str):
    return CliRunner().invoke(cli, list(arguments), catch_exceptions=False)


def exit_status(monkeypatch: pytest.MonkeyPatch, *arguments: str) -> int:
    monkeypatch.setattr(sys, "argv", ["gsp", *arguments])
    with pytest.raises(SystemExit) as stopped:
        main()
    return int(stopped.value.code or 0)


def test_help_names_every_command() -> None:
    text = run("--help").output
    for command in ("models", "split", "expand", "check", "folds", "run", "compare", "report", "demo"):
        assert command in text


def test_the_page_of_options_names_the_commands_that_have_them() -> None:
    page = (Path(__file__).parents[1] / "docs" / "command-line.md").read_text()
    rows = re.findall(r"^\| `(--\w+)[^|]*\|[^|]*\| (all|)([^|]*)\|$", page, re.MULTILINE)
    assert len(rows) == 9
    for option, is_all, text in rows:
        named = set(re.findall(r"`(\w+)`", text))
        having = {
            name for name, command in cli.commands.items() if any(option in p.opts for p in command.params)
        }
        assert having == (set(cli.commands) - named if is_all else named), option


def test_models_lists_the_scenes_as_text_and_json() -> None:
    assert "chaplygin_sleigh" in run("models").output
    rows = json.loads(run("models", "--json").stdout)
    assert {"chaplygin_sleigh", "michaelis_menten", "van_der_pol"} <= {row["name"] for row in rows}


def test_split_finds_the_slow_momentum() -> None:
    got = json.loads(run("split", "chaplygin_sleigh", "--json").stdout)
    assert got["coordinates"]["p"] == "a*m*w + omega*(I + a**2*m)"
    assert "linear first integral" in run("split", "chaplygin_sleigh").output


def test_split_names_what_is_conserved_across_the_time_scales(tmp_path) -> None:
    model = tmp_path / "binding.toml"
    text = """
    epsilon = "delta"
    [parameters]
    k = 3
    {loss}
    [slow]
    i = "-l*(i*(1 - d) - k*d)"
    [fast]
    d = "i*(1 - d) - k*d"
    [region]
    i = [0, 2]
    [start]
    i = 1
    d = 0
    [scene]
    span = [0, 1]
    epsilon = 0.01
    """
    model.write_text(text.format(loss="").replace("-l*", "-"))
    assert "\nConserved: d*delta + i.\n" in run("split", str(model)).output
    assert json.loads(run("split", str(model), "--json").stdout)["conserved_sums"] == ["d*delta + i"]
    model.write_text(text.format(loss="l = 2"))
    assert "\nConserved: 2*d*delta + i, at the values of this model.\n" in run("split", str(model)).output
    # Its slow variables are the sums that are conserved: they are told once.
    assert run("split", "rolling_ball").output.count("Conserved") == 3


def test_expand_prints_every_order_in_slow_and_in_raw_variables() -> None:
    got = json.loads(run("expand", "chaplygin_sleigh", "--order", "2", "--json").stdout)
    assert [len(row) for row in got["h"]] == [1, 1, 1]
    assert got["slow"] == ["v", "p"]
    assert "f_1  v' = -I*m*omega**2*v/(I + a**2*m)" in run("expand", "chaplygin_sleigh", "--raw").output
    # A variable that the split made is no word of the model's.
    assert run("expand", "chaplygin_sleigh").stdout.startswith("Here p = ")
    assert "Here" not in run("expand", "chaplygin_sleigh", "--raw").stdout


def test_check_exits_with_0_when_it_holds_and_1_when_not(tmp_path, monkeypatch, capsys) -> None:
    assert exit_status(monkeypatch, "check", "linear") == 0
    file = tmp_path / "fold.toml"
    file.write_text(FOLD)
    assert exit_status(monkeypatch, "check", str(file)) == 1
    assert "lost: fold: zero eigenvalue" in capsys.readouterr().out
    verdict = json.loads(run("check", str(file), "--json").stdout)
    by_name = {condition["name"]: condition["value"] for condition in verdict["conditions"]}
    assert verdict["rates"]["r"] == by_name["normal rate dominates"]
    assert verdict["holds"] is False
    assert verdict["kind"] == "lost"


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (("check", "chaplygin_slay"), 'Did you mean "chaplygin_sleigh"'),
        (("check", "missing.toml"), "no such file"),
        (("check", "a" * 300), 'gsp: there is no scene "aaa'),
        (("expand", "linear", "--order", "-1"), "non-negative integer"),
        (("report", "linear", "-o", "/proc/nowhere"), "/proc/nowhere"),
        (("expand", "linear", "--order", "three"), "not a valid integer"),
        (("nonsense",), "No such command"),
    ],
)
def test_bad_input_exits_with_2_and_says_why(arguments, words, monkeypatch, capsys) -> None:
    assert exit_status(monkeypatch, *arguments) == 2
    assert words in capsys.readouterr().err


def test_scales_are_told_along_the_run_and_for_the_parameters_that_may_vanish() -> None:
    along = json.loads(run("scales", "michaelis_menten", "--json").output)
    assert along["what"] == "TimeScales"
    assert "exhausted" in run("scales", "michaelis_menten").output
    found = json.loads(run("scales", "michaelis_menten", "--parameters", "--keep", "kappa", "--json").output)
    assert found["status"] == "SUCCESS"
    assert found["parameters"]
    assert all("kappa" not in each["vanishing"] for each in found["parameters"])
    assert any(each["vanishing"] == ["epsilon"] and each["attracts"] for each in found["parameters"])
    errors = [each["error"] for each in found["parameters"] if each["error"] is not None]
    assert errors == sorted(errors)
    assert errors[0] < 0.1
    assert (
        f"error at these values behind the layer, to t = 5: {errors[0]:.2g}"
        in run("scales", "michaelis_menten", "--parameters").output
    )


def test_special_values_are_told_without_errors_where_the_run_ends_early(tmp_path) -> None:
    model = tmp_path / "growing.toml"
    model.write_text(
        '[parameters]\nk = 0.1\n[states]\nx = "k*x^2"\ny = "x - y"\n[start]\nx = 1\ny = 1\n[scene]\nspan = [0, 20]\n',
        encoding="utf-8",
    )
    told = run("scales", str(model), "--parameters").output
    assert "k -> 0" in told
    assert "Errors were not measured." in told


def test_manifolds_and_rates_at_special_values_are_cut_where_they_are_long(tmp_path) -> None:
    model = tmp_path / "cubic.toml"
    model.write_text(
        "[parameters]\na = 3\nb = 0.2\nc = 2\nd = 0.4\nh = 0.3\nk = 0.01\n"
        '[states]\nx = "a*(1 - x)*(b + x)^3 - c*x*y/(h + y)^2"\ny = "c*x*y/(h + y)^2 - d*y*(1 + y)^3"\n'
        'z = "k*(x*y - z)"\nw = "k*(1 + x + y + z - w)^9"\n[start]\nx = 0.5\ny = 0.5\nz = 0.5\nw = 1\n'
        "[scene]\nspan = [0, 20]\n",
        encoding="utf-8",
    )
    kept = [word for name in "abcd" for word in ("--keep", name)]
    told = run("scales", str(model), "--parameters", *kept).output
    # A line holds 240 characters of each of two equations, and less of a rate.
    assert max(map(len, told.splitlines())) < 600
    assert "operations)" in told or "terms)" in told


def test_slow_rates_in_fast_time_are_told(tmp_path) -> None:
    model = tmp_path / "fast_time.toml"
    model.write_text(
        'region = {x = [1, 2], y = [0, 3]}\nslow = {x = "-epsilon*x"}\nfast = {y = "x - y"}\n'
        "start = {x = 1, y = 1}\nscene = {span = [0, 20], epsilon = 0.1}\n",
        encoding="utf-8",
    )
    told = run("check", str(model)).stderr
    assert "every slow rate vanishes at epsilon = 0" in told
    assert "write both under [states]" in told
    model.write_text(model.read_text(encoding="utf-8").replace("-epsilon*x", "-x"), encoding="utf-8")
    assert run("check", str(model)).stderr == ""


def test_what_is_kept_is_asked_for_parameters_alone() -> None:
    with pytest.raises(DeclarationError, match="Add --parameters"):
        run("scales", "michaelis_menten", "--keep", "kappa")


LONG = """
parameters = {k1 = 1, k2 = 0.7, k3 = 2, q = 0.3}
slow = { F = "-k1*F*X - q*F", T = "k2*X*Y - q*T" }
fast = { X = "F*(1+T) - k1*X - k3*X*Y", Y = "k2*X - Y - q*X*Y" }
region = { F = [0.1, 1], T = [0, 1], X = [0, 2], Y = [0, 2] }
start = { F = 1, T = 0, X = 0, Y = 0 }
scene = { span = [0, 4], epsilon = 0.02 }
"""


@pytest.mark.exhaustive
def test_coefficients_too_long_to_read_are_counted_and_shortened(tmp_path) -> None:
    # Two slow and two fast variables on an implicit branch with four parameters: h_3 has 25009 terms.
    file = tmp_path / "long.toml"
    file.write_text(LONG)
    text = run("expand", str(file)).output
    assert "Here X, Y is the point of the critical manifold" in text
    assert "h_3  has coefficients of up to" in text
    assert len(text) < 50_000
    assert "h_2  X = " in run("expand", str(file), "--values", "--order", "2").output
    assert run("report", str(file), "-o", str(tmp_path / "out")).exit_code == 0
    series = json.loads((tmp_path / "out" / "report.json").read_text())["series"]
    assert series["parameters"] == "values"
    assert series["order"] == 3


@pytest.mark.parametrize("is_read", [True, False])
def test_a_coefficient_longer_than_the_screen_is_counted_there_and_whole_in_a_file(
    monkeypatch, is_read
) -> None:
    monkeypatch.setattr("gsp.cli.deriving.screenful", lambda: 40.0 if is_read else float("inf"))
    text = run("expand", "michaelis_menten", "--order", "2").output
    counted = re.findall(
        r"h_2  .* = ([\d,]+) characters, more than a screen; a pipe, a file or --json has all", text
    )
    whole = json.loads(run("expand", "michaelis_menten", "--order", "2", "--json").stdout)["h"][2][0]
    assert counted == ([f"{len(whole):,}"] if is_read else [])
    assert (f"= {whole}\n" in text) is not is_read
    assert re.search(r"h_0  \w+ = \S", text)


def test_expand_prints_what_it_reached_where_no_order_was_asked_for(tmp_path, monkeypatch) -> None:
    file = tmp_path / "powers.toml"
    file.write_text(
        "parameters = {k = 1, m = 2}\n[slow]\ns = '-s + (s + c + k + m)^9'\n[fast]\nc = 's - c'\n"
        "[region]\ns = [0, 1]\n[start]\ns = 1\nc = 0\n[scene]\nspan = [0, 1]\nepsilon = 0.01\n"
    )
    monkeypatch.setattr(ring, "BUDGET", 3000)
    told = run("expand", str(file))
    assert told.exit_code == 0
    assert "h_0  c = s" in told.output
    assert "h_1" not in told.output
    assert "The series ends at order 0: " in told.output
    assert "--values" in told.output
    found = json.loads(run("expand", str(file), "--json").stdout)
    assert (found["order"], len(found["h"]), "3,000" in found["ending"]) == (0, 1, True)
    # An order that was asked for is given whole or not at all.
    with pytest.raises(BudgetError, match="through order 3 was reached through order 0"):
        run("expand", str(file), "--order", "3")


def test_folds_are_found_along_an_implicit_branch() -> None:
    got = json.loads(run("folds", "van_der_pol", "--json").stdout)
    places = sorted((round(p["point"]["x"], 9), round(p["point"]["y"], 9)) for p in got["special"])
    assert (1.0, -0.666666667) in places
    assert "curve of folds" in run("folds", "koper").output
    assert "without roots: it has no folds" in run("folds", "linear").output


def test_folds_of_a_branch_that_has_none_says_that_there_are_others(tmp_path) -> None:
    model = tmp_path / "laser.toml"
    model.write_text(
        '[slow]\nA = "6.5 - A - A*I"\n[fast]\nI = "I*(A/(1 + I) - 5.8/(1 + 1.8*I) - 1)"\n'
        "[region]\nA = [4, 9]\nI = [0, 6]\n[start]\nA = 6\nI = 5\n[scene]\nspan = [0, 8]\nepsilon = 0.01\n"
    )
    found = run("folds", str(model))
    assert "I = 0 without roots: it has no folds" in found.stdout
    assert "of 3 branches this is about I = 0, to which the run from the start belongs" in found.stderr


@pytest.mark.exhaustive
def test_folds_name_weights_and_powers_and_print_charts() -> None:
    line = "weights x 1, y 2, epsilon 3; degree 1; so x ~ epsilon^(1/3), y ~ epsilon^(2/3), slow time ~ epsilon^(2/3)"
    assert line in run("folds", "van_der_pol").output
    assert run("folds", "koper").output.count("along the curve of folds: weights x 1, y 2, epsilon 3") == 2
    assert "chart epsilon = r_1^3, the rescaling chart" in run("folds", "van_der_pol", "--blow-up").output
    (found,) = json.loads(run("folds", "van_der_pol", "--json").stdout)["blow_ups"]
    assert found["weights"] == {"x": 1, "y": 2, "epsilon": 3}
    assert found["exponents"] == {"x": "1/3", "y": "2/3"}
    assert found["charts"]["epsilon = r_1^3"]["x_1"] == "-x_1**2 + y_1"


@pytest.mark.exhaustive
def test_folds_are_found_along_a_graph_with_a_root(tmp_path) -> None:
    file = tmp_path / "predators.toml"
    file.write_text(
        'epsilon = "epsilon"\n[slow]\nv = "v*(u/(u + 1/4) - 3/10)"\n[fast]\nu = "u*(1 - u - v/(u + 1/4))"\n'
        "[region]\nv = [0.05, 0.45]\nu = [0.4, 1]\n[start]\nv = 0.1\nu = 0.9\n"
        "[scene]\nepsilon = 0.01\nepsilons = [0.02, 0.01]\ntolerance = 1e-3\nspan = [0, 0.5]\n"
    )
    (fold,) = [
        p["point"]
        for p in json.loads(run("folds", str(file), "--json").stdout)["special"]
        if p["kind"] == "fold"
    ]
    assert fold == pytest.approx({"v": 0.390625, "u": 0.375})
    told = run("check", str(file))
    assert told.exit_code == 1
    assert "fold: zero eigenvalue at v = 0.390625, u = 0.375" in told.output
    assert "holds: for v in [0.05, 0.38" in told.output
    written = run("report", str(file), "-o", str(tmp_path / "out"), "--no-open")
    assert written.exit_code == 0
    assert "over the region as a whole: FAILS  graph" in written.output
    assert "The conditions hold for v in [0.05, 0.38" in (tmp_path / "out" / "report.html").read_text("utf-8")


def test_methods_are_tabulated_with_their_orders() -> None:
    found = json.loads(run("methods", "michaelis_menten", "--json").stdout)
    place = found["coordinates"]["method"]["values"].index
    values = {name: column["values"] for name, column in found["variables"].items()}
    assert values["expected"][place("CSP 1")] == 2
    assert values["fitted"][place("series 2")] == pytest.approx(3, abs=0.1)
    first = found["coordinates"]["epsilon"]["values"].index(0.1)
    assert values["error"][place("solved")][first] < 1e-10


@pytest.mark.exhaustive
def test_a_chart_is_drawn_and_its_runs_are_written(tmp_path, monkeypatch: pytest.MonkeyPatch) -> None:
    # Timed once instead of five times: nothing here depends on the seconds.
    monkeypatch.setattr("gsp.comparison.work_runs.ROUNDS", 1)
    figure, table = tmp_path / "chart.png", tmp_path / "runs.csv"
    result = run("chart", "michaelis_menten", "-o", str(figure), "--csv", str(table))
    assert result.exit_code == 0
    assert "reduced 4" in result.stdout
    assert "SciPy LSODA" in table.read_text(encoding="utf-8")
    assert figure.read_bytes().startswith(b"\x89PNG")


def test_a_demo_is_written_where_it_was_asked_for(tmp_path, monkeypatch: pytest.MonkeyPatch) -> None:
    shown: list[str] = []
    monkeypatch.setattr("click.launch", lambda url: shown.append(url) or 0)
    page = tmp_path / "page.html"
    got = run("demo", "linear", "-o", str(page), "--no-open", "--json")
    assert json.loads(got.stdout) == {"name": "linear", "file": str(page), "bytes": page.stat().st_size}
    assert shown == []
    monkeypatch.chdir(tmp_path)
    assert run("demo", "linear", "--epsilon", "0.02").stdout == "demo: gsp-demo-linear.html\n"
    assert shown == [(tmp_path / "gsp-demo-linear.html").as_uri()]
    assert '"epsilon":0.02' in (tmp_path / "gsp-demo-linear.html").read_text(encoding="utf-8")


def test_demo_without_a_model_lists_the_demos() -> None:
    rows = json.loads(run("demo", "--json").stdout)
    assert rows[0]["told"]
    assert {row["name"] for row in rows} == set(models.names())
    assert "told in steps" in run("demo").output
    with pytest.raises(GspError, match="no MODEL"):
        run("demo", "--epsilon", "0.1")


def test_a_report_is_written_where_it_was_asked_for(tmp_path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("gsp.charts.applicable", lambda _: {})
    result = run("report", "linear", "-o", str(tmp_path / "out"))
    assert result.exit_code == 0
    written = json.loads((tmp_path / "out" / "report.json").read_text())
    assert written["name"] == "linear"
    assert (tmp_path / "out" / "report.html").stat().st_size > 1000


def test_nothing_is_written_when_the_scene_is_refused(tmp_path) -> None:
    file = tmp_path / "fold.toml"
    file.write_text(FOLD.replace("y - x^3/3 + x", "1 + x^2 - y/3"))
    with pytest.raises(GspError, match="is real near the start"):
        run("report", str(file), "-o", str(tmp_path / "out"))
    assert not (tmp_path / "out").exists()


def test_choose_prints_the_card_and_json() -> None:
    text = run("choose", "linear", "--tolerance", "1e-3").output
    assert "predicted" in text
    assert "->" in text
    found = json.loads(run("choose", "linear", "--json").stdout)
    assert found["attributes"]["scene"] == "linear"
    assert found["attributes"]["measured"] <= found["coordinates"]["tolerance"]["values"]
    assert set(found["variables"]["kind"]["values"]) == {"reduced", "solved", "full"}


def test_folds_outside_the_region_are_called_so() -> None:
    # The built-in region is x in (1.1, 2.2), y in (-0.6, 1.2), and the fold at (1, -2/3).
    assert "outside the region: fold at y = -0.66" in run("folds", "van_der_pol").output
    wider = ("folds", "van_der_pol", "--region", "x=0.9:2.2", "--region", "y=-0.7:1.2")
    assert "outside the region: fold at y = -0.66" not in run(*wider).output
    (fold,) = [p for p in json.loads(run(*wider, "--json").stdout)["special"] if p["point"]["x"] > 0]
    assert fold["in_region"]
    assert not any(p["in_region"] for p in json.loads(run("folds", "van_der_pol", "--json").stdout)["special"])


@pytest.mark.exhaustive
def test_two_curves_of_folds_are_told_apart_and_the_canards_on_them() -> None:
    text = run("folds", "koper").output
    assert "x = -1 throughout" in text
    assert "x = 1 throughout" in text
    assert "outside the region: folded node at y = 0.9" in text
    assert "secondary canards: 6" in text
    points = json.loads(run("folds", "koper", "--json").stdout)["folded_singularities"]
    assert [(p["kind"], p["secondary_canards"]) for p in points] == [("folded focus", 0), ("folded node", 6)]


def test_folds_say_what_is_missing(tmp_path) -> None:
    file = tmp_path / "open.toml"
    file.write_text(
        '[slow]\nx = "1"\ny = "-x"\n[fast]\nz = "x - z^3/3 + z"\n[region]\nx = [1, 2]\ny = [1, 2]\n'
        "[start]\nx = 1.5\ny = 1.5\nz = 2\n[scene]\nspan = [0, 0.1]\nepsilon = 0.01\ntolerance = 1e-3\n"
    )
    with pytest.raises(GspError, match="no bounds on z in the region of open"):
        run("folds", str(file))


def test_a_chart_has_one_of_three_endings(tmp_path) -> None:
    with pytest.raises(GspError, match=r"written as \.png, \.pdf or \.svg\. Got x\.txt"):
        run("chart", "linear", "-o", str(tmp_path / "x.txt"))


def test_a_defect_has_a_status_of_its_own_and_one_line(monkeypatch: pytest.MonkeyPatch, capsys) -> None:
    def broken(*_args, **_options):
        raise RuntimeError("no spare\n  generator")

    monkeypatch.setattr("gsp.scenes.study.classify", broken)
    assert exit_status(monkeypatch, "check", "linear") == 70
    said = capsys.readouterr().err
    assert said.count("\n") == 1
    assert (
        "defect of gsp, not of your model: RuntimeError: no spare generator. Run again with GSP_DEBUG=1" in said
    )
    monkeypatch.setenv("GSP_DEBUG", "1")
    monkeypatch.setattr(sys, "argv", ["gsp", "check", "linear"])
    with pytest.raises(RuntimeError, match="no spare"):
        main()


def test_the_package_run_as_a_module_is_the_command_line() -> None:
    for name in ("gsp", "gsp.cli"):
        found = subprocess.run(
            [sys.executable, "-m", name, "--version"], capture_output=True, text=True, timeout=300, check=False
        )
        assert found.stdout.startswith("gsp, version"), found.stderr


@pytest.mark.exhaustive
def test_a_command_ends_without_a_look_for_cycles() -> None:
    # What is registered first is called last.
    text = (
        "import atexit, gc, sys\n"
        "atexit.register(lambda: print('looked at:', len(gc.get_objects()), 'of', gc.get_freeze_count()))\n"
        "from gsp.cli import main\n"
        "sys.argv = ['gsp', 'split', 'linear']\n"
        "main()\n"
    )
    found = subprocess.run(
        [sys.executable, "-c", text], capture_output=True, text=True, timeout=300, check=False
    )
    looked, of = map(int, found.stdout.rpartition("looked at: ")[2].split(" of "))
    assert looked < 100 < 10_000 < of, found.stderr


def test_a_command_looks_for_cycles_a_hundredth_as_often_as_python(monkeypatch: pytest.MonkeyPatch) -> None:
    before = gc.get_threshold()
    try:
        exit_status(monkeypatch, "--version")
        assert gc.get_threshold()[0] >= 100 * 700
    finally:
        gc.set_threshold(*before)


def test_wrong_options_are_shown_without_control_characters(monkeypatch: pytest.MonkeyPatch, capsys) -> None:
    assert exit_status(monkeypatch, "check", "--\x1b[31m\ngsp: proved", "linear") == 2
    told = capsys.readouterr().err
    assert "\x1b" not in told
    assert not any(line.startswith("gsp: proved") for line in told.splitlines())
    assert "Usage:" in told
    assert "Error: No such option" in told


def interrupted(module: str, *lines: str) -> subprocess.CompletedProcess:
    """A process of these lines in which Ctrl-C is pressed where `module` is looked for."""
    script = (
        "import sys",
        "class Interrupting:",
        "    def find_spec(self, name, path, target=None):",
        f"        if name == {module!r}: raise KeyboardInterrupt",
        "sys.meta_path.insert(0, Interrupting())",
        *lines,
    )
    return subprocess.run(
        [sys.executable, "-c", "\n".join(script)], capture_output=True, text=True, check=False
    )


def test_ctrl_c_while_modules_are_imported_shows_no_traceback() -> None:
    done = interrupted("gsp.cli.program", "from gsp.cli import main", "main()")
    assert (done.returncode, done.stderr) == (130, "gsp: interrupted; nothing was written\n")


@pytest.mark.parametrize(("program", "ends"), [("-m", 130), ("/usr/bin/gsp", 130), ("own.py", None)])
def test_ctrl_c_while_the_package_is_imported_is_told_by_the_command_line_alone(program: str, ends) -> None:
    # `python -m gsp` and the script `gsp` import the package before any of its functions is called.
    asked = ("try:", "    import gsp", "except KeyboardInterrupt:", "    print('still its own')")
    done = interrupted("lazy_loader", f"sys.argv = [{program!r}, 'models']", *asked)
    told = "" if ends is None else "gsp: interrupted; nothing was written\n"
    assert (done.returncode, done.stderr) == (ends or 0, told)
    assert done.stdout == ("still its own\n" if ends is None else "")


@pytest.mark.exhaustive
def test_a_report_is_opened_when_that_is_asked(tmp_path, monkeypatch: pytest.MonkeyPatch) -> None:
    shown: list[str] = []
    monkeypatch.setattr("click.launch", lambda url: shown.append(url) or 1)
    told = run("report", "linear", "--order", "1", "-o", str(tmp_path / "r"), "--open")
    assert shown == [(tmp_path / "r" / "report.html").as_uri()]
    assert told.stdout.endswith("No browser was found here; open the file in one.\n")


def test_parameters_that_nothing_uses_are_told(tmp_path) -> None:
    """Another value of such a one changes nothing; one in a definition, a ramp or a claim is used."""
    text = (
        'title = "spare and k"\n[parameters]\nk = 2\nspare = 1\nrate = 3\nl = 0\n[definitions]\n"pull(u)" = "rate*u"\n'
        '[slow]\nx = "-pull(x) + l"\n[fast]\ny = "x - y"\n[region]\nx = [0, 2]\n[start]\nx = 1\ny = 1\n'
        "[scene]\nspan = [0, 1]\nepsilon = 0.1\n"
    )
    file = tmp_path / "spare.toml"
    file.write_text(text)
    assert "nothing in the file uses k, spare of its parameters\n" in run("check", str(file)).stderr
    file.write_text(text.replace("k = 2\nspare = 1\n", ""))
    assert "nothing" not in run("check", str(file)).stderr


def test_a_reduced_run_tells_how_far_its_start_is_known(tmp_path) -> None:
    """x' = v, epsilon v' = -v - x - x^3/2: through order 9 the base point of x = 1.5, v = 0 lies at 3.4."""
    file = tmp_path / "spring.toml"
    file.write_text(
        '[slow]\nx = "v"\n[fast]\nv = "-v - x - x^3/2"\n[region]\nx = [-2, 2]\n'
        "[start]\nx = 1.5\nv = 0\n[scene]\nspan = [0, 4]\nepsilon = 0.05\n"
    )
    assert (
        "base point of the start, of which x is known to about 3\n"
        in run("run", str(file), "--order", "9").stderr
    )
    assert "known" not in run("run", str(file), "--order", "1", "--epsilon", "1e-6").stderr
    assert "known" not in run("run", str(file)).stderr


def test_a_reduced_run_tells_that_its_series_is_past_its_best_order_and_its_start_unknown(tmp_path) -> None:
    """Of mu y' = sin(3 t) + x/2 - y the terms grow at mu = 0.4 from the first on, as (3 mu)^k."""
    file = tmp_path / "forced.toml"
    file.write_text(
        'epsilon = "mu"\n[slow]\nclock = "1"\nx = "-x + y"\n[fast]\ny = "sin(3*clock) + x/2 - y"\n'
        "[region]\nclock = [0, 6]\nx = [-2, 2]\n[start]\nclock = 0\nx = 1\ny = 0\n"
        "[scene]\nspan = [0, 6]\nepsilon = 0.4\n"
    )
    said = run("run", str(file), "--order", "9").stderr
    assert "of which x is not known: it may be off by about 4\n" in said
    assert "past its best order, 0: terms of higher orders grow\n" in said
    assert "best order" not in run("run", str(file), "--order", "3", "--epsilon", "0.01").stderr
    # What is reconstructed has a base point too, and is no variable of the series.
    assert "best order" not in run("run", "chaplygin_sleigh", "--order", "1").stderr


def test_a_run_takes_the_tolerances_that_its_message_advises(tmp_path) -> None:
    # An allele that is rare, down to 1e-24, and spreads when its selection turns round:
    # x = 1/(1 + 99 e^(50 - (t - 10)^2/2)).
    file = tmp_path / "allele.toml"
    file.write_text(
        '[states]\nx = "(s - 10)*x*(1 - x)"\ns = 1\n[start]\nx = 0.01\ns = 0\n[scene]\nspan = [0, 20.5]\n'
    )
    exact = 1 / (1 + 99 * math.exp(50 - 10.5**2 / 2))
    assert "give an atol below the least that x gets to" in run("run", str(file)).output
    told = run("run", str(file), "--atol", "1e-30", "--rtol", "1e-10", "--json")
    assert json.loads(told.output)["variables"]["x"]["values"][-1] == pytest.approx(exact, rel=1e-6)
    assert "atol" not in run("run", str(file), "--atol", "1e-30").output
    with pytest.raises(DeclarationError, match="atol is a finite number, positive"):
        run("run", str(file), "--atol", "0")


def test_a_reduced_run_on_an_implicit_branch_is_told_in_the_variables_that_were_asked_about() -> None:
    lines = run("run", "van_der_pol", "--order", "1").output.splitlines()
    assert [line.split()[0] for line in lines if "->" in line] == ["y", "x"]
    assert "x0" not in lines[-1]
    assert "y = " in lines[-1]


@pytest.mark.parametrize(
    "arguments",
    [
        "demo linear --no-open -o nowhere/page.html",
        "check linear --prove -o nowhere/proof.json",
        "animate linear -o nowhere/run.gif",
        "export linear -o nowhere/linear.py",
    ],
)
def test_a_folder_that_is_not_there_is_told_before_the_work(
    arguments: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    for work in ("slow_tubes.certify.certify", "demos.animation.animate", "exports.export.export"):
        monkeypatch.setattr(f"gsp.{work}", lambda *_, **__: pytest.fail("the work began"))
    with pytest.raises(GspError, match="there is no folder"):
        run(*arguments.split())
