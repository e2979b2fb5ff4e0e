"""Modes told apart by their eigenvectors, speeds inserted where that is in doubt, critical speeds counted."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
import pytest
from numpy.typing import NDArray

from pipelines.machine.assembly import build_machine, parameter_vector
from pipelines.orbits.equilibria import linear as linear_module
from pipelines.orbits.equilibria import modes as modes_module
from pipelines.orbits.equilibria.campbell import CampbellDiagram, campbell_diagram, may_turn
from pipelines.orbits.equilibria.critical_speeds import CriticalSpeeds, critical_speeds
from pipelines.orbits.equilibria.equilibrium import machine_equilibrium
from pipelines.orbits.equilibria.linear import at_speed
from pipelines.orbits.equilibria.modes import LARGEST_KNOWN, ModeSet, match_modes, modes_at
from tests.helpers.rotors import CLOSE_CRITICALS, HEAVY_ON_SOFT_FOILS, TwoDiscRotor
from tests.machines import BEARING, case, symmetric_rotor

ComplexArray = NDArray[np.complex128]


def mode_set(matrix: NDArray[np.float64]) -> ModeSet:
    """Modes of a small first-order system."""
    values, vectors = np.linalg.eig(matrix)
    kept = np.flatnonzero(values.imag > 0.0)
    kept = kept[np.argsort(values.imag[kept])]
    return ModeSet(values[kept], vectors[:, kept], np.zeros((len(kept), 0, 2)))


def coupled(detuning: float, coupling: float) -> ModeSet:
    """Two oscillators x'' = -K x, almost alike."""
    stiffness = np.array([[1.0 + detuning, coupling], [coupling, 1.0 - detuning]])
    return mode_set(np.block([[np.zeros((2, 2)), np.eye(2)], [-stiffness, -0.02 * np.eye(2)]]))


def test_modes_that_cross_keep_their_shape() -> None:
    """Hardly coupled, the frequencies change their order and the shapes do not."""
    match = match_modes(coupled(-0.05, 1e-4), coupled(0.05, 1e-4))
    assert match.partner == (1, 0)
    assert all(match.certain)


def test_modes_that_veer_are_in_doubt_until_the_steps_are_small() -> None:
    """Strongly coupled, each goes over into the other shape: seen by small steps only."""
    far = match_modes(coupled(-0.05, 0.05), coupled(0.05, 0.05))
    assert not any(far.certain)
    steps = [coupled(detuning, 0.05) for detuning in np.linspace(-0.05, 0.05, 6)]
    for one, other in pairwise(steps):
        match = match_modes(one, other)
        assert match.partner == (0, 1)
        assert all(match.certain)


def test_matching_does_not_depend_on_the_scale_of_eigenvectors() -> None:
    one, other = coupled(-0.02, 0.03), coupled(-0.01, 0.03)
    turned = ModeSet(other.eigenvalues, other.vectors * np.array([3e4j, -1e-5]), other.shapes)
    assert match_modes(one, other) == match_modes(one, turned)


@pytest.mark.parametrize(
    ("points", "own", "doubt"),
    [
        ([(0.0, 1.0), (1.0, 0.9)], 0, True),  # nothing is known of the curvature
        ([(0.0, 1.0), (1.0, 0.5), (2.0, 0.0 - 0.4)], 1, False),  # one crossing
        ([(0.0, 1.1), (1.0, 0.1), (2.0, 0.1), (3.0, 1.1)], 1, True),  # may dip below
        ([(0.0, 1.2), (1.0, 1.1), (2.0, 1.0), (3.0, 0.9)], 1, False),  # straight and far away
        ([(0.0, 2.0), (1.0, 0.01), (2.0, -0.01), (3.0, 2.0)], 1, True),  # steep bends about a flat crossing
    ],
)
def test_a_path_that_may_turn(points: list[tuple[float, float]], own: int, doubt: bool) -> None:
    assert may_turn(np.array(points), own) is doubt


def computed(
    rotor: TwoDiscRotor, grid: tuple[int, int], speeds: tuple[float, float], points: int
) -> tuple[CampbellDiagram, CriticalSpeeds]:
    description = rotor.case(grid)
    machine, parameters = build_machine(description), parameter_vector(description)
    diagram = campbell_diagram(machine, parameters, np.linspace(*speeds, points))
    return diagram, critical_speeds(machine, parameters, diagram, 0.5)


@pytest.mark.parametrize("points", [2, 8, 30])
def test_a_close_pair_is_found_with_every_number_of_speeds(points: int) -> None:
    """Forward and backward whirl, 0.0036 apart; none is told twice."""
    diagram, found = computed(CLOSE_CRITICALS, (16, 2), (0.15, 1.5), points)
    speeds = [one.speed for one in found.found]
    assert speeds == pytest.approx([0.410835, 0.414475, 1.00390, 1.04511, 1.15241], abs=1e-5)
    assert set(np.linspace(0.15, 1.5, points)) <= set(diagram.speeds)
    assert (np.diff(diagram.speeds) > 0.0).all()
    assert found.undecided == []
    change = sum(one.change for one in found.found) + found.passages
    assert found.counts[-1] - found.counts[0] == change


def test_a_range_from_one_critical_speed_to_another_holds_both() -> None:
    _, found = computed(CLOSE_CRITICALS, (16, 2), (0.3, 0.6), 8)
    first, second = (one.speed for one in found.found)
    for points in (2, 5):
        _, again = computed(CLOSE_CRITICALS, (16, 2), (first, second), points)
        assert [one.speed for one in again.found] == pytest.approx([first, second], abs=1e-9)
        assert again.counts[-1] - again.counts[0] == -2 + again.passages
        assert again.undecided == []


def test_followed_modes_are_smooth() -> None:
    """The slope of every eigenvalue changes little from step to step: none is taken for another."""
    diagram, _ = computed(CLOSE_CRITICALS, (16, 2), (0.3, 1.5), 40)
    light = np.nanmax(diagram.damping_ratios, axis=0) < 0.5
    slopes = np.diff(diagram.eigenvalues[:, light], axis=0) / np.diff(diagram.speeds)[:, None]
    assert light.sum() >= 5
    assert np.nanmax(np.abs(np.diff(slopes, axis=0))) < 0.3


@pytest.mark.slow
def test_without_equilibrium_between_the_count_says_that_some_are_missing() -> None:
    """On 24 x 2 the film closes between 0.103 and 0.209: what crosses there is told, not passed over."""
    diagram, found = computed(HEAVY_ON_SOFT_FOILS, (24, 2), (0.1, 0.6), 9)
    assert len(diagram.missing) >= 1
    assert all("raise numerics.circumferential" in reason for reason in diagram.missing.values())
    (gap,) = found.undecided
    assert gap.matters
    assert gap.low == pytest.approx(0.103, abs=2.5e-3)
    assert gap.high == pytest.approx(0.209, abs=2.5e-3)
    assert gap.after < gap.before
    known = found.counts[found.counts >= 0]
    change = sum(one.change for one in found.found) + found.passages + gap.after - gap.before
    assert known[-1] - known[0] == change


def test_on_a_finer_grid_these_are_found() -> None:
    _, found = computed(HEAVY_ON_SOFT_FOILS, (40, 3), (0.1, 0.6), 9)
    assert [one.speed for one in found.found][:2] == pytest.approx([0.1310, 0.1495], abs=1e-4)
    assert found.undecided == []


def test_a_weightless_rotor_in_supports_has_one_critical_speed() -> None:
    """Its films at ambient pressure everywhere decide nothing by rounding."""
    support = {"stiffness_xx": 8e4, "stiffness_yy": 8e4, "damping_xx": 25.0, "damping_yy": 25.0}
    rotor = symmetric_rotor(gravity=0.0, supports=[{"node": node, **support} for node in (2, 12)])
    bearing = {**BEARING, "film": "periodic"}
    description = case((24, 2), bearings=(bearing, bearing), displacement=0.0, rotor=rotor)
    machine, parameters = build_machine(description), parameter_vector(description)
    diagram = campbell_diagram(machine, parameters, np.linspace(0.2, 1.2, 6))
    found = critical_speeds(machine, parameters, diagram, 0.5)
    assert [one.speed for one in found.found] == pytest.approx([0.2028], abs=1e-4)
    assert found.undecided == []


def test_critical_speeds_of_a_large_machine_are_those_of_the_dense_matrix(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """Its modes beyond the highest frequency that is followed are known at some speeds only."""
    _, dense = computed(CLOSE_CRITICALS, (24, 2), (0.15, 1.5), 5)
    for module in (modes_module, linear_module):
        monkeypatch.setattr(module, "DENSE_SIZE", 100)
    _, sparse = computed(CLOSE_CRITICALS, (24, 2), (0.15, 1.5), 5)
    assert sparse.undecided == dense.undecided == []
    speeds = [one.speed for one in dense.found]
    assert len(speeds) == 5
    assert [one.speed for one in sparse.found] == pytest.approx(speeds, abs=1e-8)
    change = sum(one.change for one in sparse.found) + sparse.passages
    assert sparse.counts[-1] - sparse.counts[0] == change


def test_modes_of_a_large_machine_are_those_of_the_dense_matrix(monkeypatch: pytest.MonkeyPatch) -> None:
    """All lightly damped ones up to the highest frequency that is followed."""
    description = CLOSE_CRITICALS.case((40, 3))
    machine, parameters = build_machine(description), parameter_vector(description)
    at = at_speed(parameters, 0.6)
    state = machine_equilibrium(machine, at).state
    dense = modes_at(machine, at, state, 1.8)
    monkeypatch.setattr(modes_module, "DENSE_SIZE", 100)
    found = modes_at(machine, at, state, 1.8)
    wanted = dense.eigenvalues[(dense.damping_ratios < 0.5) & (dense.eigenvalues.imag < 1.8)]
    assert len(wanted) >= 5
    for value in wanted:
        assert np.abs(found.eigenvalues - value).min() < 1e-8
    assert (found.damping_ratios < LARGEST_KNOWN).all()
