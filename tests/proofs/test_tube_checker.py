"""The checker of tubes on proofs written by hand: what it accepts reaches as far as the theorem does, and no further.

x' = s k x, epsilon y' = s (y - x) with y = x + epsilon z, in |x| <= 1: epsilon z' = s (z - k x). The face is crossed
where d > k; with cones of slope L and a collar c, and p the slow rate -k towards s = -1 backwards,

    (tau - 2 epsilon (p + c)) (2 - tau) > (k/L)^2 for tau halfway.
"""

import contextlib
import copy
from functools import partial
from typing import Any

import pytest

from gsp.proofs import intervals, tube_checker
from gsp.proofs.programs import Rejected
from tests import proof_files

NEAR = 2.0**-20
UNIT = 2.0**-intervals.SHIFT
holds = partial(proof_files.holds, tube_checker.check)


def proof(*, sign: int = -1, rate: str = "1", epsilon: float = 0.25, **more: Any) -> dict:
    """s = `sign`, k = `rate`: with the rate 1 solutions of the slow field go as s says, with -1 against it."""
    s, collar = ("" if sign > 0 else "-"), 4.0 / 3.0
    width, steep = 1.0 + NEAR, (1.0 + NEAR) / 0.5
    plain = {
        "format": "gsp slow manifold 2",
        "slow": ["x"],
        "parameters": [],
        "fast": ["y"],
        "epsilon_name": "epsilon",
        "rates": [f"{s}({rate})*z0"],
        "equations": [f"{s}(z1 - z0)"],
        "series": [["z0"]],
        "basis": ["1"],
        "remainder": [f"{s}(z1 - ({rate})*z0)"],
        "region": [[(-1.0).hex(), (1.0).hex()]],
        "epsilon": epsilon.hex(),
        "blocks": [[0]],
        "signs": [sign],
        "widths": [width.hex()],
        "reach": [(width * (1 + NEAR)).hex()],
        "boundary": "mixed",
        "unique": False,
        # |f| <= 1.
        "collar": ((1.0 + NEAR) / collar).hex(),
        "cones": [
            {"low": (0.0).hex(), "high": epsilon.hex(), "slope": (steep * 1.2).hex(), "collar": collar.hex()}
        ],
    }
    return plain | more


def cone(plain: dict, **more: float) -> dict:
    """The proof with other cones."""
    found = copy.deepcopy(plain)
    found["cones"][0] |= {key: value.hex() for key, value in more.items()}
    return found


@pytest.mark.parametrize("sign", [-1, 1])
def test_a_face_is_crossed_as_far_as_it_is(sign: int) -> None:
    # rho = x, up to 1.
    assert holds(proof(sign=sign))
    for share, said in ((1.0 - NEAR, False), (1.0, False), (1.0 + NEAR, True), (2.0, True)):
        assert holds(proof(sign=sign, widths=[share.hex()], reach=[(3.0).hex()])) is said


@pytest.mark.parametrize("sign", [-1, 1])
@pytest.mark.parametrize("epsilon", [0.0625, 0.25])
@pytest.mark.parametrize("collar", [1.25, 2.0])
def test_cones_hold_as_far_as_they_do(sign: int, epsilon: float, collar: float) -> None:
    # (1 - epsilon (1 + c))^2 > 1/L^2.
    least = 1.0 / (1.0 - epsilon * (1.0 + collar))
    plain = proof(sign=sign, epsilon=epsilon, collar=(0.875).hex())
    for share, said in ((1.0 - 1e-4, False), (1.0 + 1e-4, True)):
        assert holds(cone(plain, slope=share * least, collar=collar)) is said


@pytest.mark.parametrize(("slope", "said"), [(0.5, False), (0.95, False), (4.0, True)])
def test_cones_are_not_taken_for_granted_where_no_decay_is_seen(slope: float, said: bool) -> None:
    # Over the whole region the decay 1 + n is from -2 to 4; n is 0.
    n = "((1 + z0**2)**2 - 1 - 2*z0**2 - z0**4)"
    plain = proof(epsilon=0.0625, equations=[f"-(z1 - z0)*(1 + {n})"], remainder=[f"-z1*(1 + {n}) + z0"])
    plain |= {"widths": [(1.25).hex()], "reach": [(2.0).hex()], "collar": (0.875).hex()}
    least = 1.0 / (1.0 - 0.0625 * 2.25)
    assert holds(cone(plain, slope=slope * least, collar=1.25)) is said


