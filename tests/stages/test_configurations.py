"""Every configuration that comes with agfb runs: all stages, on a tiny grid, a few points each."""

from __future__ import annotations

from pathlib import Path

import pytest

from tests.helpers.tiny import ROOT, Watched, tiny_case

CONFIGS = sorted((ROOT / "configs").rglob("*.toml"))


@pytest.mark.parametrize("config", CONFIGS, ids=lambda path: path.stem)
@pytest.mark.parametrize("stage", ["linearize", "criticals", "continue_cycles"])
def test_configuration_runs(config: Path, stage: str, tmp_path: Path) -> None:
    case = tiny_case("continue_cycles.max_points=3", config=config)
    result = Watched(stage, case, tmp_path / "store.zarr").result
    assert result.ok, result
    assert result.stop_reason
    if stage == "continue_cycles":
        assert result.summary["points"] == 3
