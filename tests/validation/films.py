"""Bearings of the reference tables, their closed forms, and what the tables list.

Forces are in units of p0 R L, stiffness and damping per unit h/c, masses in units of p0 R L t0^2 / c, all per
bearing.
"""

from __future__ import annotations

import csv
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import interp1d
from scipy.optimize import brentq

from pipelines.machine.bearing import Bearing, FilmSettings, FilmState, film_state, pack_bearing
from pipelines.orbits.equilibria.bearing_coefficients import stiffness_and_damping
from pipelines.orbits.equilibria.equilibrium import film_equilibrium
from pipelines.orbits.equilibria.linear import dynamic_stiffness

Array = NDArray[np.float64]
ComplexArray = NDArray[np.complex128]

REFERENCE = Path(__file__).parents[1] / "reference"


def reference_table(name: str) -> list[dict[str, str]]:
    """Rows of a table in tests/reference."""
    with (REFERENCE / f"{name}.csv").open(newline="") as file:
        return list(csv.DictReader(file))


@dataclass(frozen=True)
class Film:
    """A single bearing running at a bearing number (dimensionless speed) Lambda."""

    bearing: Bearing
    parameters: Array

    @property
    def speed(self) -> float:
        return float(self.parameters[0])

    def steady(self, position: tuple[float, float]) -> Array:
        """Film and foil in equilibrium, computed from scratch with the journal held at ``position``."""
        result = film_equilibrium(self.bearing, np.array(position), self.parameters)
        assert result.converged, result.reason
        return result.state

    def force(self, position: tuple[float, float]) -> Array:
        """Static force on the journal (X, Y)."""
        return self.state(self.steady(position), position).force

    def state(self, unknowns: Array, position: tuple[float, float]) -> FilmState:
        """The film with the journal at rest."""
        return film_state(self.bearing, unknowns, np.array([*position, 0.0, 0.0]), 0.0, self.parameters)

    def dynamic_stiffness(self, position: tuple[float, float], whirl_ratios: Sequence[float]) -> ComplexArray:
        """Z(i nu Lambda) at the whirl ratios nu, shape (ratios, 2, 2)."""
        exponents = 1j * self.speed * np.asarray(whirl_ratios)
        return dynamic_stiffness(
            self.bearing, self.steady(position), np.array(position), self.parameters, exponents
        )

    def coefficients(
        self, position: tuple[float, float], whirl_ratios: Sequence[float]
    ) -> tuple[Array, Array]:
        """K and C at the whirl ratios, shapes (ratios, 2, 2)."""
        return stiffness_and_damping(
            self.bearing,
            self.steady(position),
            np.array(position),
            self.parameters,
            self.speed * np.asarray(whirl_ratios, dtype=np.float64),
        )


def film(
    grid: tuple[int, int],
    *,
    slenderness: float,
    speed: float,
    foil_stiffness: float = np.inf,
    loss_factor: float = 1.0,
    periodic: bool = True,
    clipping: str = "full",
    scheme: str = "central",
    **switches: Any,
) -> Film:
    """A bearing on a grid N_theta x N_z; ``slenderness`` = L/D, an infinite foil stiffness makes it rigid.

    The other fields of ``FilmSettings`` are ``switches``.
    """
    rigid = bool(np.isinf(foil_stiffness))
    settings = FilmSettings(
        circumferential=grid[0],
        axial=grid[1],
        periodic=periodic,
        clipping=clipping,
        scheme=scheme,
        kappa=0.5 / slenderness,
        loss_factor=1.0 if rigid else loss_factor,
        stiffness_ratio=0.0 if rigid else 1.0,
        **switches,
    )
    return Film(pack_bearing(settings), np.array([speed, 0.0, 0.0, 1.0 if rigid else foil_stiffness]))


def ausman_response(s: complex, slenderness: float) -> complex:
    """G(s) = s/(1+s) (1 - tanh xi / xi), xi = (L/D) sqrt(1+s): Ausman, exact as eps -> 0, rigid bearing."""
    xi = slenderness * np.sqrt(1.0 + s)
    return complex(s / (1.0 + s) * (1.0 - np.tanh(xi) / xi))


def concentric_stiffness(
    slenderness: float, speed: float, sigma: complex, foil_stiffness: float = np.inf, loss_factor: float = 0.0
) -> ComplexArray:
    """Z(sigma) of a concentric film and its foil in series, c_f = eta k_f, shape (2, 2).

    1/G_e(s) = 1/G(s) + 1/(k_f + sigma c_f)
    Z_xx = Z_yy = pi/2 [G_e(i Lambda + 2 sigma) + G_e(-i Lambda + 2 sigma)]
    Z_xy = -Z_yx = i pi/2 [G_e(-i Lambda + 2 sigma) - G_e(i Lambda + 2 sigma)]
    """
    foil = 0.0 if np.isinf(foil_stiffness) else 1.0 / (foil_stiffness * (1.0 + sigma * loss_factor))
    forward, backward = (
        1.0 / (1.0 / ausman_response(sign * 1j * speed + 2.0 * sigma, slenderness) + foil) for sign in (1, -1)
    )
    direct, cross = 0.5 * np.pi * (forward + backward), 0.5j * np.pi * (backward - forward)
    return np.array([[direct, cross], [-cross, direct]])


@dataclass(frozen=True)
class Threshold:
    """A rigid rotor of mass ``mass`` per bearing whirls undamped: M (i omega)^2 X = -Z(i omega) X."""

    whirl_ratio: float
    stiffness: float
    mass: float


def threshold_masses(
    film: Film, position: tuple[float, float], whirl_ratios: Sequence[float]
) -> list[Threshold]:
    """Every whirl ratio in the scanned range where an eigenvalue of Z(i omega) is real and positive.

    There it equals M omega^2.  ``whirl_ratios`` (ascending) must be close enough for the two eigenvalues
    to be told apart by continuity.
    """
    unknowns, at = film.steady(position), np.array(position)

    def eigenvalues(ratio: float) -> ComplexArray:
        exponent = np.array([1j * film.speed * ratio])
        return np.linalg.eigvals(dynamic_stiffness(film.bearing, unknowns, at, film.parameters, exponent)[0])

    def nearest(ratio: float, expected: complex) -> complex:
        values = eigenvalues(ratio)
        return complex(values[np.argmin(abs(values - expected))])

    found = []
    start = eigenvalues(whirl_ratios[0])
    for low, high in pairwise(whirl_ratios):
        end = eigenvalues(high)
        if abs(end - start).sum() > abs(end[::-1] - start).sum():
            end = end[::-1]
        for first, last in zip(start, end, strict=True):
            if first.imag * last.imag < 0.0:
                chord = interp1d([low, high], [first, last])

                def imaginary(nu: float, chord: interp1d = chord) -> float:
                    return nearest(nu, chord(nu)).imag

                ratio = float(brentq(imaginary, low, high, xtol=1e-10))
                stiffness = nearest(ratio, chord(ratio)).real
                if stiffness > 0.0:
                    found.append(Threshold(ratio, stiffness, stiffness / (film.speed * ratio) ** 2))
        start = end
    return found


def relative(value: NDArray[np.generic], expected: NDArray[np.generic]) -> float:
    """|value - expected| / |expected| in the Euclidean (Frobenius) norm."""
    return float(np.linalg.norm(np.asarray(value) - expected) / np.linalg.norm(np.asarray(expected)))


def observed_order(errors: list[float], steps: list[float]) -> float:
    """Least-squares slope of log(error) over log(step)."""
    return float(np.polyfit(np.log(steps), np.log(errors), 1)[0])
