"""Points of a branch as rows of a store, and rows as the state that resumes a branch."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any

import numpy as np

from pipelines.bifurcations.branch import BranchPoint, BranchState
from pipelines.bifurcations.detection import Event, EventKind, Resonance
from pipelines.case.arrays import Array
from pipelines.case.models import Case
from pipelines.datasets.records import Branch, Group, Resume
from pipelines.datasets.schema import KINDS
from pipelines.machine.assembly import Machine
from pipelines.machine.rates import BEARINGS
from pipelines.orbits.machine_cycles import CycleShape, cycle_shape, unphysical
from pipelines.orbits.shooting import CycleProblem
from pipelines.stages.job import coordinates
from pipelines.stages.parameter_columns import parameter_columns, stored_parameters

SNAPSHOTS = 8
EVENT_NAMES = (
    *(spec.name for spec in KINDS["cycles"].arrays if spec.name.startswith("event_")),
    "steps_per_period",
)


def cycle_sizes(machine: Machine, case: Case, problem: CycleProblem) -> dict[str, int]:
    """Sizes of the dimensions of a branch's group."""
    size, columns = problem.period_map.size, problem.options.basis.maximum_columns
    return {
        "point": case.continue_cycles.max_points,
        "component": size,
        "extended": size + 2,
        "multiplier": columns,
        "column": columns,
        "sample": problem.period_map.samples,
        "coordinate": machine.rotor_freedoms,
        "bearing": BEARINGS,
        "snapshot": SNAPSHOTS,
        "theta": max(bearing.settings.nodes for bearing in machine.bearings),
        "iteration": problem.options.iterations + 1,
    }


def static_arrays(machine: Machine, case: Case, problem: CycleProblem) -> dict[str, Any]:
    """Coordinates of a branch's group, written once."""
    samples = problem.period_map.samples
    theta = np.full((BEARINGS, max(bearing.settings.nodes for bearing in machine.bearings)), np.nan)
    for index, bearing in enumerate(machine.bearings):
        theta[index, : bearing.settings.nodes] = bearing.angles
    return {
        "theta": theta,
        "sample": np.arange(samples) / samples,
        "snapshot": np.arange(SNAPSHOTS) / SNAPSHOTS,
        **coordinates(case),
    }


_SAME_HALVES = 1e-6  # of the clearance: far below the amplitude at which doubled cycles are looked for


class BranchRecorder:
    """Writes every accepted point of a branch, and ends the branch if a film is no longer physical.

    A branch of cycles of ``turns`` > 1 excitation periods also ends behind its own period doubling, beyond
    which the same cycles follow, shifted in time.  The shape of a cycle is computed once, in ``limit``, which
    the engine asks before it records a point.  ``resumed``: the stored branch that is resumed, of which
    event_kind is needed.
    """

    def __init__(
        self,
        machine: Machine,
        branch: Branch,
        case: Case,
        report_point: Callable[[BranchPoint, BranchState, tuple[Event, ...]], None],
        turns: int = 1,
        resumed: Group | None = None,
    ) -> None:
        self._machine, self._branch, self._case, self._report_point = machine, branch, case, report_point
        self._turns, self._first = turns, resumed is None
        self._repeats = resumed is not None and _has_own_doubling(resumed)
        self._shape: CycleShape | None = None

    def limit(self, point: BranchPoint) -> str | None:
        """A sentence if the point does not belong to the branch (see the class)."""
        if self._repeats:
            return "beyond its own period doubling the branch has the same cycles again, shifted in time"
        cycle = point.cycle
        self._shape = cycle_shape(
            self._machine, cycle.image.orbit, cycle.parameters, self._turns, snapshots=SNAPSHOTS
        )
        if self._first and self._turns > 1 and _halves_apart(self._shape.orbit) < _SAME_HALVES:
            return "the cycle beside the period doubling has half the period"
        return unphysical(self._shape, self._case.continue_cycles.minimum_film)

    def record(self, point: BranchPoint, state: BranchState, events: tuple[Event, ...]) -> None:
        """Commit the point that ``limit`` has just accepted, with the events that lead to it."""
        assert self._shape is not None
        self._first = False
        case, after = self._case, state.index - 1
        rows = [event_row(case, event, after) for event in events]
        rows += [unlocated_row(case, kind, point, after) for kind in point.unlocated]
        slots = {"basis": state.basis, "basis_columns": state.basis.shape[1]}
        self._branch.commit(point_row(case, point, state, self._shape), slots, rows)
        kinds = (*(event.kind for event in events), *point.unlocated)
        self._repeats = self._repeats or EventKind.OWN_PERIOD_DOUBLING in kinds
        self._report_point(point, state, events)


def _has_own_doubling(branch: Group) -> bool:
    own = KINDS["cycles"].array("event_kind").flag(EventKind.OWN_PERIOD_DOUBLING.name.lower())
    return bool(np.any(branch["event_kind"] == own))