@pytest.mark.parametrize("sign", [-1, 1])
@pytest.mark.parametrize("collar", [1.25, 2.0])
def test_a_slow_flow_that_helps_is_cut_off_to_one_that_does_not(sign: int, collar: float) -> None:
    # Against the sign of the fast direction, and at rest at the sides: (1 - epsilon c)^2 > 1/L^2.
    plain = proof(sign=sign, rate="-1", collar=(0.875).hex())
    for share, said in ((1.0 - 1e-4, False), (1.0 + 1e-4, True)):
        assert holds(cone(plain, slope=share / (1.0 - 0.25 * collar), collar=collar)) is said


def test_the_slow_rate_is_that_on_the_graph() -> None:
    # x' = -y with y = x + epsilon z: epsilon x' = -epsilon x - epsilon^2 z, epsilon z' = -(1 - epsilon) z + x, and
    # 1 - 2 epsilon - epsilon c > 1/L + epsilon^2 L is needed.
    plain = proof(epsilon=0.0625, rates=["-z1"], remainder=["-(1 - z2)*z1 + z0"], widths=[(1.1).hex()])
    plain |= {"reach": [(1.2).hex()], "collar": (0.625).hex()}
    for slope, said in ((1.25, False), (1.4, True), (16.0, True), (180.0, True), (200.0, False)):
        assert holds(cone(plain, slope=slope, collar=2.0)) is said, slope


def test_a_residual_grows_with_epsilon() -> None:
    # rho = x + 2 epsilon, up to 3/2.
    plain = proof(equations=["-(z1 - z0) + 2*z2**2"], remainder=["-z1 + z0 + 2*z2"], reach=[(3.0).hex()])
    for share, said in ((1.0 - NEAR, False), (1.0 + NEAR, True)):
        assert holds(plain | {"widths": [(1.5 * share).hex()]}) is said


def test_a_residual_is_looked_at_from_within_its_box() -> None:
    # rho = 3 + 1/x on [1, 3], up to 4; seen from -1 it would be 2 at most.
    plain = proof(epsilon=0.0625, equations=["-(z1 - z0) + z2*(3 + 1/z0 - z0)"], remainder=["-z1 + 3 + 1/z0"])
    plain = cone(plain, slope=16.0, collar=4.0) | {"reach": [(9.0).hex()], "collar": (0.875).hex()}
    plain |= {"region": [[(1.0).hex(), (3.0).hex()]]}
    for width, said in ((2.5, False), (3.9, False), (4.1, True)):
        assert holds(plain | {"widths": [width.hex()]}) is said


@pytest.mark.parametrize(("rate", "left", "said"), [
    ("-z0 + 8*z2", "z0 - 8*z2", True), ("-z0 + 20*z2", "z0 - 20*z2", False), ("-z0 + 1", "z0 - 1", False),
    ("-z0 - 20*z2", "z0 + 20*z2", False), ("-z0 - 1", "z0 + 1", False),
])  # fmt: skip
def test_the_slow_flow_at_a_side_is_that_for_every_epsilon_and_strict(rate: str, left: str, said: bool) -> None:
    plain = proof(epsilon=0.0625, rates=[rate], remainder=[f"-z1 + {left}"], boundary="inflowing")
    plain = cone(plain, slope=16.0, collar=4.0) | {"widths": [(2.5).hex()], "reach": [(9.0).hex()]}
    assert holds(plain | {"collar": (0.75).hex()}) is said
    assert holds(plain | {"collar": (0.75).hex(), "boundary": "mixed"})


def test_a_face_is_crossed_on_both_sides_of_the_graph() -> None:
    # epsilon z' = -z + x - epsilon z^2 falls least at z = -d: (1 - d/8) d > 1 with epsilon = 1/16.
    plain = proof(epsilon=0.0625, equations=["-(z1 - z0) - (z1 - z0)**2"], remainder=["-z1 + z0 - z2*z1**2"])
    plain = cone(plain, slope=16.0) | {"reach": [(3.0).hex()]}
    for width, said in ((1.1, False), (1.2, True)):
        assert holds(plain | {"widths": [width.hex()]}) is said


