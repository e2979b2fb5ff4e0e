"""The table [sample]: which machines it draws, how overrides and sweeps go with it, and what it refuses."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.stats import qmc

from pipelines.case.reading import CaseError, NamedCase, read_cases
from tests.helpers.tiny import CONFIG

TOLERANCES = """
[sample]
count = 16
seed = 3
[sample.ranges]
"bearings.foil.stiffness" = [8, 12]
[sample.tolerances]
bearings.0.clearance = 2e-6
"bearings.1.clearance" = 2e-6
"""
KEYS = ["bearings.foil.stiffness", "bearings.0.clearance", "bearings.1.clearance"]


def sampled(*overrides: str, sample: str = TOLERANCES) -> tuple[NamedCase, ...]:
    return read_cases(CONFIG.read_text() + sample, "smoke.toml", overrides, ())


def inputs(cases: tuple[NamedCase, ...]) -> np.ndarray:
    """Stiffness and both clearances of every case."""
    return np.array(
        [
            (named.case.bearings[0].foil.stiffness, *(bearing.clearance for bearing in named.case.bearings))
            for named in cases
        ]
    )


@pytest.mark.parametrize("method", ["sobol", "latin_hypercube"])
def test_each_part_of_a_range_holds_one_machine(method: str) -> None:
    """Both methods put one of 16 machines into each 16th of every range."""
    cases = sampled(f"sample.method={method}")
    assert [named.case_id for named in cases] == [f"sample={number:04d}" for number in range(16)]
    clearance = read_cases(CONFIG.read_text(), "smoke.toml")[0].case.bearings[0].clearance
    low, high = np.array([8.0, *2 * [clearance - 2e-6]]), np.array([12.0, *2 * [clearance + 2e-6]])
    cells = np.floor(16 * (inputs(cases) - low) / (high - low)).astype(int)
    for column in cells.T:
        assert sorted(column) == list(range(16))
    assert all(named.case.bearings[1].foil == named.case.bearings[0].foil for named in cases)


def test_a_sobol_sequence_covers_pairs_of_ranges() -> None:
    """16 points of a (t, 4, 3) net have a far smaller discrepancy than random ones."""
    values = inputs(sampled())
    unit = (values - values.min(axis=0)) / np.ptp(values, axis=0)
    random = np.random.default_rng(0).random((100, 16, 3))
    assert qmc.discrepancy(unit) < np.quantile([qmc.discrepancy(each) for each in random], 0.05)


def test_a_larger_count_keeps_the_machines_and_another_seed_does_not() -> None:
    few, many = inputs(sampled("sample.count=8")), inputs(sampled())
    np.testing.assert_array_equal(few, many[:8])
    assert not np.any(inputs(sampled("sample.seed=4")) == many)


def test_beside_a_sweep_every_combination_is_a_case() -> None:
    cases = sampled("sample.count=2", "sweep.excitation.displacement=[0.1, 0.2]")
    assert [named.case_id for named in cases] == [
        f"displacement={displacement}_sample={number:04d}" for displacement in (0.1, 0.2) for number in (0, 1)
    ]
    np.testing.assert_array_equal(inputs(cases[:2]), inputs(cases[2:]))


def test_a_key_set_on_the_command_line_is_not_drawn_and_the_others_stay() -> None:
    free, fixed = inputs(sampled()), inputs(sampled("bearings.foil.stiffness=9"))
    assert set(fixed[:, 0]) == {9.0}
    np.testing.assert_array_equal(fixed[:, 1:], free[:, 1:])
    alone = "[sample]\ncount = 4\n[sample.ranges]\n'bearings.foil.stiffness' = [8, 12]\n"
    (only,) = sampled("bearings.foil.stiffness=9", sample=alone)
    assert only.case_id == "smoke", "nothing is left to draw"


@pytest.mark.parametrize(
    ("override", "key", "message"),
    [
        ("sample.count=0", "sample.count", "must be >= 1"),
        ("sample.method=halton", "sample.method", "must be one of sobol, latin_hypercube"),
        ("sample.ranges={}", "sample", "at least one key"),
        ("sample.ranges.gas.viscosity=[2e-5, 1e-5]", "sample.ranges.gas.viscosity", "low < high"),
        ("sample.ranges.gas.viscosity=1e-5", "sample.ranges.gas.viscosity", "must be an array"),
        ("sample.tolerances.gas.viscosity=-1e-6", "sample.tolerances.gas.viscosity", "must be > 0"),
        ("sample.tolerances.gas.viscosty=1e-6", "sample.tolerances.gas.viscosty", "no value in the file"),
        ("sample.tolerances.name=1", "sample.tolerances.name", "not a number"),
        ("sample.tolerances.bearings.node=1", "sample.tolerances.bearings.node", "different values"),
        ("sample.tolerances.bearings.2.node=1", "sample.tolerances.bearings.2.node", "no value in the file"),
        ("sample.ranges.bearings.2.node=[1, 2]", "sample.ranges.bearings.2.node", "entries 0 to 1"),
        ("sample.ranges.gas.viscosty=[1e-5, 2e-5]", "gas.viscosty", "unknown key"),
        ("sample.ranges.bearings.0.clearance=[1e-5, 2e-5]", "sample.tolerances.bearings.0.clearance", "too"),
        ("sample.seeds=1", "sample.seeds", "allowed here: count, method, seed, ranges, tolerances"),
        ("sweep.bearings.foil.stiffness=[3, 10]", "sample", "has the key bearings.foil.stiffness twice"),
        ("sample.ranges.excitation.displacement=[0.5, 2]", "excitation.displacement", "must be"),
    ],
)
def test_what_is_refused(override: str, key: str, message: str) -> None:
    removed = ("sample.tolerances={}",) if override == "sample.ranges={}" else ()
    with pytest.raises(CaseError) as refused:
        sampled(*removed, override)
    assert any(problem.key.startswith(key) and message in str(problem) for problem in refused.value.problems)
