"""The search of `agfb run` for every bifurcation curve of a case in the plane excitation frequency x speed.

Branches of cycles cross the plane along lines of constant excitation frequency and of constant speed.  Every
bifurcation on them that lies on no curve yet starts one; so does every codimension-two point at which another
curve meets one of these.  Further rounds of lines between the old ones follow, until a whole round finds no
new curve.
"""

from __future__ import annotations

from collections.abc import Generator
from dataclasses import astuple, dataclass, field
from functools import cached_property
from pathlib import Path
from typing import Any, Literal

import numpy as np

from pipelines.bifurcations.branch import BranchStop
from pipelines.bifurcations.detection import EventKind
from pipelines.case.models import Case, ContinueCycles
from pipelines.case.reading import NamedCase
from pipelines.case.scales import PARAMETERS
from pipelines.datasets.branch import write_group
from pipelines.datasets.schema import KINDS
from pipelines.machine import film
from pipelines.machine.assembly import parameter_vector
from pipelines.orbits.equilibria.equilibrium import MEAN_PHASE, at_rest, machine_equilibrium
from pipelines.orbits.equilibria.linear import at_speed
from pipelines.stages import step_errors
from pipelines.stages.curves.open_ends import caution, open_ends
from pipelines.stages.curves.parts import compute_curve, curve_is_needed, curve_parts
from pipelines.stages.curves.rows import CONTAINERS
from pipelines.stages.curves.starts import StartQueue
from pipelines.stages.curves.track_curves import curves_result
from pipelines.stages.cycles.branch import BranchRequest, is_traced, trace_branch
from pipelines.stages.cycles.start import first_hopf
from pipelines.stages.job import Job, Origin
from pipelines.stages.parts import Part, Plan, compute_alone, discard_all
from pipelines.stages.results import Report, ShouldStop, StageResult

Interval = tuple[float, float]

GROUP = "bifurcation_set"
LINES = "cycles/s"  # beginning of the names of their groups
SPEED: Literal["speed"] = "speed"
FREQUENCY: Literal["excitation_frequency"] = "excitation_frequency"
LARGEST_ORDER = 2  # largest n of the principal resonances 2 Omega_j / n at which the first round has lines
APART = 0.02  # of the plane's width: a resonance nearer than this to another line gets no line
LINE_POINTS = 2000
EVERY_KIND = (EventKind.PERIOD_DOUBLING, EventKind.NEIMARK_SACKER, EventKind.FOLD)
SPEEDS_TRIED = 49  # for the lowest speed with a film


@dataclass(frozen=True)
class Line:
    """A branch along ``parameter`` with the other parameter ``fixed``, made in a ``round`` of the search."""

    parameter: Literal["speed", "excitation_frequency"]
    fixed: float
    round: int


def bifurcation_set(
    named: NamedCase, store_path: Path, report: Report, should_stop: ShouldStop
) -> StageResult:
    """Fill ``cycles/s000``, ..., ``pd``, ``ns``, ``folds`` and ``bifurcation_set`` of a case.

    An interrupted search resumes after the last stored point.
    """
    return compute_alone(plan_bifurcation_set(named, store_path, report, should_stop))


def plan_bifurcation_set(
    named: NamedCase, store_path: Path, report: Report, should_stop: ShouldStop
) -> SearchPlan:
    """The search of a case; each line and each direction of a curve is a part."""
    job = Job.of("bifurcation-set", named, store_path, report, should_stop)
    kinds, boundaries = _kinds(named.case), named.case.bifurcation_set.boundaries
    others = tuple(kind for kind in EVERY_KIND if kind not in kinds)
    return SearchPlan(job, StartQueue(job, kinds, boundaries, others))


