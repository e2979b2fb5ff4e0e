"""The foil: relaxation, both readings of its loss factor, both pressures, and how it follows the ring."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.integrate import solve_ivp

from pipelines.machine.bearing import Bearing, FilmSettings, film_state, pack_bearing
from pipelines.orbits.equilibria.equilibrium import film_equilibrium
from tests.helpers.ring import ring_deformation

STIFFNESS, LOSS_FACTOR, SPEED = 4.0, 0.3, 1.7
STILL = np.array([SPEED, 0.0, 0.0, STIFFNESS])
CENTRED = np.zeros(4)


def bearing(**changes: Any) -> Bearing:
    return pack_bearing(FilmSettings(circumferential=20, axial=3, loss_factor=LOSS_FACTOR, **changes))


def pressures(one: Bearing) -> NDArray[np.float64]:
    """A pressure that varies over the whole film, station by station."""
    nodes, stations = one.settings.nodes, one.settings.axial
    return 1.0 + 0.3 * np.sin(np.arange(nodes * stations, dtype=np.float64))


def foil_rate(one: Bearing, foil: NDArray[np.float64], phase: float, parameters: NDArray[np.float64]) -> Any:
    unknowns = np.concatenate([pressures(one), foil])
    return film_state(one, unknowns, CENTRED, phase, parameters).rates[-foil.size :]


@pytest.mark.parametrize(
    ("by_speed", "damping"), [(False, LOSS_FACTOR * STIFFNESS), (True, LOSS_FACTOR * STIFFNESS / SPEED)]
)
def test_foil_relaxes_exponentially(by_speed: bool, damping: float) -> None:
    """c_f dq/dtau = (p_m - 1) - k_f q at a fixed pressure: q = q_inf + (q_0 - q_inf) exp(-k_f tau / c_f).

    c_f = eta k_f, or c_f = eta k_f / Omega by the other reading of eta.
    """
    one = bearing(loss_factor_damping=by_speed)
    nodes, stations = one.settings.nodes, one.settings.axial
    start = 0.1 * np.cos(np.arange(nodes))
    end = (pressures(one).reshape(stations, nodes) - 1.0).T @ one.mean_weights / STIFFNESS
    times = np.array([0.1, 0.5, 2.0])
    solved = solve_ivp(
        lambda _, q: foil_rate(one, q, 0.0, STILL), (0.0, 2.0), start, t_eval=times, rtol=1e-10, atol=1e-12
    )
    decay = np.exp(-STIFFNESS * times / damping)
    np.testing.assert_allclose(solved.y, end[:, None] + (start - end)[:, None] * decay, rtol=0.0, atol=1e-9)


@pytest.mark.parametrize("periodic", [True, False])
def test_absolute_pressure_adds_a_constant(periodic: bool) -> None:
    """c_f dq/dtau = p_m - k_f q: at rest and ambient pressure the foil lies 1/k_f lower, also on the edge."""
    gauge, absolute = (bearing(absolute_pressure=value, periodic=periodic) for value in (False, True))
    solved = film_equilibrium(absolute, np.zeros(2), STILL)
    assert solved.converged
    nodes = absolute.settings.nodes
    np.testing.assert_allclose(solved.state[: 3 * nodes], 1.0, atol=1e-12)
    np.testing.assert_allclose(solved.state[3 * nodes :], 1.0 / STIFFNESS, atol=1e-12)
    film = film_state(absolute, solved.state, CENTRED, 0.0, STILL)
    np.testing.assert_allclose(film.thickness, 1.0 + 1.0 / STIFFNESS, atol=1e-12)
    # Away from equilibrium, too, only the constant differs.
    foil = 0.1 * np.cos(np.arange(nodes))
    difference = foil_rate(absolute, foil, 0.0, STILL) - foil_rate(gauge, foil, 0.0, STILL)
    np.testing.assert_allclose(difference, 1.0 / (LOSS_FACTOR * STIFFNESS), rtol=1e-10)


def test_absolute_pressure_is_a_wider_clearance() -> None:
    """An offset 1/k_f widens the whole film: the same force as a gauge foil in a clearance 1 + 1/k_f.

    With h = a h', a = 1 + 1/k_f: Omega' = Omega / a^2, X' = X / a, k_f' = a k_f and forces unchanged.
    """
    wider = 1.0 + 1.0 / STIFFNESS
    position = np.array([0.3, -0.4])
    absolute, gauge = bearing(absolute_pressure=True), bearing()
    scaled = np.array([SPEED / wider**2, 0.0, 0.0, wider * STIFFNESS])
    force = [
        film_state(one, solved.state, np.array([*where, 0.0, 0.0]), 0.0, parameters).force
        for one, where, parameters in ((absolute, position, STILL), (gauge, position / wider, scaled))
        for solved in [film_equilibrium(one, where, parameters)]
    ]
    np.testing.assert_allclose(force[0], force[1], rtol=1e-8)


MOVING = np.array([SPEED, 0.6, 0.25, STIFFNESS])
RING = {"ring_radius": 650.0, "ring_ratio": 0.9, "ring_amplitude": 0.8, "ring_phase": 0.4}


def ring_at(one: Bearing, phase: float) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """q_r and its rate at the nodes."""
    s = one.settings
    return ring_deformation(
        np.cos(one.angles), np.sin(one.angles), phase, MOVING[2], MOVING[1],
        s.ring_ratio, s.ring_radius, s.ring_amplitude, s.ring_phase,
    )  # fmt: skip


@pytest.mark.parametrize("phase", [0.0, 1.0, 2.5, 5.0])
def test_foil_rides_on_the_ring(phase: float) -> None:
    """c_f (dq/dtau - dq_r/dtau) = (p_m - 1) - k_f (q - q_r): the foil moves relative to its ring."""
    one = bearing(**RING)
    ring, ring_rate = ring_at(one, phase)
    relative = 0.1 * np.cos(np.arange(one.settings.nodes))
    moving = foil_rate(one, ring + relative, phase, MOVING)
    standing = foil_rate(one, relative, phase, STILL)
    np.testing.assert_allclose(moving - ring_rate, standing, rtol=0.0, atol=1e-11)


@pytest.mark.parametrize("edge_angle", [0.0, 0.7, 2.0])
@pytest.mark.parametrize("phase", [0.3, 2.0, 4.0])
def test_film_thickness_moves_at_its_rate(edge_angle: float, phase: float) -> None:
    """dh/dtau of a foil that follows its ring = Omega_ex dh/dphase, at the nodes and on the edge line.

    Journal at rest, no gauge pressure, q = q_r.
    """
    one = bearing(edge_angle=edge_angle, **RING)
    nodes = one.settings.nodes

    def film(at: float) -> Any:
        unknowns = np.concatenate([np.ones(3 * nodes), ring_at(one, at)[0]])
        return film_state(one, unknowns, np.array([0.2, -0.1, 0.0, 0.0]), at, MOVING)

    step = 1e-4
    slope = (film(phase + step).thickness - film(phase - step).thickness) / (2.0 * step)
    np.testing.assert_allclose(MOVING[1] * slope[1:-1], film(phase).thickness_rate, rtol=0.0, atol=1e-9)
    # On the edge the film is as thick as the ring and the journal make it.
    at_edge = np.array([edge_angle])
    ring, ring_rate = ring_deformation(
        np.cos(at_edge), np.sin(at_edge), phase, MOVING[2], MOVING[1], 0.9, 650.0, 0.8, 0.4
    )
    journal = 1.0 - 0.2 * np.cos(edge_angle) + 0.1 * np.sin(edge_angle)
    np.testing.assert_allclose(
        film(phase).thickness[[0, -1]], np.repeat(journal + ring, 2), rtol=0.0, atol=1e-12
    )
    np.testing.assert_allclose(MOVING[1] * slope[[0, -1]], np.repeat(ring_rate, 2), rtol=0.0, atol=1e-9)


def test_journal_velocity_enters_the_thickness_rate() -> None:
    """dh/dtau = -dX/dtau cos theta - dY/dtau sin theta + dq/dtau."""
    one = bearing()
    unknowns = np.concatenate([pressures(one), np.zeros(one.settings.nodes)])
    velocity = np.array([0.3, -0.2])
    still = film_state(one, unknowns, np.array([0.2, -0.1, 0.0, 0.0]), 0.0, STILL).thickness_rate
    moving = film_state(one, unknowns, np.array([0.2, -0.1, *velocity]), 0.0, STILL).thickness_rate
    trig = np.array([np.cos(one.angles), np.sin(one.angles)])
    np.testing.assert_allclose(moving - still, -velocity @ trig, rtol=0.0, atol=1e-13)


def test_phase_of_a_bearings_ring() -> None:
    """A ring ahead by an angle is the same ring seen later by that angle."""
    ahead, same = bearing(**{**RING, "ring_phase": 1.1}), bearing(**{**RING, "ring_phase": 0.0})
    unknowns = np.concatenate([pressures(same), np.zeros(same.settings.nodes)])
    np.testing.assert_allclose(
        film_state(ahead, unknowns, CENTRED, 0.5, MOVING).rates,
        film_state(same, unknowns, CENTRED, 1.6, MOVING).rates,
        rtol=1e-12,
        atol=1e-12,
    )