def test_the_basis_is_regular_all_over_the_region() -> None:
    # y = x + epsilon x z, so that epsilon z' = -z + 1 + epsilon z: polynomials, and P is 0 at x = 0.
    plain = proof(epsilon=0.0625, basis=["z0"], remainder=["-z1 + 1 + z2*z1"], widths=[(1.125).hex()])
    plain = cone(plain, slope=16.0, collar=8.0) | {"reach": [(3.5).hex()], "collar": (0.5).hex()}
    for low, high, said in ((-1.0, 1.0, False), (0.0, 2.0, False), (-3.0, -1.0, True), (0.5, 2.0, True)):
        assert holds(plain | {"region": [[low.hex(), high.hex()]]}) is said


@pytest.mark.parametrize(("pole", "said"), [("1/8", False), ("1/4", False), ("3", True)])
def test_the_field_is_defined_all_over_the_tube(pole: str, said: bool) -> None:
    # What the pole divides is 0 there as well, and Gamma is a polynomial; |y - x| <= epsilon d.
    equations = [f"-(z1 - z0)*(z1 - z0 - {pole})/(z1 - z0 - {pole})"]
    assert holds(cone(proof(equations=equations), collar=1.25) | {"collar": (0.875).hex()}) is said


@pytest.mark.parametrize("sign", [-1, 1])
def test_without_a_collar_the_slow_rate_counts_with_its_sign(sign: int) -> None:
    # Against the sign of the fast direction the slow rate only helps: (1 + 2 epsilon) > 1/L^2, from epsilon = 0 on.
    boundary = "overflowing" if sign < 0 else "inflowing"
    plain = proof(sign=sign, rate="-1", boundary=boundary, unique=True, collar=(0.0).hex())
    for share, said in ((1.0 - 1e-4, False), (1.0 + 1e-4, True)):
        assert holds(cone(plain, slope=share, collar=0.0)) is said


@pytest.mark.parametrize("sign", [-1, 1])
@pytest.mark.parametrize("rate", ["1", "-1"])
@pytest.mark.parametrize("boundary", ["overflowing", "inflowing", "mixed"])
def test_unique_is_what_stays_by_itself(sign: int, rate: str, boundary: str) -> None:
    outwards = (sign > 0) == (rate == "1")
    so = boundary == ("overflowing" if outwards else "inflowing")
    plain = proof(sign=sign, rate=rate, epsilon=0.0625, boundary=boundary)
    assert holds(plain) is (so or boundary == "mixed")
    unique = cone(plain, collar=0.0) | {"unique": True, "collar": (0.0).hex()}
    assert holds(unique) is (so and rate == "-1")
    assert not holds(unique | {"collar": (0.125).hex()})
    assert not holds(unique | {"unique": False})
    if so:
        found = tube_checker.check(plain)
        assert (found.unique, found.boundary) == (False, boundary)


def test_the_collar_is_as_wide_as_the_flow_is_fast() -> None:
    # |f| = 1 at the sides, so that c w >= 1, and 2 w < 2.
    plain = cone(proof(epsilon=0.0625), slope=16.0)
    for collar, width, said in (
        (2.0, 0.5 * (1 - NEAR), False), (2.0, 0.5, True), (2.0, 0.5 * (1 + NEAR), True), (1.25, 0.75, False),
        (1.25, 0.875, True), (1.25, 1.0 - NEAR, True), (1.25, 1.0, False), (1.25, 1e300, False), (0.0, 0.5, False),
        (1e300, 0.5, False), (-2.0, -0.5, False), (-2.0, 0.5, False),
    ):  # fmt: skip
        assert holds(cone(plain, collar=collar) | {"collar": width.hex()}) is said, (collar, width)


def test_the_shortest_side_decides_and_intervals_of_parameters_have_no_collar() -> None:
    # x' = -x, v' = -v, with a parameter a that counts for nothing.
    plain = cone(proof(epsilon=0.0625), slope=16.0, collar=4.0)
    plain |= {"slow": ["x", "v"], "parameters": ["a"], "rates": ["-z0", "-z1"], "equations": ["-z3 + z0"]}
    plain |= {"remainder": ["-z3 + z0"], "collar": (0.375).hex()}
    sides = {"x": 1.0, "v": 1.0, "a": 0.0}

    def over(**more: float) -> dict:
        return plain | {"region": [[(-v).hex(), v.hex()] for v in (sides | more).values()]}

    assert holds(over())
    assert holds(over(v=0.5))
    assert not holds(over(v=0.375))
    assert not holds(over(x=0.375))
    assert holds(over(a=3.0))
    # |f| is the root of 2 at the corners.
    assert holds(over() | {"collar": (0.36).hex()})
    assert not holds(over() | {"collar": (0.3).hex()})


