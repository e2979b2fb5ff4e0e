"""The table of the refinement of bifurcation points."""

from __future__ import annotations

from pydantic import field_validator

from pipelines.case.fields import InconsistentError, Number, Table, quantity, table

LARGEST_FACTOR = 8.0


class Refine(Table):
    """Recomputation of located bifurcations on finer grids (`--refine`)."""

    factors: tuple[Number, Number] = table(
        "circumferential intervals of the two finer grids / those of numerics.circumferential, rising",
        (1.5, 2.25),
        unit="1",
        because="three grids determine the order of convergence, most accurately with equal ratios",
    )
    points_per_curve: int = quantity(
        "recomputed points of every bifurcation curve besides its first",
        "",
        3,
        at_least=0,
        at_most=1000,
        because="they are spread evenly along the curve",
    )
    tolerance_factor: float = quantity(
        "numerics.multiplier_tolerance of recomputed points / of stored points",
        "1",
        0.1,
        above=0,
        at_most=1,
        because="the error of the time steps must stay far below that of the grids",
    )

    @field_validator("factors")
    @classmethod
    def _rising(cls, factors: tuple[float, float]) -> tuple[float, float]:
        if not 1.0 < factors[0] < factors[1] <= LARGEST_FACTOR:
            raise InconsistentError(
                f"must rise, > 1 and <= {LARGEST_FACTOR:g}, given [{factors[0]:g}, {factors[1]:g}]"
            )
        return factors
