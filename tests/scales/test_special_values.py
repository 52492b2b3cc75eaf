"""Special parameter values: published counts, reductions in closed form, other variables, bounds."""

from __future__ import annotations

import itertools

import pytest
import sympy as sp

from gsp.algebra.elimination_over_rationals import generic_point
from gsp.errors import BudgetError, DeclarationError, Status
from gsp.scales import small_parameter, special_values
from gsp.scales.special_values import small_parameters
from gsp.systems.system import VectorField
from tests.scales.fields import (
    H,
    alpha,
    beta,
    delta,
    eta,
    field,
    gamma,
    in_other_variables,
    michaelis_menten,
    mutualism,
    rho,
    rosenzweig_macarthur,
)

# Special values, critical manifolds and reductions, of TikhonovFenichelReductions.jl's tests.
PUBLISHED = {
    "Michaelis-Menten": (michaelis_menten, {}, (12, 5, 15)),
    "Michaelis-Menten with k_-1 fixed": (michaelis_menten, {"kept": ["km1"]}, (7, 3, 8)),
    "Rosenzweig-MacArthur": (rosenzweig_macarthur, {}, (15, 7, 18)),
    "Rosenzweig-MacArthur with alpha = 1, beta = 0": (
        rosenzweig_macarthur,
        {"kept": ["alpha"], "vanishing": ["beta"]},
        (6, 3, 8),
    ),
    # Their 35 count two more, on which the linear part is nilpotent: see the next test.
    "mutualism": (mutualism, {"kept": ["k1", "k2", "k3"]}, (27, 12, 33)),
}


@pytest.mark.parametrize("name", PUBLISHED)
def test_as_many_are_found_as_were_published(name: str) -> None:
    make, options, wanted = PUBLISHED[name]
    given = make()
    found = small_parameters(given, dimensions=[len(given.states) - 1], **options)
    assert found.status is Status.SUCCESS
    values = {each.vanishing for each in found}
    assert (len(values), len({each.manifold for each in found}), len(found)) == wanted


@pytest.mark.parametrize(("kept", "state"), [("mu1", "H"), ("mu2", "S")])
def test_two_published_reductions_of_the_mutualism_fail_the_rank_condition(kept: str, state: str) -> None:
    """With mu_i alone kept, C = 0 is a manifold of equilibria across which the linear part is nilpotent."""
    given = mutualism()
    rates = {z: r.subs({p: 0 for p in given.parameters if p.name not in (kept, "k1", "k2", "k3")}) for z, r in
             given.equations.items()}  # fmt: skip
    c = given.states[2]
    linear = sp.Matrix([*rates.values()]).jacobian(given.states).subs(c, 0)
    assert all(rate.subs(c, 0) == 0 for rate in rates.values())
    assert linear != sp.zeros(3)
    assert linear**2 == sp.zeros(3)
    found = small_parameters(given, dimensions=[2], kept=["k1", "k2", "k3"])
    manifolds = [[e.lhs for e in each.manifold] for each in found if set(each.kept) == {kept, "k1", "k2", "k3"}]
    assert [c] not in manifolds
    assert [sorted(str(f) for f in e.free_symbols) for (e,) in manifolds] == [
        [state, {"H": "k1", "S": "k2"}[state]]
    ]


def test_the_rosenzweig_macarthur_system_is_a_reduction() -> None:
    found = small_parameters(rosenzweig_macarthur(), dimensions=[2], vanishing=["beta", "eta", "rho"])
    (only,) = [each for each in found if each.vanishing == ("beta", "eta", "rho")]
    b, s, _ = only.original.states
    assert only.manifold == (sp.Eq(H, 0, evaluate=False),)
    assert only.attracts
    below = delta + gamma * b
    wanted = {
        b: rho * b * (1 - b) - alpha * (eta + beta) * b * s / below,
        s: -eta * s + gamma * (eta + beta) * b * s / below,
    }
    assert {z: sp.simplify(only.reduced[z] - rate) for z, rate in wanted.items()} == {b: 0, s: 0}
    assert set(only.reduced) == {b, s}


@pytest.mark.exhaustive
@pytest.mark.parametrize("make", [michaelis_menten, rosenzweig_macarthur])
def test_other_variables_change_no_answer_but_names(make) -> None:
    given = make()
    n = len(given.states)
    matrix = sp.Matrix(n, n, lambda i, j: [[2, 1, 0], [1, 1, 1], [0, 3, 2]][i][j])
    there = small_parameters(in_other_variables(given, matrix))
    here = small_parameters(given)
    assert there.message == here.message

    def counts(found) -> list:
        return sorted((each.vanishing, each.dimension) for each in found)

    assert counts(there) == counts(here)


