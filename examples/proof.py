"""Prove that a branch is normally hyperbolic, write the proof, and check it by other code."""

import tempfile
from pathlib import Path

import sympy as sp

import gsp
from gsp.proofs.checker import check


def main() -> None:
    y, x, eps = sp.symbols("y x epsilon")
    system = gsp.SlowFastSystem(slow={y: -x}, fast={x: y - x**3 / 3 + x}, epsilon=eps)
    branch = gsp.solve_critical(system).branches[0].through({"y": 1.0, "x": 2.1})

    # To within 1e-6 of the fold at y = -2/3, and across it.
    near = gsp.certify(branch, region={"y": (-2 / 3 + 1e-6, 2.0)})
    across = gsp.certify(branch, region={"y": (-1.0, 2.0)})
    print(near)
    print(across)

    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder, "proof.json")
        near.save(file)
        print(check(file))


if __name__ == "__main__":
    main()
