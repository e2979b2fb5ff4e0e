"""The machine as a dynamical system, and its cycles in engineering terms: orbits, film, response envelope."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from pipelines.case.arrays import Array
from pipelines.case.scales import PARAMETERS
from pipelines.machine import film
from pipelines.machine.assembly import Machine
from pipelines.machine.rates import BEARINGS, machine_rates, machine_tangent
from pipelines.machine.shifted import factors_size, machine_factorise, machine_solve
from pipelines.orbits.system import DynamicalSystem, ShiftedSolver


def machine_system(machine: Machine, forced: bool = True) -> DynamicalSystem:
    """The machine for the period map.

    ``forced=False`` leaves the period unknown (rings at rest, self-excited whirl).
    """
    integers = [bearing.integers for bearing in machine.bearings]
    return DynamicalSystem(
        size=machine.size,
        rates=machine_rates,
        tangent=machine_tangent,
        parameter_names=PARAMETERS,
        forcing=film.EXCITATION_FREQUENCY if forced else None,
        constants=machine.constants,
        layout=machine.layout,
        work_size=machine.work_size,
        shifted=ShiftedSolver(
            machine_factorise, machine_solve, factors_size(machine.rotor_freedoms, integers)
        ),
    )


@dataclass(frozen=True)
class CycleShape:
    """A cycle in engineering terms.

    Film quantities are in units of each bearing's clearance and of the ambient pressure.
    """

    orbit: Array
    """Coordinates of the master nodes, shape (samples, coordinates)."""
    minimum: Array
    """Smallest value of every coordinate over the period, shape (coordinates,)."""
    maximum: Array
    """Largest value, same shape."""
    film_trace: Array
    """Smallest film thickness along the period, shape (samples, bearings)."""
    lowest_pressure: Array
    """Smallest pressure anywhere on the orbit, shape (bearings,)."""
    pressure: Array
    """Axial mean of the pressure, shape (snapshots, bearings, theta)."""
    foil: Array
    """Foil displacement, same shape."""
    thickness: Array
    """Film thickness, same shape."""


def cycle_shape(
    machine: Machine, orbit: Array, parameters: Array, period_multiple: int = 1, snapshots: int = 8
) -> CycleShape:
    """Describe an orbit (samples, N or more) given at equal fractions of the period.

    The period is ``period_multiple`` forcing periods long.
    """
    extended, oscillator = orbit.shape[1] > machine.size, orbit[:, machine.size :]
    orbit = np.ascontiguousarray(orbit[:, : machine.size])
    samples = orbit.shape[0]
    phases = 2.0 * np.pi * period_multiple * np.arange(samples) / samples
    if extended:  # the oscillator of Eq. 17 is (sin, cos) of the phase
        phases = np.arctan2(oscillator[:, 0], oscillator[:, 1])
    trace = np.array(
        [machine.minimum_film(phase, state, parameters) for phase, state in zip(phases, orbit, strict=True)]
    )
    masters = machine.masters(orbit)
    nodes = max(bearing.settings.nodes for bearing in machine.bearings)
    pressure, foil, thickness = (np.full((snapshots, BEARINGS, nodes), np.nan) for _ in range(3))
    for row in range(snapshots):
        sample = row * samples // snapshots
        for index, bearing in enumerate(machine.bearings):
            own = slice(0, bearing.settings.nodes)
            state = machine.film(index, phases[sample], orbit[sample], parameters)
            gauge = bearing.mean_weights @ (state.padded_pressure[:, 1:-1] - 1.0)
            pressure[row, index, own] = 1.0 + gauge
            thickness[row, index, own] = state.thickness[1:-1]
            foil[row, index, own] = orbit[sample, machine.film_unknowns(index)][-bearing.settings.nodes :]
    lowest = np.array([machine.pressures(orbit, index).min() for index in range(BEARINGS)])
    extremes = masters.min(axis=0), masters.max(axis=0)
    return CycleShape(masters, *extremes, trace, lowest, pressure, foil, thickness)


def unphysical(shape: CycleShape, minimum_film: float) -> str | None:
    """Why a cycle is not physical, in a sentence: a film too thin, or a pressure below vacuum."""
    thickness, pressure = shape.film_trace.min(axis=0), shape.lowest_pressure
    thin, low = int(np.argmin(thickness)), int(np.argmin(pressure))
    if thickness[thin] < minimum_film:
        return (
            f"the journal touches the foil of bearing {thin + 1}: its film shrinks to {thickness[thin]:.3g} "
            f"of the clearance (limit {minimum_film:g}); "
            "lower the excitation or the load, or the limit continue_cycles.minimum_film"
        )
    if pressure[low] <= 0.0:
        return (
            f"the pressure in bearing {low + 1} falls below vacuum ({pressure[low]:.3g} of ambient): "
            "the film grid does not resolve it; raise numerics.circumferential"
        )
    return None
