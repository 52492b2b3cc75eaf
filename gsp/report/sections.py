"""The sections of a page, as values that its template sets."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

import sympy as sp
from markupsafe import Markup

from gsp.analysis.analysis import Analysis
from gsp.charts import has_constant_eigenvalues
from gsp.choice.verdict import CUT_SHORT, in_words
from gsp.hyperbolicity.hyperbolicity import Condition, Kind
from gsp.report.claims import claims_of
from gsp.report.contacts import no_slip
from gsp.report.ramps import ramps
from gsp.report.reduction_limits import failures, reduction_limits
from gsp.report.setting import Setting
from gsp.report.three_scales import three_scales
from gsp.report.wording import fitted, listed, number, span, words
from gsp.results.attempts import Missing, attempt
from gsp.results.bounds import at_least
from gsp.results.mathml import dotted, indexed, operator, row
from gsp.systems.system import SlowFastSystem


class Page(Setting):
    """The sections of one report, as values for the template."""

    # Sections of the page that have modules of their own.
    claims = claims_of
    three_scales = three_scales

    def __init__(self, analysis: Analysis) -> None:
        self.analysis = analysis
        scene, study = analysis.scene, analysis.study
        self.system = study.system
        self.epsilon = self.system.epsilon
        super().__init__(
            [
                *(self.epsilon, *self.system.parameters),
                *(*scene.system.states, *self.system.states, *scene.reconstruction),
            ],
            scene.units,
        )

    def head(self) -> dict[str, Any]:
        """What every section of the template speaks of; the rest they ask for, so that one may fail alone."""
        scene = self.analysis.scene
        return {
            "analysis": self.analysis,
            "scene": scene,
            "title": scene.title or scene.name or "A system with two time scales",
            "epsilon": self.inline(self.epsilon),
            "span": span(scene.span),
        }

    def question(self) -> dict[str, Any]:
        scene = self.analysis.scene
        return {
            "equations": self.equations(),
            "reconstruction": self.rates(scene.reconstruction.items()),
            "parameters": [self.named_value(s, value) for s, value in self.system.parameters.items()],
            "region": [self.interval(name, bounds) for name, bounds in scene.region.items()],
            "start": [self.named_value(sp.Symbol(name), value) for name, value in scene.full_start.items()],
        }

    def no_slip(self) -> dict[str, Any]:
        return no_slip(self.analysis)

    def ramps(self) -> list[dict[str, Any]]:
        return ramps(self.analysis.scene)

    def failures(self) -> dict[str, Any]:
        return failures(self.analysis, self.set)

    def reduction_limits(self) -> dict[str, Any]:
        return reduction_limits(self.analysis, self.set)

    def by_power(self, rate: sp.Expr) -> sp.Expr | str:
        """A rate that is a polynomial in epsilon, sorted by its powers as the series are."""
        expanded = sp.expand(rate)
        if not expanded.is_polynomial(self.epsilon):
            return rate
        coefficients: list[Any] = [sp.factor(c) for c in sp.Poly(expanded, self.epsilon).all_coeffs()]
        return self.set.power_series(coefficients[::-1], self.epsilon, open_end=False)

    # -- sections -----------------------------------------------------------------------------------------

    def answer(self) -> tuple[str, Markup]:
        """The verdict, or "Unknown" and why."""
        found = attempt("the verdict", self.verdict)
        return ("Unknown", words(found.reason)) if isinstance(found, Missing) else found

    def verdict(self) -> tuple[str, Markup]:
        """(answer, sentences): whether one may reduce, as `choose` decided it."""
        found = self.analysis.choice.verdict
        return found.answer.capitalize(), words(found.sentences)

    def measured(self) -> Markup:
        """The errors of the orders at the scene's epsilon, from a start on the slow manifold."""
        comparison = self.analysis.comparison
        if all(comparison.is_exact(order) for order in comparison.errors):
            return Markup("within rounding at order {} from the slow manifold on, at every {}").format(
                min(comparison.errors), self.inline(self.epsilon)
            )
        known = {order: self.error_at(order) for order in comparison.errors}
        shown = [
            Markup("{} at order {}{}").format(number(error, 2), order, f" ({how})" if how else "")
            for order, (error, how) in known.items()
            if not math.isnan(error)
        ]
        return Markup(", ").join(shown) if shown else Markup("not measured: a run ended early")

    def leaving(self) -> Markup:
        """How soon orbits next to a manifold that does not attract leave it; empty for one that does."""
        found = self.analysis.hyperbolicity
        if found.kind in (Kind.ATTRACTING, Kind.LOST):
            return Markup("")
        how = "every fast direction" if found.kind is Kind.REPELLING else "some fast directions"
        time = number(self.analysis.scene.epsilon / found.gap)
        return Markup("; orbits next to it leave it in {} within a time of about {}/gap = {}").format(
            how, self.inline(self.epsilon), time
        )

    def conditions(self) -> str:
        """Which conditions of the theory hold over the whole region, or at its samples where that is all there is."""
        found = self.analysis.hyperbolicity
        failed = [c.name for c in found.conditions if not c.holds]
        if failed:
            return f"not met over the whole region: {self._listed(failed)}"
        decided = self.is_proved() or found.exclusion is None or found.exclusion.is_complete
        return "met over the whole region" if decided else f"met at every sample; {found.exclusion}"

    def error_at(self, order: int) -> tuple[float, str]:
        """(error of an order at the scene's epsilon, how it is known when it was not measured there)."""
        comparison, epsilon = self.analysis.comparison, self.analysis.scene.epsilon
        pairs = sorted(zip(comparison.epsilons, comparison.errors[order]))
        pairs = [(e, error) for e, error in pairs if math.isfinite(error)]
        for e, error in pairs:
            if math.isclose(e, epsilon, rel_tol=1e-9):
                return error, ""
        pairs = [(e, error) for e, error in pairs if error > 0.0]
        if len(pairs) < 2:
            return float("nan"), ""
        below = [pair for pair in pairs if pair[0] < epsilon]
        above = [pair for pair in pairs if pair[0] > epsilon]
        if below and above:
            (a, low), (b, high) = below[-1], above[0]
            slope, how = math.log(high / low) / math.log(b / a), "interpolated"
        else:
            a, low = below[-1] if below else above[0]
            slope = comparison.slopes[order]
            how = f"extrapolated from {a:g} with the measured slope {fitted(slope)}"
        return low * (epsilon / a) ** slope, how

    def variables(self) -> Markup:
        known = Markup("{}; {}").format(self.names(self.system.x), self.names(self.system.y))
        splitting = self.analysis.study.splitting
        new = {} if splitting is None else {s: e for s, e in splitting.coordinates.items() if s != e}
        return Markup(", where ").join(
            [
                known,
                *([listed(self.inline(sp.Eq(s, e, evaluate=False)) for s, e in new.items())] if new else []),
            ]
        )

    def card(self) -> list[tuple[str, Markup]]:
        """The facts below the verdict; one that is not known gives the reason."""
        found = self.analysis.hyperbolicity
        facts: dict[str, Callable[[], Markup]] = {
            "slow, fast": self.variables,
            "kind": lambda: Markup("{}{} ({}){}").format(
                "" if found.kind is Kind.LOST else "normally hyperbolic, ",
                self.kind(),
                words(found.evidence),
                self.leaving(),
            ),
            "gap": self.gap,
            "series": lambda: Markup("through order {}, exact").format(self.analysis.series.order),
            "conditions": lambda: Markup("{}").format(self.conditions()),
            "errors": self.measured,
            "slopes": self._slopes,
        }
        made = {term: attempt(f"the line {term}", make) for term, make in facts.items()}
        return [(t, words(f.reason) if isinstance(f, Missing) else f) for t, f in made.items()]

    def kind(self) -> str:
        """What the critical manifold is over the region."""
        kind = self.analysis.hyperbolicity.kind
        return "not normally hyperbolic" if kind is Kind.LOST else str(kind)

    def losses(self) -> list[tuple[str, str, str]]:
        """Of each loss what and where it is, what orbits do, and whether the reduction goes on."""
        return [
            (
                words(loss.headline),
                words(loss.consequence),
                words(("It may go on: " if loss.may_reduce else "It ends here: ") + loss.remedy),
            )
            for loss in self.analysis.hyperbolicity.losses
        ]

    def holding(self) -> str:
        """The part of the region over which the conditions hold, where that is not all of it; empty where none does."""
        part = self.analysis.hyperbolicity.sub_region
        return "" if part is None else words(str(part))

    def gap(self) -> Markup:
        """The least |Re lambda| that is proved, else that at the samples."""
        found = self.analysis.hyperbolicity
        sampled = number(found.sampled_gap, 4)
        if found.certificate is None or not found.is_proved:
            return Markup("{} in fast time").format(sampled)
        count = len(found.certificate.boxes)
        boxes = "1 box" if count == 1 else f"{count} boxes"
        least = number(found.gap, 4, bound=at_least)
        return Markup("at least {} in fast time, proved in {}; {} at the samples").format(least, boxes, sampled)

    @staticmethod
    def decided_by(condition: Condition) -> Markup:
        """The number that decides a condition, rounded down where it is a proved bound."""
        return number(condition.value, 4, bound=at_least if condition.is_proved else None)

    def is_proved(self) -> bool:
        """Whether the kind is proved over the region."""
        return self.how_known() == "proved"

    def how_known(self) -> str:
        """Proved, refuted, or by samples alone."""
        certificate = self.analysis.hyperbolicity.certificate
        decided = {"PROVED": "proved", "REFUTED": "refuted"}
        return "sampled" if certificate is None else decided.get(certificate.verdict.name, "sampled")

    def evidence(self) -> str:
        """How the verdict is known, as a sentence."""
        found = self.analysis.hyperbolicity
        text = found.evidence[0].upper() + found.evidence[1:]
        if self.is_proved():
            return (
                f"{text}, in ball arithmetic: the kind, and that no eigenvalue comes nearer to the axis than proved. "
                f"The other numbers above are the worst of {found.samples} samples, refined."
            )
        if self.how_known() == "refuted":
            return f"{text}. That is proved in ball arithmetic."
        return f"{text}. The worst of the samples are refined. This is evidence, not a proof."

    def _slopes(self) -> Markup:
        comparison = self.analysis.comparison
        slopes = ["at rounding" if comparison.is_exact(n) else fitted(s) for n, s in comparison.slopes.items()]
        if set(slopes) == {"–"}:
            return Markup("not measured: fewer than two errors stand clear of the reference’s own")
        orders = self._listed([str(order) for order in comparison.slopes])
        return Markup("{} at orders {}").format(", ".join(slopes), orders)

    def equations(self) -> list[tuple[Markup, Markup]]:
        system = self.analysis.scene.system
        if isinstance(system, SlowFastSystem):
            return self.standard_form(system)
        return self.rates(zip(system.states, system.rates))

    def standard_form(self, system: SlowFastSystem) -> list[tuple[Markup, Markup]]:
        return self.rates(system.slow.items()) + self.rates(system.fast.items(), self.epsilon)

    def splitting(self) -> dict[str, Any] | None:
        splitting = self.analysis.study.splitting
        if splitting is None:
            return None
        f: Any = splitting.layer[0] if splitting.layer.shape == (1, 1) else splitting.layer
        new = {s: e for s, e in splitting.coordinates.items() if s != e}
        system = self.system
        return {
            "given": self.analysis.study.given,
            "scaling": splitting.scaling,
            "switches": [
                (self._equal(s.fast, s.surface / s.epsilon), "" if s.state is None else self._equal(s.state, s.value))
                for s in self.analysis.study.switches
            ],
            "states": self.names(splitting.field.states),
            "layer": [self.block("<mi>f</mi>", f), self.block("<mi>N</mi>", splitting.N)],
            "route": splitting.route,
            "new": [self.block(self.set.row(s), e) for s, e in new.items()],
            "slow": self.names(system.x),
            "fast": self.names(system.y),
            "conserved": self.names(splitting.conserved),
            "nonzero": [self.inline(row(self.set.row(e), operator("≠"), "<mn>0</mn>")) for e in splitting.nonzero],
            "system": self.standard_form(system),
        }  # fmt: skip

    def _equal(self, left: Any, right: Any) -> Any:
        return self.inline(row(self.set.row(left), operator("="), self.set.row(right)))

    def branches(self) -> list[dict[str, Any]]:
        study = self.analysis.study
        result = []
        for branch in study.critical.branches:
            if branch.graph is not None:
                rows = [self.block(self.set.row(y), h) for y, h in branch.graph.items()]
            else:
                # On the right, where it is broken into lines that a page holds.
                rows = [self.formula("<mn>0</mn>", e) for e in branch.equations]
            chosen = branch.equations == study.branch.equations
            result.append({"rows": rows, "chosen": chosen, "explicit": branch.is_explicit})
        return result

    def constant_eigenvalues(self) -> bool:
        return has_constant_eigenvalues(self.analysis)

    def series(self) -> dict[str, Any]:
        series = self.analysis.shown
        fast, slow = self.system.y, self.system.x

        def rows(name: str, symbols, table) -> list[tuple[Markup, Markup]]:
            zero = {k for k in range(series.order + 1) if all(table[k][s] == 0 for s in symbols)}
            found = [
                self.formula(indexed(name, k, self.set.row(s) if len(symbols) > 1 else None), table[k][s])
                for k in range(series.order + 1)
                for s in symbols
                if k not in zero
            ]
            if zero:
                # Orders of which nothing is left are one line, h_1 = h_2 = 0.
                left = [part for k in sorted(zero) for part in (operator("="), indexed(name, k, None))][1:]
                found.append(self.block(row(*left), sp.S.Zero))
            return found

        return {
            "h": rows("h", fast, series.coefficients),
            "f": rows("f", slow, series.reduced_field),
            "implicit": self.names(y for y in series.coordinates if y in fast),
            "cut": self.cut(),
        }

    def cut(self) -> str:
        """What is not printed of the series, and why; empty when all of it is."""
        series, shown = self.analysis.series, self.analysis.shown
        if shown is series:
            return ""
        text = f"With symbolic parameters the coefficients have up to {max(series.sizes)} terms, so the parameters' "
        text += "values are put in here."
        if shown.order < series.order:
            text += (
                f" Even so those beyond order {shown.order} are too long to print; they are used all the same."
            )
        return text

    def raw(self) -> dict[str, Any] | None:
        raw = self.analysis.raw
        if raw is None or not set(raw.chart) - set(self.system.x):
            return None
        through = min(1, raw.order)
        field = [
            self.block(
                dotted(self.set.row(z)),
                self.set.power_series([raw.reduced_field[k][z] for k in range(through + 1)], self.epsilon),
            )
            for z in raw.chart
        ]
        graph = [
            self.block(
                self.set.row(z), self.set.power_series([h[z] for h in raw.coefficients[:3]], self.epsilon)
            )
            for z in raw.coefficients[0].symbols
        ]
        return {"chart": self.names(raw.chart), "field": field, "graph": graph}

    def errors(self) -> dict[str, Any]:
        found = self.analysis.comparison
        slopes = {n: "at rounding" if found.is_exact(n) else fitted(s) for n, s in found.slopes.items()}
        stopped = [
            f"A run of order {orders} {self.epsilon} did not reach the end: {status.meaning}."
            if orders.endswith("each")
            else f"Of order {orders} for {self.epsilon} a run did not reach the end: {status.meaning}."
            for status, orders in found.ended.items()
        ]
        if found.crossed:
            places = ", ".join(f"{surface} = 0" for surface in found.crossed)
            stopped.append(
                f"The full run crosses {places}, where the field is not smooth. From order 1 on the error may fall "
                "with fewer powers."
            )
        return {
            "orders": list(found.errors),
            "rows": list(zip(found.epsilons, zip(*found.errors.values()), found.floor)),
            "slopes": list(slopes.values()),
            "expected": ["–" if power is None else power for power in found.expected.values()],
            "first": slopes.get(1),
            "stopped": stopped,
            "cut": self.analysis.cut,
        }

    def choice(self) -> dict[str, Any]:
        """What the scene needs: a sentence, and a row for each candidate."""
        found = self.analysis.choice
        names = [c.label for c in found.candidates]
        return {
            "model": in_words(found.model),
            "rows": [
                {
                    "name": name,
                    "chosen": c is found.model,
                    "predicted": c.predicted if math.isfinite(c.predicted) else math.nan,
                    "microseconds": 1e6 * c.seconds,
                    "steps": round(c.steps) if math.isfinite(c.steps) else "–",
                    "why": ": ".join(filter(None, ("serves" * c.valid, c.remark))),
                }
                for name, c in zip(names, found.candidates)
            ],
            "cut_short": CUT_SHORT if any(c.share < 1.0 for c in found.candidates) else "",
            "is_measured": any(c.is_measured for c in found.candidates),
            "layer": found.layer,
            "piece": span(found.piece),
            "predicted": found.predicted_on_piece,
            "measured": found.measured if math.isfinite(found.measured) else None,
            "tolerance": found.tolerance,
        }

    @staticmethod
    def _listed(words: list[str]) -> str:
        return words[0] if len(words) == 1 else ", ".join(words[:-1]) + " and " + words[-1]