x, y, z = sp.symbols("x y z")
a, b, k = sp.symbols("a b k")


def test_an_oscillator_has_no_small_parameter() -> None:
    found = small_parameters(field({x: a * y, y: -b * x}, (a, b)))
    assert found == ()
    assert "no parameter of the field may be called small" in str(found)


def test_poles_and_functions_are_read_and_parameters_within_functions_stay() -> None:
    """x' = y/a, y' = exp(-b x) - k y: a inductance, a decay; b cannot vanish, for it stands in a function."""
    found = small_parameters(field({x: (y - x) / a, y: sp.exp(-b * x) - k * y}, (a, b, k)))
    assert {each.vanishing for each in found} == {("a",), ("a", "k")}
    only = found[0]
    assert only.attracts
    graph = {x: y} if y in only.reduced else {y: x}
    (state,) = only.reduced
    assert only.graph == graph
    assert sp.simplify(only.reduced[state] - (sp.exp(-b * state) - k * state)) == 0
    assert sp.limit(only.field.equations[x] * only.epsilon, only.epsilon, 0) == (y - x) / a


def test_a_manifold_on_which_a_function_has_no_value_is_none() -> None:
    """A reactor cooled by a wall: T = 0 and W = 0 are no equilibria of exp(-E/T), but T = W at large cooling is."""
    c, T, W, E, q, h, tau = sp.symbols("c T W E q h tau")
    burnt = c * sp.exp(-E / T)
    found = small_parameters(field({c: -burnt, T: q * burnt - h * (T - W), W: (T - W) / tau}, (E, q, h, tau)))
    rates = [rate for each in found for rate in each.reduced.values()]
    assert not any(rate.has(sp.zoo, sp.nan, sp.oo) for rate in rates)
    assert any(each.vanishing == ("tau",) for each in found)


def test_a_manifold_on_which_a_rate_divides_by_zero_is_none() -> None:
    """Holling and Tanner: on x = 0 the predators' y (1 - y/x) has no value, whatever vanishes."""
    x, y, a, d, r = sp.symbols("x y a d r")
    rates = VectorField(
        {y: y * (1 - y / x), x: (x * (1 - x) - a * x * y / (x + d)) / r}, parameters={a: 1, d: 0.1, r: 0.02}
    )
    found = small_parameters(rates, dimensions=[1])
    assert found
    for each in found:
        assert x not in [e.lhs for e in each.manifold]
        assert not any(rate.has(sp.zoo, sp.nan) for rate in each.reduced.values())


def test_the_work_is_bounded_and_what_was_found_is_given(monkeypatch) -> None:
    monkeypatch.setattr(special_values, "BUDGET", 300)
    found = small_parameters(rosenzweig_macarthur())
    assert found.status is Status.TOO_MANY_STEPS
    assert "of 63 choices" in found.message
    whole = small_parameters(michaelis_menten())
    assert whole.status is Status.TOO_MANY_STEPS or len(whole) == 15


def test_a_piece_beyond_the_exact_algebra_ends_no_search(monkeypatch) -> None:
    whole = small_parameters(rosenzweig_macarthur())
    monkeypatch.setattr(special_values, "SHARE", 3e-7)
    found = small_parameters(rosenzweig_macarthur())
    assert found.status is Status.SUCCESS
    assert found.message.startswith("63 of 63 choices")
    assert "left out, whose linear part takes more terms than the exact algebra forms" in found.message
    # What is there is what the whole search finds.
    every = {(each.vanishing, each.manifold) for each in whole}
    assert 0 < len(found) < len(whole)
    assert {(each.vanishing, each.manifold) for each in found} < every


@pytest.mark.exhaustive
def test_a_verdict_or_reduction_beyond_the_exact_algebra_is_told_as_such(monkeypatch) -> None:
    found = small_parameters(mutualism(), kept=["k1", "k2", "k3"], dimensions=[1])
    assert all(each.is_within_reach for each in found)
    monkeypatch.setattr(small_parameter, "SHARE", 1e-6)
    again = small_parameters(mutualism(), kept=["k1", "k2", "k3"], dimensions=[1])
    beyond = [each for each in again if not each.is_within_reach]
    assert beyond
    assert len(beyond) < len(again)
    for each in beyond:
        with pytest.raises(BudgetError):
            each.reduced  # noqa: B018
    assert all(each.attracts in (None, before.attracts) for each, before in zip(again, found))


