"""The verb `export`: a reduced flow as the text of another tool."""

from __future__ import annotations

from gsp.errors import DeclarationError
from gsp.exports import TARGETS
from gsp.exports.formats import FORMATS
from gsp.exports.reduced_model import reduced_model
from gsp.scenes.scene import Scene
from gsp.scenes.study import Study, study_of
from gsp.systems.arguments import shown


def export(scene: Scene | Study, *, order: int = 1, to: str = "python") -> str:
    """The reduced flow of `order` as text that stands alone: its rates, the slow manifold, and its parameters.

    `to` is one of `gsp.exports.TARGETS`. Comments name origin, order, region and the error measured at the scene's
    epsilon; what is driven by the flow (`reconstruction`) is left out. On an implicit branch the states are
    coordinates of the critical manifold, which the slow variables are read from as the fast ones are. Raises
    `DeclarationError` for another format, `UnsupportedFunctionError` for a function that the language lacks,
    `BudgetError` for coefficients too long for a text, and what the stages before raise.

    >>> from gsp import export, models
    >>> print(export(models.load("linear"), order=1).splitlines()[-1].strip())
    return np.array(np.broadcast_arrays(epsilon*y + y, 0.0 * state[0])[:-1])
    """
    study = study_of(scene, verb="export")
    if not isinstance(to, str) or to not in TARGETS:
        raise DeclarationError(f"to is one of {', '.join(TARGETS)}.", got=shown(to), value=to, known=TARGETS)
    return FORMATS[to](reduced_model(study, order))
