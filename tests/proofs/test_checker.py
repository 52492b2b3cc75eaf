"""The checker of normal hyperbolicity on a proof written by hand: y = 0 and v = 0 over x in [0, 1]."""

from fractions import Fraction
from functools import partial
from typing import Any

import numpy as np
import pytest

from gsp.proofs import checker
from gsp.proofs.intervals import SHIFT
from tests import proof_files
from tests.proof_files import row

holds = partial(proof_files.holds, checker.checked)


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


@pytest.mark.parametrize(
    ("x", "y", "v", "said"),
    [
        (0.4375, 0.55, 0.0, True), (0.4375, -0.45, 0.0, False), (0.0625, -0.55, 0.0, True),
        (0.0625, 0.45, 0.0, False), (0.0625, 0.0, 0.55, True), (0.0625, 0.0, -0.45, False),
    ],
)  # fmt: skip
def test_the_point_lies_in_the_tube_along_its_tilted_line(x: float, y: float, v: float, said: bool) -> None:
    """The tube of the first half is |y - (x - 1/4)/2| < 1/2 and |v + (x - 1/4)/2| < 1/2."""
    plain = proof() | {"through": row(x, y, v)}
    plain["tree"][1]["slope"] = row(0.5, -0.5)
    assert holds(plain) is said


@pytest.mark.parametrize("narrow", [1, 2])
@pytest.mark.parametrize(("radius", "said"), [(0.2, True), (0.3, False)])
def test_the_glue_lies_in_the_tube_of_either_half(narrow: int, radius: float, said: bool) -> None:
    plain = proof()
    plain["tree"][narrow]["radius"] = row(0.25, 0.25)
    plain["tree"][0]["glue"]["radius"] = row(radius, 0.125)
    assert holds(plain) is said


@pytest.mark.parametrize("place", [1, 2])
@pytest.mark.parametrize(("value", "said"), [(0.25, True), (-0.25, True), (0.5, False), (3.0, False)])
def test_the_point_is_in_the_tube_in_every_direction(place: int, value: float, said: bool) -> None:
    plain = proof()
    plain["through"][place] = value.hex()
    assert holds(plain) is said


def single(equations: list[str], **node: Any) -> dict:
    """A proof of one box [-1, 1] of each slow variable, fast variables near 0."""
    m = len(equations)
    n = len(node.get("box", [-1.0, 1.0])) // 2
    unit = [float(i == j) for i in range(m) for j in range(m)]
    part = {"middle": n * [0.0], "centre": m * [0.0], "slope": m * n * [0.0], "radius": m * [0.5]}
    part |= {"inverse": [-v for v in unit], "box": n * [-1.0, 1.0], "basis": unit}
    gap = node.pop("gap", 2.0**-90)
    box = (part | node)["box"]
    return {
        "format": checker.FORMAT,
        "names": [f"v{i}" for i in range(n + m)],
        "over": n,
        "equations": equations,
        "region": [row(low, high) for low, high in zip(box[::2], box[1::2])],
        "claim": {"stable": m, "unstable": 0, "gap": gap.hex()},
        "through": row(*(part | node)["middle"], *(part | node)["centre"]),
        "tree": [{key: row(*values) for key, values in (part | node).items()} | {"signs": m * [-1]}],
    }


NEAR = Fraction(1, 2**20)


def test_a_tube_of_a_linear_system_is_as_wide_as_the_condition_asks() -> None:
    """F = A x + B y about 0: |C| |A + B T| h + |1 - C B| r < r, by components; whatever the spectrum is."""
    draw, random_matrix = np.random.default_rng(3), {}
    for n, m in 12 * [(1, 1), (2, 1), (1, 2), (2, 3)]:
        for name, shape in (("A", (m, n)), ("T", (m, n)), ("E", (m, m))):
            random_matrix[name] = draw.integers(-8, 9, shape) / 16
        A, T = random_matrix["A"], random_matrix["T"]
        # B = -1 + E/4 and C = -1: 1 - C B = E/4.
        B, r = random_matrix["E"] / 4 - np.eye(m), draw.integers(12, 17, m) / 16
        room = (r - abs(np.eye(m) + B) @ r) / np.maximum(abs(A + B @ T) @ np.ones(n), 1e-9)
        equations = [
            " + ".join(
                f"({as_text(v)})*z{k}" for k, v in enumerate([*A[i], *B[i]])
            )
            for i in range(m)
        ]  # fmt: skip
        for share, said in ((1 - NEAR, True), (1 + NEAR, False)):
            h = float(share) * room.min()
            plain = single(
                equations, box=n * [-h, h], slope=T.ravel().tolist(), radius=r.tolist(), gap=2.0**-90
            )
            assert holds(plain) is said, (A, B, T, r)


