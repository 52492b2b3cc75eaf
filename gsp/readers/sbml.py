"""SBML of levels 1 to 3: reactions with their kinetic laws, rules and compartments, as rates of change.

A species is the concentration that its symbol means, or its amount where it has only substance units; amounts change by
stoichiometry times rate (Level 3 version 2, section 4.11.7). Fast reactions have their rates divided by epsilon, so
that their stoichiometry is the N of the fast part N f. What the stoichiometry conserves is written out: one species of
each law follows from the others, the largest one where a smaller one would be rounded away. Events, algebraic rules and
delays are refused by name.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Collection
from fractions import Fraction
from typing import Any

import numpy as np
import sympy as sp

from gsp.errors import ModelFileError, is_hidden
from gsp.readers.conservation import Law, conserved, most_of
from gsp.readers.foreign import SMALL, ForeignModel, number_in
from gsp.readers.sbml_document import library, read_document
from gsp.readers.sbml_math import names_in
from gsp.readers.sbml_quantities import TOTAL, Quantities
from gsp.readers.sbml_values import fraction_text
from gsp.systems.arguments import counted
from gsp.systems.tolerances import RTOL, absolute_tolerance

# SBML does not say how fast its fast reactions are.
EPSILON = "0.01"


def read_sbml(text: str, *, origin: str = "an SBML file") -> ForeignModel:
    """What the SBML document `text` says; raises `ModelFileError` for what is refused, by name."""
    document, left_out = read_document(text)
    try:
        model = _SbmlReader(document.getModel(), library(), origin).model()
    except RecursionError:
        raise ModelFileError("values depend on each other in too long a chain.", "Shorten it.") from None
    model.left_out[:0] = left_out
    return model


class _SbmlReader(Quantities):
    """One model: how its quantities change."""

    def __init__(self, source: Any, libsbml: Any, origin: str) -> None:
        super().__init__(source, libsbml, origin)
        # How species change by reactions: coefficients that are numbers, and others as signs and what they are.
        self.coefficients: dict[str, dict[str, Fraction]] = {}
        self.terms: dict[str, list[tuple[str, int, Any]]] = {}
        self.mentioned = Counter(name for tree in self.trees() for name in set(names_in(tree)))
        # Names of conserved totals, and of amounts in compartments that change, by species.
        self.totals: dict[str, str] = {}
        self.amounts: dict[str, str] = {}

    def trees(self) -> list[Any]:
        """All mathematics that stands anywhere but in functions."""
        laws = [law.getMath() for r in self.reactions.values() if (law := r.getKineticLaw()) is not None]
        numbers = [
            r.getStoichiometryMath().getMath() for r, _ in self.all_references() if r.isSetStoichiometryMath()
        ]
        return [*laws, *numbers, *self.assigned.values(), *self.rated.values(), *self.initial.values()]

    def model(self) -> ForeignModel:
        result = self.result
        title = self.source.getName() or self.source.getIdAttribute()
        result.title = " ".join("".join(c for c in title if not is_hidden(c)).split())[:200]
        for identifier in self.functions:
            self.define_function(identifier)
        self.read_stoichiometry()
        moving = [s for s in self.species if s in self.coefficients]
        laws = self.conservation_laws(moving)
        self.name_values(laws)
        self.write_reactions()
        for identifier, tree in self.assigned.items():
            self.assign(identifier, self.written.text(tree))
        for identifier, tree in self.rated.items():
            self.add_state(self.words[identifier], self.written.text(tree), self.values.of(identifier))
            self.keep(f"the start of {self.words[identifier]}", identifier)
        for identifier in moving:
            self.write_rate(identifier)
        self.write_parameters(moving)
        self.write_laws(laws)
        result.sizes = [self.words[identifier] for identifier in self.compartments]
        if not result.states:
            raise ModelFileError(
                "no reaction and no rate rule changes anything in the file.", "Give it one that does."
            )
        if self.time_used:
            self.add_state(self.clock, "1", sp.Integer(0))
            result.windows[self.clock] = 0.0, number_in(TOTAL, "the span")
        self.choose_windows(moving, laws)
        self.take_notes(laws)
        return result

    # Stoichiometry.

    def read_stoichiometry(self) -> None:
        for reaction in self.source.getListOfReactions():
            for sign, side in ((-1, reaction.getListOfReactants()), (1, reaction.getListOfProducts())):
                for reference in side:
                    self.count(reaction.getIdAttribute(), sign, reference)
        for identifier in list(self.coefficients):
            row = {name: number for name, number in self.coefficients[identifier].items() if number}
            self.coefficients[identifier] = row
            if not row and identifier not in self.terms:
                del self.coefficients[identifier]

    def count(self, reaction: str, sign: int, reference: Any) -> None:
        species = reference.getSpecies()
        if species not in self.species:
            raise ModelFileError(f"{reaction} changes {species[:64]!r}, which is no species.", "Declare it.")
        if self.species[species].getBoundaryCondition() or self.species[species].getConstant():
            return
        if species in self.assigned or species in self.rated:
            raise ModelFileError(
                f"{species} has a rule, and {reaction} changes it too.",
                "Keep one, or make it a boundary species.",
            )
        row = self.coefficients.setdefault(species, {})
        own = reference.getIdAttribute()
        tree = reference.getStoichiometryMath().getMath() if reference.isSetStoichiometryMath() else None
        if own and (own in self.assigned or own in self.rated or own in self.initial):
            self.terms.setdefault(species, []).append((reaction, sign, own))
        elif tree is not None and not tree.isInteger():
            self.terms.setdefault(species, []).append((reaction, sign, tree))
        else:
            number = Fraction(tree.getInteger()) if tree is not None else self.number_of(reference)
            row[reaction] = row.get(reaction, Fraction(0)) + sign * number

    def conservation_laws(self, moving: list[str]) -> list[Law]:
        """Laws over species whose coefficients are numbers; slow ones are kept, and those that many rates mention, or
        the small ones where these would lose their digits.
        """
        fast = {name for name, reaction in self.reactions.items() if reaction.getFast()}
        order = sorted(
            (s for s in moving if s not in self.terms),
            key=lambda s: (not fast.isdisjoint(self.coefficients[s]), -self.mentioned[s], self.values.of(s)),
        )
        laws = conserved({s: self.coefficients[s] for s in order})
        if laws and self.loses_digits(laws, moving):
            order.sort(key=lambda s: (not fast.isdisjoint(self.coefficients[s]), self.values.of(s)))
            laws = conserved({s: self.coefficients[s] for s in order})
        if laws is None:
            self.result.notes.append("conservation laws were not looked for: the network is too large")
            return []
        kept = [s for s in moving if s not in {law.species for law in laws}]
        rows = {s: {r: c for r, c in self.coefficients[s].items() if r in fast} for s in kept}
        if not self.rated and laws and all(rows.values()) and conserved(rows) == []:
            # Every direction that is left is fast; what is conserved is all that is slow.
            self.result.notes.append("conserved sums are kept as states, for nothing else is slow")
            return []
        return laws

    def loses_digits(self, laws: list[Law], moving: list[str]) -> bool:
        """Whether what follows from the others is rounded, as the largest of them is, by more than a run may be off."""
        amounts = {s: abs(float(self.values.of(s))) for s in moving}
        rounded = max(
            np.spacing(float(abs(c)) * amounts[s]) for law in laws for s, c in law.others.items() if c
        )
        return bool(rounded > absolute_tolerance(RTOL, {}, amounts))

    # Names of what is written.

    def name_values(self, laws: list[Law]) -> None:
        """Choose which identifiers stand for themselves, and which for a definition."""
        for identifier in self.assigned:
            if self.mentioned[identifier] or identifier not in self.parameters:
                self.standing[identifier] = self.new(f"{self.words[identifier]}_rule")
        for law in laws:
            word = self.words[law.species]
            self.standing[law.species], self.totals[law.species] = (
                self.new(f"{word}_rest"),
                self.new(f"total_{word}"),
            )
        for identifier in self.species:
            if identifier in self.standing or identifier in self.rated or identifier in self.assigned:
                continue
            if self.is_amount_state(identifier):
                self.standing[identifier] = self.new(f"{self.words[identifier]}_concentration")
        if any(reaction.getFast() for reaction in self.reactions.values()):
            self.result.small = self.new("epsilon")
            self.result.parameters[self.result.small] = EPSILON

    def is_amount_state(self, identifier: str) -> bool:
        """Whether the state of a species is its amount though its symbol means its concentration."""
        return self.is_concentration(identifier) and self.varies(self.species[identifier].getCompartment())

    def state_word(self, identifier: str) -> str:
        if not self.is_amount_state(identifier):
            return self.words[identifier]
        if identifier not in self.amounts:
            self.amounts[identifier] = self.new(f"{self.words[identifier]}_amount")
        return self.amounts[identifier]

    def state_value(self, identifier: str) -> sp.Rational:
        value = self.values.of(identifier)
        return value * self.size_of(self.species[identifier]) if self.is_amount_state(identifier) else value

    # What is written.

    def add_state(self, word: str, rate: str, start: sp.Rational) -> None:
        self.result.states[word], self.result.starts[word] = rate, fraction_text(start)

    def keep(self, word: str, *identifiers: str, parts: Collection[str] = ()) -> None:
        """Say of what `word`, the value of `identifiers` and of these `parts`, is worked out once, at the start."""
        made_of = self.made_of(*identifiers, *parts) | {self.words[part] for part in parts}
        if made_of:
            self.result.worked_out[word] = made_of

    def assign(self, identifier: str, text: str) -> None:
        """`text` is what `identifier` is: a definition where it is mentioned, and an observable under its own name."""
        if identifier in self.standing:
            self.result.definitions[self.standing[identifier]] = text
            text = self.standing[identifier]
        self.result.observables[self.words[identifier]] = text

    def write_reactions(self) -> None:
        changing = {reaction for row in self.coefficients.values() for reaction in row}
        changing |= {reaction for terms in self.terms.values() for reaction, _, _ in terms}
        for identifier in self.reactions:
            if identifier in changing or self.mentioned[identifier]:
                text = self.written.text(self.law(identifier), self.locals[identifier])
                self.result.definitions[self.words[identifier]] = text
            else:
                self.result.left_out.append(f"the reaction {identifier}, which changes nothing")

    def write_rate(self, identifier: str) -> None:
        species = self.species[identifier]
        if identifier in self.totals:
            return
        pieces = [
            (number, self.rate_word(reaction)) for reaction, number in self.coefficients[identifier].items()
        ]
        for reaction, sign, what in self.terms.get(identifier, []):
            text = self.stands(what) if isinstance(what, str) else self.written.text(what)
            pieces.append((Fraction(sign), f"({text})*{self.rate_word(reaction)}"))
        text = weighted_sum(pieces)
        factor = self.factor_of(species)
        if factor:
            text = f"{self.stands(factor)}*({text})"
        word, size = self.state_word(identifier), species.getCompartment()
        if self.is_amount_state(identifier):
            self.assign(identifier, f"{word}/{self.stands(size)}")
        elif self.is_concentration(identifier):
            text = f"({text})/{self.stands(size)}"
        self.add_state(word, text, self.state_value(identifier))
        self.keep(f"the start of {word}", identifier)

    def write_parameters(self, moving: list[str]) -> None:
        given: dict[str, bool] = {}
        for identifier, compartment in self.compartments.items():
            if (
                compartment.getSpatialDimensionsAsDouble() != 0
                or compartment.isSetSize()
                or self.mentioned[identifier]
            ):
                given[identifier] = True
        given |= {identifier: parameter.isSetValue() for identifier, parameter in self.parameters.items()}
        for identifier, species in self.species.items():
            if identifier not in moving:
                given[identifier] = species.isSetInitialAmount() or species.isSetInitialConcentration()
        given |= {own: True for own in self.references if self.mentioned[own] or own in self.initial}
        for identifier, has_value in given.items():
            if identifier in self.assigned or identifier in self.rated:
                continue
            if not (has_value or identifier in self.initial or self.mentioned[identifier]):
                self.result.left_out.append(f"{identifier}, which has no value")
                continue
            if identifier in self.species and self.is_amount_state(identifier):
                word = self.state_word(identifier)
                self.result.parameters[word] = fraction_text(self.state_value(identifier))
                self.assign(identifier, f"{word}/{self.stands(self.species[identifier].getCompartment())}")
            else:
                word = self.words[identifier]
                self.result.parameters[word] = fraction_text(self.values.of(identifier))
                self.keep(word, identifier)

    def rate_word(self, reaction: str) -> str:
        word = self.words[reaction]
        return f"{word}/{self.result.small}" if self.reactions[reaction].getFast() else word

    def write_laws(self, laws: list[Law]) -> None:
        """One species of each law from the others: x = T + sum c x, where x are amounts over conversion factors."""
        for law in laws:
            weights = {name: self.weight(name) for name in (law.species, *law.others)}
            alike = len({text for text, _ in weights.values()}) == 1
            if alike:
                weights = {name: ("", sp.Integer(1)) for name in weights}
            amounts = {name: self.state_value(name) * value for name, (_, value) in weights.items()}
            total = amounts[law.species] - sum(
                (sp.Rational(c.numerator, c.denominator) * amounts[name] for name, c in law.others.items()),
                sp.Integer(0),
            )
            word = self.totals[law.species]
            self.result.parameters[word] = fraction_text(total)
            weighed = [name for name, (text, _) in weights.items() if text]
            factors = [self.factor_of(self.species[name]) for name in weighed]
            sizes = [self.species[name].getCompartment() for name in weighed]
            self.keep(word, *weights, parts={*filter(None, factors), *sizes})
            others = [(c, f"{self.state_word(name)}{weights[name][0]}") for name, c in law.others.items()]
            text = weighted_sum([(Fraction(1), word), *others])
            if weights[law.species][0]:
                text = f"({text})/(1{weights[law.species][0]})"
            if self.is_amount_state(law.species):
                text = f"({text})/{self.stands(self.species[law.species].getCompartment())}"
            self.assign(law.species, text)

    def weight(self, identifier: str) -> tuple[str, sp.Rational]:
        """What makes an amount over its conversion factor of the state of a species, and its value."""
        species = self.species[identifier]
        text, value = "", sp.Integer(1)
        if self.is_concentration(identifier) and not self.is_amount_state(identifier):
            text, value = f"*{self.stands(species.getCompartment())}", self.size_of(species)
        factor = self.factor_of(species)
        if factor:
            text, value = f"{text}/{self.stands(factor)}", value / self.values.of(factor)
        return text, value

    # For the reader.

    def choose_windows(self, moving: list[str], laws: list[Law]) -> None:
        """From nothing to what a conserved sum leaves room for, or, a guess, to the start and as much again as the most
        of any species.
        """
        names = {name for law in laws for name in (law.species, *law.others)}
        weights = {name: float(self.weight(name)[1]) for name in names}
        values = {name: float(self.state_value(name)) for name in names}
        capacity = {
            # Of what is all there a sum of doubles may come out a little less.
            name: max(amount / weights[name], values[name])
            for name, amount in most_of(laws, {name: weights[name] * values[name] for name in names}).items()
        }
        kept = [identifier for identifier in moving if identifier not in self.totals]
        starts = {s: number_in(self.result.starts[self.state_word(s)], self.state_word(s)) for s in kept}
        most = max((value for value in starts.values() if value > 0), default=1.0)
        for s, value in starts.items():
            if value >= 0:
                kind = self.result.bounds if s in capacity else self.result.windows
                kind[self.state_word(s)] = 0.0, capacity.get(s, value + most)
        if not capacity.keys().isdisjoint(starts):
            self.result.notes.append("region: what a conserved sum holds goes from 0 to all of it")

    def take_notes(self, laws: list[Law]) -> None:
        result, notes = self.result, self.result.notes
        kinds = (
            (len(self.reactions), "reaction"),
            (len(self.species), "species"),
            (len(self.compartments), "compartment"),
            (len(self.parameters), "parameter"),
            (len(self.functions), "function"),
            (len(self.rated) + len(self.assigned), "rule"),
            (len(self.initial), "initial assignment"),
        )
        result.understood = "understood: " + ", ".join(
            counted(number, noun) for number, noun in kinds if number
        )
        fast = [identifier for identifier, reaction in self.reactions.items() if reaction.getFast()]
        if fast:
            notes.append(
                f"fast: {', '.join(fast)[:300]}; divided by {result.small}, whose value {EPSILON} is a guess: "
                "the file means the limit 0"
            )
            own = [name for name in SMALL if name in self.parameters]
            if own:
                notes.append(f"{', '.join(own)} of the file stays a parameter")
        for law in laws[:8]:
            pieces = [(Fraction(1), law.species), *((-c, name) for name, c in law.others.items())]
            kept = weighted_sum(pieces)[:200]
            notes.append(f"conserved: {kept} in amounts; {law.species} follows from the others")
        if len(laws) > 8:
            notes.append(f"conserved: {len(laws) - 8} more sums")
        guessed = [c for c in self.compartments if self.is_size_guessed(c)]
        if guessed:
            notes.append(f"sizes that are not given are 1: {', '.join(guessed)[:300]}")
        notes.append(f"units are not read; the span from 0 to {TOTAL} is a guess, for SBML has none")

    def is_size_guessed(self, identifier: str) -> bool:
        compartment = self.compartments[identifier]
        holds = any(s.getCompartment() == identifier for s in self.species.values())
        return (
            holds
            and not compartment.isSetSize()
            and identifier not in self.initial
            and not self.varies(identifier)
            and compartment.getSpatialDimensionsAsDouble() != 0
            and self.source.getLevel() > 1
        )


def weighted_sum(pieces: list[tuple[Fraction, str]]) -> str:
    """A sum with coefficients, as text.

    >>> weighted_sum([(Fraction(-1), "a"), (Fraction(3, 2), "b")])
    '-a + (3/2)*b'
    """
    text = ""
    for number, word in pieces:
        if not number:
            continue
        size = abs(number)
        piece = word if size == 1 else f"{size}*{word}" if size.denominator == 1 else f"({size})*{word}"
        sign = ("-" if number < 0 else "") if not text else (" - " if number < 0 else " + ")
        text += sign + piece
    return text or "0"
