"""Arithmetic on real and on complex values of intermediate code, single doubles or vectors of them."""

from __future__ import annotations

from typing import Any

from llvmlite import ir

from gsp.lowering.steps.values import constant, constants

Complex = tuple[Any, Any]


def intrinsic(builder: Any, name: str, *values: Any) -> Any:
    """LLVM's function `name` of values of one type."""
    kind = values[0].type
    suffix = f"v{kind.count}f64" if isinstance(kind, ir.VectorType) else "f64"
    full = f"llvm.{name}.{suffix}"
    function = builder.module.globals.get(full)
    if function is None:
        function = ir.Function(builder.module, ir.FunctionType(kind, [kind] * len(values)), full)
    return builder.call(function, values)


class RealArithmetic:
    """Numbers are values. Sums of products are fused where the processor can: one rounding instead of two."""

    def __init__(self, builder: Any, width: int = 0) -> None:
        self.builder = builder
        self.width = width

    def constant(self, value: float) -> Any:
        """`value`, in every lane."""
        return constants(*[value] * self.width) if self.width else constant(value)

    def multiply(self, a: Any, b: Any) -> Any:
        """a b."""
        return self.builder.fmul(a, b)

    def add_product(self, total: Any, a: Any, b: Any) -> Any:
        """total + a b; a total of None is 0."""
        return self.builder.fmul(a, b) if total is None else intrinsic(self.builder, "fmuladd", a, b, total)

    def subtract_product(self, total: Any, a: Any, b: Any) -> Any:
        """total - a b; a total of None is 0."""
        return self.add_product(total, self.builder.fneg(a), b)

    def reciprocal(self, a: Any) -> Any:
        """1/a."""
        return self.builder.fdiv(self.constant(1.0), a)

    def size(self, a: Any) -> Any:
        """|a|."""
        return intrinsic(self.builder, "fabs", a)

    def largest(self, values: list[Any]) -> Any:
        """The largest of real numbers; one that is no number may be passed over."""
        result = values[0]
        for value in values[1:]:
            result = self.builder.select(self.builder.fcmp_ordered(">", value, result), value, result)
        return result


class ComplexArithmetic(RealArithmetic):
    """Numbers are pairs (real part, imaginary part)."""

    def negative(self, a: Complex) -> Complex:
        return self.builder.fneg(a[0]), self.builder.fneg(a[1])

    def multiply(self, a: Complex, b: Complex) -> Complex:
        return self.add_product(None, a, b)

    def add_product(self, total: Complex | None, a: Complex, b: Complex) -> Complex:
        real, imaginary = (None, None) if total is None else total
        real_part = super().add_product
        real = real_part(real_part(real, a[0], b[0]), self.builder.fneg(a[1]), b[1])
        return real, real_part(real_part(imaginary, a[0], b[1]), a[1], b[0])

    def subtract_product(self, total: Complex | None, a: Complex, b: Complex) -> Complex:
        return self.add_product(total, self.negative(a), b)

    def reciprocal(self, a: Complex) -> Complex:
        inverse = super().reciprocal(super().add_product(self.builder.fmul(a[0], a[0]), a[1], a[1]))
        return self.builder.fmul(a[0], inverse), self.builder.fneg(self.builder.fmul(a[1], inverse))

    def size(self, a: Complex) -> Any:
        """|Re a| + |Im a|: the modulus would cost a root."""
        return self.builder.fadd(super().size(a[0]), super().size(a[1]))
