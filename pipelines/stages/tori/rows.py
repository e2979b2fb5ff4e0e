"""Tori as rows of a store, and rows as the state that resumes a branch."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from pipelines.bifurcations.tori.circle_map import PeriodCircle
from pipelines.bifurcations.tori.events import TorusEvent
from pipelines.bifurcations.tori.fourier import amplitudes, angles, resampled
from pipelines.bifurcations.tori.problem import TorusUnknowns
from pipelines.bifurcations.tori.torus import TorusPoint, TorusState
from pipelines.case.arrays import Array
from pipelines.case.models import Case
from pipelines.case.scales import PARAMETERS
from pipelines.datasets.records import Branch, Resume
from pipelines.datasets.schema import KINDS
from pipelines.machine.assembly import Machine
from pipelines.machine.rates import BEARINGS
from pipelines.orbits.machine_cycles import CycleShape, cycle_shape, unphysical
from pipelines.orbits.steppers import ImplicitStepper
from pipelines.stages.job import coordinates
from pipelines.stages.parameter_columns import parameter_columns

CURVE_ANGLES = 129  # of the stored curves of the masters, and at least as many for the extremes of a torus


def torus_sizes(machine: Machine, case: Case) -> dict[str, int]:
    """Sizes of the dimensions of a branch of tori."""
    columns, most = case.numerics.max_columns, case.continue_tori.max_angles
    return {
        "point": case.continue_tori.max_points,
        "component": machine.size,
        "angle": most,
        "wave": most // 2 + 1,
        "multiplier": columns,
        "column": columns,
        "curve": CURVE_ANGLES,
        "coordinate": machine.rotor_freedoms,
        "bearing": BEARINGS,
    }


def static_arrays(case: Case) -> dict[str, Any]:
    """Coordinates of the group, written once."""
    return {"curve": angles(CURVE_ANGLES), **coordinates(case)}


@dataclass(frozen=True)
class TorusShape:
    """A torus in engineering terms, all displacements over clearance.

    ``orbits``: what ``cycle_shape`` tells, of many orbits one after the other that cover the torus;
    ``section`` (CURVE_ANGLES, coordinates): the invariant curve at the start of a period;
    ``whirl_frequency``; ``step_error``: of the images by the time steps, largest component.
    """

    orbits: CycleShape
    section: Array
    whirl_frequency: float
    step_error: float


def torus_shape(machine: Machine, circle: PeriodCircle, at: TorusUnknowns) -> TorusShape:
    """The shape of a torus from a pass from each of its angles, and one with half of the steps."""
    images, orbits = _passes(circle, at, circle.steps)
    count, samples, size = orbits.shape
    parameters, multiple = circle.parameters_at(at.parameter), circle.period_map.period_multiple
    shape = cycle_shape(
        machine,
        orbits.reshape(count * samples, size),
        parameters[: len(PARAMETERS)],
        multiple * count,
        snapshots=0,
    )
    masters = shape.orbit.reshape(count, samples, -1)
    return TorusShape(
        _between_angles(shape, count),
        resampled(masters[:, 0], CURVE_ANGLES),
        abs(whirl_turn(masters, at.rotation)) / circle.period_map.period(parameters),
        _step_error(circle, at, images),
    )


def _between_angles(shape: CycleShape, count: int) -> CycleShape:
    """The shape with orbits between those from ``count`` angles, so that no extreme is missed."""
    orbits, films = (
        resampled(values.reshape(count, -1, values.shape[1]), max(count, CURVE_ANGLES)).reshape(
            -1, values.shape[1]
        )
        for values in (shape.orbit, shape.film_trace)
    )
    return replace(
        shape, orbit=orbits, minimum=orbits.min(axis=0), maximum=orbits.max(axis=0), film_trace=films
    )


def _passes(circle: PeriodCircle, at: TorusUnknowns, steps: int) -> tuple[Array, Array]:
    """Images (M, N) and orbits (M, samples, N) over a period from all angles."""
    period_map = circle.period_map
    period = period_map.period(circle.parameters_at(at.parameter))
    passes = [
        period_map.evaluate(state, circle.parameters_at(at.parameter, float(angle)), period, steps)
        for angle, state in zip(angles(len(at.states)), at.states, strict=True)
    ]
    return np.array([one.state for one in passes]), np.array([one.orbit for one in passes])


def _step_error(circle: PeriodCircle, at: TorusUnknowns, images: Array) -> float:
    """Error of the images with n steps of order p: |x_n - x_{n/2}| / (2^p - 1).

    NaN for an explicit stepper, whose steps follow from stability.
    """
    stepper = circle.period_map.stepper
    if not isinstance(stepper, ImplicitStepper):
        return math.nan
    half = max(1, circle.steps // 2)
    change = np.max(np.abs(images - _passes(circle, at, half)[0]))
    return float(change / ((circle.steps / half) ** stepper.order - 1.0))


def whirl_turn(masters: Array, rotation: float) -> float:
    """The rotation rho + 2 pi k [rad per period], with the integer k for which the motion is strongest.

    ``masters`` (M, samples, coordinates) at the phases 2 pi s/S.

    The first wave of the second angle is c(phase) exp(i theta) with c(2 pi) = exp(i rho) c(0), so that
    c exp(-i rho phase/2 pi) has a Fourier series, with a wave for every k.
    """
    samples = masters.shape[1]
    first = np.fft.fft(masters, axis=0)[1]
    carried = first * np.exp(-1j * rotation * np.arange(samples) / samples)[:, None]
    power = np.sum(np.abs(np.fft.fft(carried, axis=0)) ** 2, axis=1)
    strongest = int(np.argmax(power))
    return rotation + 2.0 * math.pi * (strongest - samples if 2 * strongest > samples else strongest)


class TorusRecorder:
    """Writes every accepted torus of a branch, and stops the branch if a film is no longer physical.

    The shape of a torus is needed by both and computed once, in ``limit``, which the engine asks first.
    """

    def __init__(
        self,
        machine: Machine,
        circle: PeriodCircle,
        branch: Branch,
        case: Case,
        report_point: Callable[[TorusPoint, TorusState, tuple[TorusEvent, ...]], None],
    ) -> None:
        self._machine, self._circle, self._branch = machine, circle, branch
        self._case, self._report_point = case, report_point
        self._shape: TorusShape | None = None

    def limit(self, point: TorusPoint) -> str | None:
        """A sentence if the torus is not physical: a film too thin, or a pressure below vacuum."""
        self._shape = torus_shape(self._machine, self._circle, point.torus.unknowns)
        return unphysical(self._shape.orbits, self._case.continue_cycles.minimum_film)

    def record(self, point: TorusPoint, state: TorusState, events: tuple[TorusEvent, ...]) -> None:
        """Commit the torus that ``limit`` has just accepted, with the bifurcations that lead to it."""
        assert self._shape is not None
        row = point_row(self._case, self._circle, point, state, self._shape)
        found = [event_row(self._case, self._circle, event, state) for event in events]
        self._branch.commit(row, _slots(state), found)
        self._report_point(point, state, events)


def point_row(
    case: Case, circle: PeriodCircle, point: TorusPoint, state: TorusState, shape: TorusShape
) -> dict[str, Any]:
    """One row of the group ``tori`` of a case."""
    parameters, at = circle.parameters_at(state.parameter), point.torus.unknowns
    scale = max(1.0, float(np.max(np.abs(at.states))))
    return {
        **parameter_columns(case, parameters[: len(PARAMETERS)]),
        "period": circle.period_map.period(parameters),
        "rotation": state.rotation,
        "whirl_frequency": shape.whirl_frequency,
        "section": state.states,
        "angle_count": len(state.states),
        "amplitudes": amplitudes(at.states),
        "tail": scale * point.torus.error,
        "residual": scale * point.torus.residual,
        "step": state.step,
        "arclength": state.arclength,
        "direction": np.int8(state.tangent_parameter > 0.0),
        "moduli": point.spectrum.moduli,
        "unstable_count": state.unstable,
        "spectrum": np.int8(point.spectrum.complete),
        "section_curve": shape.section,
        "orbit_minimum": shape.orbits.minimum,
        "orbit_maximum": shape.orbits.maximum,
        "minimum_pressure": shape.orbits.lowest_pressure,
        "minimum_film": shape.orbits.film_trace.min(axis=0),
        "newton_iterations": point.iterations,
        "steps_per_period": circle.steps,
        "step_error": shape.step_error,
    }


def event_row(case: Case, circle: PeriodCircle, event: TorusEvent, state: TorusState) -> dict[str, Any]:
    """A bifurcation between the point before ``state`` and its own."""
    spec, at = KINDS["tori"], event.unknowns
    return {
        "event_kind": np.int8(spec.array("event_kind").flag(event.kind.name.lower())),
        "event_after_point": state.index - 1,
        "event_arclength": event.arclength,
        **parameter_columns(case, circle.parameters_at(at.parameter)[: len(PARAMETERS)], "event_"),
        "event_rotation": at.rotation,
        "event_section": at.states,
        "event_angle_count": len(at.states),
        "event_moduli": event.moduli,
        "event_stability": np.int8(_stability_change(event)),
        "event_residual": event.residual,
    }


def _stability_change(event: TorusEvent) -> int:
    """Flag of what the torus does; unset where the numbers of unstable multipliers do not tell it."""
    if event.destabilises is None:
        return -1
    return KINDS["tori"].array("event_stability").flag("lost" if event.destabilises else "gained")


def _slots(state: TorusState) -> dict[str, Any]:
    """Data that only the step after the newest point needs."""
    return {
        "tangent": state.tangent_states,
        "tangent_rotation": state.tangent_rotation,
        "tangent_parameter": state.tangent_parameter,
        "basis": state.bases,
        "basis_columns": state.bases.shape[2],
        "basis_leading": state.leading,
    }


def resumed_state(newest: Resume, parameter: str) -> TorusState:
    """The state after the newest row."""
    row, slots = newest.row, newest.slots
    count, columns = int(row["angle_count"]), int(slots["basis_columns"])
    return TorusState.from_arrays(
        {
            "index": newest.n_points - 1,
            "states": row["section"][:count],
            "rotation": row["rotation"],
            "parameter": row[parameter],
            "tangent_states": slots["tangent"][:count],
            "tangent_rotation": slots["tangent_rotation"],
            "tangent_parameter": slots["tangent_parameter"],
            "step": row["step"],
            "arclength": row["arclength"],
            "bases": slots["basis"][:count, :, :columns],
            "leading": slots["basis_leading"],
            "moduli": row["moduli"][np.isfinite(row["moduli"])],
            "unstable": row["unstable_count"],
        }
    )
