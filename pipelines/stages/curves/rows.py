"""Points of bifurcation curves as rows of a store, and the state read back from which a curve resumes."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pipelines.bifurcations.curve import CurvePoint, CurveState, SpecialKind, SpecialPoint, TongueSide
from pipelines.bifurcations.curves.codimension_two import unstable_others
from pipelines.bifurcations.curves.stored_curves import KnownCurve
from pipelines.bifurcations.detection import EventKind
from pipelines.bifurcations.plane import CurveProblem
from pipelines.case.arrays import Array
from pipelines.case.models import Case
from pipelines.datasets.branch import BranchWriter
from pipelines.datasets.records import Group, Resume
from pipelines.datasets.schema import KINDS
from pipelines.machine.assembly import Machine
from pipelines.machine.rates import BEARINGS
from pipelines.orbits.grazing import Graze, nearest_graze
from pipelines.orbits.machine_cycles import CycleShape, cycle_shape, unphysical
from pipelines.stages.parameter_columns import parameter_columns, stored_parameters

CONTAINERS: Mapping[EventKind, str] = {
    EventKind.PERIOD_DOUBLING: "pd",
    EventKind.NEIMARK_SACKER: "ns",
    EventKind.FOLD: "folds",
}
DIRECTION_NAMES = ("tangent", "normal", "gradient", "bend")  # of the array `directions`, in this order
# read by `traced`, with the free parameters
TRACED = ("parameter_tangent", "arclength", "state", "angle", "unstable_count")
# read by `stored_special`
SPECIAL_NAMES = tuple(array.name for array in KINDS["curve"].arrays if array.name.startswith("event_"))


def curve_sizes(machine: Machine, case: Case, problem: CurveProblem) -> dict[str, int]:
    """Sizes of the dimensions of a curve's group."""
    size, columns = problem.period_map.size, problem.options.basis.maximum_columns
    return {
        "point": case.track_curves.max_points,
        "component": size,
        "extended": size + 3,
        "augmented": size + 1,
        "direction": len(DIRECTION_NAMES),
        "side": 2,
        "free": 2,
        "special": len(SpecialKind),
        "multiplier": columns,
        "column": columns,
        "coordinate": machine.rotor_freedoms,
        "bearing": BEARINGS,
        # a correction, and a second one where the time steps are refined
        "iteration": 2 * (problem.options.iterations + 1),
    }


class CurveRecorder:
    """Writes every accepted point of a curve, and stops the curve where a film is no longer physical.

    Both need the shape of the cycle. ``limit``, which the continuation calls first, computes it.
    """

    def __init__(
        self,
        machine: Machine,
        problem: CurveProblem,
        curve: BranchWriter,
        case: Case,
        report_point: Callable[[CurvePoint, CurveState, tuple[SpecialPoint, ...]], None],
    ) -> None:
        self._machine, self._problem, self._curve = machine, problem, curve
        self._case, self._report_point = case, report_point
        self._shape: CycleShape | None = None
        self._graze: Graze | None = None

    def limit(self, point: CurvePoint) -> str | None:
        """The reason why a point is not physical: a film too thin, or a pressure below vacuum; else None."""
        cycle = point.cycle
        multiple = self._problem.period_map.period_multiple
        self._shape = cycle_shape(self._machine, cycle.image.orbit, cycle.parameters, multiple, snapshots=0)
        self._graze = nearest_graze(self._machine, cycle.image.orbit, multiple)
        return unphysical(self._shape, self._case.continue_cycles.minimum_film)

    def record(self, point: CurvePoint, state: CurveState, specials: tuple[SpecialPoint, ...]) -> None:
        """Commit the point last given to ``limit``, and the codimension-two points just before it."""
        assert self._shape is not None
        case, after = self._case, state.index - 1
        rows = [special_row(case, special, after) for special in specials]
        rows += [_unlocated_row(case, kind, point, after) for kind in point.unlocated]
        autonomous = self._problem.period_map.autonomous
        row = point_row(case, point, state, self._shape, autonomous) | _graze_columns(self._graze)
        self._curve.commit(row, _slots(state), rows)
        self._report_point(point, state, specials)


