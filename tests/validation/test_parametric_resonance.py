"""Stability boundaries of linear parametrically excited systems, found as events on their trivial cycle.

Mathieu's equation: characteristic values to the ten printed digits.  The pair of coupled oscillators of
pe_2dof_*.csv: the 'floquet' columns to their six printed digits.
"""

from __future__ import annotations

import csv
from pathlib import Path

import numpy as np
import pytest

from pipelines.bifurcations.arclength import continue_branch
from pipelines.bifurcations.branch import BranchStart, BranchStop, ContinuationOptions
from pipelines.bifurcations.detection import DetectionOptions, Event, EventKind
from pipelines.orbits.period_map import PeriodMap
from pipelines.orbits.shooting import CycleProblem, ShootingOptions
from pipelines.orbits.steppers import DOPRI8
from pipelines.orbits.system import DynamicalSystem
from tests.systems import mathieu, parametric_pair

REFERENCE = Path(__file__).parents[1] / "reference"


def rows(name: str) -> list[dict[str, str]]:
    return list(csv.DictReader((REFERENCE / name).read_text().splitlines()))


def boundaries(
    system: DynamicalSystem,
    parameters: list[float],
    name: str,
    interval: tuple[float, float],
    kinds: tuple[EventKind, ...] = tuple(EventKind),
    step: float = 0.02,
) -> list[Event]:
    """Events on the trivial cycle over an interval of one parameter."""
    problem = CycleProblem(
        PeriodMap(system, DOPRI8, minimum_steps=192),
        np.array(parameters),
        name,
        ShootingOptions(tolerance=1e-12),
    )
    options = ContinuationOptions(
        interval, step=step, maximum_step=step, max_points=1000, detection=DetectionOptions(kinds=kinds)
    )
    events: list[Event] = []
    result = continue_branch(
        problem,
        BranchStart(np.zeros(system.size), interval[0]),
        options,
        lambda point, state, found: events.extend(found),
    )
    assert result.stop is BranchStop.RANGE
    return events


@pytest.mark.parametrize("row", rows("mathieu_characteristic_values.csv"), ids=lambda row: f"q={row['q']}")
def test_mathieu(row: dict[str, str]) -> None:
    """det(M - I) = 0 at a0, b2, a2 (branch points) and det(M + I) = 0 at b1, a1 (period doublings).

    The table prints ten decimals; 192 steps of the eighth-order method leave an error far below them.
    The system is conservative, so Neimark-Sacker points are not looked for.
    """
    expected = sorted(
        (float(value), EventKind.BRANCH_POINT if "mult+1" in name else EventKind.PERIOD_DOUBLING)
        for name, value in row.items()
        if name != "q"
    )
    low, high = expected[0][0] - 0.0511, expected[-1][0] + 0.05
    kinds = (EventKind.BRANCH_POINT, EventKind.PERIOD_DOUBLING)
    if float(row["q"]) == 5.0:
        # a0 and b1 are 0.01 apart
        events = boundaries(mathieu(), [0.0, 5.0, 2.0], "a", (low, -5.7), kinds, step=0.004)
        events += boundaries(mathieu(), [0.0, 5.0, 2.0], "a", (1.7, high), kinds, step=0.05)
    else:
        events = boundaries(mathieu(), [0.0, float(row["q"]), 2.0], "a", (low, high), kinds, step=0.04)
    assert [event.kind for event in events] == [kind for _, kind in expected]
    # half a unit of the last printed digit, and the error of the integrator
    found = [event.parameters[0] for event in events]
    assert np.allclose(found, [value for value, _ in expected], rtol=0, atol=2e-10)


@pytest.mark.parametrize(
    "row", rows("pe_2dof_resonance.csv"), ids=lambda row: f"{row['resonance']}-{row['eps']}"
)
def test_parametric_resonance(row: dict[str, str]) -> None:
    """2 w_2 opens a period-doubling window, w_1 + w_2 a Neimark-Sacker window, 2 w_1 none."""
    centre = float(row["Om0"])
    printed = [float(text) for text in row["floquet_boundaries_within_0.4"].split(";") if text]
    kind = EventKind.PERIOD_DOUBLING if row["resonance"] == "2om2" else EventKind.NEIMARK_SACKER
    system = parametric_pair((0.02, 0.03))
    interval = (centre - 0.25, centre + 0.25)
    events = boundaries(system, [centre, float(row["eps"])], "omega", interval, step=0.0173)
    assert [event.kind for event in events] == [kind] * len(printed)
    assert np.allclose([event.parameters[0] for event in events], printed, rtol=0, atol=6e-7)


@pytest.mark.parametrize("row", rows("pe_2dof_antiresonance.csv"), ids=lambda row: f"eps={row['eps']}")
def test_parametric_antiresonance(row: dict[str, str]) -> None:
    """The self-excited pair is stable only between two Neimark-Sacker points near w_2 - w_1."""
    printed = [
        float(text) for text in row["floquet_stability_boundaries_in_Om(0.45..1.0)"].split(";") if text
    ]
    system = parametric_pair((-0.05, 0.12))
    events = [
        event
        for event in boundaries(system, [0.45, float(row["eps"])], "omega", (0.6, 1.0), step=0.0173)
        if event.kind is EventKind.NEIMARK_SACKER
    ]
    assert np.allclose([event.parameters[0] for event in events], printed, rtol=0, atol=6e-7)
    assert [np.sign(event.transversality) for event in events] == [-1.0, 1.0][: len(events)]