def _halves_apart(orbit: Array) -> float:
    """Distance that the masters move in half a period: zero for a cycle of half the period."""
    return float(np.max(np.abs(orbit[0] - orbit[len(orbit) // 2])))


def point_row(case: Case, point: BranchPoint, state: BranchState, shape: CycleShape) -> dict[str, Any]:
    """One row of the group ``cycles`` of a case."""
    spectrum = point.cycle.spectrum
    return {
        **parameter_columns(case, point.cycle.parameters),
        "period": state.period,
        "state": state.state,
        "tangent": np.concatenate([state.tangent_state, [state.tangent_period, state.tangent_parameter]]),
        "step": state.step,
        "arclength": state.arclength,
        "direction": np.int8(state.tangent_parameter > 0.0),
        "multipliers": spectrum.multipliers,
        "multiplier_residual": spectrum.residuals,
        "multiplier_count": len(spectrum.multipliers),
        "unstable_count": point.unstable,
        "unexplained": np.int8(point.unexplained),
        "orbit": shape.orbit,
        "orbit_minimum": shape.minimum,
        "orbit_maximum": shape.maximum,
        "minimum_pressure": shape.lowest_pressure,
        "minimum_film": shape.film_trace.min(axis=0),
        "minimum_film_trace": shape.film_trace,
        "film_pressure": shape.pressure,
        "foil_displacement": shape.foil,
        "film_thickness": shape.thickness,
        "newton_iterations": point.iterations,
        "newton_history": np.array(point.residual_norms),
        "steps_per_period": state.steps,
        "step_error": state.step_error,
        "coarser_error": state.coarser_error,
    }


def event_row(case: Case, event: Event, after_point: int) -> dict[str, Any]:
    """One located bifurcation."""
    cycles = KINDS["cycles"]
    return {
        "event_kind": np.int8(cycles.array("event_kind").flag(event.kind.name.lower())),
        "event_after_point": after_point,
        **parameter_columns(case, event.parameters, "event_"),
        "event_period": event.period,
        "event_state": event.state,
        "event_multipliers": event.multipliers,
        "event_angle": event.angle,
        "event_transversality": event.transversality,
        "event_resonance": np.int8(cycles.array("event_resonance").flag(_resonance_name(event))),
        "event_residual": event.residual,
    }


def _resonance_name(event: Event) -> str:
    return "none" if event.resonance.value == 0 else event.resonance.name


def unlocated_row(case: Case, kind: EventKind, point: BranchPoint, after_point: int) -> dict[str, Any]:
    """A bifurcation that was detected before a point but not located: the point's values, no residual."""
    cycles, unknowns = KINDS["cycles"], point.cycle.unknowns
    return {
        "event_kind": np.int8(cycles.array("event_kind").flag(kind.name.lower())),
        "event_after_point": after_point,
        **parameter_columns(case, point.cycle.parameters, "event_"),
        "event_period": unknowns.period,
        "event_state": unknowns.state,
        "event_multipliers": point.cycle.spectrum.multipliers,
        "event_angle": np.nan,
        "event_transversality": np.nan,
        "event_resonance": np.int8(cycles.array("event_resonance").flag("none")),
        "event_residual": np.nan,
    }


def stored_event(branch: Group, index: int) -> Event:
    """A located bifurcation read from the store; ``branch`` needs the arrays ``EVENT_NAMES``."""
    arrays = branch.arrays
    multipliers = arrays["event_multipliers"][index]
    multipliers = multipliers[np.isfinite(multipliers)]
    angle = float(arrays["event_angle"][index])
    name = KINDS["cycles"].array("event_kind").flags[int(arrays["event_kind"][index])]
    after = min(int(arrays["event_after_point"][index]) + 1, branch.n_points - 1)
    return Event(
        kind=EventKind[name.upper()],
        parameters=stored_parameters(arrays, index, "event_"),
        state=np.array(arrays["event_state"][index]),
        period=float(arrays["event_period"][index]),
        multipliers=multipliers,
        critical=complex(np.exp(1j * angle)),
        angle=angle,
        transversality=float(arrays["event_transversality"][index]),
        resonance=Resonance(max(0, int(arrays["event_resonance"][index]))),
        residual=float(arrays["event_residual"][index]),
        fraction=float("nan"),
        steps=int(arrays["steps_per_period"][after]),
    )


# what a branch goes on from
RESUMED = ("state", "period", "tangent", "multipliers", "multiplier_count", "arclength")


def resumed_state(newest: Resume, rows: Mapping[str, Array], parameter: str) -> BranchState:
    """The state after the newest row; ``rows`` holds the arrays ``RESUMED`` and the parameter of all rows."""
    row = newest.row
    previous = max(0, newest.n_points - 2)
    known = int(rows["multiplier_count"][previous]) if newest.n_points > 1 else 0
    count, columns = int(row["multiplier_count"]), int(newest.slots["basis_columns"])
    tangent, before = row["tangent"], rows["tangent"][previous]
    return BranchState.from_arrays(
        {
            "index": newest.n_points - 1,
            "state": row["state"],
            "period": row["period"],
            "parameter": row[parameter],
            "tangent_state": tangent[:-2],
            "tangent_period": tangent[-2],
            "tangent_parameter": tangent[-1],
            "step": row["step"],
            "arclength": row["arclength"],
            "steps": row["steps_per_period"],
            "step_error": row["step_error"],
            "coarser_error": row["coarser_error"],
            "basis": newest.slots["basis"][:, :columns],
            "multipliers": row["multipliers"][:count],
            "previous_state": rows["state"][previous],
            "previous_period": rows["period"][previous],
            "previous_parameter": rows[parameter][previous],
            "previous_tangent_state": before[:-2],
            "previous_tangent_period": before[-2],
            "previous_tangent_parameter": before[-1],
            "previous_multipliers": rows["multipliers"][previous][:known],
            "previous_arclength": rows["arclength"][previous],
            "start_state": rows["state"][0],
            "start_period": rows["period"][0],
            "start_parameter": rows[parameter][0],
        }
    )