def point_row(
    case: Case, point: CurvePoint, state: CurveState, shape: CycleShape, autonomous: bool
) -> dict[str, Any]:
    """One row of a group of kind ``curve`` of a case."""
    spectrum, form = point.cycle.spectrum, point.normal_form
    return {
        **parameter_columns(case, point.cycle.parameters),
        "period": state.period,
        "state": state.state,
        "parameter_tangent": state.tangent_parameters,
        "step": state.step,
        "arclength": state.arclength,
        "angle": point.angle,
        "kappa": state.cos_theta,
        "kappa_slope": state.cos_theta_slope,
        "special_tests": state.tests,
        "multipliers": spectrum.multipliers,
        "multiplier_residual": spectrum.residuals,
        "multiplier_count": len(spectrum.multipliers),
        "unstable_count": unstable_others(point.kind, spectrum.multipliers, point.cos_theta, autonomous),
        "normal_form": complex(np.nan, np.nan) if form is None else form.coefficient,
        "normal_form_error": np.nan if form is None else form.error,
        "criticality": np.int8(_criticality(point)),
        "orbit_minimum": shape.minimum,
        "orbit_maximum": shape.maximum,
        "minimum_pressure": shape.lowest_pressure,
        "minimum_film": shape.film_trace.min(axis=0),
        "newton_iterations": point.iterations,
        "newton_history": np.array(point.residual_norms),
        "alignment": point.alignment,
        "steps_per_period": state.steps,
        "step_error": state.step_error,
        "coarser_error": state.coarser_error,
        "clipping_width": state.clipping_width,
        "width_effect": point.width_effect,
    }


def _graze_columns(graze: Graze | None) -> dict[str, Any]:
    """Where the film comes nearest to touching ambient pressure without slope."""
    if graze is None:
        graze = Graze(np.nan, -1, np.nan, np.nan)
    return {f"grazing_{name}": value for name, value in vars(graze).items()}


def _criticality(point: CurvePoint) -> int:
    """Flag of the criticality; unset for a fold, without a normal form, and where its sign is not certain."""
    form = point.normal_form
    if form is None or point.kind is EventKind.FOLD or not form.decided:
        return -1
    name = "supercritical" if form.supercritical else "subcritical"
    return KINDS["curve"].array("criticality").flag(name)


def _slots(state: CurveState) -> dict[str, Any]:
    """Arrays that are stored for the newest point only, since only the next step needs them."""
    directions = [getattr(state, name) for name in DIRECTION_NAMES]
    return {
        "directions": np.array([np.concatenate([d.state, [d.period], d.parameters]) for d in directions]),
        "critical_vectors": np.array(
            [np.append(state.right, state.right_period), np.append(state.left, state.left_phase)]
        ),
        "basis": state.basis,
        "basis_columns": state.basis.shape[1],
    }


def special_row(case: Case, special: SpecialPoint, after_point: int) -> dict[str, Any]:
    """One located codimension-two point as a row."""
    return _event_row(
        case, special.kind, special.parameters, special.state, special.period, special.multipliers,
        after_point, angle=float(np.arccos(np.clip(special.cos_theta, -1.0, 1.0))), residual=special.residual,
        tongue=special.tongue, width=special.width,
    )  # fmt: skip


def _unlocated_row(case: Case, kind: SpecialKind, point: CurvePoint, after_point: int) -> dict[str, Any]:
    """A codimension-two point that was detected but not located, with the values of the point after it."""
    cycle = point.cycle
    return _event_row(
        case, kind, cycle.parameters, cycle.unknowns.state, cycle.unknowns.period, cycle.spectrum.multipliers,
        after_point, angle=point.angle, residual=np.nan,
    )  # fmt: skip


