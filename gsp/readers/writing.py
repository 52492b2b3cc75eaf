"""Scenes to model files: what `load` reads back as the same scene."""

from __future__ import annotations

import json
import os
from collections.abc import Iterable, Iterator, Mapping
from pathlib import Path

import sympy as sp
from sympy.printing.str import StrPrinter

from gsp.errors import DeclarationError, ModelFileError
from gsp.readers.toml import read_model
from gsp.results.files import write_file
from gsp.scenes.fast_phase import FastPhase
from gsp.scenes.ramp_question import RampQuestion
from gsp.scenes.scene import Scene
from gsp.scenes.view import View
from gsp.systems.arguments import check_noun, shown
from gsp.systems.system import SlowFastSystem

# To how many digits two expressions that are written differently are compared.
DIGITS = 40


def save(scene: Scene, path: str | os.PathLike[str]) -> Path:
    """Write `scene` as a model file to `path`, which ends in .toml; the inverse of `load`.

    The text is read back first and must give the same scene. Numbers return to the last bit, expressions exactly,
    although a factor may have been multiplied into a sum. Raises `DeclarationError` for a scene that the format cannot
    hold, such as one with a function outside its grammar, and `OutputError` where the file cannot be written.

    >>> gsp.save(gsp.models.load("chaplygin_sleigh"), "sleigh.toml")              # doctest: +SKIP
    """
    if not isinstance(path, (str, os.PathLike)) or Path(path).suffix.lower() != ".toml":
        raise DeclarationError("save takes the path of a file that ends in .toml.", got=shown(path), value=path)
    return write_file(as_toml(scene).encode(), Path(path))


def as_toml(scene: Scene) -> str:
    """The text of a model file that is read as `scene`; raises `DeclarationError` where there is none."""
    check_noun(scene, Scene, verb="save")
    text = _written(scene)
    try:
        back = read_model(text, name=scene.name)
    except (ModelFileError, DeclarationError) as error:
        raise DeclarationError(f"the scene cannot be kept in a model file: {error}") from None
    for saved, found in zip(_content(scene), _content(back), strict=True):
        if saved != found and not _agree(saved, found):
            raise DeclarationError(
                f"the scene cannot be kept in a model file: {shown(saved)} is read back as {shown(found)}."
            )
    return text


def _content(scene: Scene) -> Iterator[object]:
    """All that a scene holds, in the order of a file."""
    system = scene.system
    yield from (type(system), str(system.epsilon), scene.second, scene.title, scene.source, scene.description)
    yield from (
        scene.region,
        scene.full_start,
        scene.span,
        scene.epsilon,
        scene.epsilons,
        scene.tolerance,
        scene.path,
        scene.starts,
        scene.units,
        scene.views,
        scene.phase,
    )
    for name, asked in scene.ramps.items():
        yield from (name, dict(asked.edge), dict(asked.start), *asked.ramp.ends, asked.ramp.profile)
    for table in (
        *(asked.ramp.parameters for asked in scene.ramps.values()), system.parameters,
        dict(zip(system.states, system.rates)), system.observables, scene.reconstruction, *scene.claims.values(),
    ):  # fmt: skip
        for symbol, expression in table.items():
            yield symbol.name
            yield expression


def _agree(saved: object, found: object) -> bool:
    """Whether two expressions have the same values, where SymPy has multiplied a number into a sum of one of them."""
    if not isinstance(saved, sp.Expr) or not isinstance(found, sp.Expr):
        return False
    plain = [_by_name(saved), _by_name(found)]
    if plain[0].free_symbols != plain[1].free_symbols:
        return False
    names = sorted(plain[0].free_symbols, key=str)
    # They are compared in three places.
    for k in range(3):
        place = {s: sp.Rational(2 * i + 3 * k + 5, 7 * i + k + 6) for i, s in enumerate(names)}
        values = [e.xreplace(place).evalf(DIGITS) for e in plain]
        gap, bound = abs(values[0] - values[1]), sp.Float(10) ** (10 - DIGITS) * (1 + abs(values[0]))
        if not gap.is_finite or gap > bound:
            return False
    return True


def _by_name(expression: sp.Expr) -> sp.Expr:
    return expression.xreplace(
        {s: sp.Symbol(s.name) for s in expression.free_symbols if isinstance(s, sp.Symbol)}
    )


