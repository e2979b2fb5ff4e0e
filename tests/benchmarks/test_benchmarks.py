"""The benchmarks run and write what they should; what they measure is not tested."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

from tests.benchmarks.__main__ import ENTRIES, main
from tests.benchmarks.measuring import growth_exponent, interleaved

RATIOS = {
    "tangent_batch_ratio": {"tangent_batch_ratio", "period_map", "period_map_with_columns"},
    "backward_error_ratio": {
        "backward_error_ratio",
        "backward_error_ratio_unclipped",
        "backward_error",
        "default_error",
    },
    "growth_exponent": {
        "growth_exponent",
        "growth_exponent_walked",
        "composition_ratio",
        "branch_point_12x2",
        "branch_point_16x2",
        "branch_point_24x2",
    },
}


@pytest.mark.parametrize("name", RATIOS)
def test_the_file_and_the_table(name: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    path = tmp_path / "new" / "bench.json"
    main(["--quick", "-o", str(path), name])
    content = json.loads(path.read_text())
    assert content.keys() == RATIOS[name]
    for entry in content.values():
        assert entry.keys() == {"value", "unit", "what"}
        assert np.isfinite(entry["value"])
        assert entry["unit"] in {"1", "s", "ms"}
        assert entry["what"]
    out, err = capsys.readouterr()
    assert [line.split("`")[1] for line in out.splitlines()[2:]] == list(content)
    assert err.startswith(name)


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