@dataclass
class SearchPlan(Plan):
    """Round by round: all lines of a round, then all curves that start from what is stored.

    ``lines`` of the rounds whose curves are traced, and whether the search is ``complete``.
    """

    job: Job
    queue: StartQueue
    lines: list[Line] = field(default_factory=list)
    complete: bool = False

    @cached_property
    def lowest(self) -> float | None:
        """The lowest speed of the lines; None if there is nothing to search."""
        return None if nothing_to_search(self.job.case) is not None else lowest_speed(self.job)

    def parts(self, settled: bool = True) -> Generator[Part]:
        """The missing lines of a round, or the missing curves.

        Lines do not wait for what starts curves; the second round always follows the first.
        """
        self.lines, self.complete = [], False
        if self.lowest is None:
            return
        rounds = self.job.case.bifurcation_set.max_rounds
        for number in range(rounds):
            fresh, missing = self._round(number, self.lowest)
            if number > 0:
                if not settled or (yield from self._missing_curves()):
                    yield from missing if number == 1 else ()
                    return
                self.complete = number > 1 and self._last_round_was_in_vain()
                if self.complete:
                    return
            if missing:
                yield from missing
                if number == 0 and rounds > 1:
                    self.lines += fresh
                    yield from self._round(1, self.lowest)[1]
                return
            self.lines += fresh
        if settled and not (yield from self._missing_curves()):
            self.complete = rounds > 1 and self._last_round_was_in_vain()

    def _round(self, number: int, lowest: float) -> tuple[list[Line], list[Part]]:
        """The lines of the round after those of `lines`, and parts for those that are missing."""
        fresh, missing = lines_of_round(self.job, number, lowest), list[Part]()
        for index, line in enumerate(fresh, start=len(self.lines)):
            request = _request(self.job, line, index, lowest)
            if not is_traced(self.job, request):
                missing.append(Part(request.group, {"line": astuple(line), "lowest": lowest}))
        return fresh, missing

    def compute(self, part: Part, job: Job) -> None:
        """Trace one line, or one curve in one direction."""
        if "line" not in part.arguments:
            compute_curve(job, part)
            return
        line, index = Line(*part.arguments["line"]), int(part.group.removeprefix(LINES))
        trace_branch(job, _request(job, line, index, part.arguments["lowest"]))

    def is_needed(self, part: Part) -> bool:
        """Whether a curve that is traced ahead still may be needed."""
        return curve_is_needed(self.job, part)

    def result(self) -> StageResult:
        """How the search ended, and how it covered the plane."""
        job = self.job
        if (reason := nothing_to_search(job.case)) is not None:
            return StageResult(job.case_id, True, reason)
        if self.lowest is None:
            return StageResult(
                job.case_id, False, f"no equilibrium of the plane leaves a film of "
                f"{job.case.bifurcation_set.smallest_film:g} of the clearance",
                "raise the upper end of track_curves.ranges, or lower bifurcation_set.smallest_film",
            )  # fmt: skip
        if not job.should_stop():
            discard_all(job)
            _write(job, self.lines, self.lowest, self.complete)
        return _result(job, self.lines, self.complete)

    def _missing_curves(self) -> Generator[Part, None, bool]:
        """The curves from all `lines` that are missing; returns whether there are any."""
        lines = {f"{LINES}{index:03d}" for index in range(len(self.lines))}
        self.queue.without = frozenset(
            group for group in self.job.groups("cycles") if group.startswith(LINES) and group not in lines
        )
        found = False
        for part in curve_parts(self.queue):
            found = True
            yield part
        return found

    def _last_round_was_in_vain(self) -> bool:
        last = max((line.round for line in self.lines), default=0)
        return not any(
            _new_curves(self.job, index) for index, line in enumerate(self.lines) if line.round == last
        )


def nothing_to_search(case: Case) -> str | None:
    """Why a case has no set in the plane of excitation frequency and speed; None when it has one."""
    if set(case.track_curves.parameters) != {SPEED, FREQUENCY}:
        return "the search covers the plane of excitation_frequency and speed only"
    if parameter_vector(case)[film.DISPLACEMENT] == 0.0:
        return "without displacement of the rings nothing depends on the excitation frequency"
    return None


def _kinds(case: Case) -> tuple[EventKind, ...]:
    """The kinds of curves that the search follows, always in the same order."""
    return tuple(kind for kind in EVERY_KIND if kind.name.lower() in case.bifurcation_set.kinds)


def _range(case: Case, parameter: str) -> Interval:
    table = case.track_curves
    return table.ranges[table.parameters.index(parameter)]