def _written(scene: Scene) -> str:
    system = scene.system
    parts = {
        "parameters": _expressions(system.parameters),
        **(
            {"slow": _expressions(system.slow), "fast": _expressions(system.fast)}
            if isinstance(system, SlowFastSystem)
            else {"states": _expressions(system.equations)}
        ),
        "observables": _expressions(system.observables),
        "reconstruction": _expressions(scene.reconstruction),
        "region": {name: _list(interval) for name, interval in scene.region.items()},
        "start": {name: repr(value) for name, value in scene.full_start.items()},
        "scene": {
            "span": _list(scene.span),
            **({"epsilon": repr(scene.epsilon), "epsilons": _list(scene.epsilons)} if scene.has_small else {}),
            "tolerance": repr(scene.tolerance),
            **({"path": json.dumps(scene.path)} if scene.path else {}),
        },
        **{f"claims.{_quoted(name)}": _expressions(rates) for name, rates in scene.claims.items()},
        **{
            f"starts.{_quoted(name)}": {state: repr(value) for state, value in start.items()}
            for name, start in scene.starts.items()
        },
        **{f"views.{_quoted(name)}": _view(view) for name, view in scene.views.items()},
        **{f"ramps.{_quoted(name)}": _ramp(asked) for name, asked in scene.ramps.items()},
        "phase": _phase(scene.phase),
        "units": {name: _quoted(unit) for name, unit in scene.units.items()},
    }
    head = {key: _quoted(getattr(scene, key)) for key in ("name", "title", "source", "description")}
    lines = [f"{key} = {text}" for key, text in head.items() if text != '""']
    if scene.has_small:
        small = _quoted(str(system.epsilon))
        lines.append(f"epsilon = {f'[{small}, {_quoted(scene.second)}]' if scene.second else small}")
    for title, table in parts.items():
        if table:
            lines += ["", f"[{title}]", *(f"{_key(name)} = {value}" for name, value in table.items())]
    return "\n".join(lines) + "\n"


def _phase(asked: FastPhase | None) -> dict[str, str]:
    if asked is None:
        return {}
    name = {"name": _quoted(asked.name)} if asked.name else {}
    return {**name, **({"pair": json.dumps(asked.pair)} if asked.pair else {})}


def _view(view: View) -> dict[str, str]:
    written = {axis: _quoted(name) for axis, name in zip("xyz", view.names, strict=False)}
    if view.title:
        written["title"] = _quoted(view.title)
    if view.ranges:
        written["ranges"] = _inline({name: _list(interval) for name, interval in view.ranges.items()})
    return written


def _ramp(asked: RampQuestion) -> dict[str, str]:
    """By expressions in the phase, as any ramp is."""
    ramp, text = asked.ramp, _Grammar()
    ends = ", ".join(_quoted(text.doprint(end)) for end in ramp.ends if end is not None)
    points = {"edge": asked.edge, "start": asked.start}
    return {
        "profile": _quoted(text.doprint(ramp.profile)),
        "ends": f"[{ends}]",
        "parameters": _inline(_expressions(ramp.parameters)),
        **{what: _inline({s: repr(v) for s, v in point.items()}) for what, point in points.items() if point},
    }


def _inline(table: Mapping[str, str]) -> str:
    return f"{{{', '.join(f'{_key(name)} = {value}' for name, value in table.items())}}}"


def _expressions(table: Mapping[sp.Symbol, sp.Expr]) -> dict[str, str]:
    return {symbol.name: _quoted(_Grammar().doprint(value)) for symbol, value in table.items()}


def _key(name: str) -> str:
    # TOML takes other letters between quotes alone; what is no name of a model file is then refused by that.
    return name if name.isascii() else _quoted(name)


def _list(values: Iterable[float]) -> str:
    return f"[{', '.join(map(repr, values))}]"


def _quoted(text: str) -> str:
    # TOML has no surrogate pairs, which JSON writes where it keeps to ASCII, and wants DEL escaped.
    return json.dumps(text, ensure_ascii=False).replace("\x7f", "\\u007f")


class _Grammar(StrPrinter):
    """SymPy's own text where it is that of the grammar, whose words differ for a few and whose numbers are short."""

    def _print_Integer(self, expr: sp.Integer) -> str:
        return str(expr.p) if abs(expr.p) < 10**DIGITS else self._long(expr.p)

    def _print_Rational(self, expr: sp.Rational) -> str:
        if max(abs(expr.p), expr.q) < 10**DIGITS:
            return f"{expr.p}/{expr.q}"
        return f"({self._print(sp.Integer(expr.p))}/{self._print(sp.Integer(expr.q))})"

    def _long(self, number: int) -> str:
        """A sum over powers of 10, in each of which stands a factor of at most `DIGITS` digits."""
        terms, power, rest = [], 0, abs(number)
        while rest % 10 == 0:
            rest, power = rest // 10, power + 1
        while rest:
            rest, digits = divmod(rest, 10**DIGITS)
            if digits:
                terms.append(f"{digits}*10**{power}" if power else str(digits))
            power += DIGITS
        total = " + ".join(reversed(terms))
        return f"(-({total}))" if number < 0 else f"({total})"

    def _print_Exp1(self, expr: sp.Expr) -> str:
        return "exp(1)"

    def _print_Abs(self, expr: sp.Expr) -> str:
        return f"abs({self._print(expr.args[0])})"

    def _print_LatticeOp(self, expr: sp.Expr) -> str:
        *rest, last = sorted(map(self._print, expr.args))
        # The grammar's min and max take two.
        for text in rest:
            last = f"{type(expr).__name__.lower()}({text}, {last})"
        return last
