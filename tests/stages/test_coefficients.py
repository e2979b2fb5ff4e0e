"""`agfb coefficients`: K and C over speed and whirl frequency against statics and the dynamic stiffness."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from pipelines.datasets.coefficient_tables import bearing_table
from pipelines.datasets.integrity import verify
from pipelines.datasets.reading import read_group
from pipelines.datasets.records import Group
from pipelines.datasets.store import open_for_reading
from pipelines.machine.assembly import build_machine, parameter_vector
from pipelines.machine.bearing import Bearing, film_state
from pipelines.orbits.equilibria.equilibrium import at_rest, film_equilibrium
from pipelines.orbits.equilibria.linear import at_speed, dynamic_stiffness
from pipelines.stages.linear.coefficients import request_of
from pipelines.stages.scheduling.plan import StageStatus, plan
from tests.helpers.tiny import Watched, tiny_case
from tests.helpers.trees import compare_trees

STAGE = "coefficients"
SMALL = ("coefficients.points=4", "coefficients.frequencies=5")


def stored(path: Path) -> Group:
    return read_group(open_for_reading(path), f"cases/smoke/{STAGE}")


@pytest.fixture(scope="module")
def store(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("coefficients") / "a.zarr"
    result = Watched(STAGE, tiny_case(*SMALL), path).result
    assert result.ok
    assert result.summary == {"speeds": 4, "whirl frequencies": 5}
    return path


def test_the_axes_follow_the_table_or_the_linearisation(store: Path) -> None:
    group, time = stored(store), build_machine(tiny_case().case).scales.time
    np.testing.assert_allclose(group["speed"], np.linspace(0.7, 1.3, 4), rtol=1e-15)
    np.testing.assert_allclose(group["frequency"], np.linspace(0.0, 1.3, 5), rtol=1e-15)
    table = bearing_table(open_for_reading(store), f"cases/smoke/{STAGE}", 0)
    np.testing.assert_allclose(table.speed_rpm * 2 * np.pi / 60 * time, group["speed"], rtol=1e-14)
    np.testing.assert_allclose(table.frequency_hertz * 2 * np.pi * time, group["frequency"], rtol=1e-14)
    assert verify(store) == []


def test_at_rest_stiffness_is_the_derivative_of_the_static_force(store: Path) -> None:
    """Central differences of the film's equilibrium force; their error falls with the square of the step."""
    group, machine = stored(store), build_machine(tiny_case().case)
    for index in (0, 3):
        still = at_rest(at_speed(parameter_vector(tiny_case().case), float(group["speed"][index])))
        for number, bearing in enumerate(machine.bearings):
            journal, stiffness = group["journal"][index, number], group["stiffness"][index, 0, number]
            static = [static_stiffness(bearing, journal, still, h) for h in (2e-3, 1e-3)]
            errors = [np.max(np.abs(each - stiffness)) for each in static]
            assert errors[0] / errors[1] == pytest.approx(4.0, rel=0.2)
            assert errors[1] < 1e-4 * np.max(np.abs(stiffness))


def static_stiffness(bearing: Bearing, journal: np.ndarray, still: np.ndarray, h: float) -> np.ndarray:
    """-dF/dX of the steady film by central differences."""

    def force(position: np.ndarray) -> np.ndarray:
        steady = film_equilibrium(bearing, position, still)
        assert steady.converged
        return film_state(bearing, steady.state, np.append(position, [0.0, 0.0]), 0.0, still).force

    differences = [force(journal + d) - force(journal - d) for d in h * np.eye(2)]
    return -np.column_stack(differences) / (2 * h)


def test_they_are_the_dynamic_stiffness(store: Path) -> None:
    group, machine = stored(store), build_machine(tiny_case().case)
    at = at_speed(parameter_vector(tiny_case().case), float(group["speed"][2]))
    frequency = group["frequency"]
    for number, bearing in enumerate(machine.bearings):
        film = group["state"][2, machine.film_unknowns(number)]
        whole = dynamic_stiffness(bearing, film, group["journal"][2, number], at, 1j * frequency)
        stiffness, damping = group["stiffness"][2, :, number], group["damping"][2, :, number]
        again = stiffness + 1j * frequency[:, None, None] * damping
        np.testing.assert_allclose(again, whole, rtol=1e-12, atol=1e-12)


def test_damping_at_rest_is_the_limit_for_slow_whirl(store: Path) -> None:
    """Z(i w) is even in its real, odd in its imaginary part: C(w) nears C(0) with the square of w."""
    group, machine = stored(store), build_machine(tiny_case().case)
    at = at_speed(parameter_vector(tiny_case().case), float(group["speed"][1]))
    film = group["state"][1, machine.film_unknowns(0)]
    slow = np.array([4e-2, 2e-2])
    whole = dynamic_stiffness(machine.bearings[0], film, group["journal"][1, 0], at, 1j * slow)
    limit = group["damping"][1, 0, 0]
    errors = [np.max(np.abs(z.imag / w - limit)) for z, w in zip(whole, slow, strict=True)]
    assert errors[0] / errors[1] == pytest.approx(4.0, rel=0.05)
    assert errors[1] < 1e-2 * np.max(np.abs(limit))


def test_the_ring_of_the_table_is_taken(tmp_path: Path, store: Path) -> None:
    Watched(STAGE, tiny_case(*SMALL, "coefficients.ring='undeformed'"), tmp_path / "a.zarr")
    other, group = stored(tmp_path / "a.zarr"), stored(store)
    assert np.max(np.abs(other["stiffness"] / group["stiffness"] - 1.0)) > 1e-3


def test_interrupted_and_resumed_it_has_the_same_bytes(tmp_path: Path, store: Path) -> None:
    case = tiny_case(*SMALL)
    stopped = Watched(STAGE, case, tmp_path / "a.zarr", stop_after=2)
    assert (stopped.result.stop_reason, stopped.finished) == ("stopped on request", 2)
    assert Watched(STAGE, case, tmp_path / "a.zarr").finished == 2
    assert compare_trees(store, tmp_path / "a.zarr") == []
    assert Watched(STAGE, case, tmp_path / "a.zarr").reported == []


def test_another_request_is_computed_again(tmp_path: Path) -> None:
    case, path = tiny_case(*SMALL), tmp_path / "a.zarr"
    Watched(STAGE, case, path)
    wider = tiny_case(*SMALL, "linearize.speed_range=[0.7, 1.2]")
    assert next(plan((STAGE,), (case,), path)).there is StageStatus.COMPLETE
    assert next(plan((STAGE,), (wider,), path)).there is StageStatus.NOTHING
    assert Watched(STAGE, wider, path).finished == 4
    assert stored(path).attributes["request"] == request_of(wider.case)
    assert stored(path)["speed"][-1] == pytest.approx(1.2)


def test_no_equilibrium_is_a_result(tmp_path: Path) -> None:
    result = Watched(STAGE, tiny_case(*SMALL, "rotor.gravity=1000"), tmp_path / "a.zarr").result
    assert not result.ok
    assert result.stop_reason == "no speed of the range has an equilibrium"
    assert np.isnan(stored(tmp_path / "a.zarr")["stiffness"]).all()