def lowest_speed(job: Job) -> float | None:
    """The lowest speed of the plane at which the film of the equilibrium is thick enough.

    The rings are at their mean displacement.  None if no speed has a film of
    ``bifurcation_set.smallest_film``.  The speed is found to a thousandth of the range.
    """
    low, high = _range(job.case, SPEED)

    def has_film(speed: float) -> bool:
        parameters = at_speed(parameter_vector(job.case), speed)
        found = machine_equilibrium(job.machine, parameters)
        if not found.converged:
            return False
        films = job.machine.minimum_film(MEAN_PHASE, found.state, at_rest(parameters))
        return float(np.min(films)) >= job.case.bifurcation_set.smallest_film

    speeds = [float(speed) for speed in np.linspace(low, high, SPEEDS_TRIED)]
    first = next((index for index, speed in enumerate(speeds) if has_film(speed)), None)
    if first is None or first == 0:
        return None if first is None else low
    below, above = speeds[first - 1], speeds[first]
    while above - below > 1e-3 * (high - low):
        middle = 0.5 * (below + above)
        below, above = (below, middle) if has_film(middle) else (middle, above)
    return above


def lines_of_round(job: Job, number: int, lowest: float) -> list[Line]:
    """The lines of a round: between those of earlier rounds; in the first round also at resonances.

    The resonances are the predicted ones of the group ``criticals``.
    """
    case, search = job.case, job.case.bifurcation_set
    frequencies = _spread(search.frequencies, _range(case, FREQUENCY), number)
    if number == 0 and search.resonances:
        frequencies += _resonant_frequencies(job, frequencies)
    speeds = _spread(search.speeds, (lowest, _range(case, SPEED)[1]), number)
    return [Line(FREQUENCY, value, number) for value in speeds] + [
        Line(SPEED, value, number) for value in frequencies
    ]


def _spread(count: int, interval: Interval, number: int) -> list[float]:
    """One value in each of ``count`` equal cells: the middle in round 0, other places in later rounds."""
    low, high = interval
    # van der Corput sequence: 1/2, 0, 1/4, 3/4, 1/8, ...
    index = {0: 1, 1: 0}.get(number, number)
    offset = sum(int(digit) / 2.0 ** (place + 1) for place, digit in enumerate(reversed(f"{index:b}")))
    return [low + (high - low) * (cell + offset) / count for cell in range(count)]


def _resonant_frequencies(job: Job, taken: list[float]) -> list[float]:
    """Predicted principal resonances inside the plane that are not beside another line."""
    low, high = _range(job.case, FREQUENCY)
    if not job.groups("criticals"):
        return []
    names = ("resonance_frequency", "resonance_order", "resonance_kind")
    arrays = job.read("criticals", names).arrays
    principal = KINDS["criticals"].array("resonance_kind").flag("principal")
    wanted = (arrays["resonance_kind"] == principal) & (arrays["resonance_order"] <= LARGEST_ORDER)
    found: list[float] = []
    for value in np.sort(arrays["resonance_frequency"][wanted]):
        beside = min((abs(value - other) for other in taken + found), default=np.inf)
        if low <= value <= high and beside > APART * (high - low):
            found.append(float(value))
    return found


def _request(job: Job, line: Line, index: int, lowest: float) -> BranchRequest:
    """The branch of a line, downwards from the upper end, where films are thick and periods short."""
    case = job.case
    low, high = _range(case, line.parameter)
    low = max(low, lowest) if line.parameter == SPEED else low
    step = case.bifurcation_set.maximum_step
    table = ContinueCycles(
        parameter=line.parameter,
        range=(low, high),
        start=high,
        formulation=case.continue_cycles.formulation,
        step=min(case.continue_cycles.step, step),
        minimum_step=case.continue_cycles.minimum_step,
        maximum_step=step,
        max_points=LINE_POINTS,
        minimum_film=case.continue_cycles.minimum_film,
        direction="down",
    )
    other = FREQUENCY if line.parameter == SPEED else SPEED
    return BranchRequest(
        f"{LINES}{index:03d}",
        case.model_copy(update={"continue_cycles": table}),
        direction=-1,
        fixed={other: line.fixed},
    )


