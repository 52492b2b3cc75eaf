"""Equations of the nouns of this package."""

from __future__ import annotations

from gsp.results.equations import Equation, all_equations_of
from gsp.results.registry import equations
from gsp.scenes.scene import Scene
from gsp.scenes.study import Study


@equations.of(Study)
def _equations_of_study(value: Study) -> list[Equation]:
    return all_equations_of(value.scene)


@equations.of(Scene)
def _equations_of_scene(value: Scene) -> list[Equation]:
    return all_equations_of(value.system)
