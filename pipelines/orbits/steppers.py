"""Explicit Runge-Kutta steppers as data: a tableau, checked when built, with its stability interval.

    k_i = f(tau + c_i h, s + h sum_j a_ij k_j),    s_next = s + h sum_i b_i k_i

The loop that runs them is ``pipelines.orbits.propagation.propagate``.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray
from scipy.integrate import DOP853

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


def steppers() -> dict[str, Stepper]:
    """All steppers by name."""
    return {stepper.name: stepper for stepper in (RK4, BUTCHER6, DOPRI8)}
