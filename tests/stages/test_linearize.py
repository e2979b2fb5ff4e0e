"""`linearize` into a store: equilibria, eigenvalues and coefficients of every speed, resume, failure."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from pipelines.case.reading import NamedCase
from pipelines.datasets.reading import read_group
from pipelines.datasets.records import Group
from pipelines.datasets.store import open_for_reading
from pipelines.datasets.watching import watch
from pipelines.machine import film
from pipelines.machine.assembly import build_machine, parameter_vector
from pipelines.orbits.equilibria.equilibrium import Equilibrium, at_rest
from pipelines.orbits.equilibria.linear import Instability, at_speed, linear_point
from pipelines.stages.linear import linearize as stage
from pipelines.stages.linear.along_speed import reference_parameters
from tests.helpers.rotors import HEAVY_ON_SOFT_FOILS
from tests.helpers.tiny import Watched, tiny_case
from tests.helpers.trees import compare_trees

HEAVY = "rotor.gravity=1000"


def linear(path: Path) -> Group:
    return read_group(open_for_reading(path), "cases/smoke/linear")


def test_every_speed_has_its_equilibrium_and_its_eigenvalues(tmp_path: Path) -> None:
    case = tiny_case()
    watched = Watched("linearize", case, tmp_path / "a.zarr")
    assert watched.result.ok
    assert [progress.done for progress in watched.reported] == list(range(1, 8))
    rows, machine = linear(tmp_path / "a.zarr").arrays, build_machine(case.case)
    assert rows["speed"].tolist() == np.linspace(0.7, 1.3, 7).tolist()
    for index, speed in enumerate(rows["speed"]):
        still, state = at_rest(at_speed(parameter_vector(case.case), speed)), rows["state"][index]
        assert np.max(np.abs(machine.rates(0.0, state, still))) < 1e-10
        np.testing.assert_array_equal(rows["minimum_film"][index], machine.minimum_film(0.0, state, still))
        for bearing in range(2):
            np.testing.assert_array_equal(
                rows["journal"][index, bearing], machine.journal(state, bearing)[:2]
            )
        every = np.linalg.eigvals(machine.jacobian(0.0, state, still).toarray())
        every = every[every.imag >= -1e-9 * np.abs(every)]
        leading = every[np.argsort(-every.real)][:6]
        assert np.max(np.abs(np.sort(leading.real) - np.sort(rows["eigenvalues"][index].real))) < 1e-9
        assert np.max(rows["eigenvalue_residual"][index]) < 1e-8


def test_coefficients_at_low_frequency_are_the_static_stiffness(tmp_path: Path) -> None:
    """As the whirl frequency tends to zero, K tends to -dF/dX of the steady film, the error with its square:
    here from central differences of the film's equilibrium force.
    """
    from pipelines.machine.bearing import film_state
    from pipelines.orbits.equilibria.equilibrium import film_equilibrium

    case = tiny_case("linearize.whirl_ratios=[0.001, 0.002]", "linearize.points=2")
    Watched("linearize", case, tmp_path / "a.zarr")
    rows, machine = linear(tmp_path / "a.zarr").arrays, build_machine(case.case)
    still = at_rest(at_speed(parameter_vector(case.case), float(rows["speed"][0])))
    bearing, journal, h = machine.bearings[0], rows["journal"][0, 0], 1e-5

    def force(position: np.ndarray) -> np.ndarray:
        steady = film_equilibrium(bearing, position, still)
        assert steady.converged
        return film_state(bearing, steady.state, np.append(position, [0.0, 0.0]), 0.0, still).force

    static = np.column_stack([-(force(journal + d) - force(journal - d)) / (2 * h) for d in h * np.eye(2)])
    errors = [np.max(np.abs(rows["bearing_stiffness"][0, ratio, 0] - static)) for ratio in (0, 1)]
    assert errors[0] < 1e-5 * np.max(np.abs(static))
    # damping: the slope of the quadrature part, the same at both low frequencies
    np.testing.assert_allclose(rows["bearing_damping"][0, 0], rows["bearing_damping"][0, 1], rtol=1e-4)


def test_the_instability_speed_is_where_a_pair_crosses(tmp_path: Path) -> None:
    case = tiny_case()
    result = Watched("linearize", case, tmp_path / "a.zarr").result
    attributes = linear(tmp_path / "a.zarr").attributes
    speed = attributes["instability_speed"]
    assert result.summary["instability speed"] == speed
    assert result.summary["instability speed [rpm]"] == pytest.approx(case.case.scales.speed_rpm(speed))
    machine = build_machine(case.case)
    point = linear_point(machine, at_speed(parameter_vector(case.case), speed), 4)
    leading = point.eigenpairs.values[0]
    # 1e-8 in speed is 1e-8 of the slope in the growth rate
    assert abs(leading.real) < 1e-8 * attributes["instability_growth_slope"]
    assert leading.imag == pytest.approx(attributes["instability_frequency"], abs=1e-9)


def test_a_range_without_instability_has_none(tmp_path: Path) -> None:
    result = Watched("linearize", tiny_case("linearize.speed_range=[0.7, 1.0]"), tmp_path / "a.zarr").result
    assert result.ok
    assert result.summary["instability speed"] is None
    assert result.summary["stable up to"] == 1.0
    assert result.summary["stable up to [rpm]"] == pytest.approx(tiny_case().case.scales.speed_rpm(1.0))
    assert linear(tmp_path / "a.zarr").attributes["unstable_from_start"] is False
    assert "unstable from the lowest speed" not in result.summary


def test_a_machine_that_is_never_stable_says_so(tmp_path: Path) -> None:
    # a weightless journal runs concentric, where only the foil's damping opposes half-frequency whirl
    result = Watched(
        "linearize", tiny_case("rotor.gravity=0", "linearize.points=2"), tmp_path / "a.zarr"
    ).result
    assert result.summary["instability speed"] is None
    assert result.summary["unstable from the lowest speed"] is True


def test_undeformed_rings_are_those_of_the_passive_machine(tmp_path: Path) -> None:
    case = tiny_case("linearize.ring=undeformed", "linearize.points=2")
    assert reference_parameters(case.case, "undeformed")[film.DISPLACEMENT] == 0.0
    Watched("linearize", case, tmp_path / "a.zarr")
    passive = tiny_case("linearize.points=2", "excitation.displacement=0.0", stages=("linearize",))
    Watched("linearize", passive, tmp_path / "b.zarr")
    for name in ("state", "eigenvalues", "bearing_stiffness"):
        np.testing.assert_array_equal(
            linear(tmp_path / "a.zarr").arrays[name], linear(tmp_path / "b.zarr").arrays[name]
        )


@pytest.mark.parametrize("stops", [[3, 1]])
def test_resuming_gives_the_same_bytes(tmp_path: Path, stops: list[int]) -> None:
    case = tiny_case()
    Watched("linearize", case, tmp_path / "undisturbed.zarr")
    for stop in stops:
        stopped = Watched("linearize", case, tmp_path / "stopped.zarr", stop_after=stop)
        assert stopped.result.stop_reason == "stopped on request"
        assert stopped.finished == stop
    resumed = Watched("linearize", case, tmp_path / "stopped.zarr")
    assert resumed.finished == 7 - sum(stops)
    assert compare_trees(tmp_path / "undisturbed.zarr", tmp_path / "stopped.zarr") == []
    again = Watched("linearize", case, tmp_path / "stopped.zarr")
    assert again.reported == [], "what is finished is not computed again"
    assert again.result == resumed.result


def test_another_request_is_computed_again(tmp_path: Path) -> None:
    """Also one of which rows are left: a speed costs less than a second."""
    Watched("linearize", tiny_case(), tmp_path / "a.zarr", stop_after=3)
    wider = tiny_case("linearize.points=4", "linearize.speed_range=[0.6, 1.2]")
    assert Watched("linearize", wider, tmp_path / "a.zarr").finished == 4
    assert linear(tmp_path / "a.zarr")["speed"].tolist() == np.linspace(0.6, 1.2, 4).tolist()
    Watched("linearize", wider, tmp_path / "b.zarr")
    assert compare_trees(tmp_path / "a.zarr" / "cases", tmp_path / "b.zarr" / "cases") == []


def test_no_equilibrium_is_a_result(tmp_path: Path) -> None:
    watched = Watched("linearize", tiny_case(HEAVY, "linearize.points=2"), tmp_path / "a.zarr")
    assert not watched.result.ok
    assert watched.result.stop_reason == "no speed of the range has an equilibrium"
    assert "of the rotor's weight" in watched.result.advice
    assert "lighten the rotor" in watched.result.advice
    group = linear(tmp_path / "a.zarr")
    assert group.attributes["n_points"] == 2
    assert np.all(np.isnan(group.arrays["state"]))
    assert np.all(np.isfinite(group.arrays["newton_residual"]))


def heavy(points: int, highest: float) -> NamedCase:
    """A rotor whose films close on 24 x 2 between the speeds 0.103 and 0.209."""
    return NamedCase.of(
        "smoke",
        HEAVY_ON_SOFT_FOILS.case((24, 2), linearize={"speed_range": (0.1, highest), "points": points}),
    )


@pytest.mark.slow
def test_some_speeds_without_equilibrium_are_named(tmp_path: Path) -> None:
    """2 of 23: told, and no failure; interrupted anywhere the same bytes."""
    watched = Watched("linearize", heavy(23, 1.2), tmp_path / "a.zarr")
    assert watched.result.ok
    assert watched.result.stop_reason == "some speeds have no equilibrium"
    assert watched.result.summary["without equilibrium"] == "0.15, 0.2"
    assert watched.result.summary["instability speed"] == pytest.approx(1.051, abs=0.01)
    told = linear(tmp_path / "a.zarr").attributes["speeds_without_equilibrium"]
    assert [one.partition(":")[0] for one in told] == ["speed 0.15", "speed 0.2"]
    assert all("on 48 x 3 all of it" in one for one in told)
    (described,) = (state for state in watch(tmp_path / "a.zarr") if state.group == "linear")
    assert described.speeds_without_equilibrium == tuple(told)
    for stop in (1, 1, 1):
        Watched("linearize", heavy(23, 1.2), tmp_path / "b.zarr", stop_after=stop)
    Watched("linearize", heavy(23, 1.2), tmp_path / "b.zarr")
    assert compare_trees(tmp_path / "a.zarr", tmp_path / "b.zarr") == []


@pytest.mark.slow
def test_too_many_speeds_without_equilibrium_are_a_failure(tmp_path: Path) -> None:
    result = Watched("linearize", heavy(11, 0.6), tmp_path / "a.zarr").result
    assert not result.ok
    assert result.stop_reason == "too many speeds have no equilibrium"
    assert result.advice.startswith("2 of 11 speeds have none: 0.15, 0.2; at speed 0.2: on the grid 24 x 2")
    assert linear(tmp_path / "a.zarr").attributes["n_points"] == 11


def instability(monkeypatch: pytest.MonkeyPatch, *growth: float) -> dict[str, Any]:
    """What is told of leading pairs that grow so at the speeds 0, 1, ...; NaN: no equilibrium."""
    eigenvalues = np.array(growth)[:, None] + 1j
    eigenvalues[np.isnan(eigenvalues)] = complex(np.nan, np.nan)
    states = np.zeros((len(growth), 1))
    rows = {"speed": np.arange(len(growth)), "eigenvalues": eigenvalues, "state": states}

    def middle(machine: None, parameters: None, low: float, high: float, guess: None) -> Instability:
        return Instability(
            0.5 * (low + high), 1.0, np.zeros(1), Equilibrium(np.zeros(1), 0, 0, True, ""), 0, 1
        )

    monkeypatch.setattr(stage, "hopf_between", middle)
    return stage._instability(None, np.zeros(4), rows)  # type: ignore[arg-type]


def test_an_instability_between_speeds_without_equilibrium_is_a_failure(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """Also where the equilibrium becomes stable again and loses it once more: that is not the first."""
    for after in ((), (-0.1, 0.2)):
        found = instability(monkeypatch, -0.1, np.nan, np.nan, 0.2, *after)
        assert found["instability_speed"] is None
        assert found["instability_between"] == [0.0, 3.0]
        assert found["unstable_from_start"] is False


def test_what_is_unstable_from_the_start_is_told_beside_a_later_instability(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    found = instability(monkeypatch, 0.1, -0.1, 0.2)
    assert (found["instability_speed"], found["unstable_from_start"]) == (1.5, True)
    assert "unstable_from_start" not in instability(monkeypatch, -0.1, -0.2, 0.2)


def test_decrements_and_directions_of_every_eigenvalue(tmp_path: Path) -> None:
    """The direction from the area that the nodes' ellipses enclose, computed from the dense eigenvectors."""
    from pipelines.machine.rotor_modes import whirl_directions
    from pipelines.orbits.equilibria.modes import node_shapes

    case = tiny_case("linearize.points=2")
    Watched("linearize", case, tmp_path / "a.zarr")
    group, machine = linear(tmp_path / "a.zarr"), build_machine(case.case)
    still = at_rest(at_speed(parameter_vector(case.case), float(group["speed"][1])))
    values, vectors = np.linalg.eig(machine.jacobian(0.0, group["state"][1], still).toarray())
    names = {1: "forward", -1: "backward", 0: "mixed"}
    for index, eigenvalue in enumerate(group["eigenvalues"][1]):
        decrement, direction = group["logarithmic_decrement"][1, index], group.labels("direction")[1, index]
        if abs(eigenvalue.imag) < 1e-9:
            assert (np.isnan(decrement), direction) == (True, "unset")
            continue
        assert decrement == pytest.approx(-2.0 * np.pi * eigenvalue.real / eigenvalue.imag, rel=1e-12)
        ratio = group["damping_ratio"][1, index]
        assert decrement == pytest.approx(2.0 * np.pi * ratio / np.sqrt(1.0 - ratio**2), rel=1e-9)
        same = int(np.argmin(np.abs(values - eigenvalue)))
        found = whirl_directions(node_shapes(machine, vectors[:, [same]]))
        assert direction == names[int(found[0])]
    assert np.isfinite(group["logarithmic_decrement"][1]).sum() >= 4
