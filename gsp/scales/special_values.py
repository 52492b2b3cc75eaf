"""Parameters that may be small: special values from which slow manifolds and their reductions come, found exactly.

A Tikhonov-Fenichel parameter value (Goeke, Walcher and Zerz 2015) is one at which the field has a manifold of
equilibria that is normally hyperbolic. Here it is looked for where some of the parameters are zero.
"""

from __future__ import annotations

import itertools
from collections.abc import Callable, Iterable, Iterator, Sequence

import sympy as sp

from gsp.algebra.centres import centres
from gsp.errors import BudgetError, DeclarationError, Status
from gsp.scales.critical_piece import CriticalPiece
from gsp.scales.polynomial_field import PolynomialField, Ray
from gsp.scales.small_parameter import SHARE, SmallParameter, SmallParameters
from gsp.scales.triangular_sets import decomposed
from gsp.systems.arguments import check_each, check_noun, check_progress, check_text, check_whole
from gsp.systems.system import VectorField

# Terms of all equations that are looked at: some 50 s.
BUDGET = 2_000_000


def small_parameters(
    field: VectorField | SmallParameter,
    *,
    dimensions: Iterable[int] | None = None,
    vanishing: Iterable[str] = (),
    kept: Iterable[str] = (),
    progress: Callable[[float], object] | None = None,
) -> SmallParameters:
    """Every choice of parameters of `field` that may be called small, each with its critical manifold and reduction.

    A tuple of `SmallParameter`, fewest vanishing parameters first; empty where nothing may be left out. `dimensions`
    are those of the critical manifolds, all from 1 to n - 1 where none are given; parameters in `vanishing` are always
    among those that vanish, those in `kept` never. The work is bounded in terms of polynomials, and `.status` says
    whether it went to the end. Of a `SmallParameter` the special values of its reduction are found: those on a special
    value, which are a third time scale and what `nest` takes. Raises `DeclarationError` for a field with a small
    parameter of its own, and for a reduction to an implicit manifold.

    >>> s, c, e0, k1, k, k2 = sp.symbols("s c e0 k1 k k2")
    >>> field = VectorField({s: -k1*e0*s + (k1*s + k)*c, c: k1*e0*s - (k1*s + k + k2)*c}, epsilon=None,
    ...                     parameters={e0: 1, k1: 1, k: 1, k2: 1})
    >>> [str(found) for found in small_parameters(field) if found.vanishing == ("e0",)]
    ['e0 -> 0: c = 0, attracts']
    """
    check_noun(field, (VectorField, SmallParameter), verb="small_parameters")
    check_progress(progress)
    if isinstance(field, SmallParameter):
        field = field.reduced_field
    if field.epsilon is not None:
        raise DeclarationError(
            f"the field has a small parameter already, {field.epsilon}.",
            "Use split(field), or declare it with epsilon=None and the parameter among the others.",
        )
    n = len(field.states)
    fast_counts = _dimensions(dimensions, n)
    # About their centres states that are amounts are positive, as signs are asked for.
    whole = PolynomialField(field.about(centres(field.rates, field.states)))
    free, forced = _choices(whole, vanishing, kept)
    found: list[SmallParameter] = []
    if not fast_counts:
        return SmallParameters(found, field=field, status=Status.SUCCESS, message="There is one state only.")
    left = BUDGET
    looked, skipped, large, steep = 0, [], [], []

    def count(terms: int) -> None:
        nonlocal left
        left -= terms
        if left < 0:
            raise BudgetError("the terms are used up.", limit=BUDGET)

    total = 2 ** len(free) - (not forced)
    size = sum(len(top) for top, _ in whole.rates)
    status, rest = Status.SUCCESS, ""
    try:
        for chosen in _subsets(free, forced):
            count(size)
            if progress is not None:
                progress(max(looked / total, 1.0 - left / BUDGET))
            ray = Ray(whole, chosen)
            if ray.is_special:
                pieces = _at(whole, ray, chosen, fast_counts, count, skipped, large)
                found += [SmallParameter.of(field, critical, chosen) for critical in pieces]
            elif ray.order > 1:
                steep.append(chosen)
            looked += 1
    except BudgetError as error:
        status, rest = Status.TOO_MANY_STEPS, f" The rest was not looked at: {error}"
    except KeyboardInterrupt:
        status, rest = Status.INTERRUPTED, " The rest was not looked at."
    message = f"{looked} of {total} choices of vanishing parameters were looked at.{rest}"
    if skipped:
        message += f" {len(skipped)} pieces were left out, on which no equation is linear in a variable."
    if large:
        message += (
            f" {len(large)} were left out, whose linear part takes more terms than the exact algebra forms."
        )
    if steep:
        least = ", ".join(p.name for p in steep[0])
        message += (
            f" {len(steep)} have a pole of order two or more, the first with {least}, and no leading part of order "
            "one: give what grows, such as a stiff force, as a state."
        )
    return SmallParameters(found, field=field, status=status, message=message)


