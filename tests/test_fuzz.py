"""What the fuzzer found stays mended, its inputs are the same for the same seed, and a few of them go through."""

import itertools
from pathlib import Path

import pytest

from gsp.errors import DeclarationError, GspError
from gsp.systems.flow import check_epsilon
from tests.cases import thinned
from tests.fuzz.inputs import CASES, TEMPLATES, inputs
from tests.fuzz.run import check, read

FILES = sorted(CASES.glob("*.toml"))


@pytest.mark.parametrize("path", thinned(FILES, 2), ids=[path.stem for path in FILES])
def test_a_file_that_was_found_ends_in_a_verdict_or_in_our_own_error(path: Path, tmp_path: Path) -> None:
    scene = read(path.read_text(encoding="utf-8"), tmp_path)
    if not isinstance(scene, GspError):
        assert check(scene)


def test_the_templates_are_valid(tmp_path: Path) -> None:
    for text in TEMPLATES:
        scene = read(text, tmp_path)
        assert not isinstance(scene, GspError), scene
        assert check(scene).startswith("attracting")


def test_inputs_are_the_same_for_the_same_seed_and_some_are_read(tmp_path: Path) -> None:
    texts = [list(itertools.islice(inputs(7), 300)) for _ in range(2)]
    assert texts[0] == texts[1]
    answers = [read(text, tmp_path) for text in texts[0]]
    read_ = sum(not isinstance(answer, GspError) for answer in answers)
    assert 10 < read_ < 290


@pytest.mark.parametrize("epsilon", [1e-300, 1e300])
def test_an_epsilon_beyond_double_precision_is_refused(epsilon: float) -> None:
    with pytest.raises(DeclarationError, match="powers leave double precision"):
        check_epsilon(epsilon)
