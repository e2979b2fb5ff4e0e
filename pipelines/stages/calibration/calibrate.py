"""`agfb calibrate`: bounded least squares of chosen keys to target thresholds.

Every machine that the search asks for is one row of the group ``calibration``, committed when all its targets
are known.  The search itself is deterministic: a resumed one runs again over the stored rows, which cost
nothing, and computes only what is missing.  From the second machine on onsets are sought near those of the
nearest machine; the machine that is found is computed once more along branches from the lowest speed, which
confirms that no onset lies below.
"""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from pipelines.case.arrays import Array
from pipelines.case.calibrate_settings import CORNERS, number_at
from pipelines.case.models import Calibrate, CalibrationParameter, Case
from pipelines.case.reading import NamedCase
from pipelines.datasets.branch import BranchWriter, open_branch
from pipelines.datasets.reading import read_group
from pipelines.datasets.records import ENDED
from pipelines.datasets.schema import KINDS
from pipelines.datasets.store import Store, case_group, open_for_writing
from pipelines.stages.calibration.doubling import Corner
from pipelines.stages.calibration.fit import Evaluation, Fit, NoEvaluationsLeft, fit
from pipelines.stages.calibration.onset_speed import FAILED, FOUND
from pipelines.stages.calibration.targets import Corners, Expected, Reached, corner_key, reached
from pipelines.stages.results import Progress, Report, ShouldStop, StageResult, StopRequested

GROUP = "calibration"
CONVERGED = "converged"
OTHER_ONSET = "another onset lies below"
FAILED_TARGETS = "some targets cannot be computed"
OUT_OF_EVALUATIONS = "the allowed number of machines is computed"  # also in earlier stores
ADVICE = {
    CONVERGED: "",
    OTHER_ONSET: "the found machine loses stability below the onset that was followed: "
    "start another search from this machine",
    FAILED_TARGETS: "the table of targets says why; narrow the ranges of the parameters or of the speed",
    OUT_OF_EVALUATIONS: "raise calibrate.max_evaluations to continue, or calibrate.tolerance",
}
NO_TABLE = "there is no table [calibrate]"
DIGITS = 10  # of the values of parameters
SAME_ONSET = 1e-3  # relative difference up to which two onsets count as one
NAMES = ("position", "reached", "onset", "status", "begin")


def calibrate(named: NamedCase, store_path: Path, report: Report, should_stop: ShouldStop) -> StageResult:
    """Fill the group ``calibration`` of a case; a search that does not converge is a failed stage."""
    settings = named.case.calibrate
    if settings is None:
        return StageResult(named.case_id, False, NO_TABLE, "give calibrate.parameters and calibrate.targets")
    store, group = open_for_writing(store_path), case_group(named.case_id, GROUP)
    with _open(store, group, named.case, settings) as branch:
        if not branch.is_complete(OUT_OF_EVALUATIONS, settings.max_evaluations):
            try:
                _search(Machines(branch, store, named, settings, report, should_stop))
            except StopRequested:
                return StageResult(named.case_id, True, "stopped on request")
    return _result(named.case_id, store, group)


def _open(store: Store, group: str, case: Case, settings: Calibrate) -> BranchWriter:
    ranges = np.array([parameter.range for parameter in settings.parameters])
    static = {
        "wanted": np.array([target.wanted for target in settings.targets]),
        "scatter": np.array([target.scatter for target in settings.targets]),
        "low": ranges[:, 0],
        "high": ranges[:, 1],
    }
    sizes = {
        "evaluation": settings.max_evaluations + 1,  # one confirms
        "parameter": len(settings.parameters),
        "target": len(settings.targets),
    }
    request = settings.model_dump(mode="json", exclude={"max_evaluations"})
    steps = case.continue_cycles.model_dump(
        mode="json", include={"formulation", "step", "minimum_step", "maximum_step", "minimum_film"}
    )
    return open_branch(store, group, GROUP, sizes, static, {"request": request, "continue_cycles": steps})


def position_of(parameter: CalibrationParameter, value: float) -> float:
    """Position of a value within its range, from 0 to 1."""
    low, high = parameter.range
    if parameter.scale == "log":
        return float(np.log(value / low) / np.log(high / low))
    return (value - low) / (high - low)