def _new_curves(job: Job, index: int) -> int:
    """Number of curves that start from bifurcations on a line."""
    group = f"{LINES}{index:03d}"
    found = 0
    for name in job.groups(*CONTAINERS.values()):
        attributes = job.read(name, ()).attributes
        origin = Origin.of(attributes)
        found += int(origin is not None and origin.group == group and attributes["half"] == 0)
    return found


def _write(job: Job, lines: list[Line], lowest: float, complete: bool) -> None:
    """Write the group that records how the plane was searched."""
    case, spec = job.case, KINDS[GROUP]
    branches = [
        job.read(f"{LINES}{index:03d}", (line.parameter, "event_kind")) for index, line in enumerate(lines)
    ]
    reached = [
        (float(branch[line.parameter].min()), float(branch[line.parameter].max()))
        if branch.n_points
        else (np.nan, np.nan)
        for line, branch in zip(lines, branches, strict=True)
    ]
    whole = {BranchStop.RANGE.name.lower(), BranchStop.LIMIT.name.lower()}
    arrays: dict[str, Any] = {
        "line_parameter": np.array([spec.array("line_parameter").flag(line.parameter) for line in lines]),
        "line_fixed": np.array([line.fixed for line in lines]),
        "line_low": np.array([low for low, _ in reached]),
        "line_high": np.array([high for _, high in reached]),
        "line_round": np.array([line.round for line in lines]),
        "line_events": np.array([branch.n_events for branch in branches]),
        "line_new_curves": np.array([_new_curves(job, index) for index in range(len(lines))]),
        "line_complete": np.array(
            [int(branch.attributes["stop_reason"] in whole and branch.n_points > 0) for branch in branches]
        ),
    }
    passive = first_hopf(job.machine, _at_rest(case), *_range(case, SPEED))
    attributes = {
        "parameters": list(case.track_curves.parameters),
        "ranges": [list(interval) for interval in case.track_curves.ranges],
        "rounds": lines[-1].round + 1,
        "covered": covered(lines, complete),
        "kinds": [kind.name.lower() for kind in _kinds(case)],
        "boundaries": case.bifurcation_set.boundaries,
        "complete": complete,
        "open_ends": [end.as_dict() for end in open_ends(job.store, job.case_id)],
        "passive_instability_speed": None if passive is None else passive.speed,
        "lowest_speed": lowest,
    }
    write_group(job.store, job.path(GROUP), GROUP, arrays, attributes)


def _at_rest(case: Case) -> np.ndarray:
    """The parameters of the passive machine, its rings undeformed."""
    parameters = parameter_vector(case)
    parameters[PARAMETERS.index("displacement")] = 0.0
    return parameters


def covered(lines: list[Line], complete: bool) -> str:
    """A sentence that says how the plane was searched."""
    along_speed = sum(line.parameter == SPEED for line in lines)
    rounds = lines[-1].round + 1
    last = sum(line.round == lines[-1].round for line in lines)
    met = (
        f"the last {last} of them met no new curve"
        if complete
        else "the last round still met new curves: raise bifurcation_set.max_rounds"
    )
    return (
        f"{along_speed} branches along the speed and {len(lines) - along_speed} along the excitation "
        f"frequency in {rounds} rounds; {met}"
    )


def _result(job: Job, lines: list[Line], complete: bool) -> StageResult:
    """The result of the search: a success if every curve is complete."""
    kinds = _kinds(job.case)
    traced = [kind for kind in EVERY_KIND if kind in kinds or job.groups(CONTAINERS[kind])]
    results = {CONTAINERS[kind]: curves_result(job, kind) for kind in traced}
    summary: dict[str, Any] = {"lines": len(lines)}
    summary |= {f"{name} curves": result.summary["curves"] for name, result in results.items()}
    advice = [result.advice for result in results.values() if not result.ok]
    if not lines or job.should_stop():
        return StageResult(job.case_id, True, "stopped on request", "", summary)
    sentence = covered(lines, complete)
    ok = all(result.ok for result in results.values())
    doubt = step_errors.caution(step_errors.count_in(job.store, map(job.path, job.groups(*results))))
    sentences = "; ".join(filter(None, advice))
    doubts = "; ".join(filter(None, (doubt, caution(open_ends(job.store, job.case_id)))))
    return StageResult(job.case_id, ok, sentence, sentences, summary, caution=doubts)