def _at(
    whole: PolynomialField,
    ray: Ray,
    chosen: tuple[sp.Symbol, ...],
    fast_counts: frozenset[int],
    count: Callable[[int], None],
    skipped: list[tuple[sp.Symbol, ...]],
    large: list[tuple[sp.Symbol, ...]],
) -> list[CriticalPiece]:
    """What there is where those `chosen` vanish; they go to `skipped` or `large` for each piece that was not solved."""
    n = len(whole.field.states)
    # What the layer moves is fast, and is what had better be left out.
    moved = frozenset(v for v, (top, _) in zip(whole.variables.solvable, ray.layer) if top != 0)
    pieces = decomposed(
        [top for top, _ in ray.layer],
        whole.variables,
        most=n - min(fast_counts),
        count=count,
        first=moved,
    )
    skipped += [chosen] * pieces.unsolved
    found = []
    for piece in pieces.pieces:
        critical = CriticalPiece(whole, ray, piece)
        if n - critical.codimension not in fast_counts:
            continue
        with whole.ring.afresh(SHARE):
            before = whole.ring.spent
            try:
                if critical.is_hyperbolic and critical.is_in_domain:
                    found.append(critical)
            except BudgetError:
                large.append(chosen)
            # Products of terms that take the time of one of these.
            count((whole.ring.spent - before) // 2_500)
    return found


def _subsets(free: Sequence[sp.Symbol], forced: Sequence[sp.Symbol]) -> Iterator[tuple[sp.Symbol, ...]]:
    """Fewest first; never none."""
    for size in range(len(free) + 1):
        for chosen in itertools.combinations(free, size):
            if chosen or forced:
                yield (*forced, *chosen)


def _choices(
    whole: PolynomialField, vanishing: Iterable[str], kept: Iterable[str]
) -> tuple[list[sp.Symbol], list[sp.Symbol]]:
    """Parameters that may vanish, and those that must."""
    names = [p.name for p in whole.may_vanish]
    must, never = (_checked(given, what, names) for given, what in ((vanishing, "vanishing"), (kept, "kept")))
    both = [name for name in must if name in never]
    if both:
        raise DeclarationError(f"{both[0]} is in vanishing and in kept.", "Leave it in one of them.")
    free = [p for p in whole.may_vanish if p.name not in (*must, *never)]
    return free, [p for p in whole.may_vanish if p.name in must]


def _checked(given: Iterable[str], what: str, names: list[str]) -> tuple[str, ...]:
    def known(name: object) -> str:
        text = check_text(getattr(name, "name", name), what=f"every name in {what}")
        if text not in names:
            raise DeclarationError.none_of(
                names, text, f'{what} names "{text}", which is no parameter that may vanish.', "There are"
            )
        return text

    return check_each(given, known, what=what, be="a sequence of names", remedy='Try ("k",).')


def _dimensions(given: Iterable[int] | None, n: int) -> frozenset[int]:
    if given is None:
        return frozenset(range(1, n))
    be = f"whole numbers from 1 to {n - 1}"
    found = check_each(
        given,
        lambda s: check_whole(s, what="every one of dimensions", least=1, most=n - 1),
        what="dimensions",
        be=be,
    )
    if not found:
        raise DeclarationError(f"dimensions are {be}, one or more.", got="none")
    return frozenset(found)
