"""Runs in time of the machine on the smallest grid against its cycles and their Floquet multipliers."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from pipelines.datasets.reading import read_group
from pipelines.datasets.records import Group
from pipelines.datasets.store import open_for_reading
from tests.helpers.tiny import SHARP, Watched, tiny_case

pytestmark = pytest.mark.slow

PERIOD = 2.0 * np.pi / 0.7
RANGE = (
    "continue_cycles.start=1.0",
    "continue_cycles.range=[1.0, 1.26]",
    "continue_cycles.max_points=20",
    "continue_cycles.step=0.02",
)


@pytest.fixture(scope="module")
def store(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The cycles along the speed through the Neimark-Sacker point at 1.185."""
    path = tmp_path_factory.mktemp("transients") / "run.zarr"
    assert Watched("continue_cycles", tiny_case(SHARP, *RANGE), path).result.ok
    return path


def cycles(store: Path) -> Group:
    return read_group(open_for_reading(store), "cases/smoke/cycles/b000")


def run(store: Path, *overrides: str) -> Group:
    """The analysis of a run that starts from a stored cycle."""
    case = tiny_case(SHARP, *RANGE, "transient.start=cycles/b000", *overrides)
    result = Watched("transient", case, store).result
    assert result.stop_reason == "finished"
    group = str(result.summary["group"]).replace("transient/", "transient_analysis/")
    return read_group(open_for_reading(store), f"cases/smoke/{group}")


def run_up(store: Path, periods: int) -> float:
    """Largest difference of the envelopes of a run-up from 1.0 to 1.16 and of the cycles, over the width."""
    branch = cycles(store)
    found = run(
        store,
        "transient.start_row=0",
        f"transient.duration={periods * PERIOD!r}",
        f"transient.times=[0.0, {periods * PERIOD!r}]",
        f"transient.speeds=[{float(branch['speed'][0])!r}, 1.16]",
        "transient.samples_per_period=128",
    )
    worst = 0.0
    half = 0.5 * np.diff(found["window_speed"])[0]
    for bearing, column in enumerate((3, 11)):  # y of the masters 2 and 12, which rise with the speed
        last, first = found["window_speed"] + half, found["window_speed"] - half
        high = np.interp(last, branch["speed"], branch["orbit_maximum"][:, column])
        low = np.interp(first, branch["speed"], branch["orbit_minimum"][:, column])
        apart = [
            np.abs(found["envelope_high"][:, bearing, 1] - high),
            np.abs(found["envelope_low"][:, bearing, 1] - low),
        ]
        worst = max(worst, float(np.max(apart / (high - low))))
    return worst


def test_a_slow_run_up_follows_the_cycles(store: Path) -> None:
    """The envelope lags behind in proportion to the acceleration: half of it, half the difference."""
    fast, slow = run_up(store, 80), run_up(store, 160)
    assert slow < 0.002
    assert fast / slow == pytest.approx(2.0, rel=0.1)  # the samples resolve 1e-4 of the width


def rates(store: Path, speed: float, change: float, periods: int) -> tuple[Group, float]:
    """A run from the stored cycle nearest to a speed, changed by a little, and ln|mu|/T of that cycle."""
    branch = cycles(store)
    row = int(np.argmin(np.abs(branch["speed"] - speed)))
    found = run(
        store,
        f"transient.start_row={row}",
        f"transient.duration={periods * PERIOD!r}",
        "transient.times=[0.0]",
        f"transient.speeds=[{float(branch['speed'][row]) + change!r}]",
        f"transient.steps_per_period={int(branch['steps_per_period'][row])}",
    )
    return found, float(np.log(np.abs(branch["multipliers"][row, 0])) / PERIOD)


def test_beyond_the_neimark_sacker_point_a_run_grows_as_the_multiplier_says(store: Path) -> None:
    """From the cycle of a speed 1e-6 away; the rate is taken over the second half, when the next pair has
    faded, and at the end the motion is still small enough to be linear.
    """
    found, rate = rates(store, 1.24, 1e-6, 160)
    assert rate > 0.002
    assert found["growth_rate"][0] == pytest.approx(rate, rel=0.01)
    assert found.labels("motion")[0] == "unsettled"
    assert found["return_distance"][0, 0] < 0.05


def test_below_it_a_run_settles_as_the_multiplier_says(store: Path) -> None:
    """The change of the speed by 1e-4 alone changes the rate by 0.13 %."""
    found, rate = rates(store, 1.1, 1e-4, 120)
    assert rate < -0.005
    assert found["growth_rate"][0] == pytest.approx(rate, rel=0.01)
    assert found.labels("motion")[0] == "period_1"
