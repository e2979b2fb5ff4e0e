"""Runge-Kutta steppers as data: a tableau, checked when built, and its stability.

    k_i = f(tau + c_i h, s + h sum_j a_ij k_j),    s_next = s + h sum_i b_i k_i

The loops that run them are ``propagation.propagate`` for explicit ones, ``implicit.propagate_implicit`` for
diagonally implicit ones.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray
from scipy.integrate import DOP853

_PREDICTOR_POINTS = (
    2  # more extrapolate the decayed parts of the film worse: 3.3 Newton iterations a stage, not 3.7
)
_ROUNDING = 1e-13  # the published coefficients carry 16 digits and sums of them a few units of the last


@dataclass(frozen=True)
class Stepper:
    """An explicit Runge-Kutta method of the stated ``order``; a is (stages, stages), b and c are (stages,).

    Raises ValueError when the tableau is not explicit, its rows do not sum to c, or its weights do not sum to
    one.
    """

    name: str
    order: int
    a: NDArray[np.float64]
    b: NDArray[np.float64]
    c: NDArray[np.float64]

    def __post_init__(self) -> None:
        if np.any(np.triu(self.a) != 0.0):
            raise ValueError(f"stepper {self.name!r}: a must be strictly lower triangular")
        if not np.allclose(self.a.sum(axis=1), self.c, rtol=0.0, atol=_ROUNDING):
            raise ValueError(f"stepper {self.name!r}: the rows of a must sum to c")
        if abs(self.b.sum() - 1.0) > _ROUNDING:
            raise ValueError(f"stepper {self.name!r}: the weights sum to {self.b.sum()}, not to one")

    @property
    def stages(self) -> int:
        return len(self.b)

    @cached_property
    def stability_polynomial(self) -> NDArray[np.float64]:
        """Coefficients of R(z) = 1 + sum_k z^k b' A^(k-1) 1, lowest power first."""
        coefficients = [1.0]
        power = np.ones(self.stages)
        for _ in range(self.stages):
            coefficients.append(float(self.b @ power))
            power = self.a @ power
        return np.array(coefficients)

    @cached_property
    def real_stability_interval(self) -> float:
        """The largest beta with abs(R(-x)) <= 1 for every x in [0, beta]."""
        x = np.linspace(0.0, 4.0 * self.stages, 400_001)[1:]
        modulus = np.abs(np.polynomial.polynomial.polyval(-x, self.stability_polynomial))
        outside = np.flatnonzero(modulus > 1.0 + 1e-12)
        return float(x[outside[0] - 1]) if outside.size and outside[0] > 0 else 0.0


@dataclass(frozen=True)
class ImplicitStepper:
    """A singly diagonally implicit method with an explicit first stage; the last stage is the new point.

    a is (stages, stages) with one ``gamma`` on its diagonal below the first row, c (stages,).  Raises
    ValueError when the tableau has another shape or its rows do not sum to c.
    """

    name: str
    order: int
    a: NDArray[np.float64]
    c: NDArray[np.float64]

    def __post_init__(self) -> None:
        diagonal = np.diag(self.a)
        if np.any(np.triu(self.a, 1) != 0.0) or np.any(self.a[0] != 0.0):
            raise ValueError(
                f"stepper {self.name!r}: a must be lower triangular with an explicit first stage"
            )
        if diagonal[1] <= 0.0 or np.any(diagonal[1:] != diagonal[1]):
            raise ValueError(f"stepper {self.name!r}: the diagonal of a must be one positive number")
        if not np.allclose(self.a.sum(axis=1), self.c, rtol=0.0, atol=_ROUNDING) or self.c[-1] != 1.0:
            raise ValueError(f"stepper {self.name!r}: the rows of a must sum to c, the last one to one")

    @property
    def b(self) -> NDArray[np.float64]:
        """The weights of the new point: the last row of a."""
        return np.asarray(self.a[-1])

    @property
    def stages(self) -> int:
        return len(self.c)

    def stability(self, z: complex) -> complex:
        """R(z), the growth of a step of s' = z s / h."""
        stages = np.linalg.solve(np.eye(self.stages) - z * self.a, np.ones(self.stages))
        return complex(stages[-1])

    @cached_property
    def predictor(self) -> NDArray[np.float64]:
        """Weights (stages, 2 stages) that extrapolate the slopes of two steps to each stage.

        Lagrange interpolation through the nearest known abscissae of the last step and of this one.
        """
        weights = np.zeros((self.stages, 2 * self.stages))
        for i in range(1, self.stages):
            known = {
                self.stages + j: self.c[j] for j in range(i)
            }  # of this step; its first is the last before
            known |= {j: self.c[j] - 1.0 for j in range(self.stages - 1)}
            nearest = sorted(known, key=lambda k: abs(known[k] - self.c[i]))[:_PREDICTOR_POINTS]
            for k in nearest:
                others = [known[other] for other in nearest if other != k]
                weights[i, k] = np.prod([(self.c[i] - x) / (known[k] - x) for x in others])
        return weights