def test_every_step_of_epsilon_has_its_own_cones() -> None:
    plain = proof(epsilon=0.25, collar=(0.875).hex())
    low, high = ({"slope": (4.0).hex(), "collar": value.hex()} for value in (4.0, 1.25))
    first = low | {"low": (0.0).hex(), "high": (0.0625).hex()}
    second = high | {"low": (0.0625).hex(), "high": (0.25).hex()}
    assert holds(plain | {"cones": [first, second]})
    for cones in (
        [second, first], [first], [second], [first, second | {"low": (0.125).hex()}], [first, first, second],
        [first, second | {"high": (0.375).hex()}], [first | {"collar": (64.0).hex()}, second],
        [first, second | {"collar": (16.0).hex()}], [first | {"collar": (1.0).hex()}, second],
        [first, second | {"slope": (1.5).hex()}], [first | {"slope": (1.0).hex()}, second],
    ):  # fmt: skip
        assert not holds(plain | {"cones": cones}), cones


def test_the_reach_is_that_of_the_basis() -> None:
    # y = x + epsilon P z with P = 2: z is half as long.
    plain = proof() | {"basis": ["2"], "remainder": ["-(z1 - z0/2)"], "widths": [(0.5 * (1 + NEAR)).hex()]}
    plain = cone(plain, slope=16.0)
    for share, said in ((1.0, False), (1.0 + NEAR, True), (1.0 + 2 * NEAR, True)):
        assert holds(plain | {"reach": [share.hex()]}) is said


# x' = -x, epsilon y_0' = -y_0 + k y_1 + x, epsilon y_1' = -y_1, k = 1/2.
COUPLED = {
    "fast": ["u", "v"],
    "rates": ["-z0"],
    "equations": ["-z1 + z2/2 + z0", "-z2"],
    "series": [["z0", "0"]],
    "basis": ["1", "0", "0", "1"],
    "remainder": ["-z1 + z2/2 + z0", "-z2"],
    "reach": [(9.0).hex(), (9.0).hex()],
}


def coupled(**more: Any) -> dict:
    return cone(proof(epsilon=0.0625) | COUPLED | more, slope=16.0)


@pytest.mark.parametrize("other", [0.25, 1.0])
def test_other_blocks_are_taken_off_the_margin_of_a_face(other: float) -> None:
    # d_0 > 1 + d_1/2.
    for share, said in ((1.0 - NEAR, False), (1.0 + NEAR, True)):
        widths = [(share * (1.0 + 0.5 * other)).hex(), other.hex()]
        assert holds(coupled(blocks=[[0], [1]], signs=[-1, -1], widths=widths)) is said


def test_a_block_of_two_falls_as_its_symmetric_part() -> None:
    # (1 - k/2) d > 1, by Gershgorin's discs, which are sharp here.
    for share, said in ((1.0 - 1e-6, False), (1.0 + 1e-6, True)):
        assert holds(coupled(blocks=[[0, 1]], signs=[-1], widths=[(share / 0.75).hex()])) is said
    # |y_0| and |y_1| reach as far as the block: its norm.
    plain = coupled(blocks=[[0, 1]], signs=[-1], widths=[(2.0).hex()])
    assert holds(plain | {"reach": [(2.0 + NEAR).hex()] * 2})
    assert not holds(plain | {"reach": [(2.0 - NEAR).hex(), (9.0).hex()]})
    assert not holds(plain | {"reach": [(9.0).hex(), (2.0 - NEAR).hex()]})


@pytest.mark.parametrize(("fast", "signs"), [("z2", [-1, 1]), ("-z2", [-1, -1])])
def test_signs_are_those_of_the_blocks(fast: str, signs: list[int]) -> None:
    plain = coupled(equations=["-z1 + z0", fast], remainder=["-z1 + z0", fast], blocks=[[0], [1]])
    plain |= {"widths": [(1.5).hex(), (1.0).hex()]}
    for first in (-1, 1):
        for second in (-1, 1):
            assert holds(plain | {"signs": [first, second]}) is ([first, second] == signs)
    assert not holds(cone(plain, collar=0.0) | {"signs": signs, "unique": True, "collar": (0.0).hex()})
    found = tube_checker.check(plain | {"signs": signs})
    assert (found.stable, found.unstable) == (signs.count(-1), signs.count(1))


