"""How small is small enough for Michaelis and Menten's reaction, and what its reduction costs, both proved."""

import sympy as sp

import gsp


def main() -> None:
    s, c, epsilon = sp.symbols("s c epsilon")
    slow = {s: -s + (s + sp.Rational(1, 2)) * c}
    system = gsp.SlowFastSystem(slow=slow, fast={c: s - (s + 1) * c}, epsilon=epsilon, name="Michaelis-Menten")
    branch = gsp.solve_critical(system).branches[0]
    for order in (0, 1):
        series = gsp.expand(branch, order=order)
        print(f"order {order}")
        print(gsp.certify(series, region={"s": (0.1, 5)}))
        print(gsp.bound_reduction(series, start={"s": 5.0}, span=(0, 10), epsilon=0.1))


if __name__ == "__main__":
    main()
