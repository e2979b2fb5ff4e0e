"""Passes over the period that pieces of work take, as counted on finished branches."""

from __future__ import annotations

from pipelines.case.models import Case

PASSES_PER_CYCLE = 12  # corrections, tangents and multipliers, and locating what lies between two points
PASSES_PER_CURVE_POINT = 65  # normal forms on two smoothed machines included
PASSES_PER_CELL = 1.5  # of a survey: half of them with the few time steps that it needs
_NORMAL_FORMS = 3.0  # times as long as a point of a curve without


def passes_per_curve_point(case: Case) -> float:
    """Those of a point of a curve, with its normal form if the case asks for it."""
    return PASSES_PER_CURVE_POINT / (1.0 if case.track_curves.normal_forms else _NORMAL_FORMS)