def as_text(value: float) -> str:
    numerator, denominator = value.as_integer_ratio()
    return f"{numerator}/{denominator}"


@pytest.mark.parametrize("sign", ["", "-"])
def test_an_image_that_reaches_the_side_of_the_tube_is_not_inside(sign: str) -> None:
    for share, said in ((Fraction(1), False), (1 - NEAR, True)):
        assert holds(single([f"-z1 + ({sign}{share / 2})"])) is said


@pytest.mark.parametrize("sign", ["", "-"])
def test_what_is_less_than_a_unit_is_rounded_against_the_claim(sign: str) -> None:
    unit, most = 2.0**-SHIFT, SHIFT - 6
    # The image is one unit from the middle; a radius is rounded down.
    for radius, said in ((1.0, False), (1.5, False), (2.5, True)):
        assert holds(single([f"-z1 + ({sign}1/{2**SHIFT})"], radius=[radius * unit])) is said
    # A box that ends half a unit from 0 reaches it.
    ends = (0.5 * unit, 1.0) if not sign else (-1.0, -0.5 * unit)
    assert not holds(single([f"-z1 + 0*sqrt({sign}z0)"], box=ends, middle=[0.5 * sum(ends)]))
    ends = (1.5 * unit, 1.0) if not sign else (-1.0, -1.5 * unit)
    assert holds(single([f"-z1 + 0*sqrt({sign}z0)"], box=ends, middle=[0.5 * sum(ends)]))
    # A rate of 64 units; the claim is rounded up. What is off the diagonal is halved away from 0.
    for gap, said in ((62.5, True), (63.0, True), (63.5, False), (64.0, False)):
        assert holds(single([f"-z1/{2**most}"], gap=gap * unit, inverse=[-(2.0**most)])) is said
    rates = [f"-z1/{2**most} + ({sign}z2)/{2**SHIFT}", f"-z2/{2**most}"]
    for gap, said in ((62.0, True), (63.0, False)):
        plain = single(
            rates, gap=gap * unit, inverse=[-(2.0**most), 0.0, 0.0, -(2.0**most)], radius=[2.0**-3] * 2
        )
        assert holds(plain) is said


def test_a_gap_is_that_of_the_symmetric_part_in_the_basis() -> None:
    # y' = -y + q v, v' = -v: 1 - |q|/2, and in a basis that shortens v as much as is liked.
    for q in (0.5, -0.5):
        for gap, said in ((0.75 - 2.0**-40, True), (0.75 + 2.0**-40, False)):
            assert holds(single([f"-z1 + ({as_text(q)})*z2", "-z2"], gap=gap)) is said
            turned = single([f"-z1 + ({as_text(q)})*z2", "-z2"], gap=gap, basis=[4.0, 0.0, 0.0, 1.0])
            assert holds(turned) is True


@pytest.mark.parametrize(
    "more",
    [
        {"over": 0}, {"over": 3}, {"over": 4}, {"equations": ["-z1"]}, {"equations": []}, {"tree": []}, {"tree": {}},
        {"claim": {"stable": 1, "unstable": 1, "gap": (0.5).hex()}}, {"format": "none"}, {"tree": [1]},
        {"claim": {"stable": 2, "unstable": 1, "gap": (0.5).hex()}}, {"region": [row(0.0, 0.75)]},
        {"claim": {"stable": 2, "unstable": 0, "gap": (0.0).hex()}}, {"through": row(2.0, 0.0, 0.0)},
        {"tree": proof()["tree"][:2]}, {"tree": [*proof()["tree"], leaf(0.5, 1.0)]}, {"tree": [leaf(0.0, 0.5)]},
        {"tree": [proof()["tree"][0] | {"at": (1.0).hex()}, *proof()["tree"][1:]]},
        {"tree": [proof()["tree"][0] | {"glue": tube(0.25, 0.125)}, *proof()["tree"][1:]]},
        {"tree": [proof()["tree"][0] | {"glue": tube(0.5, 0.0)}, *proof()["tree"][1:]]},
        {"tree": [proof()["tree"][0], leaf(0.5, 1.0), leaf(0.0, 0.5)]},
    ],
)  # fmt: skip
def test_what_is_no_proof_is_refused(more: dict) -> None:
    assert not holds(proof() | more)
