"""The numbers that golden.json freezes: the smoke case through its stages, on a short piece of its branch."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from pipelines.case.reading import read_cases
from pipelines.datasets.reading import read_group
from pipelines.datasets.store import open_for_reading
from pipelines.stages.cycles.continue_cycles import continue_cycles
from pipelines.stages.linear.criticals import criticals
from pipelines.stages.linear.linearize import linearize
from pipelines.stages.scheduling.preparation import prepare_store

CONFIG = Path(__file__).parents[2] / "configs" / "smoke.toml"
SHORTER = (
    "linearize.points=4",
    "criticals.points=15",
    "criticals.unbalance_points=4",
    "continue_cycles.start=1.18",
    "continue_cycles.range=[1.18, 1.21]",
)


def golden_values(folder: Path) -> dict[str, Any]:
    """Compute the values anew, in a store below ``folder``; every entry is a number or a list of numbers."""
    (case,) = read_cases(CONFIG.read_text(), CONFIG.name, SHORTER)
    path = folder / "golden.zarr"
    prepare_store(path, [case], ["golden"])
    for stage in (linearize, criticals, continue_cycles):
        result = stage(case, path, lambda progress: None, lambda: False)
        assert result.ok, result
    store = open_for_reading(path)
    linear = read_group(store, "cases/smoke/linear")
    critical = read_group(store, "cases/smoke/criticals").arrays
    branch = read_group(store, "cases/smoke/cycles/b000").arrays
    oscillating = branch["multipliers"][-1][branch["multipliers"][-1].imag > 0.0][:4]
    return {
        "instability_speed": linear.attributes["instability_speed"],
        "instability_frequency": linear.attributes["instability_frequency"],
        "bearing_stiffness": linear.arrays["bearing_stiffness"][-1, 0, 0].ravel().tolist(),
        "bearing_damping": linear.arrays["bearing_damping"][-1, 0, 0].ravel().tolist(),
        "critical_speeds": critical["critical_speed"].tolist(),
        "condensed_frequencies": critical["condensed_frequency"].tolist(),
        "neimark_sacker_speed": branch["event_speed"].tolist(),
        "neimark_sacker_angle": branch["event_angle"].tolist(),
        "neimark_sacker_transversality": branch["event_transversality"].tolist(),
        "multiplier_moduli": abs(oscillating).tolist(),
        "minimum_film": branch["minimum_film"][-1].tolist(),
        "orbit_maximum": branch["orbit_maximum"][-1, :4].tolist(),
    }
