"""Coefficients of the Radau IIA methods with 5 and 7 stages: collocation of order 9 and 13, L-stable.

E. Hairer, G. Wanner, Solving Ordinary Differential Equations II, 2nd ed., Springer 1996, sections IV.5 and IV.8,
and Stiff differential equations solved by Radau methods, J. Comput. Appl. Math. 111 (1999), 93-111. The nodes
are the zeros of P_s - P_(s-1), Legendre on (0, 1), and a_ij the integral of the Lagrange polynomial l_j from 0
to c_i; both from mpmath with 60 digits, rounded once. All else follows at import: it steers the iteration, the
step and the dense output, where a few units in the last place do no harm.
"""

from __future__ import annotations

import numpy as np

# By family, stages = 5 + 2 family; all is padded with zeros to one width.
STAGES = (5, 7)
WIDTH = 8
# The stage at whose guess the field is linearised, by family. One earlier a run takes up to 3 % less work,
# but ends with more of the iteration's error: of 275 runs by RADAU9 28 are above 3 tolerances for 13.
LINEARISED = np.array([3, 5])

_NODES = [
    [0.05710419611451768, 0.2768430136381238, 0.5835904323689168, 0.8602401356562195, 1.0],
    [
        0.029316427159784893,
        0.1480785996684843,
        0.3369846902811543,
        0.5586715187715501,
        0.7692338620300545,
        0.9269456713197411,
        1.0,
    ],
]

_MATRICES = [
    [
        [
            0.07299886431790333,
            -0.02673533110794557,
            0.018676929763984353,
            -0.01287910609330644,
            0.005042839233882015,
        ],
        [
            0.15377523147918246,
            0.14621486784749352,
            -0.03644456890512809,
            0.02123306311930472,
            -0.007935579902728777,
        ],
        [
            0.14006304568480987,
            0.29896712949128346,
            0.16758507013524895,
            -0.03396910168661774,
            0.010944288744192253,
        ],
        [
            0.14489430810953477,
            0.2765000687601592,
            0.32579792291042103,
            0.12875675325490976,
            -0.015708917378805327,
        ],
        [0.14371356079122594, 0.28135601514946207, 0.31182652297574126, 0.22310390108357075, 0.04],
    ],
    [
        [
            0.03754626499392133,
            -0.0140393345564604,
            0.0103527896007423,
            -0.008158322540275011,
            0.006388413879534685,
            -0.004602326779148656,
            0.0018289425614706437,
        ],
        [
            0.08014759651561897,
            0.08106206398589154,
            -0.021237992120711036,
            0.014000291238817119,
            -0.010234185730090163,
            0.0071534651513645905,
            -0.0028126393724067235,
        ],
        [
            0.0720638469418819,
            0.17106835498388662,
            0.10961456404007211,
            -0.024619871728984055,
            0.014760377043950817,
            -0.009575259396791401,
            0.0036726783971383057,
        ],
        [
            0.07570512581982441,
            0.15409015514217114,
            0.2271077366732024,
            0.11747818703702478,
            -0.023810827153044174,
            0.012709985533661206,
            -0.004608844281289633,
        ],
        [
            0.07391234216319184,
            0.16135560761594242,
            0.2068672415521042,
            0.23700711534269422,
            0.10308679353381345,
            -0.018854139152580447,
            0.0058589009748887914,
        ],
        [
            0.07470556205979623,
            0.1583072238724687,
            0.21415342326720002,
            0.21987784703186003,
            0.19875212168063527,
            0.06926550160550914,
            -0.00811600819772829,
        ],
        [
            0.07449423555601031,
            0.15910211573365074,
            0.21235188950297781,
            0.22355491450728324,
            0.19047493682211558,
            0.1196137446126562,
            0.02040816326530612,
        ],
    ],
]

NODES = np.zeros((2, WIDTH))
A = np.zeros((2, WIDTH, WIDTH))
# A^-1 = T diag(EIGENVALUES) T^-1 with one real eigenvalue, first, and conjugate pairs, of which one is kept. A
# pair takes two columns of T, Re v and -Im v, so that with w = w1 + i w2 the part of Z is Re(v w); v ends in 1.
EIGENVALUES = np.zeros((2, 4), dtype=complex)
T = np.zeros((2, WIDTH, WIDTH))
T_INVERSE = np.zeros((2, WIDTH, WIDTH))
# Coefficients c_1, c_2, ... of `interpolate_many` for the collocation polynomial, from the stages' rises Z, and
# for the polynomial of one degree more that is 0 at both ends, has the slope 1 at the start, and is flat at the
# nodes.
DENSE = np.zeros((2, WIDTH, WIDTH))
DEFECT = np.zeros((2, WIDTH))


def _nest(x: np.ndarray, count: int) -> np.ndarray:
    """Values (x.size, count) of 1, x, x (1-x), x^2 (1-x), ..., the basis of `interpolate_many`."""
    factors = [x if k % 2 else 1.0 - x for k in range(1, count)]
    return np.cumprod(np.column_stack([np.ones_like(x), *factors]), axis=1)


def _fill(family: int, stages: int) -> None:
    c = NODES[family, :stages] = _NODES[family]
    a = A[family, :stages, :stages] = _MATRICES[family]
    values, vectors = np.linalg.eig(np.linalg.inv(a))
    kept = [k for k in np.argsort(np.abs(np.imag(values))) if np.imag(values[k]) >= 0.0]
    columns = []
    for k in kept:
        vector = vectors[:, k] / vectors[-1, k]
        columns += [np.real(vector)] if k == kept[0] else [np.real(vector), -np.imag(vector)]
    EIGENVALUES[family, : len(kept)] = values[kept]
    T[family, :stages, :stages] = np.column_stack(columns)
    T_INVERSE[family, :stages, :stages] = np.linalg.inv(T[family, :stages, :stages])

    # Z - theta Z_s = theta (1 - theta) p(theta): p by its values at the nodes but the last.
    inner = np.array(c[:-1])
    rises = np.eye(stages - 1, stages)
    rises[:, -1] = -inner
    weights = (inner * (1.0 - inner))[:, np.newaxis]
    DENSE[family, : stages - 1, :stages] = np.linalg.solve(_nest(inner, stages - 1), rises / weights)
    # The integral K of prod (tau - c_i)/prod (-c_i) vanishes at 1: quadrature of order 2 s - 1. Sampled at s points.
    kernel = np.polynomial.Polynomial.fromroots(c)
    kernel = (kernel / kernel(0.0)).integ()
    points = (1.0 - np.cos(np.pi * (np.arange(stages) + 0.5) / stages)) / 2.0
    samples = kernel(points) / (points * (1.0 - points))
    DEFECT[family, :stages] = np.linalg.solve(_nest(points, stages), samples)


for _family, _stages in enumerate(STAGES):
    _fill(_family, _stages)

# The largest values on (0, 1) of the factors of the polynomial's last four coefficients, x^a (1-x)^b with a + b =
# stages - 3 to stages, a = b or b + 1: they come at x = a/(a+b).
LARGEST_FACTORS = np.array(
    [
        [(a / (a + b)) ** a * (b / (a + b)) ** b for a, b in ((m - 1, m - 1), (m, m - 1), (m, m), (m + 1, m))]
        for m in (2, 3)
    ]
)
