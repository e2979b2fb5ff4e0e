"""When the corrector of a curve gives up."""

from __future__ import annotations

import pytest

from pipelines.bifurcations.critical.correction import History
from tests.bifurcations.curve_runs import FLIP, map_problem
from tests.bifurcations.explicit_maps import henon


@pytest.mark.parametrize(
    ("values", "stuck"),
    [
        ((1e-2, 9e-3, 8e-3, 7e-3, 6e-3), True),
        ((1e-2, 9e-3, 8e-3, 7e-3), False),  # three steps are not enough
        ((3e-3, 4e-3, 3e-3, 1e-2, 4e-3), False),  # it oscillates, but the last step was a good one
        ((3e-3, 4e-3, 3e-3, 1e-2, 4e-3, 3e-3), True),
        ((1e-5, 1e-1, 1e-2, 1e-3, 1e-4), False),  # an overshoot, then it gets on
        ((1e-2, 9e-3, 1e-3, 9e-4, 8e-4), False),
        ((1e-2, 1e-13, 2e-13, 1e-13, 2e-13), False),  # small already: the cycle is still settling
    ],
)
def test_it_is_stuck_when_four_steps_did_not_halve_the_test_function(
    values: tuple[float, ...], stuck: bool
) -> None:
    history = History()
    for value in values:
        history = history.and_then(1e-9, value)
    assert history.stuck(map_problem(henon(), FLIP, (0, 0), ("a", "b"))) is stuck
