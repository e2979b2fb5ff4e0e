"""The selection of one eigenvalue per circle, on linear flows over the circle with known multipliers."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import pytest

from pipelines.bifurcations.tori.circle_map import CircleImage
from pipelines.bifurcations.tori.fourier import angles
from pipelines.bifurcations.tori.invariant_curve import Torus
from pipelines.bifurcations.tori.problem import TorusProblem, TorusUnknowns
from pipelines.bifurcations.tori.slow_bases import constant_bases
from pipelines.bifurcations.tori.stability import TorusSpectrum, growth_moduli, torus_spectrum
from pipelines.bifurcations.tori.system import CirclePass
from pipelines.orbits.shooting import ShootingOptions

GOLDEN = np.pi * (np.sqrt(5.0) - 1.0)  # rho of the golden mean


@dataclass(frozen=True)
class Prescribed:
    """A map of known rotation of which only that is asked."""

    size: int
    turn: float

    def rotation(self, parameter: float) -> tuple[float, float]:
        return self.turn, 0.0

    def evaluate(self, state, angle, parameter, columns, with_parameter) -> CircleImage:  # type: ignore[no-untyped-def]
        raise AssertionError("no pass is needed")


def spectrum_of(matrices: np.ndarray, rotation: float, cut: float = 1e-3) -> TorusSpectrum:
    """The spectrum of v(theta) -> C(theta) v(theta), C (M, n, n) given at the angles."""
    count, size, _ = matrices.shape
    problem = TorusProblem(Prescribed(size, rotation), ShootingOptions(checked_modulus=cut))
    unknowns = TorusUnknowns(np.zeros((count, size)), rotation, 0.0)
    passed = CirclePass(unknowns.states, matrices, unknowns.states, True)
    return torus_spectrum(problem, Torus(unknowns, constant_bases(np.eye(size), count), passed, 0.0, 0.0))


def turns(at: np.ndarray) -> np.ndarray:
    return np.moveaxis(np.array([[np.cos(at), -np.sin(at)], [np.sin(at), np.cos(at)]]), 2, 0)


def test_constant_flow() -> None:
    """Real, complex and negative multipliers, two of them of equal modulus."""
    blocks = np.zeros((6, 6))
    blocks[:2, :2] = 0.9 * turns(np.array([1.1]))[0]
    blocks[2, 2], blocks[3, 3], blocks[4, 4], blocks[5, 5] = 0.7, -0.7, 1.2, 0.05
    mixing = np.eye(6) + 0.3 * np.sin(1.0 + np.arange(36.0)).reshape(6, 6)
    matrix = mixing @ blocks @ np.linalg.inv(mixing)
    found = spectrum_of(np.tile(matrix, (15, 1, 1)), GOLDEN)
    assert found.complete
    assert found.unstable == 1
    assert found.moduli == pytest.approx([1.2, 0.9, 0.9, 0.7, 0.7, 0.05], abs=1e-10)


@pytest.mark.parametrize("winding", [0, 1, 3])
def test_flow_that_turns_with_the_angle(winding: int) -> None:
    """C = T(theta + rho) diag T(theta)^-1 with frames T that turn ``winding`` half times around: for odd
    numbers each bundle is a Moebius band, whose eigenfunctions have half-integer centres.
    """
    at, multipliers = angles(63), np.array([0.8, 0.3])

    def frames(angle: np.ndarray) -> np.ndarray:
        bent = np.eye(2) + 0.2 * np.array([[0.0, 1.0], [1.0, 0.0]]) * np.cos(angle)[:, None, None]
        return turns(0.5 * winding * angle) @ bent

    matrices = frames(at + GOLDEN) * multipliers @ np.linalg.inv(frames(at))
    found = spectrum_of(matrices, GOLDEN)
    assert found.complete
    # waves are added until residuals are below 1e-5, which leaves far less in the moduli
    assert found.moduli == pytest.approx(multipliers, abs=1e-8)
    assert growth_moduli(matrices, GOLDEN) == pytest.approx(multipliers, rel=1e-3)


def test_growth_where_circles_are_degenerate() -> None:
    """rho of half a turn: the product over two passes varies with the angle, and the largest of the starting
    angles is told, by growth alone.
    """
    at = angles(15)
    matrices = (0.8 + 0.1 * np.cos(2.0 * at))[:, None, None] * np.diag([1.0, 0.5])[None, :, :]
    found = spectrum_of(matrices, np.pi)
    assert not found.complete
    expected = max(0.8 + 0.1 * np.cos(2.0 * start) for start in (0.0, 0.7, 1.9))
    assert found.moduli == pytest.approx([expected, 0.5 * expected], rel=1e-9)


@pytest.mark.parametrize(
    ("largest", "complete", "decided"), [(1.015, False, False), (1.03, False, True), (1.001, True, True)]
)
def test_growth_rates_near_one_leave_the_stability_open(
    largest: float, complete: bool, decided: bool
) -> None:
    moduli = np.array([largest, 0.5])
    spectrum = TorusSpectrum(moduli.astype(complex), np.zeros(2), -1, moduli, moduli, complete)
    assert spectrum.decided == decided
    if decided:
        assert spectrum.unstable == 1
