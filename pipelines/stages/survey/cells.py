"""A cycle of the machine found alone: its problem, the machine at rest, its bifurcation and its film."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from pipelines.case.arrays import Array
from pipelines.case.models import Case
from pipelines.machine.assembly import Machine
from pipelines.machine.extremes import FILM, LOW_PRESSURE, OBSERVED, machine_extremes
from pipelines.machine.rates import BEARINGS
from pipelines.orbits.equilibria.equilibrium import MEAN_PHASE, Equilibrium, at_rest
from pipelines.orbits.harmonic_balance import RestingSystem
from pipelines.orbits.machine_cycles import machine_system
from pipelines.orbits.period_map import PeriodMap
from pipelines.orbits.shooting import Cycle, CycleProblem, ShootingOptions
from pipelines.orbits.steppers import steppers

SAMPLES = 32  # of an orbit, at which the film is looked at
NEWTON_SHARE = 0.01  # of the tolerated miss: what Newton's method leaves
PICARD_TOLERANCE = 1e-2
MULTIPLIER_SHARE = 0.2  # of the tolerated error: what the subspace iteration leaves
CHECKED_MODULUS = 0.3
REAL = 1e-6  # imaginary part, relative to the modulus, below which a multiplier is taken as real


def forced_cycles(
    machine: Machine, case: Case, parameters: Array, miss: float, multiplier_tolerance: float
) -> CycleProblem:
    """The cycles of a machine with moving rings, at ``parameters``.

    ``miss``: tolerance of a cycle by harmonic balance; ``multiplier_tolerance``: of the time steps.
    """
    period_map = PeriodMap(
        machine_system(machine),
        stepper=steppers()[case.numerics.stepper],
        samples=SAMPLES,
        steps_per_period=case.numerics.steps_per_period,
    )
    options = ShootingOptions(
        tolerance=NEWTON_SHARE * miss,
        iterations=case.numerics.newton_iterations,
        picard_tolerance=PICARD_TOLERANCE,
        multiplier_tolerance=MULTIPLIER_SHARE * multiplier_tolerance,
        checked_modulus=CHECKED_MODULUS,
        step_tolerance=multiplier_tolerance,
    )
    return CycleProblem(period_map, parameters, "speed", options)


def resting_system(machine: Machine, equilibrium: Equilibrium, parameters: Array) -> RestingSystem:
    """The machine about an equilibrium."""
    jacobian = machine.jacobian(MEAN_PHASE, equilibrium.state, at_rest(parameters))
    return RestingSystem.of(equilibrium.state, jacobian.toarray())


def bifurcation_of(multiplier: complex) -> str:
    """The bifurcation at which a multiplier passes the unit circle."""
    if abs(multiplier.imag) > REAL * abs(multiplier):
        return "neimark_sacker"
    return "fold" if multiplier.real > 0.0 else "period_doubling"


def nearest_to_circle(multipliers: NDArray[np.complex128]) -> complex:
    """The multiplier with the smallest |ln|mu||, with an imaginary part that is not negative."""
    with np.errstate(divide="ignore"):
        nearest = complex(multipliers[np.argmin(np.abs(np.log(np.abs(multipliers))))])
    return complex(nearest.real, abs(nearest.imag))


def film_status(machine: Machine, cycle: Cycle, minimum_film: float) -> tuple[str, float]:
    """Whether a cycle can be, in the words of the array ``status``, and its smallest film."""
    orbit, out, work = cycle.image.orbit, np.empty(OBSERVED), np.empty(machine.work_size)
    smallest = np.full((OBSERVED // BEARINGS, BEARINGS), np.inf)
    for sample, state in enumerate(orbit):
        phase = 2.0 * math.pi * sample / len(orbit)
        machine_extremes(phase, state, cycle.parameters, machine.constants, machine.layout, work, out)
        smallest = np.minimum(smallest, out.reshape(smallest.shape))
    thinnest = float(smallest[FILM].min())
    if smallest[LOW_PRESSURE].min() <= 0.0:
        return "below_vacuum", thinnest
    return ("thin_film" if thinnest < minimum_film else "found"), thinnest
