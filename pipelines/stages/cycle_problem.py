"""From a case to the continuation problem of its cycles."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray

from pipelines.bifurcations.branch import ContinuationOptions
from pipelines.bifurcations.detection import DetectionOptions
from pipelines.case.models import PARAMETERS, Case
from pipelines.machine import film
from pipelines.machine.assembly import Machine, parameter_vector
from pipelines.orbits.floquet import BasisOptions
from pipelines.orbits.machine_cycles import machine_system
from pipelines.orbits.period_map import Formulation, PeriodMap
from pipelines.orbits.shooting import CycleProblem, ShootingOptions
from pipelines.orbits.steppers import steppers

Array = NDArray[np.float64]

ORBIT_SAMPLES = 64
INITIAL_COLUMNS = 23  # and the parameter column: three lines of eight
BUFFER_COLUMNS = 7
PICARD_TOLERANCE = 1e-2  # of a predictor and a Newton update; a pass with two columns is nearly a whole one


def cycle_problem(machine: Machine, case: Case, fixed: Mapping[str, float] | None = None) -> CycleProblem:
    """The cycles of a case along the parameter that is continued, at the value where the branch starts.

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
        step_tolerance=numerics.multiplier_tolerance,
        basis=basis,
    )
    return CycleProblem(period_map, parameters, table.parameter, options)


def is_self_excited(case: Case) -> bool:
    """Whether the cycles are those of the passive machine, whose period is its own."""
    table = case.continue_cycles
    return (
        table.formulation == "autonomous"
        and case.excitation.displacement == 0.0
        and table.parameter != "displacement"
    )


def continuation_options(case: Case, direction: int) -> ContinuationOptions:
    """Options of the arclength continuation; foil stiffnesses count relative to the first one."""
    table = case.continue_cycles
    start = parameter_vector(case)[film.FOIL_STIFFNESS] if table.start is None else table.start
    return ContinuationOptions(
        range=table.range,
        direction=direction,
        step=table.step,
        minimum_step=table.minimum_step,
        maximum_step=table.maximum_step,
        max_points=table.max_points,
        parameter_scale=float(start) if table.parameter == "foil_stiffness" else 1.0,
        detection=DetectionOptions(event_tolerance=0.01 * case.numerics.event_tolerance),
    )
