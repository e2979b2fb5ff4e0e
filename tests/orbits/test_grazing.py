"""Stationary points of the pressure over angle and time, against closed forms."""

from __future__ import annotations

import math

import numpy as np
import pytest

from pipelines.machine.assembly import build_machine
from pipelines.orbits.grazing import nearest_graze, stationary_points
from tests.machines import case

PEAK = (1.3, 0.7)  # angle and phase


def pressure(samples: int, nodes: int, level: float = 0.0):  # type: ignore[no-untyped-def]
    """level + exp(0.3 (cos a + 2 cos b)): a maximum, a minimum and two saddles."""
    phase = 2.0 * np.pi * np.arange(samples)[:, None] / samples - PEAK[1]
    angle = 2.0 * np.pi * np.arange(nodes) / nodes - PEAK[0]
    return level + np.exp(0.3 * (np.cos(phase) + 2.0 * np.cos(angle)))


VALUES = np.exp(0.3 * np.array([-3.0, -1.0, 1.0, 3.0]))


def test_all_stationary_points_are_found_with_fourth_order() -> None:
    errors = []
    for size in (16, 32, 64, 128):
        found = stationary_points(pressure(size, size))
        distances = np.abs(found.values[:, None] - VALUES)
        assert np.all(distances.min(axis=0) < 0.02)
        errors.append(max(distances.min(axis=0)))
    # where a point lies between the nodes changes the constant
    assert np.polyfit(np.log2([16, 32, 64, 128]), -np.log2(errors), 1)[0] == pytest.approx(4.0, abs=0.6)


def test_places_have_second_order() -> None:
    errors = []
    for size in (16, 32, 64):
        found = stationary_points(pressure(size, size))
        best = int(np.argmax(found.values))
        spacing = 2.0 * np.pi / size
        errors.append(
            math.hypot(found.columns[best] * spacing - PEAK[0], found.rows[best] * spacing - PEAK[1])
        )
    assert errors[-1] < 1e-3
    assert np.log2(errors[0] / errors[2]) / 2.0 > 1.7


def test_a_film_with_an_edge_has_none_there() -> None:
    field = np.roll(pressure(32, 32), -round(PEAK[0] * 32 / (2.0 * np.pi)), axis=1)  # maximum at the edge
    assert np.max(stationary_points(field).values) > np.exp(0.85)
    assert np.max(stationary_points(field, periodic=False).values) < np.exp(0.85)


def test_constant_pressure_is_stationary_nowhere() -> None:
    assert not stationary_points(np.zeros((16, 8))).values.size


def test_the_machine_grazes_where_its_pressure_does() -> None:
    """The pressure of one station of the second bearing touches ambient from below."""
    own = case((24, 2))
    machine = build_machine(own)
    settings = machine.bearings[1].settings
    orbit = np.zeros((64, machine.size))
    for index in range(2):
        machine.pressures(orbit, index)[:] = 0.5  # constant: no stationary point
    level = 1.0 - np.exp(0.9) - 2e-3
    angles = machine.bearings[1].angles - PEAK[0]
    phases = 2.0 * np.pi * np.arange(64)[:, None] / 64 - PEAK[1]
    film = machine.pressures(orbit, 1).reshape(64, settings.axial, settings.nodes)
    film[:, 0] = level + np.exp(0.3 * (np.cos(phases) + 2.0 * np.cos(angles)))
    graze = nearest_graze(machine, orbit)
    assert graze is not None
    spacing = angles[1] - angles[0]
    assert graze.bearing == 1
    assert graze.gauge == pytest.approx(-2e-3, abs=0.02 * spacing**4)
    assert graze.angle == pytest.approx(PEAK[0], abs=0.1 * spacing)
    assert graze.phase == pytest.approx(PEAK[1], abs=1e-2)
    doubled = nearest_graze(machine, orbit, 2)
    assert doubled is not None
    assert doubled.phase == pytest.approx(2.0 * graze.phase)


def test_without_clipping_nothing_grazes() -> None:
    own = case((24, 2))
    smooth = [bearing.model_copy(update={"clipping": "smooth"}) for bearing in own.bearings]
    machine = build_machine(own.model_copy(update={"bearings": tuple(smooth)}))
    assert nearest_graze(machine, np.ones((16, machine.size))) is None
