"""The checker of normal hyperbolicity on a proof written by hand: y = 0 and v = 0 over x in [0, 1]."""

import pytest

from gsp.proofs import checker
from gsp.proofs.programs import Rejected


def row(*values: float) -> list[str]:
    return [value.hex() for value in values]


def tube(middle: float, radius: float = 0.5) -> dict:
    return {
        "middle": row(middle),
        "centre": row(0.0, 0.0),
        "slope": row(0.0, 0.0),
        "radius": row(radius, radius),
        "inverse": row(-1.0, 0.0, 0.0, -1.0),
    }


def leaf(low: float, high: float) -> dict:
    return tube(0.5 * (low + high)) | {
        "box": row(low, high), "signs": [-1, -1], "basis": row(1.0, 0.0, 0.0, 1.0)
    }  # fmt: skip


def proof() -> dict:
    return {
        "format": checker.FORMAT,
        "names": ["x", "y", "v"],
        "over": 1,
        "equations": ["-z1", "-z2"],
        "region": [row(0.0, 1.0)],
        "claim": {"stable": 2, "unstable": 0, "gap": (0.75).hex()},
        "through": row(0.25, 0.0, 0.0),
        "tree": [{"axis": 0, "at": (0.5).hex(), "glue": tube(0.5, 0.125)}, leaf(0.0, 0.5), leaf(0.5, 1.0)],
    }


def holds(plain: dict) -> bool:
    try:
        checker.checked(plain)
    except Rejected:
        return False
    return True


def test_what_is_written_holds() -> None:
    found = checker.checked(proof())
    assert (found.boxes, found.stable, found.unstable, found.gap) == (2, 2, 0, 0.75)


@pytest.mark.parametrize(("gap", "said"), [(1.0 - 2.0**-50, True), (1.0, False), (1.0 + 2.0**-50, False)])
def test_the_gap_is_less_than_the_rates(gap: float, said: bool) -> None:
    assert holds(proof() | {"claim": {"stable": 2, "unstable": 0, "gap": gap.hex()}}) is said


@pytest.mark.parametrize(
    ("place", "value", "said"), [(0, 0.0, False), (3, 0.0, False), (0, -1.5, True), (0, -2.5, False)]
)
def test_the_image_is_in_the_interior(place: int, value: float, said: bool) -> None:
    # 1 - C D_y g is 1 + c: the image is the tube itself where c is 0, and a half of it where c is -3/2.
    plain = proof()
    plain["tree"][1]["inverse"][place] = value.hex()
    assert holds(plain) is said


@pytest.mark.parametrize(
    ("centre", "radius", "said"),
    [(0.0, 0.25, True), (0.0, 0.5, False), (0.25, 0.2, False), (0.25, 0.3, False), (0.0, 0.4, True)],
)
def test_the_whole_glue_lies_in_both_tubes(centre: float, radius: float, said: bool) -> None:
    plain = proof()
    plain["tree"][0]["glue"] |= {"radius": row(radius, 0.125), "centre": row(centre, 0.0)}
    assert holds(plain) is said


@pytest.mark.parametrize("place", [1, 2])
@pytest.mark.parametrize(("value", "said"), [(0.25, True), (-0.25, True), (0.5, False), (3.0, False)])
def test_the_point_is_in_the_tube_in_every_direction(place: int, value: float, said: bool) -> None:
    plain = proof()
    plain["through"][place] = value.hex()
    assert holds(plain) is said