def _singly_implicit(
    name: str, order: int, rows: list[list[float]], abscissae: list[float]
) -> ImplicitStepper:
    """A method from the ``rows`` of a below the first, without their first entry, which follows from c."""
    c = np.array(abscissae, dtype=float)
    a = np.zeros((len(c), len(c)))
    for i, row in enumerate(rows):
        a[i + 1, 1 : 1 + len(row)] = row
        a[i + 1, 0] = c[i + 1] - sum(row)
    return ImplicitStepper(name, order, a, c)


def _explicit(name: str, order: int, rows: list[list[float]], weights: list[float]) -> Stepper:
    a = np.zeros((len(weights), len(weights)))
    for i, row in enumerate(rows):
        a[i + 1, : len(row)] = row
    return Stepper(name, order, a, np.array(weights), a.sum(axis=1))


# Kutta (1901), the classical method of the paper.
RK4 = _explicit("rk4", 4, [[1 / 2], [0, 1 / 2], [0, 0, 1]], [1 / 6, 1 / 3, 1 / 3, 1 / 6])

# Butcher (1964), order six in seven stages.
BUTCHER6 = _explicit(
    "butcher6",
    6,
    [
        [1 / 3],
        [0, 2 / 3],
        [1 / 12, 1 / 3, -1 / 12],
        [25 / 48, -55 / 24, 35 / 48, 15 / 8],
        [3 / 20, -11 / 24, -1 / 8, 1 / 2, 1 / 10],
        [-261 / 260, 33 / 13, 43 / 156, -118 / 39, 32 / 195, 80 / 39],
    ],
    [13 / 200, 0, 11 / 40, 11 / 40, 4 / 25, 4 / 25, 13 / 200],
)

# Dormand and Prince, order eight in twelve stages; the coefficients are those of scipy.
DOPRI8 = Stepper("dopri8", 8, np.array(DOP853.A), np.array(DOP853.B), np.array(DOP853.C))


_GAMMA = 23 / 125

# Kennedy and Carpenter (2019), Applied Numerical Mathematics 146: ESDIRK5(4)7L[2]SA2, L-stable.
ESDIRK5 = _singly_implicit(
    "esdirk5",
    5,
    [
        [_GAMMA],
        [791020047304 / 3561426431547, _GAMMA],
        [-158159076358 / 11257294102345, -85517644447 / 5003708988389, _GAMMA],
        [
            -1653327111580 / 4048416487981, 1514767744496 / 9099671765375, 14283835447591 / 12247432691556,
            _GAMMA,
        ],
        [
            -4540011970825 / 8418487046959, -1790937573418 / 7393406387169, 10819093665085 / 7266595846747,
            4109463131231 / 7386972500302, _GAMMA,
        ],
        [
            -188593204321 / 4778616380481, 2809310203510 / 10304234040467, 1021729336898 / 2364210264653,
            870612361811 / 2470410392208, -1307970675534 / 8059683598661, _GAMMA,
        ],
    ],
    [0, 2 * _GAMMA, 7121331996143 / 11335814405378, 49 / 353, 3706679970760 / 5295570149437, 347 / 382, 1],
)  # fmt: skip


def steppers() -> dict[str, Stepper | ImplicitStepper]:
    """All steppers by name."""
    return {stepper.name: stepper for stepper in (ESDIRK5, RK4, BUTCHER6, DOPRI8)}
