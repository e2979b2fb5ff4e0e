"""The benchmarks run and write what they should; what they measure is not tested."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

from pipelines.machine.lanes import LANES
from pipelines.orbits.floquet import deterministic_block
from tests.benchmarks.__main__ import ENTRIES, PAGE, main
from tests.benchmarks.arithmetic import film_multiply_adds
from tests.benchmarks.brusselator import FREQUENCY, START, chain
from tests.benchmarks.measuring import (
    Measurement,
    growth_exponent,
    interleaved,
    markdown_table,
    recorded_values,
)

pytestmark = pytest.mark.slow

NAMES = {
    "tangent_batch_ratio": {
        *("tangent_batch_ratio", "period_map", "period_map_columns"),
        *("tangent_batch_ratio_rk4", "period_map_rk4", "period_map_columns_rk4"),
    },
    "further_columns_ratio": {"further_columns_ratio"},
    "shared_work": {"twin_bearings_ratio", "nearby_pass_ratio"},
    "stepper_ratio": {"stepper_ratio_12x2"},
    "branch_point_ratio": {"branch_point_ratio"},
    "full_monodromy_ratio": {"full_monodromy_ratio", "cycle_correction"},
    "backward_error_ratio": {
        *("backward_error_ratio", "backward_error_ratio_unclipped", "backward_error", "default_error")
    },
    "growth_exponent": {"growth_exponent", "branch_point_12x2", "branch_point_16x2"},
    "curve_point_ratio": {"curve_point_ratio", "curve_point_ratio_normal_form"},
    "survey_cell_ratio": {"survey_cell_ratio", "survey_cell"},
    "passes_per_point": {
        *("passes_per_branch_point", "orbits_per_branch_point"),
        *("passes_per_curve_point", "orbits_per_curve_point"),
        *("passes_per_curve_form_point", "orbits_per_curve_form_point"),
    },
    "transient_steps_ratio": {"transient_steps_ratio", "transient_step"},
    "commit_ratio": {"commit_ratio", "commit"},
    "campaign_ratio": {"campaign_ratio"},
    "peak_memory": {"peak_memory"},
    "arithmetic": {"solve_fraction_of_peak", "solve_fraction_of_load_bound"},
    "brusselator": {"brusselator_exponent", "brusselator_10", "brusselator_20"},
    "cold_start": {"compile_time", "cached_start"},
}


@pytest.mark.parametrize("name", ENTRIES)
def test_the_file_and_the_table(name: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    path = tmp_path / "new" / "bench.json"
    main(["--quick", "-o", str(path), name])
    content = json.loads(path.read_text())
    assert content.keys() == NAMES[name]
    for entry in content.values():
        assert entry.keys() == {"value", "unit", "what"}
        assert np.isfinite(entry["value"])
        assert entry["unit"] in {"1", "s", "ms", "MB"}
        assert entry["what"]
    out, err = capsys.readouterr()
    assert [line.split("`")[1] for line in out.splitlines()[2:]] == list(content)
    assert err.startswith(name)


def test_recorded_values_stand_beside_the_measured() -> None:
    page = (
        "# Performance\n\n| name | value | what |\n|---|---|---|\n| `a_ratio` | 3.2 (2.8 to 3.5) | a / b |\n"
    )
    measured = [Measurement("a_ratio", 3.456, "1", "a / b"), Measurement("c", 0.1, "s", "new")]
    assert recorded_values(page) == {"a_ratio": "3.2 (2.8 to 3.5)"}
    assert markdown_table(measured, recorded_values(page)).splitlines()[2:] == [
        "| `a_ratio` | 3.46 | 3.2 (2.8 to 3.5) | 1 | a / b |",
        "| `c` | 0.1 |  | s | new |",
    ]
    assert {"curve_point_ratio", "campaign_ratio"} <= recorded_values(PAGE.read_text()).keys()


def test_an_unknown_name_is_refused(capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit) as stopped:
        main(["tangent"])
    assert stopped.value.code == 2
    message = capsys.readouterr().err
    assert all(name in message for name in ENTRIES)


def test_growth_exponent_of_a_power_law() -> None:
    sizes = [166.0, 340.0, 532.0, 1936.0]
    assert growth_exponent(sizes, [3e-4 * size**2.7 for size in sizes]) == pytest.approx(2.7, rel=1e-12)


def test_runs_are_interleaved() -> None:
    calls: list[str] = []
    pair = interleaved(lambda: calls.append("a"), lambda: calls.append("b"), pairs=3, warm_up=False)
    assert calls == ["a", "b"] * 3
    assert pair.ratio > 0.0


def test_multiply_adds_of_a_film_of_one_station() -> None:
    # Three lines: 3 for the foil, then 9 for right sides, 6 for forces, 12 for the journal, 3 for the foil
    # again, and 2 + 3 + 2 of the elimination; in a closed ring 1 + 3 + 1 and two rows and two columns.
    assert film_multiply_adds(3, 1, periodic=False) == 33 + 7
    assert film_multiply_adds(3, 1, periodic=True) == 33 + 5 + 4
    # two more neighbours: 5 rows of b_q, one more M and one more U
    assert film_multiply_adds(3, 1, periodic=False, reach=2) == 33 + 6 + 7 + 2


def test_the_chain_solves_its_shifted_equations() -> None:
    system, parameters, shift = chain(7), np.array([START, FREQUENCY]), 0.1
    state, columns = 2.0 + deterministic_block(14, 1)[:, 0], deterministic_block(14, LANES, 1)
    jacobian = system.tangent_at(0.3, state, np.eye(14), parameters)
    difference = np.empty_like(jacobian)
    for k, step in enumerate(1e-6 * np.eye(14)):
        ends = [system.rates_at(0.3, state + sign * step, parameters) for sign in (1.0, -1.0)]
        difference[:, k] = (ends[0] - ends[1]) / 2e-6
    np.testing.assert_allclose(jacobian, difference, rtol=0.0, atol=1e-7)
    assert system.shifted is not None
    factors, work = np.zeros(system.shifted.factors_size), np.zeros(system.work_size)
    lines, own = columns.ravel().copy(), (system.constants, system.layout)
    system.shifted.factorise(0.3, state, parameters, shift, *own, work, factors)
    system.shifted.solve(factors, *own, work, lines)
    expected = np.linalg.solve(np.eye(14) - shift * jacobian, columns)
    np.testing.assert_allclose(lines.reshape(14, LANES), expected, rtol=0.0, atol=1e-12)
