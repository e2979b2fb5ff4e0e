"""Tondl's forced self-excited system against verified Neimark-Sacker and period-doubling points.

tests/reference/tondl_verified_points.csv comes from shooting with an 8th-order integrator, confirmed by
collocation.
"""

from __future__ import annotations

import csv
import math
from pathlib import Path

import numpy as np
import pytest

from pipelines.bifurcations.arclength import continue_branch
from pipelines.bifurcations.branch import BranchStart, BranchStop, ContinuationOptions
from pipelines.bifurcations.detection import Event, EventKind
from pipelines.orbits.period_map import Formulation, PeriodMap
from pipelines.orbits.shooting import CycleProblem, ShootingOptions
from pipelines.orbits.steppers import DOPRI8
from tests.systems import tondl

TABLE = Path(__file__).parents[1] / "reference" / "tondl_verified_points.csv"
ROWS = list(csv.DictReader(TABLE.read_text().splitlines()))
KINDS = {"NS": EventKind.NEIMARK_SACKER, "PD": EventKind.PERIOD_DOUBLING}
TOLERANCE = 1e-8  # what the table is good for


def located(row: dict[str, str], formulation: Formulation) -> Event:
    """Continue in c1 at the row's eta across the tabulated value and return the one event found."""
    eta, c1 = float(row["eta"]), float(row["c1"])
    period_map = PeriodMap(tondl(), DOPRI8, formulation)
    problem = CycleProblem(period_map, np.array([0.0, eta]), "c1", ShootingOptions(tolerance=1e-12))
    start = BranchStart(period_map.extend(np.array([0.33, 0.05, 0.0, 0.0])), c1 - 0.013, 2.0 * math.pi / eta)
    options = ContinuationOptions((c1 - 0.013, c1 + 0.007), step=0.01, maximum_step=0.01)
    events: list[Event] = []
    result = continue_branch(problem, start, options, lambda point, state, found: events.extend(found))
    assert result.stop is BranchStop.RANGE
    assert len(events) == 1
    return events[0]


def tabulated_multipliers(row: dict[str, str]) -> np.ndarray:
    return np.array([complex(text) for text in row["multipliers_forced_system"].split(";")])


@pytest.mark.parametrize("row", ROWS, ids=lambda row: f"{row['kind']}-{row['eta']}")
def test_every_row(row: dict[str, str]) -> None:
    event = located(row, Formulation.STROBOSCOPIC)
    assert event.kind is KINDS[row["kind"]]
    assert event.parameters[0] == pytest.approx(float(row["c1"]), abs=TOLERANCE)
    assert event.angle == pytest.approx(float(row["theta"]), abs=TOLERANCE)
    state = [float(row[f"u{i}_at_phase0"]) for i in range(1, 5)]
    assert np.allclose(event.state, state, rtol=0, atol=TOLERANCE)
    for multiplier in tabulated_multipliers(row):
        assert np.min(np.abs(event.multipliers - multiplier)) < TOLERANCE
    assert event.residual < 1e-9
    assert event.transversality > 0.0  # more self-excitation, less stability


@pytest.mark.parametrize("row", [ROWS[0], ROWS[7], ROWS[-1]], ids=lambda row: f"{row['kind']}-{row['eta']}")
def test_autonomous_formulation_finds_the_same_points(row: dict[str, str]) -> None:
    """Unknown period and Eq. 17 instead of the stroboscopic map: same parameter, same multipliers and 1,
    exp(-2T).
    """
    event = located(row, Formulation.AUTONOMOUS)
    assert event.kind is KINDS[row["kind"]]
    assert event.parameters[0] == pytest.approx(float(row["c1"]), abs=TOLERANCE)
    period = 2.0 * math.pi / float(row["eta"])
    assert event.period == pytest.approx(period, abs=TOLERANCE)
    expected = np.concatenate([tabulated_multipliers(row), [1.0, math.exp(-2.0 * period)]])
    for multiplier in expected:
        assert np.min(np.abs(event.multipliers - multiplier)) < TOLERANCE
    assert len(event.multipliers) == 6


def test_strong_resonance_is_flagged_near_a_quarter_turn() -> None:
    """Row eta = 0.98 has theta = pi/2 + 0.022; eta = 0.72 is 0.33 away from every strong resonance."""
    by_eta = {row["eta"]: row for row in ROWS}
    assert located(by_eta["0.98"], Formulation.STROBOSCOPIC).resonance.name == "R4"
    assert located(by_eta["0.72"], Formulation.STROBOSCOPIC).resonance.name == "NONE"