def test_the_simplest_have_every_manifold_with_the_fewest_vanishing_parameters() -> None:
    found = small_parameters(rosenzweig_macarthur())
    simplest = found.simplest()
    assert len(simplest) < len(found)
    for each in found:
        same = [s for s in simplest if set(s.manifold) == set(each.manifold)]
        assert any(set(s.vanishing) <= set(each.vanishing) for s in same)
    for one, other in itertools.permutations(simplest, 2):
        assert set(one.manifold) != set(other.manifold) or not set(one.vanishing) <= set(other.vanishing)


@pytest.mark.exhaustive
def test_five_species_with_eight_rates_are_gone_through_to_the_end() -> None:
    """An enzyme with an inhibitor and a supply: each manifold consists of equilibria, across it the rank is full."""
    E, S, I, C, D, *k = sp.symbols("E S I C D k1:9")  # noqa: E741
    bind, make, block = k[0] * E * S - k[1] * C, k[2] * C, k[4] * E * I - k[5] * D
    rates = {E: -bind + make - block + k[6] * D, S: k[7] - bind - k[3] * S, I: -block, C: bind - make,
             D: block - k[6] * D}  # fmt: skip
    found = small_parameters(field(rates, k))
    assert found.status is Status.SUCCESS
    assert found.message.startswith("255 of 255")
    assert {len(each.graph or {}) for each in found} >= {1, 2, 3, 4}
    point = generic_point((*rates, *k))
    for each in found:
        if each.graph is None:
            continue
        gone = {p: 0 for p in k if p.name in each.vanishing}
        on = {z: e.subs(point) for z, e in each.graph.items()}
        there = {**{s: value for s, value in point.items() if s not in gone}, **gone, **on}
        layer = sp.Matrix([*rates.values()])
        assert layer.subs(there).is_zero_matrix, each
        linear = layer.jacobian([*rates]).subs(there)
        assert linear.rank() == (linear**2).rank() == len(on), each


def test_interrupted_it_gives_what_it_has() -> None:
    shares: list[float] = []

    def stop(share: float) -> None:
        shares.append(share)
        if len(shares) == 6:
            raise KeyboardInterrupt

    found = small_parameters(michaelis_menten(), progress=stop)
    assert found.status is Status.INTERRUPTED
    assert found.message.startswith("5 of 15")
    assert shares == sorted(shares)
    assert found


def test_a_field_with_a_small_parameter_is_sent_to_split() -> None:
    from gsp.systems.system import VectorField

    with pytest.raises(DeclarationError, match="split"):
        small_parameters(VectorField({x: -x, y: -y / a}, epsilon=a))
    with pytest.raises(DeclarationError, match='"e1", which is no parameter'):
        small_parameters(michaelis_menten(), kept=["e1"])
    with pytest.raises(DeclarationError, match="in vanishing and in kept"):
        small_parameters(michaelis_menten(), kept=["e0"], vanishing=["e0"])
    assert small_parameters(field({x: -a * x}, (a,))) == ()


def test_a_pole_of_order_two_is_told_with_what_it_comes_from() -> None:
    q, v, mu, d, c = sp.symbols("q v mu d c")
    joint = field({q: v, v: -q / mu**2 - d * v / mu - c * v}, (mu, d, c))
    found = small_parameters(joint)
    told = {each.vanishing for each in found}
    assert not any("mu" in vanishing for vanishing in told)
    # mu alone or with d, c or both: 4 of 7 choices.
    assert "4 have a pole of order two or more, the first with mu," in found.message
    # With the spring's force as a state there is none.
    f = sp.Symbol("f")
    forced = field({f: -v / mu, v: (f - d * v) / mu - c * v}, (mu, d, c))
    found = small_parameters(forced)
    assert "pole" not in found.message


