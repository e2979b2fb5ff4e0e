"""Estimate the duration of a case: a few pieces of its work, timed on its own machine and grid.

What a piece takes is measured; how many of them a point takes is not known before: each ``PASSES_PER_...``,
here and in `pipelines.stages.pass_counts`, is what was counted on finished branches.  An estimate is good to
a factor of two or three; that branches end before `max_points` makes it too long rather than too short.
"""

from __future__ import annotations

import math
import time
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from pipelines.case.models import Case
from pipelines.case.survey_settings import survey_axes
from pipelines.case.torus_settings import FEWEST_ANGLES
from pipelines.machine import film
from pipelines.machine.assembly import Machine, build_machine, parameter_vector
from pipelines.orbits.equilibria.bearing_coefficients import machine_coefficients
from pipelines.orbits.equilibria.campbell import campbell_diagram
from pipelines.orbits.equilibria.equilibrium import Equilibrium, machine_equilibrium
from pipelines.orbits.equilibria.linear import at_speed, linear_point
from pipelines.orbits.shooting import CycleProblem, NewtonStop, Unknowns, first_basis
from pipelines.orbits.steppers import ImplicitStepper
from pipelines.orbits.time_steps import MOST_STEPS, first_steps, required_steps_at, steps_stable_at
from pipelines.stages.cycles.problem import INITIAL_COLUMNS, cycle_problem
from pipelines.stages.linear.along_speed import reference_parameters
from pipelines.stages.pass_counts import PASSES_PER_CELL, PASSES_PER_CYCLE, passes_per_curve_point
from pipelines.stages.refinement.levels import case_on, grid_family

PASSES_PER_LEVEL = 30  # of a refined bifurcation, on one of its grids
PASSES_PER_ANGLE = 15  # of a torus, its corrections and its stability
_MEASURED_STEPS = 256  # of an explicit stepper at most
_TRIALS = 3  # the first may load kernels, and others share the machine


@dataclass
class Durations:
    """Times [s] of one point of each kind, measured once for all cases of the same rotor and grid.

    None where the machine has no equilibrium to measure at.
    """

    _known: dict[Any, float | None] = field(default_factory=dict)

    def of_equilibrium(self, case: Case) -> float | None:
        """One speed of `agfb linearize`."""
        return self._once(case, _equilibrium)

    def of_coefficients(self, case: Case) -> float | None:
        """One speed of `agfb coefficients`."""
        once = self._once(case, _whirl_frequency)
        return None if once is None else case.coefficients.frequencies * once

    def of_campbell_speed(self, case: Case) -> float | None:
        """One speed of `agfb criticals`, its part of the unbalance response included."""
        return self._once(case, _campbell_speed)

    def of_pass(self, case: Case) -> float | None:
        """A pass over the period with all tangents."""
        return self._once(case, _pass)

    def of_cycle(self, case: Case) -> float | None:
        """One point of a branch of cycles."""
        once = self._once(case, _pass)
        return None if once is None else PASSES_PER_CYCLE * once

    def of_curve_point(self, case: Case) -> float | None:
        """One point of a curve of bifurcations."""
        once = self._once(case, _pass)
        return None if once is None else passes_per_curve_point(case) * once

    def of_survey_line(self, case: Case) -> float | None:
        """One line of a survey."""
        once = self._once(case, _pass)
        cells = survey_axes(case.survey, case.track_curves)[0].points
        return None if once is None else PASSES_PER_CELL * cells * once

    def of_refined_point(self, case: Case) -> float | None:
        """One bifurcation on all grids of `agfb ... --refine`."""
        levels = [case_on(case, grid) for grid in grid_family(case)]
        passes = [self._once(level, _pass) for level in levels if level is not None]
        return None if None in passes else PASSES_PER_LEVEL * sum(each for each in passes if each is not None)

    def of_torus(self, case: Case) -> float | None:
        """One point of a branch of tori with the fewest angles."""
        once = self._once(case, _pass)
        return None if once is None else PASSES_PER_ANGLE * FEWEST_ANGLES * once

    def _once(self, case: Case, measure: Callable[[Machine, Case], float | None]) -> float | None:
        grid = [(bearing.film, bearing.clipping) for bearing in case.bearings]
        key = (measure, repr((case.numerics, case.rotor, grid)))
        if key not in self._known:
            self._known[key] = measure(build_machine(case), case)
        return self._known[key]


def _equilibrium(machine: Machine, case: Case) -> float | None:
    """Time of two speeds at the upper end of the range; the first one also loads the kernels."""
    table = case.linearize
    parameters = reference_parameters(case, table.ring)
    high = table.speed_range[1]
    first = linear_point(machine, at_speed(parameters, high), table.eigenvalues)
    if isinstance(first, Equilibrium):
        return None
    begin = time.perf_counter()
    linear_point(machine, at_speed(parameters, 0.97 * high), table.eigenvalues, first.equilibrium.state)
    return time.perf_counter() - begin


def _whirl_frequency(machine: Machine, case: Case) -> float | None:
    """Time of the coefficients at one whirl frequency; the first call may load kernels."""
    parameters = reference_parameters(case, case.coefficients.ring)
    equilibrium = machine_equilibrium(machine, parameters)
    if not equilibrium.converged:
        return None
    spent = math.inf
    for _ in range(_TRIALS):
        begin = time.perf_counter()
        machine_coefficients(machine, parameters, equilibrium.state, parameters[film.SPEED : film.SPEED + 1])
        spent = min(spent, time.perf_counter() - begin)
    return spent


def _campbell_speed(machine: Machine, case: Case) -> float | None:
    speeds = np.array([case.criticals.speed_range[1]])
    for _ in range(2):
        begin = time.perf_counter()
        if campbell_diagram(machine, parameter_vector(case), speeds).missing:
            return None
    return time.perf_counter() - begin


def _pass(machine: Machine, case: Case) -> float | None:
    """All tangents over one period, with the number of steps that a cycle near the equilibrium requires."""
    problem = cycle_problem(machine, case)
    period_map, parameters = problem.period_map, problem.parameters
    found = machine_equilibrium(machine, parameters)
    if not found.converged:
        return None
    state, period = period_map.extend(found.state), _period(problem)
    guess = problem.consistent(Unknowns(state, period, float(parameters[problem.index])))
    if isinstance(period_map.stepper, ImplicitStepper):
        steps = first_steps(problem, guess)
        assert not isinstance(steps, NewtonStop)  # only explicit steppers are too stiff
        basis = first_basis(problem, guess, steps)
        image = period_map.evaluate(state, parameters, period, steps, basis)
        required = required_steps_at(period_map, problem.options, basis, image).steps
    else:  # a pass with the steps that stability requires may take minutes: a share of them is timed
        required = steps_stable_at(problem, guess)
        if required > MOST_STEPS:
            return None
        steps = period_map.rounded_steps(min(required, _MEASURED_STEPS))
        basis = np.eye(period_map.size, min(INITIAL_COLUMNS, period_map.size))
    seconds = []
    for _ in range(_TRIALS):
        begin = time.perf_counter()
        period_map.evaluate(state, parameters, period, steps, basis)
        seconds.append(time.perf_counter() - begin)
    return min(seconds) * required / steps


def _period(problem: CycleProblem) -> float:
    """Period of the rings, or of whirl at half the speed if the rings rest."""
    if problem.period_map.system.forcing is not None:
        return problem.period_map.period(problem.parameters)
    return 4.0 * math.pi / float(problem.parameters[film.SPEED])
