"""Commands that derive: `gsp split`, `gsp expand`, `gsp folds`."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import click

from gsp.cli.asking import asks, json_option
from gsp.cli.program import cli
from gsp.cli.telling import print_json, screenful, tell, tell_notes
from gsp.errors import NO_REASON, GspError

if TYPE_CHECKING:
    from gsp.scenes.scene import Scene


@cli.command()
@asks("set", "small", "fast", looks=True)
@json_option
def split(scene: Scene, as_json: bool) -> None:
    """Find the slow and the fast variables of MODEL, and say how they were found.

    With two small parameters this is done for both.
    """
    from gsp.nested.nesting import nest
    from gsp.scenes.study import study_of

    study = study_of(scene)
    nested = nest(scene, order=0) if scene.second else None
    splitting, system = study.splitting, study.system
    still = [x for x, rate in system.slow.items() if rate == 0]
    told = {x: x if splitting is None else splitting.coordinates[x] for x in still}
    sums = _conserved_sums(study.scene, tuple(told.values()))
    if as_json:
        identity = {s.name: s.name for s in system.states}
        print_json(
            {
                "name": scene.name,
                "slow": {x.name: str(rate) for x, rate in system.slow.items()},
                "fast": {y.name: str(rate) for y, rate in system.fast.items()},
                "coordinates": identity
                if splitting is None
                else {s.name: str(e) for s, e in splitting.coordinates.items()},
                "conserved": [x.name for x in still],
                "conserved_sums": [str(law) for law in sums],
                "explanation": "declared in standard form" if splitting is None else splitting.explain(),
                "nested": None if nested is None else nested.as_dict(),
            }
        )
        return
    declared = "Declared in standard form." + f"\n{scene.description}" * bool(scene.description)
    lines = [declared if splitting is None else splitting.explain()]
    lines += [f"Conserved: {x}, for {x}' = 0." for x in still if splitting is None]
    lines += [f"Conserved: {law}{where}." for law, where in sums.items()]
    tell("\n".join(lines) + "\n")
    tell(system)
    if nested is not None:
        tell(f"\n{nested.explain()}")


def _conserved_sums(scene: Scene, known: tuple[Any, ...]) -> dict[Any, str]:
    """Conserved linear combinations of the states of the model, none where those `known` are all there are.

    Each has the words that say where it is so.
    """
    from gsp.scales.conservation import conserved_by, is_conserved

    flow = scene.system
    _, laws = conserved_by(flow, scene.epsilon if scene.has_small else None)
    linear = [law for law in known if not any(law.diff(z).has(*flow.states) for z in flow.states)]
    if len(laws) <= len(linear):
        return {}
    return {
        law: "" if is_conserved(law, flow.states, flow.rates) else ", at the values of this model"
        for law in laws
        if law not in known
    }


@cli.command()
@asks("set", "small", "fast", looks=True)
@click.option("--order", type=int, help="Highest power of epsilon [3, or less if the terms become too long].")
@click.option("--raw", is_flag=True, help="Use the model's own variables, not the slow and fast ones.")
@click.option(
    "--values",
    is_flag=True,
    help="Insert the values of the parameters. With many parameters this is much shorter.",
)
@json_option
def expand(scene: Scene, order: int | None, raw: bool, values: bool, as_json: bool) -> None:
    """Print the slow manifold h_0, h_1, ... and the reduced field f_0, f_1, ... of MODEL."""
    from gsp.scenes.study import study_of
    from gsp.slow.raw_series import carry_back
    from gsp.slow.series import READABLE

    study = study_of(scene)
    if order is None:
        # The order that a series is expanded through where none is asked for, as far as the budget goes.
        whole, ending = study.series_within_budget(3, symbolic=not values)
    else:
        whole, ending = study.series(order, symbolic=not values), ""
    if ending and study.system.parameters and not values:
        ending += " With --values it is shorter, and may go further."
    lengths = [] if as_json else whole.sizes
    through = next((k for k, n in enumerate(lengths) if n > READABLE), whole.order + 1) - 1
    # Only what is printed is turned into expressions: that is where the time of a long series goes.
    series: Any = whole.at_order(max(through, 0))
    if raw and study.splitting is not None:
        series = carry_back(series, study.splitting)
        if series is None:
            raise GspError(
                f"the series of {scene.name} cannot be carried back to the raw variables explicitly.",
                "Leave --raw out; the slow coordinates are given by `gsp split`.",
            )
    fields = [("h", series.coefficients), ("f", series.reduced_field)]
    if as_json:
        rows = {letter: [[str(e) for e in row] for row in part] for letter, part in fields}
        names = {letter: [s.name for s in part[0].symbols] for letter, part in fields}
        print_json(
            {
                "name": scene.name,
                "order": whole.order,
                "ending": ending,
                "slow": names["f"],
                "fast": names["h"],
                "h": rows["h"],
                "reduced_field": rows["f"],
            }
        )
        return
    if not study.branch.is_explicit:
        fast = ", ".join(y.name for y in study.system.y)
        tell(f"Here {fast} is the point of the critical manifold over the slow variables: {study.branch}")
    if study.splitting is not None and not raw:
        new = [f"{s} = {e}" for s, e in study.splitting.coordinates.items() if s != e]
        if new:
            tell(f"Here {', '.join(new)}")
    remedy = "--json prints all of it" if values else "--values is shorter, --json prints all of it"
    for letter, part in fields:
        for k, size in enumerate(whole.sizes):
            if k > through:
                tell(f"{letter}_{k}  has coefficients of up to {size} terms; {remedy}")
                continue
            for symbol, expression in part[k].as_dict().items():
                prime = "'" if letter == "f" else ""
                text = str(expression)
                if len(text) > screenful():
                    text = f"{len(text):,} characters, more than a screen; a pipe, a file or --json has all of them"
                tell(f"{letter}_{k}  {symbol}{prime} = {text}")
    if ending:
        tell(ending)


@cli.command()
@asks("set", "region", "small", "fast", looks=True)
@click.option("--blow-up", is_flag=True, help="Print the charts in which each of these points is blown up.")
@json_option
def folds(scene: Scene, blow_up: bool, as_json: bool) -> None:
    """Follow the critical manifold of MODEL through its folds.

    The search covers a box that is larger than the region by one and a half of its widths on every side. Points outside
    the region are marked. At a fold, a and b are the coefficients of v' = b dx + a v^2 along the null direction. The
    weights say with which powers of epsilon orbits pass the point. Over two slow variables the folded singularities
    follow, through which canards go. For a field that switches, the ends of sliding in the region are listed too.
    """
    from gsp.analysis.fold_surroundings import (
        folded_around,
        local_scales,
        never_folds,
        not_followed,
        surroundings,
        switch_ends,
    )
    from gsp.critical.continuation.critical_curve import CriticalCurve
    from gsp.critical.continuation.critical_sheet import CriticalSheet
    from gsp.scenes.sheet import explain_sheet
    from gsp.scenes.study import study_of

    study = study_of(scene)
    found, obstacle = surroundings(study), not_followed(study)
    ends = switch_ends(study)

    def plain(p: Any) -> dict[str, Any]:
        return {"kind": str(p.kind), "point": dict(p.point), "coefficients": dict(p.coefficients)}

    sides = list(map(plain, ends))
    if obstacle is not None and never_folds(study.branch):
        # Another branch may fold, which a start beside it follows.
        tell_notes(explain_sheet(study.critical, study.branch, study.start, study.region))
        message = obstacle.fact
        if as_json:
            print_json(
                {"name": scene.name, "message": message, "special": [], "curves": [], "switch_ends": sides}
            )
        else:
            tell("\n".join([message, *map(str, ends)]))
        return
    if obstacle is not None:
        raise obstacle
    assert found is not None
    curves = [found] if isinstance(found, CriticalCurve) else [*found.folds]
    scales = local_scales(study, found)
    folded, why_not = folded_around(study) if curves and isinstance(found, CriticalSheet) else ((), NO_REASON)
    if as_json:
        print_json(
            {
                "name": scene.name,
                "message": found.message,
                "special": [
                    {**plain(p), "in_region": p.is_in(study.region)} for curve in curves for p in curve.special
                ],
                "folded_singularities": [point.as_dict() for point in folded],
                "folded_reason": why_not,
                "switch_ends": sides,
                "blow_ups": [
                    {"point": dict(s.point), "reason": str(s.reason)}
                    if s.blow_up is None
                    else {"point": dict(s.point), **s.blow_up.as_dict()}
                    for s in scales
                ],
                "curves": [
                    {
                        "kind": "critical manifold" if isinstance(curve, CriticalCurve) else "folds",
                        "points": {name: curve[name].tolist() for name in curve.names},
                    }
                    for curve in curves
                ],
            }
        )
        return
    texts = [curve.described(study.region) for curve in curves]
    told = [str(s.blow_up) if blow_up and s.blow_up is not None else f"  {s}" for s in scales]
    texts += ["powers of epsilon there", *told] if scales else []
    texts += [f"{'' if point.is_in(study.region) else 'outside the region: '}{point}" for point in folded]
    texts += [f"folded singularities: {why_not}"] if why_not else []
    texts += map(str, ends)
    tell("\n".join(texts if isinstance(found, CriticalCurve) else [found.message, *texts]))
