"""Arrays of XPPAUT's files: written out as XPPAUT prints them, and refused where it reads something else."""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Mapping
from pathlib import Path

import numpy as np
import pytest

from gsp.errors import ModelFileError
from gsp.readers import xppaut_arrays, xppaut_order
from gsp.readers.xppaut import read_ode
from gsp.readers.xppaut_arrays import LINES, without_sums, written_out
from tests import xppaut

FILES = sorted((Path(__file__).parent / "xppaut").glob("*.ode"))
WITH_ARRAYS = [path for path in FILES if re.search(r"\[[0-9]+\.\.", path.read_text())]


def lines(text: str) -> list[str]:
    return [line for _, line in written_out(enumerate(text.strip().splitlines(), 1))]


def test_a_range_is_a_line_for_each_member() -> None:
    assert lines("x[1..3]'=-x[j]+[j]") == ["x1'=-x1+1", "x2'=-x2+2", "x3'=-x3+3"]
    assert lines("x[2..3]'=x[j-1]+x[j+1]+y[j*2]+z[7]") == ["x2'=x1+x3+y4+z7", "x3'=x2+x4+y6+z7"]
    assert lines("init x[0..1]=0.[j]") == ["init x0=0.0", "init x1=0.1"]
    assert lines("y=x[4]+x[05]") == ["y=x4+x5"]


def test_a_block_is_written_out_member_by_member() -> None:
    text = "%[1..2]\nx[j]'=y[j]\ny[j]'=-x[j]\n%\nz'=1"
    assert lines(text) == ["x1'=y1", "y1'=-x1", "x2'=y2", "y2'=-x2", "z'=1"]


def test_settings_and_lines_without_brackets_stay() -> None:
    assert lines("@ fold=x[0..9]\nx'=1") == ["@ fold=x[0..9]", "x'=1"]


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("init x[1..3]=0,y[1..3]=1", "line 1: the line has a second range"),
        ("x'=y[j]", "line 1: [j] stands outside of an array"),
        ("x[0..3]'=x[j-1]", "line 1: the index [j-1] is -1 for j = 0"),
        ("x[3..1]'=1", "line 1: the range [3..1] has a negative index or no member"),
        ("x[-1..1]'=1", "line 1: the range [-1..1]"),
        ("x[1..9999]'=1", "line 1: the range [1..9999] has more than 2000 members"),
        ("x[1..2]'=y[k]", "line 1: the index [k] is not understood"),
        ("x[1..2]'=y[j+k]", "line 1: the index [j+k] is not understood"),
        ("x[1..2]'=y[j", "line 1: a bracket is not closed"),
        ("%[1..2]\nx[j]'=1", "line 2: a block is not closed"),
        ("%[1..2]\n%[1..3]", "line 2: '%[1..3]' opens or closes no block"),
        ("%[1..2]\ny[1..3]'=1\n%", "line 2: a range within a block"),
        ("% [2..", "line 1: '% [2..' opens or closes no block"),
        ("x'=sum(0,3)of(x)\ny'=sum(0,3)*2", "line 2: a sum is written sum(0,9)of(...)"),
        ("x'=sum(0,n)of(x)", "line 1: bounds of sums and shifts are whole numbers"),
        ("x'=sum(0,99999)of(x)", "line 1: a sum from 0 to 99999 is too long"),
        ("x'=sum(0,1)of(sum(0,1)of(x))", "line 1: a sum within a sum"),
        ("x'=shift(x,1)", "line 1: shift(x,1) lies past the first or the last state"),
        ("x'=shift(y,0)\ny=x", "line 1: shift goes from a state to another"),
        ("x'=shift(x)", "line 1: sum and shift take two arguments"),
        ("x'=shift(x,0", "line 1: a parenthesis is not closed"),
        ("x'=shift(x,0.5)", "line 1: bounds of sums"),
        ("x'=ishift(x,0)", "line 1: ishift is an array of tables"),
        ("x'=int[.5]{x}", "line 1: int is an integral"),
    ],
)
def test_what_xppaut_reads_differently_is_refused(text: str, words: str) -> None:
    with pytest.raises(ModelFileError) as caught:
        read_ode(text + "\ndone\n")
    assert words in str(caught.value), str(caught.value)


@pytest.mark.exhaustive
def test_a_file_grows_no_further_than_its_limit() -> None:
    text = "\n".join(f"%[1..2000]\nx{i}_[j]'=1\n%" for i in range(12))
    with pytest.raises(ModelFileError, match=f"more than {LINES} lines"):
        read_ode(text)
    with pytest.raises(ModelFileError, match="characters"):
        read_ode("x[1..2000]'=" + "1+" * 4000 + "1")
    cells = "%[0..399]\nx[j]'=-x[j]+sum(0,39)of(shift(x0,i')*[j]*" + "1" * 90 + ")\n%"
    with pytest.raises(ModelFileError, match="more than 1000000 characters"):
        read_ode(cells)
    with pytest.raises(ModelFileError, match="a sum from 0 to 1999 is too long"):
        read_ode("x'=sum(0,1999)of(x+i'*x)\n")
    for nested in (
        "sum(0,1)of(" * 3000 + "x",
        "shift(x," + "(" * 5000 + "1" + ")" * 5001,
        "shift(x," + "-" * 9000 + "1)",
    ):
        with pytest.raises(ModelFileError):
            read_ode(f"x'={nested}\n")