def value_at(parameter: CalibrationParameter, position: float) -> float:
    """The inverse of `position_of`, rounded to the shown digits, which then reproduce the machine."""
    low, high = parameter.range
    value = low * (high / low) ** position if parameter.scale == "log" else low + position * (high - low)
    return float(f"{value:.{DIGITS}g}")


def values_at(settings: Calibrate, position: Array) -> dict[str, float]:
    """The value of every calibrated key at a position (n,)."""
    return {
        key: value_at(parameter, float(place))
        for parameter, place in zip(settings.parameters, position, strict=True)
        for key in parameter.keys
    }


def start_position(case: Case, settings: Calibrate) -> Array:
    """Start of the search: the configuration's own values (n,)."""
    document = case.model_dump(mode="json")
    own = [number_at(document, parameter.keys[0]) for parameter in settings.parameters]
    places = [
        position_of(parameter, value)
        for parameter, value in zip(settings.parameters, own, strict=True)
        if value is not None
    ]
    return np.clip(np.array(places), 0.0, 1.0)


class Machines:
    """The machines of a search, as rows of the group; a missing one is computed and committed.

    ``nearby`` of `at`: branches begin below the onsets of the nearest row, the first machine aside.
    """

    def __init__(
        self,
        branch: BranchWriter,
        store: Store,
        named: NamedCase,
        settings: Calibrate,
        report: Report,
        should_stop: ShouldStop,
    ) -> None:
        self.branch, self.named, self.settings = branch, named, settings
        self._report, self._should_stop = report, should_stop
        stored = read_group(store, branch.group, NAMES)
        self._rows: list[dict[str, Any]] = [
            {name: stored[name][index] for name in NAMES} for index in range(stored.n_points)
        ]
        self._penalties = _penalties(named.case, settings)

    def onsets(self, position: Array, nearby: bool) -> Array:
        """Onset speeds (m,) of a computed machine, NaN for targets without one."""
        index = self.index_of(position, nearby)
        assert index is not None
        return np.asarray(self._rows[index]["onset"])

    def index_of(self, position: Array, nearby: bool = True) -> int | None:
        """The row of a machine, computed near an onset or from the lowest speed, as the first machine is."""
        wanted = KINDS[GROUP].array("begin").flag("near_onset" if nearby else "lowest_speed")
        for index, row in enumerate(self._rows):
            same = np.array_equal(row["position"], position)
            if same and (row["begin"] == wanted or (nearby and index == 0)):
                return index
        return None

    def at(self, position: Array, nearby: bool = True) -> Evaluation:
        """The machine at a position (n,).  Raises NoEvaluationsLeft, StopRequested."""
        index = self.index_of(position, nearby)
        if index is None:
            if nearby and len(self._rows) >= self.settings.max_evaluations:
                raise NoEvaluationsLeft
            index = len(self._rows)
            row = self._row(position, nearby and index > 0)
            self.branch.commit(row)
            self._rows.append(row)
            self._report_progress()
        return self._evaluation(self._rows[index])

    def _row(self, position: Array, nearby: bool) -> dict[str, Any]:
        values, spec = values_at(self.settings, position), KINDS[GROUP]
        nearest = self._nearest(position) if nearby else None
        found: list[Reached] = []
        corners: Corners = {}
        for index in range(len(self.settings.targets)):
            if self._should_stop():
                raise StopRequested
            expected = None if nearest is None else _expected(nearest, self.settings, index)
            found.append(
                reached(
                    self.named.case,
                    values,
                    self.settings.targets[index],
                    self.settings,
                    expected,
                    self._should_stop,
                    corners,
                )
            )
        statuses, kinds = spec.array("status").flags, ("unset", *spec.array("bifurcation").flags)
        own = [value_at(p, float(x)) for p, x in zip(self.settings.parameters, position, strict=True)]
        return {
            "position": position,
            "value": np.array(own),
            "reached": np.array([each.value for each in found]),
            "onset": np.array([each.onset for each in found]),
            "status": np.array([statuses.index(each.status) for each in found], dtype=np.int8),
            "bifurcation": np.array([kinds.index(each.bifurcation) - 1 for each in found], dtype=np.int8),
            "begin": np.int8(spec.array("begin").flag("near_onset" if nearby else "lowest_speed")),
        }

    def _nearest(self, position: Array) -> Mapping[str, Any]:
        distances = [float(np.linalg.norm(row["position"] - position)) for row in self._rows]
        return self._rows[int(np.argmin(distances))]

    def _evaluation(self, row: Mapping[str, Any]) -> Evaluation:
        statuses = KINDS[GROUP].array("status").flags
        failed = np.array([statuses[int(flag)] in FAILED for flag in row["status"]])
        told = zip(self.settings.targets, row["reached"].tolist(), strict=True)
        weighted = np.array([target.deviation(value) for target, value in told])
        deviations = np.where(failed, self._penalties, weighted)
        return Evaluation(np.array(row["position"]), deviations, failed)

    def _report_progress(self) -> None:
        found, total = self._evaluation(self._rows[-1]), self.settings.max_evaluations
        worst = int(np.argmax(np.abs(found.deviations)))
        lost = f", {int(found.failed.sum())} targets failed" if found.failed.any() else ""
        message = (
            f"sum of squares {found.cost:.4g}, largest deviation {found.deviations[worst]:.3g} of target "
        )
        message += f"{worst + 1}{lost}"
        self._report(Progress("calibrate", self.named.case_id, len(self._rows), total + 1, message))


