"""C99: functions that fill an array, on an implicit branch by Newton's method along the sheet."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import sympy as sp

from gsp.exports.body import Body, body_of, commented, named, values_of
from gsp.exports.languages import C_WORDS, C
from gsp.exports.names import renamed
from gsp.exports.reduced_model import ReducedModel

# Newton corrections behind the first, which is an Euler step, may be this share of the way: else it may have landed
# on another sheet. Steps are halved down to this share of the line, the end of the sheet being there.
TRUSTED, SHORTEST, TRIALS, NEWTON_STEPS = 0.1, 1e-13, 600, 12


def c_text(model: ReducedModel) -> str:
    """C99 functions that fill an array; parameters in an array, their default values beside.

    On an implicit branch they return whether the branch was found over `slow`, and fill with NaN where not.
    """
    names = renamed(model.symbols, reserved=C_WORDS)
    parameters = values_of(model)
    listed = ", ".join(value for _, value in parameters) or "0.0"
    head = f"const double *slow, double {names[model.epsilon]}, const double *parameters, double *out"
    functions = []
    for name, outputs, says in (
        ("reduced_rates", model.rates, named("The rates of", model.slow, names)),
        ("reduced_slow_manifold", model.manifold, named("The slow manifold:", model.fast, names)),
    ):
        body = body_of(C, model, outputs, names, C_WORDS)
        unused = [f"(void){word};" for word in ("slow", names[model.epsilon], "parameters")]
        lines = [*unused, *_solved(model, len(outputs)), *_read(model, body, names)]
        lines += [f"const double {step} = {text};" for step, text in body.steps]
        lines += [f"out[{i}] = {text};" for i, text in enumerate(body.results)]
        lines += [] if model.sheet is None else ["return 1;"]
        functions.append(
            f"/* {says} */\n" + _function("void" if model.sheet is None else "int", name, head, lines)
        )
    texts = functions if model.sheet is None else [_following(model, names), *functions]
    text = "\n".join(texts)
    places = ", ".join(names[s] for s, _ in parameters) or "there are none"
    prelude = "#include <math.h>\n" + ("" if model.sheet is None else "#include <string.h>\n") + "\n"
    if "sign(" in text:
        prelude += "static double sign(double u)\n{\n    return u > 0.0 ? 1.0 : u < 0.0 ? -1.0 : u;\n}\n\n"
    prelude += f"/* Default values of the parameters: {places}. */\n"
    prelude += f"const double reduced_parameters[{max(len(parameters), 1)}] = {{{listed}}};\n"
    return f"{commented(model, names, '/* ', ' */')}\n{prelude}\n{text}"


def _function(kind: str, name: str, head: str, lines: Sequence[str]) -> str:
    return f"{kind} {name}({head})\n{{\n" + "".join(f"    {line}\n" for line in lines) + "}\n"


def _read(model: ReducedModel, body: Body, names: Mapping[sp.Symbol, str]) -> list[str]:
    """The symbols that a body uses, from the arrays that hold them."""
    parameters = [symbol for symbol, _ in values_of(model)]
    fast = model.fast if model.sheet is not None else ()
    return [
        f"const double {names[symbol]} = {array}[{i}];"
        for array, symbols in (("slow", model.slow), ("fast", fast), ("parameters", parameters))
        for i, symbol in enumerate(symbols)
        if symbol in body.used
    ]


def _solved(model: ReducedModel, outputs: int) -> list[str]:
    if model.sheet is None:
        return []
    return [
        f"double fast[{len(model.fast)}];",
        "if (!reduced_base_point(slow, parameters, fast)) {",
        f"    for (int i = 0; i < {outputs}; i++) out[i] = NAN;",
        "    return 0;",
        "}",
    ]


def _following(model: ReducedModel, names: Mapping[sp.Symbol, str]) -> str:
    """The equations of an implicit branch, and Newton's method along its sheet from a point that lies on it."""
    sheet = model.sheet
    assert sheet is not None
    n, m, count = len(model.fast), len(model.slow), len(values_of(model))
    entries = [sp.diff(equation, y) for equation in sheet.equations for y in model.fast]
    body = body_of(C, model, [*sheet.equations, *entries], names, C_WORDS)
    lines = ["(void)slow;", "(void)parameters;", *_read(model, body, names)]
    lines += [f"const double {step} = {text};" for step, text in body.steps]
    lines += [f"solved[{i}] = {text};" for i, text in enumerate(body.results[:n])]
    lines += [f"jacobian[{i}] = {text};" for i, text in enumerate(body.results[n:])]
    head = "const double *slow, const double *parameters, const double *fast, double *solved, double *jacobian"
    fast = ", ".join(names[s] for s in model.fast)
    given = {
        "N": n, "M": m, "COUNT": count, "STEPS": NEWTON_STEPS, "TRIALS": TRIALS, "TRUSTED": TRUSTED,
        "SHORTEST": SHORTEST, "SLOW": ", ".join(map(repr, sheet.slow)), "FAST": ", ".join(map(repr, sheet.fast)),
        "NAMES": fast,
    }  # fmt: skip
    text = _SOLVER
    for name, value in given.items():
        text = text.replace(f"@{name}@", str(value))
    return (
        f"/* What vanishes on the critical manifold, and its derivatives by {fast}. */\n"
        + _function("static void", "equations", head, lines)
        + "\n"
        + text
    )