@pytest.mark.exhaustive
@pytest.mark.parametrize(
    ("is_reversible", "configurations", "moving", "alone"), [(False, 57, 16, 14), (True, 195, 82, 70)]
)
def test_configurations_of_small_and_large_parameters_of_an_enzyme(
    is_reversible: bool, configurations: int, moving: int, alone: int
) -> None:
    """Each parameter small, of order one or large, up to the unit of time: 14 of Lapuz and Wechselberger (2025).

    They are those of the irreversible scheme in which one manifold attracts, with no other there, and something moves.
    """
    s, c, e0, q, *rates = sp.symbols("s c e0 q k1 km1 k2 km2")
    rates = rates[: 3 + is_reversible]
    on, off, make, back = (*rates, sp.Integer(0))[:4]
    bound, made = on * (e0 - c) * s - off * c, make * c - back * (e0 - c) * (1 - s - c)
    found = {}
    for signs in itertools.product((-1, 0, 1), repeat=1 + len(rates)):
        power = signs[0], *(k - min(signs[1:]) for k in signs[1:])
        if power in found:
            continue
        scaled = {p: p * q**k for p, k in zip((e0, *rates), power)}
        terms = {
            z: sp.Add.make_args(sp.expand(r.xreplace(scaled))) for z, r in ((s, -bound), (c, bound - made))
        }
        least = min(term.as_coeff_exponent(q)[1] for row in terms.values() for term in row)
        equations = {z: sp.Add(*[term / q**least for term in row]) for z, row in terms.items()}
        present = [p for p in (e0, *rates, q) if any(r.has(p) for r in equations.values())]
        found[power] = (
            small_parameters(field(equations, present), vanishing=["q"], kept=[p.name for p in present[:-1]])
            if q in present
            else ()
        )

    def useful(each) -> bool:
        return each.attracts is not False and each.is_positive is not False and not each.is_trivial

    counts = [any(map(useful, pieces)) for pieces in found.values()]
    single = [len(pieces) == 1 and useful(pieces[0]) for pieces in found.values()]
    assert (len(found), sum(counts), sum(single)) == (configurations, moving, alone)


@pytest.mark.parametrize("far", [1000, -(10**6)])
def test_amounts_counted_from_elsewhere_are_as_positive(far: int) -> None:
    """The enzyme's with k2: where it is small c = 0 had no positive points, or was undecided."""
    s, c, e0, k1, k, k2 = sp.symbols("s c e0 k1 k k2")
    near = VectorField(
        {s: -k1 * e0 * s + (k1 * s + k) * c, c: k1 * e0 * s - (k1 * s + k + k2) * c},
        parameters={e0: sp.Rational(1, 50), k1: 1, k: sp.Rational(1, 2), k2: sp.Rational(1, 2)},
    )
    less, more = {s: s - far, c: c - far}, {s: s + far, c: c + far}
    moved = VectorField({z: e.xreplace(less) for z, e in near.equations.items()}, parameters=near.parameters)
    pairs = list(zip(small_parameters(moved), small_parameters(near), strict=True))
    assert any(here.attracts and here.is_positive for _, here in pairs)
    for there, here in pairs:
        assert (there.vanishing, there.attracts, there.is_positive) == (
            here.vanishing, here.attracts, here.is_positive
        )  # fmt: skip
        for one, other in zip(there.manifold, here.manifold, strict=True):
            assert sp.expand(one.lhs.xreplace(more) - other.lhs) == 0
        if here.graph is not None and there.graph is not None:
            for z, e in there.graph.items():
                assert sp.simplify(e.xreplace(more) - far - here.graph[z]) == 0
            for z, e in there.reduced.items():
                assert sp.simplify(e.xreplace(more) - here.reduced[z]) == 0


@pytest.mark.parametrize(
    ("loss", "said"),
    [
        # z' = -a loss to leading order: z = 0 attracts, and exponentially only where the slope there is not 0.
        (z ** sp.Rational(3, 2), []),
        (z * sp.log(1 + z), []),
        (z * sp.sinh(z) ** 2, []),
        (sp.sqrt(z) + z, []),
        (z * (1 + sp.sqrt(z)), [True]),
        (z * sp.exp(-z), [True]),
    ],
    ids=str,
)
def test_functions_of_a_state_that_vanishes_have_their_value_there(loss: sp.Expr, said: list) -> None:
    found = small_parameters(field({x: b * (1 - x), z: -a * loss + k * x}, (a, b, k)), vanishing=["b", "k"])
    at_zero = [each for each in found if each.graph == {z: 0}]
    assert [each.attracts for each in at_zero] == said
    for each in at_zero:
        # a z = k x on the way there.
        assert sp.simplify(each.reduced[x] - b * (1 - x)) == 0


@pytest.mark.parametrize(
    ("loss", "said"),
    [
        # A function that vanishes tells where its state is, so that the slope of z tanh(z) is 0 there.
        (z * sp.tanh(z), []),
        (z * (sp.exp(z) - 1), []),
        (z * sp.log(1 + z), []),
        (sp.tanh(z), [True]),
        (sp.exp(z) - 1, [True]),
        (z * (sp.exp(z) - 2), [False, True]),
    ],
    ids=str,
)
def test_a_function_that_is_known_on_the_manifold_tells_its_state(loss: sp.Expr, said: list) -> None:
    found = small_parameters(field({x: b * (1 - x), z: -a * loss + k * x}, (a, b, k)), vanishing=["b", "k"])
    assert sorted(each.attracts for each in found if set(each.vanishing) == {"b", "k"}) == said
