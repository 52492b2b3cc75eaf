"""Names in TeX: letters where they are letters, and else as they are spelt."""

import pytest
import sympy as sp

import gsp
from gsp.charts.style import mathematics
from gsp.results.mathml import Typesetter
from gsp.results.tex import name_in_tex, spelt, tex


@pytest.mark.parametrize(
    ("name", "text"),
    [
        ("lambda", r"\lambda"), ("V_max", "V_{max}"), ("xbar", r"\bar{x}"), ("k12", "k_{12}"),
        ("σ", r"\sigma"), ("Vabs", r"\mathrm{Vabs}"), ("Ical", r"\mathrm{Ical}"),
        ("tprime", r"\mathrm{tprime}"), ("sigma__a", r"\mathrm{sigma\_\_a}"),
        ("mu_", r"\mathrm{mu\_}"), ("_x", r"\mathrm{\_x}"), ("x_kabs", r"\mathrm{x\_kabs}"),
        ("k_1_2", r"k_{1\,2}"), ("k_12", "k_{12}"), ("Potassium_gate_max", r"\mathrm{Potassium}_{gate\,max}"),
    ],
)  # fmt: skip
def test_no_name_is_set_as_a_formula(name: str, text: str) -> None:
    assert name_in_tex(name) == text
    assert mathematics(name) == f"${text}$"


def test_letters_of_other_alphabets_are_spelt() -> None:
    assert [spelt(name) for name in ("Λ", "ς", "ϕ_1", "ж")] == ["Lambda", "sigma", "phi_1", "_"]


def test_a_name_is_a_factor_and_no_power_on_cards() -> None:
    x, y, k, epsilon = sp.symbols("x y kabs__2 epsilon")
    system = gsp.SlowFastSystem(slow={x: -k * x}, fast={y: x - y}, epsilon=epsilon, parameters={k: 1})
    assert r"\dot{x} &= - \mathrm{kabs\_\_2} x" in (system._repr_latex_() or "")
    assert tex(k**2) == r"\mathrm{kabs\_\_2}^{2}"
    assert "msup" not in Typesetter([epsilon, *system.parameters, *system.states]).row(k * x)
