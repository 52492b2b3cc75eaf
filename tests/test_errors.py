"""Exceptions carry what a caller decides on, and nothing in the package takes their text apart."""

import ast
import copy
import dataclasses
import pickle
from pathlib import Path

import pytest

import gsp
from gsp import models
from gsp.algebra import ring
from gsp.errors import (
    NO_REASON,
    BudgetError,
    DeclarationError,
    GspError,
    ModelFileError,
    Named,
    Reason,
    UnknownNameError,
    one_line,
)
from gsp.readers.expressions import CHARACTERS, parse_expression
from gsp.readers.toml import CLAIMS, read_model
from gsp.results.attempts import Missing, attempt

ROOT = Path(gsp.__file__).parent
# Methods of text that find or cut something in it.
CUTTING = {
    *("startswith", "endswith", "split", "rsplit", "partition", "rpartition", "splitlines", "find", "rfind"),
    *("index", "rindex", "count", "removeprefix", "removesuffix", "strip", "lstrip", "rstrip", "replace"),
}
# Attributes and variables that hold sentences.
TEXTS = {"message", "reason", "fact", "remedy", "meaning", "note", "why", "why_not"}
# Where text is made of fields in the first place.
MAKING = {"errors.py"}


def is_sentence(node: ast.AST) -> bool:
    return isinstance(node, ast.Constant) and isinstance(node.value, str) and " " in node.value.strip()


def is_told(node: ast.AST, told: set[str], caught: set[str]) -> bool:
    """Whether a node is the text of an exception, a status or a reason."""
    if isinstance(node, ast.Name):
        # A meaning by itself is a mapping from names to symbols.
        return node.id in told or node.id in TEXTS - {"meaning"}
    if isinstance(node, ast.Call) and isinstance(node.func, ast.Name) and node.func.id in ("str", "repr"):
        return bool(node.args) and isinstance(node.args[0], ast.Name) and node.args[0].id in caught
    if isinstance(node, ast.JoinedStr):
        inside = [value.value for value in node.values if isinstance(value, ast.FormattedValue)]
        return any(isinstance(value, ast.Name) and value.id in caught for value in inside)
    if isinstance(node, ast.Subscript):
        return is_told(node.value, told, caught)
    if isinstance(node, ast.Attribute):
        of_error = isinstance(node.value, ast.Name) and node.value.id in caught
        return node.attr in TEXTS or (of_error and node.attr == "args")
    return False


def taken_apart(source: str) -> list[int]:
    """Lines of a module in which the text of an exception, a status or a reason is searched, compared or cut.

    What is only shown may be cut short at its end.
    """
    nodes = list(ast.walk(ast.parse(source)))
    caught = {node.name for node in nodes if isinstance(node, ast.ExceptHandler) and node.name}
    told: set[str] = set()
    for node in nodes:
        if isinstance(node, ast.Assign) and is_told(node.value, set(), caught):
            told |= {target.id for target in node.targets if isinstance(target, ast.Name)}
    found = []
    for node in nodes:
        looked: list[ast.expr] = []
        if isinstance(node, ast.Call) and isinstance(node.func, ast.Attribute):
            is_pattern = isinstance(node.func.value, ast.Name) and node.func.value.id == "re"
            looked = node.args[1:] if is_pattern else [node.func.value] * (node.func.attr in CUTTING)
        elif isinstance(node, ast.Subscript):
            is_end = isinstance(node.slice, ast.Slice) and node.slice.lower is None
            looked = [] if is_end else [node.value]
        elif isinstance(node, ast.Compare):
            sides = [node.left, *node.comparators]
            # Whether there is a text at all may be asked.
            asks = any(isinstance(side, ast.Constant) and side.value in ("", None) for side in sides)
            looked = [] if asks else sides
            if isinstance(node.ops[0], (ast.In, ast.NotIn, ast.Eq, ast.NotEq)) and any(map(is_sentence, sides)):
                found.append(node.lineno)
        if any(is_told(part, told, caught) for part in looked):
            found.append(node.lineno)
    return sorted(set(found))


@pytest.mark.parametrize(
    "line",
    [
        "x = str(error).split('. ')[0]",
        "x = 'fold' in str(error)",
        "x = str(error)[3:]",
        "x = error.args[0].startswith('no')",
        "x = run.message.startswith('no')",
        "x = re.match('a', str(error))",
        "x = f'{error}'.partition(':')",
        "x = status.meaning == 'a fold'",
        "text = str(error); x = text.split()",
        "x = 'followed only' in note",
        "x = any('followed only' in text for text in notes)",
        "x = kind.value == 'transcritical point'",
        "x = candidate.why_not.startswith(END)",
        "x = why.startswith((GAP, END))",
    ],
)
def test_text_that_is_taken_apart_is_found(line: str) -> None:
    assert taken_apart(f"try:\n    pass\nexcept ValueError as error:\n    {line}") == [4]


@pytest.mark.parametrize(
    "line",
    [
        "raise KeyError(str(error))",
        "x = error.reason",
        "x = f'so: {error}'",
        "x = reason == ''",
        "x = str(error)[:80]",
    ],
)
def test_text_that_is_handed_on_is_not(line: str) -> None:
    assert not taken_apart(f"try:\n    pass\nexcept ValueError as error:\n    {line}")


