"""What `agfb report` says of a survey: unstable cells, the lowest onset, agreement with the curves."""

from __future__ import annotations

from dataclasses import asdict, dataclass
from typing import Any

import numpy as np

from pipelines.case.units import Scale, in_both
from pipelines.datasets.dimensional import scale_of_case
from pipelines.datasets.reading import case_attributes, read_group
from pipelines.datasets.records import Group
from pipelines.datasets.store import Store, case_group
from pipelines.stages.reports.operating_range import SPEED, OperatingRange
from pipelines.stages.survey.onsets import GROUP, Onset, onsets

NEAR = 0.01  # of the height of the plane: a first bifurcation this near is that of the survey


@dataclass(frozen=True)
class SurveySummary:
    """A survey in numbers.

    ``without``: cells without a cycle, or with one that cannot be.  Of its onsets, ``compared`` have a first
    bifurcation on the curves at the same place, ``agreeing`` of them within ``near``.
    """

    parameters: tuple[str, str]
    cells: int
    unstable: int
    without: int
    lowest: Onset | None
    near: float
    compared: int
    agreeing: int
    scale: Scale

    def as_dict(self) -> dict[str, Any]:
        """The summary as plain data."""
        plain = asdict(self) | {"lowest": None if self.lowest is None else self.lowest._asdict()}
        del plain["scale"]
        return plain

    def sentence(self) -> str:
        """The summary in a line."""
        parts = [f"survey: {self.unstable} of {self.cells} cells unstable"]
        if self.without:
            parts[0] += f", {self.without} without a usable cycle"
        if self.lowest is not None:
            place = self.lowest.place(self.parameters, self.scale)
            parts.append(f"lowest onset at {place} ({self.lowest.kind})")
        if self.compared:
            near = in_both("speed", self.near, self.scale, ".2g")
            parts.append(
                f"{self.agreeing} of {self.compared} onsets within {near} of the first bifurcation of the "
                "curves"
            )
        return "; ".join(parts)


def survey_summary(store: Store, case: str, ranges: OperatingRange | None) -> SurveySummary | None:
    """The summary of a case's survey, compared with the ``ranges`` of the curves; None without a survey."""
    name = case_group(case, GROUP)
    if not store.has_group(name):
        return None
    group = read_group(store, name)
    found, status = onsets(group), group.labels("status")
    along, across = (str(parameter) for parameter in group.attributes["parameters"])
    near, apart = 0.0, np.zeros(0)
    if ranges is not None and (along, across) == (ranges.parameter, SPEED):
        near, apart = NEAR * (ranges.speeds[1] - ranges.speeds[0]), _distances(found, ranges)
    return SurveySummary(
        parameters=(along, across),
        cells=int(status.size),
        unstable=_unstable(group),
        without=int(np.sum(status != "found")),
        lowest=min(found, key=lambda onset: onset.across, default=None),
        near=near,
        compared=len(apart),
        agreeing=int(np.sum(apart <= near)),
        scale=scale_of_case(case_attributes(store, case)["scales"]),
    )


def _unstable(group: Group) -> int:
    return int(np.sum((group.labels("status") == "found") & (group["unstable_count"] > 0)))


def _distances(found: list[Onset], ranges: OperatingRange) -> np.ndarray:
    """Distances in speed of the onsets from the first bifurcations at their abscissae, where there is one."""
    bounded = [boundary for boundary in ranges.boundaries if boundary.curve >= 0]
    if not bounded:
        return np.zeros(0)
    abscissae, speeds = (np.array([getattr(one, name) for one in bounded]) for name in ("abscissa", "speed"))
    inside = [onset for onset in found if abscissae[0] <= onset.along <= abscissae[-1]]
    return np.array([abs(onset.across - np.interp(onset.along, abscissae, speeds)) for onset in inside])
