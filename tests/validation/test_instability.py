"""The speed of instability of the reconstructed machine converges with the grid.

Measured, k_f = 10, foil edge at theta = 0, Gümbel clipping:

    second order    24 x 2   40 x 3   96 x 4   160 x 5  | backward, uniform: 40 x 5   80 x 10
                    1.0787   1.0814   1.0815   1.0815   |                    1.1263   1.0993
    fourth order    24 x 3   32 x 3   40 x 3   48 x 4   96 x 4
                    1.0800   1.0813   1.0811   1.0815   1.0815
"""

from __future__ import annotations

import numpy as np
import pytest

from pipelines.machine.assembly import build_machine, parameter_vector
from pipelines.orbits.equilibria.linear import LinearPoint, at_speed, linear_point, locate_instability
from tests.machines import BEARING, case

# Extrapolated from grids up to 240 x 4, of this clipping and of one that leaves the edge cells alone.
GUMBEL_LIMIT = 1.0815
GUMBEL_LIMIT_UNCERTAINTY = 2e-4


def instability_speed(
    grid: tuple[int, int],
    bracket: tuple[float, float] = (1.0, 1.15),
    clipping: str = "gumbel",
    film: str = "edge",
    **numerics: str,
) -> float:
    bearing = {**BEARING, "clipping": clipping, "film": film}
    description = case(grid, bearings=(bearing, bearing), displacement=0.0, numerics=numerics)
    machine, parameters = build_machine(description), parameter_vector(description)
    points: list[LinearPoint] = []
    for speed in bracket:
        guess = points[-1].equilibrium.state if points else None
        point = linear_point(machine, at_speed(parameters, speed), 6, guess)
        assert isinstance(point, LinearPoint)
        points.append(point)
    return locate_instability(machine, parameters, *points).speed


@pytest.mark.parametrize(
    ("clipping", "film", "bracket", "coarsest"),
    [
        ("full", "edge", (0.78, 0.84), 36),
        ("full", "periodic", (0.62, 0.67), 36),
        ("gumbel", "periodic", (1.07, 1.12), 72),
    ],
)
def test_second_order(clipping: str, film: str, bracket: tuple[float, float], coarsest: int) -> None:
    """The whole chain, from the film to the located speed: halving the spacing quarters the change.

    Coarser than 72 the clipped force, of fourth order, is as far off as the film, of second.
    """
    speeds = [instability_speed((count * coarsest, 4), bracket, clipping, film) for count in (1, 2, 4)]
    order = np.log2(abs((speeds[1] - speeds[0]) / (speeds[2] - speeds[1])))
    assert order == pytest.approx(2.0, abs=0.3)


def test_fourth_order() -> None:
    speeds = [
        instability_speed((count, 4), (0.62, 0.67), "full", "periodic", scheme="fourth_order")
        for count in (24, 48, 96)
    ]
    assert np.log2(abs((speeds[1] - speeds[0]) / (speeds[2] - speeds[1]))) == pytest.approx(4.0, abs=0.2)


def test_fourth_order_with_clipping_and_an_edge() -> None:
    errors = [
        abs(instability_speed(grid, scheme="fourth_order") - GUMBEL_LIMIT)
        for grid in ((24, 3), (32, 3), (48, 4))
    ]
    assert (np.diff(errors) < 0.0).all()
    assert errors[0] <= 1.5e-3 * GUMBEL_LIMIT
    assert errors[1] <= 2e-4 * GUMBEL_LIMIT + GUMBEL_LIMIT_UNCERTAINTY
    assert errors[2] <= 1e-4 * GUMBEL_LIMIT + GUMBEL_LIMIT_UNCERTAINTY


def test_instability_of_clipped_films_with_an_edge() -> None:
    """Each refinement comes closer to the limit; from 40 x 3 on within 0.1 %."""
    errors = [abs(instability_speed(grid) - GUMBEL_LIMIT) for grid in ((24, 2), (40, 3), (96, 4), (160, 5))]
    assert (np.diff(errors) < 0.0).all()
    assert errors[1] <= 1e-3 * GUMBEL_LIMIT
    assert errors[-1] <= 5e-4 * GUMBEL_LIMIT + GUMBEL_LIMIT_UNCERTAINTY


def test_backward_scheme_overestimates_stability() -> None:
    """The paper's scheme on 80 x 10 is more than ten times as far off as second order on 40 x 3."""
    backward = instability_speed((80, 10), (1.0, 1.15), scheme="backward", axial_scheme="uniform")
    central = instability_speed((40, 3))
    assert backward - GUMBEL_LIMIT > 10.0 * (abs(central - GUMBEL_LIMIT) + GUMBEL_LIMIT_UNCERTAINTY)
