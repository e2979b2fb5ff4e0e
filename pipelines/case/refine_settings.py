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
        because="three grids tell the order of convergence, equal ratios tell it best",
    )
    points_per_curve: int = quantity(
        "points of every bifurcation curve that are recomputed beside its first one",
        "",
        3,
        at_least=0,
        at_most=1000,
        because="they are spread evenly along the curve",
    )
    tolerance_factor: float = quantity(
        "numerics.multiplier_tolerance of the recomputed points / that of the stored ones",
        "1",
        0.1,
        above=0,
        at_most=1,
        because="the time steps must not blur what the grids tell",
    )

    @field_validator("factors")
    @classmethod
    def _rising(cls, factors: tuple[float, float]) -> tuple[float, float]:
        if not 1.0 < factors[0] < factors[1] <= LARGEST_FACTOR:
            raise InconsistentError(
                f"must rise, > 1 and <= {LARGEST_FACTOR:g}, given [{factors[0]:g}, {factors[1]:g}]"
            )
        return factors