def test_a_file_may_have_just_so_many_lines(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(xppaut_arrays, "LINES", 4)
    assert len(read_ode("x'=-x\n%[1..3]\ny[j]'=x\n%\n").states) == 4
    with pytest.raises(ModelFileError, match=r"line 3: .* more than 4 lines"):
        read_ode("x'=-x\n%[1..4]\ny[j]'=x\n%\n")


def test_sums_and_shifts_are_written_out() -> None:
    states = ("x0", "x1", "x2", "y")
    assert without_sums("2*sum(0,2)of(i'*shift(x0,i'))", states, longest=99) == "2*(((0)*x0)+((1)*x1)+((2)*x2))"
    assert without_sums("shift(x1,mod(-1,3)-(2*1-1))+pi'", states, longest=99) == "x2+pi'"
    assert without_sums("sum(1,0)of(y)", states, longest=99) == "(0)"
    assert without_sums("shift(x1,mod(7,1)+mod(1,2))", states, longest=99) == "x2"
    assert without_sums("shift(x0,1+2)-shift(y,1-2*2)+shift(x1,-mod(5,2))", states, longest=99) == "y-x0+x0"


# What was closed before makes no room for more.
DEEP = "+".join(["(0)"] * 60 + ["(" * 101 + "1" + ")" * 101])


@pytest.mark.parametrize("by", ["3", "-2", "mod(1,0)", "mod(1,-2)", "mod(1)", "2*", "1.5", "10000000000", DEEP])
def test_a_shift_to_no_state_is_refused(by: str) -> None:
    with pytest.raises(ModelFileError):
        without_sums(f"shift(x1,{by})", ("x0", "x1", "x2", "y"), longest=99)


def test_a_constant_of_the_start_that_moves_is_refused() -> None:
    with pytest.raises(ModelFileError, match=r"line 2: !k is a constant for XPPAUT.*uses x"):
        read_ode("x'=k\n!k=2*m\nm=x+1\n")
    with pytest.raises(ModelFileError, match=r"line 1: !k is a constant for XPPAUT.*uses t"):
        read_ode("!k=t\nx'=k\n")
    assert "k" in read_ode("par a=1\n!k=2*a\nx'=k-x\n").definitions


def test_a_quantity_that_xppaut_takes_from_the_step_before_is_told() -> None:
    for text, line in (("a=b+1\nb=x\nx'=a\n", 1), ("f(u)=u+b\na=f(x)\nb=x\nx'=a\n", 2)):
        told = " ".join(read_ode(text).notes)
        assert f"a (line {line}) uses b; XPPAUT takes its value of the step before" in told
    # By way of functions that use one another, of which the outer ones stand above.
    chain = "".join(f"f{k}(u)=f{k + 1}(u)+1\n" for k in range(8))
    told = " ".join(read_ode(f"{chain}f8(u)=u+b\na=f0(x)\nb=x\nx'=a\n").notes)
    assert "a (line 10) uses b;" in told
    # A function is worked out where it is called, and a constant before all others.
    model = read_ode("f(u)=u+b\nb=x*k\na=f(x)\n!k=2\nx'=a\n")
    assert len(model.definitions) == 4
    assert "step before" not in " ".join(model.notes)


def test_three_dots_are_two() -> None:
    assert lines("x[1...2]'=-x[j]") == lines("x[1..2]'=-x[j]")
    assert lines("%[1...2]\nx[j]'=1\n%") == lines("%[1..2]\nx[j]'=1\n%")


@pytest.mark.parametrize(
    ("text", "first", "second"),
    [
        ("x'=-x\na=b+1\nb=x+1\naux c=a\ninit x=1", 1.0, 3.0),
        ("x'=-x\n!k=x+1\naux c=k\ninit x=1", 2.0, 2.0),
    ],
)
def test_xppaut_has_these_values_at_the_start_and_a_step_later(text: str, first: float, second: float) -> None:
    rows, _ = xppaut.run(f"{text}\n@ meth=euler,dt=.5,total=.5\ndone\n")
    assert rows[:, -1].tolist() == [first, second]


@pytest.mark.parametrize("path", WITH_ARRAYS, ids=lambda path: path.stem)
def test_arrays_are_written_out_as_xppaut_prints_them(path: Path) -> None:
    rows, printed = xppaut.run(path.read_text())
    theirs = {
        name.lower(): "".join(rate.lower().split())
        for name, rate in re.findall(r"(?m)^\d+:d(\w+)/dt=(.*)$", printed)
    }
    text = path.read_text().lower().replace("\\\n", "")
    said = (
        (i, " ".join(line.split())) for i, line in enumerate(text.splitlines(), 1) if line.strip(" #") == line
    )
    written = "\n".join(line for _, line in written_out(pair for pair in said if pair[1]))
    ours = {
        (one or other): "".join(rate.split())
        for one, other, rate in re.findall(r"(?m)^(?:(\w+) ?'|d(\w+)/dt) ?=(.*)$", written)
    }
    assert len(theirs) == len(read_ode(path.read_text()).states)
    assert ours == theirs
    assert np.isfinite(rows[0]).all()


def test_there_are_files_with_arrays() -> None:
    assert len(WITH_ARRAYS) >= 6
    assert len(FILES) >= 20


def test_the_order_of_thousands_of_quantities_is_looked_at_once(monkeypatch: pytest.MonkeyPatch) -> None:
    counted = Counter()
    carried = xppaut_order._carried

    def looked_at(uses: Mapping[str, set[str]], moving: set[str]) -> dict[str, str]:
        class Counting(dict):
            def __getitem__(self, name: str) -> set[str]:
                counted[name] += 1
                return super().__getitem__(name)

        return carried(Counting(uses), moving)

    monkeypatch.setattr(xppaut_order, "_carried", looked_at)
    chain = "\n".join(f"!a{i}=a{i - 1}+1" if i else "!a0=1" for i in range(1500))
    assert len(read_ode(f"{chain}\nx'=a1499-x\n").definitions) == 1500
    assert set(counted.values()) == {1}
