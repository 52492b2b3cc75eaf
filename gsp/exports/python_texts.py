"""Texts in Python: for NumPy, JAX and CasADi."""

from __future__ import annotations

from gsp.algebra.languages import CASADI, JAX, PYTHON
from gsp.algebra.printing import Language
from gsp.exports.body import bodies_of, commented, heading, starts_of, values_of
from gsp.exports.names import renamed
from gsp.exports.reduced_model import ReducedModel
from gsp.exports.reserved_words import PYTHON_WORDS

_NUMPY_END = "return np.array(np.broadcast_arrays({}, 0.0 * state[0])[:-1])"


def python_text(model: ReducedModel) -> str:
    """NumPy functions of numbers or of arrays, keyword arguments for parameters."""
    # What is constant gets the shape of the others.
    text = _functions(model, PYTHON, _NUMPY_END)
    imports = "import numpy as np\n"
    if "erf(" in text:
        imports = f"import math\n\n{imports}\nerf = np.vectorize(math.erf, otypes=[float])\n"
    return _joined(model, imports, text)


def jax_text(model: ReducedModel) -> str:
    """JAX functions of arrays, to be differentiated, mapped and compiled; doubles are the caller's to ask for."""
    text = _functions(model, JAX, _NUMPY_END.replace("np.", "jnp."))
    imports = "import jax.numpy as jnp\n"
    if "erf(" in text:
        imports += "from jax.scipy.special import erf\n"
    note = '# JAX has single precision unless jax.config.update("jax_enable_x64", True) was called.\n'
    return _joined(model, note + imports, text)


def casadi_text(model: ReducedModel) -> str:
    """CasADi functions of SX, MX or DM, columns in and out."""
    return _joined(model, "import casadi as ca\n", _functions(model, CASADI, "return ca.vertcat({})"))


def _functions(model: ReducedModel, language: Language, end: str) -> str:
    names = renamed(model.symbols, reserved=PYTHON_WORDS)
    functions = []
    bodies = bodies_of(language, model, names, PYTHON_WORDS)
    for head, (body, says) in zip(("rates(t, state", "slow_manifold(state"), bodies):
        values = "".join(f", {names[s]}={v}" for s, v in values_of(model, with_epsilon=True))
        lines = [f"{names[s]} = state[{i}]" for i, s in enumerate(model.states) if s in body.used]
        lines += [f"{name} = {text}" for name, text in body.steps]
        lines.append(end.format(", ".join(body.results)))
        functions.append(f'def {head}{values}):\n    """{says}"""\n' + "".join(f"    {x}\n" for x in lines))
    return "\n\n".join(functions)


def _joined(model: ReducedModel, imports: str, text: str) -> str:
    names = renamed(model.symbols, reserved=PYTHON_WORDS)
    start = f"# {heading('A start of', model.states, names)}\nstart = [{starts_of(model)}]\n"
    return f"{commented(model, names, '# ')}\n{imports}\n{start}\n\n{text}"