_SOLVER = """enum { SLOW_COUNT = @M@, FAST_COUNT = @N@, PARAMETER_COUNT = @COUNT@ };

/* Gauss elimination: solved becomes jacobian^-1 solved; returns the sign of the determinant, 0 if singular. */
static int eliminate(double *jacobian, double *solved)
{
    int turn = 1;
    for (int k = 0; k < FAST_COUNT; k++) {
        int best = k;
        for (int i = k + 1; i < FAST_COUNT; i++)
            if (fabs(jacobian[FAST_COUNT * i + k]) > fabs(jacobian[FAST_COUNT * best + k])) best = i;
        const double pivot = jacobian[FAST_COUNT * best + k];
        if (!(fabs(pivot) > 0.0 && fabs(pivot) < HUGE_VAL)) return 0;
        if (best != k) {
            for (int j = 0; j < FAST_COUNT; j++) {
                const double held = jacobian[FAST_COUNT * k + j];
                jacobian[FAST_COUNT * k + j] = jacobian[FAST_COUNT * best + j];
                jacobian[FAST_COUNT * best + j] = held;
            }
            const double held = solved[k];
            solved[k] = solved[best];
            solved[best] = held;
            turn = -turn;
        }
        if (pivot < 0.0) turn = -turn;
        for (int i = k + 1; i < FAST_COUNT; i++) {
            const double factor = jacobian[FAST_COUNT * i + k] / pivot;
            for (int j = k; j < FAST_COUNT; j++) jacobian[FAST_COUNT * i + j] -= factor * jacobian[FAST_COUNT * k + j];
            solved[i] -= factor * solved[k];
        }
    }
    for (int k = FAST_COUNT - 1; k >= 0; k--) {
        for (int j = k + 1; j < FAST_COUNT; j++) solved[k] -= jacobian[FAST_COUNT * k + j] * solved[j];
        solved[k] /= jacobian[FAST_COUNT * k + k];
    }
    return turn;
}

/* Newton's method from fast; the sign of the determinant where it converges without leaving the sheet, else 0. */
static int newton(const double *slow, const double *parameters, double way, double *fast)
{
    double solved[FAST_COUNT], jacobian[FAST_COUNT * FAST_COUNT], first = 0.0, further = 0.0;
    int turn = 0;
    for (int step = 0; step < @STEPS@; step++) {
        double length = 0.0, size = 0.0;
        equations(slow, parameters, fast, solved, jacobian);
        turn = eliminate(jacobian, solved);
        if (turn == 0) return 0;
        for (int i = 0; i < FAST_COUNT; i++) {
            fast[i] -= solved[i];
            length += solved[i] * solved[i];
            size += fast[i] * fast[i];
        }
        length = sqrt(length);
        size = 1.0 + sqrt(size);
        if (!(length < HUGE_VAL)) return 0;
        if (step == 0) first = length; else further += length;
        if (length <= 4e-16 * size || (step > 2 && length <= 1e-14 * size))
            return further <= @TRUSTED@ * (first + way) + 1e-12 * size ? turn : 0;
    }
    return 0;
}

/* The point of the critical manifold over slow: @NAMES@, on the sheet through a point that is known, which is followed
   along the straight line from there to slow and from the default values to parameters. 1 when it was found, else 0. */
int reduced_base_point(const double *slow, const double *parameters, double *fast)
{
    static const double known[SLOW_COUNT] = {@SLOW@}, over[FAST_COUNT] = {@FAST@};
    double share = 0.0, length = 1.0, line = 0.0;
    for (int i = 0; i < SLOW_COUNT; i++) line += (slow[i] - known[i]) * (slow[i] - known[i]);
    for (int i = 0; i < PARAMETER_COUNT; i++)
        line += (parameters[i] - reduced_parameters[i]) * (parameters[i] - reduced_parameters[i]);
    line = sqrt(line);
    memcpy(fast, over, sizeof over);
    const int side = newton(known, reduced_parameters, 1.0, fast);
    if (side == 0 || !(line < HUGE_VAL)) return 0;
    for (int trial = 0; trial < @TRIALS@; trial++) {
        const double end = share + length < 1.0 ? share + length : 1.0;
        double place[SLOW_COUNT], values[PARAMETER_COUNT + 1] = {0.0}, tried[FAST_COUNT];
        for (int i = 0; i < SLOW_COUNT; i++) place[i] = end < 1.0 ? known[i] + end * (slow[i] - known[i]) : slow[i];
        for (int i = 0; i < PARAMETER_COUNT; i++)
            values[i] =
                end < 1.0 ? reduced_parameters[i] + end * (parameters[i] - reduced_parameters[i]) : parameters[i];
        memcpy(tried, fast, sizeof tried);
        if (newton(place, values, (end - share) * line, tried) == side) {
            memcpy(fast, tried, sizeof tried);
            if (end >= 1.0) return 1;
            share = end;
            length *= 2.0;
        } else {
            length = 0.5 * (end - share);
            if (length < @SHORTEST@) return 0;
        }
    }
    return 0;
}
"""
