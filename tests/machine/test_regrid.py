"""States on another film grid: exact along the axis, of fourth order around the bearing."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from pipelines.machine.assembly import Machine, build_machine
from pipelines.machine.axial import chebyshev_operator, uniform_operator
from pipelines.machine.regrid import regrid
from tests.machines import BEARING, OTHER_BEARING, case


def machine(grid: tuple[int, int], film: str = "edge", axial_scheme: str = "chebyshev") -> Machine:
    """Two bearings with different foil edges, so that a mistaken bearing or angle is seen."""
    first = {**BEARING, "film": film} if film == "periodic" else BEARING
    second = {**OTHER_BEARING, "film": film} if film == "periodic" else {**OTHER_BEARING, "edge_angle": 0.7}
    return build_machine(case(grid, bearings=(first, second), numerics={"axial_scheme": axial_scheme}))


def film_state(built: Machine, pressure: Any, foil: Any) -> np.ndarray:
    """The state whose pressures are 1 + pressure(theta - edge, z), with the rotor at 0, 1, 2, ..."""
    parts = []
    for bearing in built.bearings:
        settings = bearing.settings
        operator = {"chebyshev": chebyshev_operator, "uniform": uniform_operator}[settings.axial_scheme]
        angles = bearing.angles - settings.edge_angle
        stations = operator(settings.axial).stations
        parts += [1.0 + pressure(angles[None, :], stations[:, None]).ravel(), foil(angles)]
    return np.concatenate([*parts, np.arange(float(built.size - built.rotor_start))])


def smooth(angle: np.ndarray, z: np.ndarray) -> np.ndarray:
    """Zero on the edge line and at the side, even about the middle, and nothing else of note."""
    around = np.sin(angle) + 0.5 * (1.0 - np.cos(angle))
    return around * np.exp(np.cos(angle)) * (np.cos(2.0 * (1.0 - 2.0 * z)) - np.cos(2.0))


def foil_shape(angle: np.ndarray) -> np.ndarray:
    return 0.1 * np.sin(angle + 0.3)


@pytest.mark.parametrize("film", ["edge", "periodic"])
@pytest.mark.parametrize("axial", [1, 2, 4])
def test_polynomials_of_the_collocation_are_exact_along_the_axis(film: str, axial: int) -> None:
    """x^2k - 1 with x = 1 - 2z, k <= axial, on the same stations around the bearing."""
    coarse, fine = machine((24, axial), film), machine((24, axial + 3), film)

    def profile(angle: np.ndarray, z: np.ndarray) -> np.ndarray:
        return np.sin(angle) * sum((1.0 - 2.0 * z) ** (2 * k) - 1.0 for k in range(1, axial + 1))

    found = regrid(coarse, fine, film_state(coarse, profile, foil_shape))
    np.testing.assert_allclose(found, film_state(fine, profile, foil_shape), rtol=0.0, atol=1e-12)


def test_cubics_are_exact_around_the_bearing() -> None:
    """A cubic that vanishes on the edge line for the pressure, any cubic for the foil."""
    coarse, fine = machine((16, 2)), machine((37, 2))

    def pressure(angle: np.ndarray, z: np.ndarray) -> np.ndarray:
        return 0.05 * angle * (angle - 2.0 * np.pi) * (angle - 1.0) * z * (1.0 - z)

    def foil(angle: np.ndarray) -> np.ndarray:
        return 0.01 * angle**3 - 0.1 * angle + 0.3

    found = regrid(coarse, fine, film_state(coarse, pressure, foil))
    np.testing.assert_allclose(found, film_state(fine, pressure, foil), rtol=0.0, atol=1e-12)


def midpoint_error(grid: tuple[int, int], factor: tuple[int, int], **kind: str) -> float:
    """Largest error on the grid that lies between the stations of ``grid``."""
    source = machine(grid, **kind)
    target = machine((factor[0] * grid[0], factor[1] * grid[1]), **kind)
    found = regrid(source, target, film_state(source, smooth, foil_shape))
    return float(np.max(np.abs(found - film_state(target, smooth, foil_shape))))


@pytest.mark.parametrize("film", ["edge", "periodic"])
def test_the_order_around_the_bearing_is_four(film: str) -> None:
    errors = [midpoint_error((count, 4), (2, 1), film=film) for count in (128, 256)]
    # near an edge, where no derivative is prescribed, the order is approached from above: 4.35, 4.23, 4.14
    assert 3.9 < np.log2(errors[0] / errors[1]) < 4.3
    assert errors[1] < 1e-6


def test_the_order_of_the_uniform_axial_grid_is_four() -> None:
    """Both directions halved together; the spline is mirrored in the middle of the film."""
    errors = [midpoint_error((8 * count, count), (2, 2), axial_scheme="uniform") for count in (8, 16)]
    assert np.log2(errors[0] / errors[1]) == pytest.approx(4.0, abs=0.2)


@pytest.mark.parametrize("axial_scheme", ["chebyshev", "uniform"])
def test_there_and_back_with_whatever_follows_the_rotor(axial_scheme: str) -> None:
    """A grid that contains the coarse one gives its values back, and states behind the rotor's are kept."""
    axial = 3 if axial_scheme == "chebyshev" else 6
    coarse, fine = (
        machine((24, 3), axial_scheme=axial_scheme),
        machine((48, axial), axial_scheme=axial_scheme),
    )
    state = np.append(film_state(coarse, smooth, foil_shape), [0.25, -0.5])
    state[: coarse.rotor_start] += 0.01 * np.random.default_rng(3).standard_normal(coarse.rotor_start)
    there = regrid(coarse, fine, state)
    assert there.shape == (fine.size + 2,)
    np.testing.assert_array_equal(there[fine.rotor_start :], state[coarse.rotor_start :])
    np.testing.assert_allclose(regrid(fine, coarse, there), state, rtol=0.0, atol=1e-12)


def test_what_cannot_be_moved() -> None:
    built = machine((16, 1))
    other = build_machine(case((16, 1), rotor={**case().rotor.model_dump(), "masters": (0, 2, 12, 14)}))
    with pytest.raises(ValueError, match="the rotors have 28 and 16 states"):
        regrid(built, other, np.zeros(built.size))
    with pytest.raises(ValueError, match="the state has 3 entries"):
        regrid(built, built, np.zeros(3))