def _event_row(
    case: Case,
    kind: SpecialKind,
    parameters: Array,
    state: Array,
    period: float,
    multipliers: NDArray[np.complex128],
    after_point: int,
    angle: float,
    residual: float,
    tongue: TongueSide | None = None,
    width: float = np.nan,
) -> dict[str, Any]:
    flags = KINDS["curve"].array("event_kind").flags
    return {
        "event_kind": np.int8([flag.lower() for flag in flags].index(kind.name.lower())),
        "event_after_point": after_point,
        **parameter_columns(case, parameters, "event_"),
        "event_period": period,
        "event_state": state,
        "event_multipliers": multipliers,
        "event_angle": angle,
        "event_residual": residual,
        "event_tongue": np.int8(-1 if tongue is None else tongue),
        "event_width": width,
    }


def special_labels(curve: Group) -> list[str]:
    """What the codimension-two points of a curve are, from its event_kind and event_tongue."""
    pairs = zip(curve.labels("event_kind").tolist(), curve.labels("event_tongue").tolist(), strict=True)
    return ["unresolved tongue" if side == "unresolved" else kind.replace("_", " ") for kind, side in pairs]


def stored_special(curve: Group, index: int) -> SpecialPoint:
    """A located codimension-two point read back; ``curve`` must have its arrays ``SPECIAL_NAMES``."""
    arrays = curve.arrays
    tongue = int(arrays["event_tongue"][index])
    name = KINDS["curve"].array("event_kind").flags[int(arrays["event_kind"][index])]
    multipliers = arrays["event_multipliers"][index]
    return SpecialPoint(
        kind=SpecialKind[name.upper()],
        parameters=stored_parameters(arrays, index, "event_"),
        state=np.array(arrays["event_state"][index]),
        period=float(arrays["event_period"][index]),
        multipliers=multipliers[np.isfinite(multipliers)],
        cos_theta=float(np.cos(arrays["event_angle"][index])),
        residual=float(arrays["event_residual"][index]),
        fraction=float("nan"),
        steps=-1,
        tongue=None if tongue < 0 else TongueSide(tongue),
        width=float(arrays["event_width"][index]) if "event_width" in arrays else float("nan"),
    )


def traced(curve: Group, names: tuple[str, str]) -> KnownCurve:
    """A stored curve, to test which bifurcations lie on it; needs the arrays ``TRACED`` and ``names``."""
    parameters = np.column_stack([curve[name] for name in names])
    return KnownCurve(
        parameters,
        curve["parameter_tangent"],
        curve["arclength"],
        curve["state"],
        curve["angle"],
        curve["unstable_count"].astype(float),
    )


RESUMED = (*TRACED, "period", "special_tests")  # read by `resumed_state`, with the free parameters


def resumed_state(newest: Resume, rows: Mapping[str, Array], names: tuple[str, str]) -> CurveState:
    """The state after the newest row; ``rows`` holds the arrays ``RESUMED`` and ``names`` of all rows."""
    row, slots = newest.row, newest.slots
    previous = max(0, newest.n_points - 2)
    tests = rows["special_tests"][previous]
    size = len(row["state"])
    arrays: dict[str, Any] = {name: row[name] for name in ("state", "period", "step", "arclength")}
    arrays |= {"cos_theta": row["kappa"], "cos_theta_slope": row["kappa_slope"]}
    for name, direction in zip(DIRECTION_NAMES, slots["directions"], strict=True):
        arrays |= {
            f"{name}_state": direction[:size],
            f"{name}_period": direction[size],
            f"{name}_parameters": direction[size + 1 :],
        }
    (right, left), columns = slots["critical_vectors"], int(slots["basis_columns"])
    arrays |= {
        "index": newest.n_points - 1,
        "parameters": [row[name] for name in names],
        "right": right[:-1],
        "right_period": right[-1],
        "left": left[:-1],
        "left_phase": left[-1],
        "tests": row["special_tests"],
        "previous_tests": tests if newest.n_points > 1 else np.full_like(tests, np.nan),
        "previous_arclength": rows["arclength"][previous],
        "steps": row["steps_per_period"],
        "step_error": row["step_error"],
        "coarser_error": row["coarser_error"],
        "clipping_width": row["clipping_width"],
        "basis": slots["basis"][:, :columns],
        "start_state": rows["state"][0],
        "start_period": rows["period"][0],
        "start_parameters": [rows[name][0] for name in names],
    }
    return CurveState.from_arrays(arrays)