@pytest.mark.parametrize("sign", [-1, 1])
def test_the_other_directions_of_a_cone_count_by_half(sign: int) -> None:
    # epsilon z_0' = s z_0 + x drives epsilon z_1' = -s z_1 + q z_0. In the cone of z_1, of which tau is 1 where the
    # slow rates are small, (2 + tau)/2 (2 - tau) > q^2 is needed. With a whole z_0 in it 3 > q^2 would do, and then
    # the cones of a saddle need not meet in a graph.
    s, t = ("-", "") if sign < 0 else ("", "-")
    for q, said in (("6/5", True), ("5/4", False), ("3/2", False), ("17/10", False)):
        plain = coupled(
            equations=[f"{s}(z1 - z0)", f"{t}z2 + ({q})*(z1 - z0)"], blocks=[[0], [1]], epsilon=2.0**-20
        )
        plain = cone(plain, slope=2.0**10, high=2.0**-20)
        plain |= {"remainder": [f"{s}z1 + z0", f"{t}z2 + ({q})*z1"], "epsilon": (2.0**-20).hex()}
        plain |= {"signs": [sign, -sign], "widths": [(1.5).hex(), (8.0).hex()]}
        assert holds(plain) is said, q


def test_what_is_less_than_the_checker_resolves_is_rounded_against_the_claim() -> None:
    # y = 0 is invariant, and tubes about it may be as thin as they like; the unit is 2^-192.
    plain = cone(proof(epsilon=0.0625), slope=16.0) | {
        "equations": ["-z1"],
        "remainder": ["-z1"],
        "series": [["0"]],
    }
    for reach, said in ((1.5, False), (1.75, False), (2.5, True)):
        thin = {"widths": [(1.625 * UNIT).hex()], "reach": [(reach * UNIT).hex()]}
        assert holds(plain | thin) is said


def test_every_product_of_a_margin_is_rounded_against_the_claim() -> None:
    # epsilon z_0' = -z_0 + 3/5 z_1 + 3/5 z_2, |z_1| and |z_2| in one unit of 2^-192: 6/5 of one, and 1 + 1 rounded.
    plain = cone(proof(epsilon=0.0625), slope=16.0) | {
        "fast": ["u", "v", "w"],
        "equations": ["-z1 + 3/5*z2 + 3/5*z3", "-z2", "-z3"],
        "remainder": ["-z1 + 3/5*z2 + 3/5*z3", "-z2", "-z3"],
        "series": [["0", "0", "0"]],
        "basis": [str(int(i == j)) for i in range(3) for j in range(3)],
        "blocks": [[0], [1], [2]],
        "signs": [-1] * 3,
        "reach": [(64 * UNIT).hex()] * 3,
    }
    for units, said in ((1, False), (2, False), (3, True)):
        assert holds(plain | {"widths": [(k * UNIT).hex() for k in (units, 1, 1)]}) is said


def test_a_proof_takes_no_more_operations_than_the_bound(monkeypatch: pytest.MonkeyPatch) -> None:
    # What is added to Gamma is 0, and wide over a wide box: some boxes more for each factor of 10.
    def wide(factor: int) -> dict:
        nought = f"{factor}*((1 + z0**2)**2 - 1 - 2*z0**2 - z0**4)"
        plain = proof(widths=[(2.0).hex()], reach=[(4.0).hex()])
        return plain | {"equations": [f"-(z1 - z0) + z2*{nought}"], "remainder": [f"-(z1 - z0) + {nought}"]}

    def operations(plain: dict) -> int:
        found = tube_checker._TubeProof(plain)
        with contextlib.suppress(Rejected):
            found.checked()
        return found._operations()

    few, many = operations(wide(0)), operations(wide(10))
    assert 100 < few < many / 10
    for most, said in ((few - 1, True), (many, False)):
        monkeypatch.setattr(tube_checker, "MOST_OPERATIONS", most)
        with pytest.raises(Rejected) as refused:
            tube_checker.check(wide(10))
        assert ("operations on intervals" in str(refused.value)) is said
    # The last box is finished.
    monkeypatch.setattr(tube_checker, "MOST_OPERATIONS", few)
    assert operations(wide(10)) < 2 * few