def test_nothing_is_decided_on_the_text_of_an_exception() -> None:
    found = {
        str(path.relative_to(ROOT)): lines
        for path in sorted(ROOT.rglob("*.py"))
        if path.relative_to(ROOT).as_posix() not in MAKING
        if (lines := taken_apart(path.read_text(encoding="utf-8")))
    }
    assert not found


def test_the_text_is_made_of_the_fields() -> None:
    error = DeclarationError("span is a pair.", "Write (0, 1).", got="3 of them", value=3)
    assert str(error) == "span is a pair. Got 3 of them. Write (0, 1)."
    assert (error.fact, error.value, error.remedy) == ("span is a pair", 3, "Write (0, 1).")


@pytest.mark.parametrize(
    "error",
    [
        UnknownNameError("there is no 'q'.", value="q", known=("x", "y")),
        BudgetError("too many terms.", limit=10, value=12),
        DeclarationError("no number.", got="a function", value=lambda: None),
    ],
)
def test_fields_cross_to_another_process(error: GspError) -> None:
    for other in (pickle.loads(pickle.dumps(error)), copy.copy(error)):
        assert type(other) is type(error)
        assert (str(other), other.fact, other.known, other.limit) == (
            str(error),
            error.fact,
            error.known,
            error.limit,
        )
        assert other.value == (None if callable(error.value) else error.value)


def test_an_unknown_name_tells_the_name_and_what_there_is() -> None:
    with pytest.raises(UnknownNameError) as caught:
        Named(alpha=1, beta=2)["alhpa"]
    assert (caught.value.name, caught.value.known) == ("alhpa", ("alpha", "beta"))
    assert 'Did you mean "alpha"?' in str(caught.value)
    scene = models.load("van_der_pol")
    with pytest.raises(DeclarationError) as refused:
        gsp.integrate(scene.system, start={"x": 1.0, "q": 0.0}, span=(0.0, 1.0), epsilon=0.1)
    assert refused.value.value == "q"
    assert set(refused.value.known) == {"x", "y"}


def test_a_budget_tells_its_limit_and_what_was_spent(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(ring, "PRODUCT", 20)
    with pytest.raises(BudgetError) as caught:
        gsp.study(models.load("michaelis_menten")).series(6, symbolic=True)
    assert caught.value.limit == 20
    assert isinstance(caught.value.spent, int)
    assert caught.value.spent > 20


def test_a_file_tells_the_limit_that_it_breaks() -> None:
    with pytest.raises(ModelFileError) as caught:
        parse_expression("1" * (CHARACTERS + 1), symbols={})
    assert (caught.value.limit, caught.value.value) == (CHARACTERS, CHARACTERS + 1)
    claims = "".join(f"[claims.c{i}]\nx = '0'\n" for i in range(CLAIMS + 1))
    text = "[slow]\nx = '1'\n[fast]\ny = 'x - y'\n[region]\nx = [0, 1]\n[start]\nx = 0\ny = 0\n"
    with pytest.raises(ModelFileError) as caught:
        read_model(f"{text}[scene]\nspan = [0, 1]\nepsilon = 0.1\n{claims}", name="many")
    assert (caught.value.limit, caught.value.value) == (CLAIMS, CLAIMS + 1)


def test_a_start_outside_the_region_is_told_as_a_point() -> None:
    scene = models.load("michaelis_menten")
    _, high = scene.region["s"]
    with pytest.raises(DeclarationError) as caught:
        dataclasses.replace(scene, start={**scene.start, "s": high + 1.0})
    assert caught.value.point is not None
    assert caught.value.point["s"] == caught.value.value == high + 1.0


def test_an_error_keeps_its_fields_under_the_place_where_it_was_met() -> None:
    error = BudgetError("too long.", "Cut it.", limit=3, value=4).under("line 2")
    assert isinstance(error, BudgetError)
    assert str(error) == "line 2: too long. Cut it."
    assert (error.fact, error.remedy, error.limit, error.spent) == ("line 2: too long", "Cut it.", 3, 4)
    other = ModelFileError.of(error, "a.toml")
    assert isinstance(other, ModelFileError)
    assert (str(other), other.limit) == ("a.toml: line 2: too long. Cut it.", 3)


def test_what_is_missing_has_a_reason_with_its_fact_apart() -> None:
    def refuse() -> None:
        raise GspError("the branch 1. Ordnung ends.", "Shrink the region.", got="x = 1. 2")

    missing = attempt("a part", refuse)
    assert isinstance(missing, Missing)
    assert missing.reason == "the branch 1. Ordnung ends. Got x = 1. 2. Shrink the region."
    assert (missing.reason.fact, missing.reason.remedy) == ("the branch 1. Ordnung ends", "Shrink the region.")
    assert pickle.loads(pickle.dumps(missing.reason)).fact == missing.reason.fact
    assert not NO_REASON
    assert Reason("it ends.").fact == "it ends"


def test_what_is_shown_of_an_exception_is_one_line() -> None:
    assert one_line(GspError("a\nb")) == "a b"
    assert one_line(KeyError("a"), 6) == "KeyErr"
