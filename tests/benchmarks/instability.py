"""Error of the instability speed: the paper's scheme against the default one."""

from __future__ import annotations

from tests.benchmarks.measuring import Measurement
from tests.benchmarks.settings import SCHEME, Settings
from tests.validation.test_instability import instability_speed

# With Gümbel clipping and the whole film, which suction destabilises.
_BRACKETS = {"gumbel": (0.95, 1.25), "full": (0.75, 1.15)}
_PAPER = {"scheme": "backward", "axial_scheme": "uniform"}


def backward_error(settings: Settings) -> list[Measurement]:
    """Error of the paper's scheme / error of the default, against Richardson extrapolation of fine central
    grids.
    """
    ratio, errors = _errors(settings, "gumbel")
    whole, _ = _errors(settings, "full")
    paper, default = _name(settings.backward_grid), _name(settings.default_grid)
    coarse, fine = map(_name, settings.reference_grids)
    against = f"reference: second-order Richardson from central {coarse} and {fine}"
    return [
        Measurement(
            "backward_error_ratio", ratio, "1",
            f"error in the instability speed: backward and uniform on {paper} / default on {default}; "
            + against,
        ),
        Measurement("backward_error_ratio_unclipped", whole, "1", "the same, pressure unclipped"),
        Measurement("backward_error", errors[0], "1", f"informative: relative error of backward {paper}"),
        Measurement("default_error", errors[1], "1", f"informative: relative error of the default {default}"),
    ]  # fmt: skip


def _errors(settings: Settings, clipping: str) -> tuple[float, tuple[float, float]]:
    """Ratio of the errors and both relative errors."""
    bracket = _BRACKETS[clipping]
    coarse, fine = (instability_speed(grid, bracket, clipping) for grid in settings.reference_grids)
    refinement = (settings.reference_grids[1][0] / settings.reference_grids[0][0]) ** 2
    reference = fine + (fine - coarse) / (refinement - 1.0)
    paper = abs(instability_speed(settings.backward_grid, bracket, clipping, **_PAPER) / reference - 1.0)
    default = abs(
        instability_speed(settings.default_grid, bracket, clipping, scheme=SCHEME) / reference - 1.0
    )
    return paper / default, (paper, default)


def _name(grid: tuple[int, int]) -> str:
    return f"{grid[0]}x{grid[1]}"
