"""Every configuration that comes with agfb runs: all stages, on a tiny grid, a few points each."""

from __future__ import annotations

from pathlib import Path

import pytest

from tests.helpers.configurations import FILES
from tests.helpers.tiny import Watched, tiny_case

SAME_MACHINE = {"fig4", "fig5", "fig6"}  # as fig3, whose equilibria are theirs
RUNS = [
    (stage, config)
    for stage in ("linearize", "criticals", "continue_cycles")
    for config in FILES
    if stage == "continue_cycles" or config.stem not in SAME_MACHINE
]


@pytest.mark.parametrize(("stage", "config"), RUNS, ids=lambda value: getattr(value, "stem", value))
def test_configuration_runs(stage: str, config: Path, tmp_path: Path) -> None:
    # the ranges of the tiny settings are dimensionless, whatever the units of the file
    units = [f"{table}.units=dimensionless" for table in ("linearize", "criticals", "continue_cycles")]
    case = tiny_case("continue_cycles.max_points=3", *units, config=config)
    result = Watched(stage, case, tmp_path / "store.zarr").result
    assert result.ok, result
    assert result.stop_reason
    if stage == "continue_cycles":
        assert result.summary["points"] == 3
