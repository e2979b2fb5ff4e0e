"""Build the continuation problem of a case's cycles."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import replace
from functools import cache

from pipelines.bifurcations.branch import ContinuationOptions
from pipelines.bifurcations.detection import DetectionOptions
from pipelines.bifurcations.normal_forms.coefficients import NormalFormOptions
from pipelines.bifurcations.plane import Kinks
from pipelines.case.models import Case
from pipelines.case.scales import PARAMETERS
from pipelines.machine import film
from pipelines.machine.assembly import Machine, build_machine, parameter_vector
from pipelines.orbits.floquet import BasisOptions
from pipelines.orbits.grazing import nearest_graze
from pipelines.orbits.machine_cycles import machine_system
from pipelines.orbits.period_map import Formulation, PeriodMap
from pipelines.orbits.shooting import CycleProblem, ShootingOptions
from pipelines.orbits.steppers import steppers
from pipelines.orbits.system import DynamicalSystem, Matrix, Vector

ORBIT_SAMPLES = 64
INITIAL_COLUMNS = 23  # and the parameter column: three lines of eight
BUFFER_COLUMNS = 7
PICARD_TOLERANCE = 1e-2  # of a predictor and a Newton update
SHARE = 1e-3  # of what the time steps leave in the multipliers: asked of these and of the test functions,
SHARPEST, BLUNTEST = 1e-9, 1e-8  # but within these: where a resonance is found does not depend on it
EVENT_SHARE = 0.01  # of the tolerance in the parameter: that along the branch or curve

NORMAL_FORM = NormalFormOptions(difference=2.5e-4)  # stays inside the regularised clipping


def cycle_problem(machine: Machine, case: Case, fixed: Mapping[str, float] | None = None) -> CycleProblem:
    """The cycles of a case along the continued parameter, at the value where the branch starts.

    ``fixed``: other parameters at values that are not the case's own.
    """
    table, numerics = case.continue_cycles, case.numerics
    parameters = parameter_vector(case)
    for name, value in (fixed or {}).items():
        parameters[PARAMETERS.index(name)] = value
    if table.start is not None:
        parameters[PARAMETERS.index(table.parameter)] = table.start
    period_map = PeriodMap(
        machine_system(machine, forced=not is_self_excited(case)),
        stepper=steppers()[numerics.stepper],
        formulation=Formulation(table.formulation),
        samples=ORBIT_SAMPLES,
        steps_per_period=numerics.steps_per_period,
    )
    basis = BasisOptions(
        multiplier_cut=numerics.multiplier_cut,
        buffer=BUFFER_COLUMNS,
        initial_columns=min(INITIAL_COLUMNS, numerics.max_columns),
        maximum_columns=numerics.max_columns,
    )
    options = ShootingOptions(
        tolerance=numerics.newton_tolerance,
        iterations=numerics.newton_iterations,
        picard_tolerance=PICARD_TOLERANCE,
        multiplier_tolerance=min(max(SHARPEST, SHARE * numerics.multiplier_tolerance), BLUNTEST),
        step_tolerance=numerics.multiplier_tolerance,
        basis=basis,
    )
    return CycleProblem(period_map, parameters, table.parameter, options)


def is_clipped(case: Case) -> bool:
    """Whether the clipping of a bearing is Guembel's, so that the equations are only piecewise smooth."""
    return any(bearing.clipping == "gumbel" for bearing in case.bearings)


def smooth_maps(case: Case, period_map: PeriodMap, widths: Sequence[float]) -> tuple[PeriodMap, ...]:
    """The period map of a case with Guembel's clipping regularised over each of the ``widths``.

    The ``smooth_maps`` of a CurveProblem; none when the clipping of neither bearing is Guembel's.
    """
    return tuple(
        replace(period_map, system=_smooth_system(case, width)) for width in widths if is_clipped(case)
    )


def kinks_of(case: Case, machine: Machine, period_map: PeriodMap) -> Kinks | None:
    """How the curves of a case pass the kinks of Guembel's clipping; None without kinks or widths."""
    if not (is_clipped(case) and case.track_curves.clipping_widths):
        return None

    @cache
    def regularised(width: float) -> PeriodMap:
        return smooth_maps(case, period_map, (width,))[0]

    def distance(orbit: Matrix, parameters: Vector) -> float:
        graze = nearest_graze(machine, orbit, period_map.period_multiple)
        return math.inf if graze is None else abs(graze.gauge)

    return Kinks(regularised, case.track_curves.clipping_widths, distance)


def _smooth_system(case: Case, width: float) -> DynamicalSystem:
    smooth = {"clipping": "smooth", "smoothing": width}
    bearings = tuple(
        bearing.model_copy(update=smooth) if bearing.clipping == "gumbel" else bearing
        for bearing in case.bearings
    )
    machine = build_machine(case.model_copy(update={"bearings": bearings}))
    return machine_system(machine, forced=not is_self_excited(case))


def is_self_excited(case: Case) -> bool:
    """Whether the cycles are self-excited cycles of the passive machine, with unknown period."""
    table = case.continue_cycles
    return (
        table.formulation == "autonomous"
        and case.excitation.displacement == 0.0
        and table.parameter != "displacement"
    )


def parameter_scale(case: Case, name: str) -> float:
    """The change of a continued parameter that counts as one; for a foil stiffness the case's own value."""
    return float(parameter_vector(case)[film.FOIL_STIFFNESS]) if name == "foil_stiffness" else 1.0


def continuation_options(case: Case, direction: int) -> ContinuationOptions:
    """Options of the continuation; foil stiffnesses are relative to the one at the start."""
    table = case.continue_cycles
    scale = parameter_scale(case, table.parameter)
    if table.parameter == "foil_stiffness" and table.start is not None:
        scale = table.start
    return ContinuationOptions(
        range=table.range,
        direction=direction,
        step=table.step,
        minimum_step=table.minimum_step,
        maximum_step=table.maximum_step,
        max_points=table.max_points,
        parameter_scale=scale,
        detection=DetectionOptions(event_tolerance=EVENT_SHARE * case.numerics.event_tolerance),
    )