def _expected(row: Mapping[str, Any], settings: Calibrate, index: int) -> Expected:
    """The onset of a row's target, or its corner, where the row has one."""
    target = settings.targets[index]
    if target.quantity in CORNERS:
        same = [
            place
            for place, other in enumerate(settings.targets)
            if other.quantity == "corner_frequency" and corner_key(other) == corner_key(target)
        ]
        index = same[0] if same else index
    found = row["status"][index] == KINDS[GROUP].array("status").flag(FOUND)
    if not found or not np.isfinite(row["onset"][index]):
        return None
    onset = float(row["onset"][index])
    if settings.targets[index].quantity == "corner_frequency":
        return Corner(float(row["reached"][index]), onset)
    return None if target.quantity in CORNERS else onset


def _penalties(case: Case, settings: Calibrate) -> Array:
    """Weighted deviations (m,) of targets that fail: their whole speed range."""
    rpm = case.scales.speed_rpm_per_unit
    intervals = [target.speed_range or settings.speed_range for target in settings.targets]
    return np.array([
        (high - low) * (1.0 if target.value_rpm is None else rpm) / target.scatter
        for target, (low, high) in zip(settings.targets, intervals, strict=True)
    ])  # fmt: skip


def _search(machines: Machines) -> None:
    """Run the least squares over the machines, confirm the result, and say how the search ended."""
    settings = machines.settings
    start = start_position(machines.named.case, settings)
    found = fit(machines.at, start, settings.tolerance, settings.difference_step)
    reason = _confirmed(machines, found.best) if found.converged else OUT_OF_EVALUATIONS
    best = machines.index_of(found.best.position, nearby=not found.converged)
    machines.branch.finish(reason, ADVICE[reason], best=best, jacobian=_plain(found))


def _plain(found: Fit) -> list[list[float]] | None:
    return None if found.jacobian is None else found.jacobian.tolist()


def _confirmed(machines: Machines, best: Evaluation) -> str:
    """How the search ended, confirmed by its machine recomputed from the lowest speed."""
    again = machines.at(best.position, nearby=False)
    if np.any(again.failed):
        return FAILED_TARGETS
    followed, confirmed = (machines.onsets(best.position, nearby) for nearby in (True, False))
    other = np.abs(confirmed - followed) > SAME_ONSET * confirmed  # never where neither has one
    return OTHER_ONSET if np.any(other) else CONVERGED


def _result(case_id: str, store: Store, group: str) -> StageResult:
    content = read_group(store, group, ())
    attributes = content.attributes
    reason = attributes["stop_reason"]
    if attributes["status"] != ENDED:
        return StageResult(case_id, True, "stopped on request")
    summary = {"machines": content.n_points}
    return StageResult(case_id, reason == CONVERGED, reason, attributes["stop_advice"], summary)
