"""The quantities of an SBML model: what they are called here, what stands for them, and their values at the start."""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping
from fractions import Fraction
from typing import Any

import sympy as sp

from gsp.errors import ModelFileError
from gsp.readers.conditions import POSITIVE
from gsp.readers.expressions import FUNCTIONS, RESERVED
from gsp.readers.foreign import ForeignModel, free_name
from gsp.readers.sbml_math import Mathematics, decimal, names_in
from gsp.readers.sbml_values import Values, exact, fraction_text
from gsp.systems.arguments import counted

# SBML does not say for how long a model runs.
TOTAL = "10"
_WORD = re.compile(r"[A-Za-z][A-Za-z0-9_]{0,63}")
# ln is no name of a definition.
_TAKEN = RESERVED | FUNCTIONS.keys()


class Quantities:
    """One model: what its identifiers are called here, how they get their values, and how they change."""

    def __init__(self, source: Any, libsbml: Any, origin: str) -> None:
        self.source = source
        self.result = ForeignModel(origin, total=TOTAL)
        self.taken: set[str] = set(_TAKEN)
        # An identifier's word, and what stands for its value in rates where that is not its word: a definition.
        self.words: dict[str, str] = {}
        self.standing: dict[str, str] = {}
        self.assigned: dict[str, Any] = {}
        self.rated: dict[str, Any] = {}
        self.initial: dict[str, Any] = {}
        self.species = {s.getIdAttribute(): s for s in source.getListOfSpecies()}
        self.compartments = {c.getIdAttribute(): c for c in source.getListOfCompartments()}
        self.parameters = {p.getIdAttribute(): p for p in source.getListOfParameters()}
        self.reactions = {r.getIdAttribute(): r for r in source.getListOfReactions()}
        self.functions = {f.getIdAttribute(): f for f in source.getListOfFunctionDefinitions()}
        self.references = {r.getIdAttribute(): r for r, _ in self.all_references() if r.getIdAttribute()}
        self.refuse()
        self.name_all()
        self.read_rules()
        self.clock, self.time_used, self.positive = self.new("t"), False, ""
        self.condition_functions: set[str] = set()
        self.locals = {identifier: self.read_locals(identifier) for identifier in self.reactions}
        options: dict[str, Any] = {"positive": self.step, "condition_functions": self.condition_functions}
        self.written = Mathematics(libsbml, self.stands, time=self.time, **options)
        self.plain = Mathematics(libsbml, self.word, time=lambda: self.clock, **options)
        self.values = Values(
            self.words, formula=self.formula, given=self.given, functions=self.function_table, time=self.clock
        )

    def all_references(self) -> Iterator[tuple[Any, int]]:
        """Reactants with -1 and products with 1."""
        for reaction in self.source.getListOfReactions():
            yield from ((reference, -1) for reference in reaction.getListOfReactants())
            yield from ((reference, 1) for reference in reaction.getListOfProducts())

    def refuse(self) -> None:
        """What no model here has."""
        algebraic = sum(rule.isAlgebraic() for rule in self.source.getListOfRules())
        for number, noun, remedy in (
            (self.source.getNumEvents(), "event", "A model here is a flow without jumps: take {} out."),
            (algebraic, "algebraic rule", "Solve {} for a quantity, and assign that."),
        ):
            if number:
                is_read, it = ("is", "it") if number == 1 else ("are", "them")
                fact = f"the file has {counted(number, noun)}, which {is_read} not read."
                raise ModelFileError(fact, remedy.format(it))
        if self.source.getNumConstraints():
            self.result.left_out.append(counted(self.source.getNumConstraints(), "constraint"))

    def name_all(self) -> None:
        tables = (
            self.functions,
            self.compartments,
            self.species,
            self.parameters,
            self.reactions,
            self.references,
        )
        own = [identifier for table in tables for identifier in table]
        plain = {identifier for identifier in own if _WORD.fullmatch(identifier)} - _TAKEN
        self.taken |= plain
        renamed = []
        for identifier in own:
            self.words[identifier] = identifier
            if identifier not in plain:
                self.words[identifier] = self.new(re.sub("^[^A-Za-z]+", "", identifier) or "x")
                renamed.append(f"{identifier[:64]} is {self.words[identifier]}")
        if renamed:
            self.result.notes.append("renamed, for they are no names here: " + ", ".join(renamed)[:300])

    def read_rules(self) -> None:
        for rule in self.source.getListOfRules():
            variable = rule.getVariable()
            if variable in self.rated or variable in self.assigned:
                raise ModelFileError(f"{variable} has two rules.", "Keep one.")
            (self.rated if rule.isRate() else self.assigned)[variable] = self.mathematics_of(
                rule, "rule", variable
            )
        for assignment in self.source.getListOfInitialAssignments():
            variable = assignment.getSymbol()
            self.initial[variable] = self.mathematics_of(assignment, "initial assignment", variable)

    def mathematics_of(self, element: Any, what: str, variable: str) -> Any:
        if variable not in self.words:
            raise ModelFileError(
                f"a rule or an assignment names {variable[:64]!r}, which is not there.", "Declare it."
            )
        if not element.isSetMath():
            raise ModelFileError(f"the {what} of {variable} has no mathematics.", "Give it some, or remove it.")
        return element.getMath()

    # What stands for an identifier.

    def word(self, identifier: str) -> str:
        if identifier not in self.words:
            raise ModelFileError(f"the name {identifier[:64]!r} is not declared.", "Declare it, or correct it.")
        return self.words[identifier]

    def stands(self, identifier: str) -> str:
        return self.standing.get(identifier) or self.word(identifier)

    def new(self, word: str) -> str:
        """`word`, or one like it where it is taken."""
        return free_name(word, self.taken)

    def time(self) -> str:
        self.time_used = True
        return self.clock

    def step(self) -> str:
        if not self.positive:
            self.positive, argument = self.new("positive"), self.new("u")
            self.result.definitions[f"{self.positive}({argument})"] = re.sub(r"\bu\b", argument, POSITIVE)
        return self.positive

    def read_locals(self, reaction: str) -> dict[str, str]:
        """The words of the parameters of a kinetic law, which become parameters of the model."""
        law, words = self.reactions[reaction].getKineticLaw(), {}
        for parameter in () if law is None else map(law.getParameter, range(law.getNumParameters())):
            name = parameter.getIdAttribute()
            if not parameter.isSetValue():
                raise ModelFileError(f"{name} of {reaction} has no value.", "Give it one.")
            words[name] = self.new(f"{self.words[reaction]}_{name}")
            value = exact(decimal(parameter.getValue(), f"{name} of {reaction}"))
            self.result.parameters[words[name]] = fraction_text(value)
        return words

    # Values at the start.

    def formula(self, identifier: str) -> tuple[str, Mapping[str, sp.Rational]] | None:
        tree = self.initial.get(identifier) or self.assigned.get(identifier)
        if tree is not None:
            return self.plain.text(tree), {}
        if identifier in self.reactions:
            local = self.locals[identifier]
            own = {word: exact(self.result.parameters[word]) for word in local.values()}
            return self.plain.text(self.law(identifier), local), own
        return None

    def given(self, identifier: str) -> sp.Rational:
        if identifier in self.parameters:
            parameter = self.parameters[identifier]
            if not parameter.isSetValue():
                raise ModelFileError(f"{identifier} has no value.", "Give it one.")
            return exact(decimal(parameter.getValue(), identifier))
        if identifier in self.compartments:
            compartment = self.compartments[identifier]
            return (
                exact(decimal(compartment.getSize(), identifier)) if compartment.isSetSize() else sp.Integer(1)
            )
        if identifier in self.references:
            number = self.number_of(self.references[identifier])
            return sp.Rational(number.numerator, number.denominator)
        species = self.species[identifier]
        if species.isSetInitialAmount():
            amount = exact(decimal(species.getInitialAmount(), identifier))
            return amount / self.size_of(species) if self.is_concentration(identifier) else amount
        if species.isSetInitialConcentration():
            concentration = exact(decimal(species.getInitialConcentration(), identifier))
            return concentration if self.is_concentration(identifier) else concentration * self.size_of(species)
        raise ModelFileError(f"{identifier} has no initial value.", "Give it an amount or a concentration.")

    def size_of(self, species: Any) -> sp.Rational:
        size = self.values.of(species.getCompartment())
        if size <= 0:
            raise ModelFileError(
                f"the compartment {species.getCompartment()} has the size {size}.", "Give it a positive one."
            )
        return size

    def is_concentration(self, identifier: str) -> bool:
        """Whether the symbol of a species means its concentration."""
        species = self.species[identifier]
        compartment = self.compartments[species.getCompartment()]
        return not species.getHasOnlySubstanceUnits() and compartment.getSpatialDimensionsAsDouble() != 0

    def factor_of(self, species: Any) -> str:
        return species.getConversionFactor() or self.source.getConversionFactor()

    def made_of(self, *identifiers: str) -> frozenset[str]:
        """The words of what the values of `identifiers` at the start are worked out of."""
        found, own = set[str](), set[str]()
        waiting = list(identifiers)
        while waiting:
            tree, local = self.initial.get(name := waiting.pop()) or self.assigned.get(name), {}
            if tree is None and name in self.reactions:
                tree, local = self.law(name), self.locals[name]
            if tree is not None:
                parts = set(names_in(tree))
                own |= {local[part] for part in parts & local.keys()}
                parts -= local.keys()
            elif name in self.species and self.is_converted(name):
                parts = {self.species[name].getCompartment()}
            else:
                parts = set()
            waiting += parts - found
            found |= parts
        return frozenset(own | {self.words[part] for part in found if part in self.words})

    def is_converted(self, identifier: str) -> bool:
        """Whether the value of a species at the start is given as an amount and is a concentration, or the reverse."""
        return self.species[identifier].isSetInitialAmount() == self.is_concentration(identifier)

    def varies(self, compartment: str) -> bool:
        return compartment in self.rated or compartment in self.assigned

    # Functions.

    def function_table(self) -> dict[str, str]:
        own = {self.words[identifier] for identifier in self.functions} | {self.positive}
        return {head: text for head, text in self.result.definitions.items() if head.partition("(")[0] in own}

    def define_function(self, identifier: str, path: tuple[str, ...] = ()) -> None:
        word, function = self.words[identifier], self.functions[identifier]
        if identifier in path:
            circle = " -> ".join((*path[path.index(identifier) :], identifier))
            raise ModelFileError(f"the functions {circle[:300]} are a circle.", "Write one of them out.")
        if any(head.partition("(")[0] == word for head in self.result.definitions):
            return
        body = function.getBody() if function.isSetMath() else None
        if body is None:
            raise ModelFileError(
                f"the function {identifier} has no mathematics.", "Give it some, or remove it."
            )
        arguments = [function.getArgument(i).getName() for i in range(function.getNumArguments())]
        for name in (set(names_in(body)) & self.functions.keys()).difference(arguments):
            self.define_function(name, (*path, identifier))
        local = {name: self.new(name if _WORD.fullmatch(name) else "x") for name in arguments}
        found = self.written.whole(body, local)
        if found.is_condition:
            self.condition_functions.add(identifier)
        head = f"{word}({', '.join(local[name] for name in arguments)})" if arguments else word
        self.result.definitions[head] = found.text

    def law(self, reaction: str) -> Any:
        """The mathematics of the kinetic law of a reaction."""
        law = self.reactions[reaction].getKineticLaw()
        if law is None or not law.isSetMath():
            raise ModelFileError(f"the reaction {reaction} has no kinetic law.", "Give it one, or remove it.")
        return law.getMath()

    def number_of(self, reference: Any) -> Fraction:
        """The stoichiometry of a species reference where it is a number."""
        value = reference.getStoichiometry()
        if value != value:
            raise ModelFileError(
                f"{reference.getSpecies()} takes part in a reaction without a stoichiometry.", "Give it one."
            )
        return Fraction(decimal(value, "a stoichiometry")) / reference.getDenominator()
