"""What a solve of the shifted equations must compute, and how much of the machine's rates it reaches.

A multiply-add counts as two operations.  Two bounds: multiply-adds from registers alone, and multiply-adds
whose factor and line both come from the first-level cache, as every one of a solve does as it is written.
"""

from __future__ import annotations

import numpy as np
from numba import njit

from pipelines.machine.assembly import Machine, build_machine, parameter_vector
from pipelines.machine.lanes import LANES
from pipelines.machine.rates import BEARINGS
from pipelines.machine.shifted import FORCES, JOURNAL_COORDINATES, machine_factorise, machine_solve
from pipelines.orbits.machine_cycles import machine_system
from tests.benchmarks.measuring import Measurement
from tests.benchmarks.rates import cached_multiply_add_rate, multiply_add_rate, seconds_each
from tests.benchmarks.settings import SCHEME, Settings
from tests.machines import case

_SHIFT = 0.03  # about that of esdirk5 with fifty steps a period; the work does not depend on it


def film_multiply_adds(nodes: int, stations: int, *, periodic: bool, reach: int = 1) -> int:
    """Multiply-adds per column for one bearing."""
    rows, block = nodes * stations, stations**2
    seam = reach if periodic else 0
    chain = nodes - seam  # lines of the block banded part
    neighbours = sum(chain - distance for distance in range(1, reach + 1))
    elimination = (
        neighbours * block  # b_i <- b_i - M_{i,o} b_{i-o}
        + (chain + seam**2) * block  # D_i^-1 b_i, and the equations of the seam
        + neighbours * block  # U_{i,o} x_{i+o}
        + 2 * chain * seam * block  # W_i b_i and T_i x_seam
    )
    return (
        nodes  # b_q / (1 + shift r)
        + (2 * reach + 1) * rows  # what b_q at neighbouring angles adds to b
        + elimination
        + 2 * rows  # gas force, two directions
        + JOURNAL_COORDINATES * rows  # Z (dX, dY, dX', dY')
        + rows  # foil: the weighted mean of the stations' pressures
    )


def rotor_multiply_adds(freedoms: int) -> int:
    """Multiply-adds per column for the rotor and the closing system."""
    return (
        2 * freedoms**2  # v^ = S^-1 b_v - shift S^-1 M^-1 K b_x
        + FORCES * JOURNAL_COORDINATES  # F^ + Y_x b_x + (shift Y_x + Y_v) v^
        + FORCES**2  # the inverse of the closing system
        + FORCES * freedoms  # v = v^ + shift S^-1 M^-1 F
        + freedoms  # x = b_x + shift v
    )


def multiply_adds(machine: Machine) -> int:
    """Multiply-adds of ``machine_solve`` for one column."""
    films = [(bearing.settings, bearing.reach) for bearing in machine.bearings]
    of_films = sum(
        film_multiply_adds(film.nodes, film.axial, periodic=film.periodic, reach=reach)
        for film, reach in films
    )
    return of_films + rotor_multiply_adds(machine.rotor_freedoms)


@njit
def _solves(count, factors, constants, layout, work, right, lines):  # type: ignore[no-untyped-def]
    for _ in range(count):
        lines[:] = right
        machine_solve(factors, constants, layout, work, lines)


@njit
def _copies(count, right, lines):  # type: ignore[no-untyped-def]
    for k in range(count):
        right[0] = k
        lines[:] = right


def solve_arithmetic(settings: Settings) -> list[Measurement]:
    """One solve for LANES columns on the default grid against the machine's rates."""
    nodes, stations = settings.default_grid
    machine, seconds = _solve_seconds(settings)
    needed = multiply_adds(machine) * LANES
    rate = needed / seconds
    peak = multiply_add_rate(settings.repetitions)
    cached = cached_multiply_add_rate(settings.repetitions)
    name = f"machine_solve, {LANES} columns on {nodes}x{stations}"
    return [
        Measurement(
            "solve_fraction_of_peak", rate / peak, "1",
            f"{name}: {2e-9 * needed:.3g} GFlop needed in {1e6 * seconds:.3g} us, {2e-9 * rate:.3g} GFlop/s "
            f"reached; registers alone give {2e-9 * peak:.3g} GFlop/s",
        ),
        Measurement(
            "solve_fraction_of_load_bound", rate / cached, "1",
            f"{name}: time with every factor and line from the first-level cache "
            f"({2e-9 * cached:.3g} GFlop/s, {8e-9 * (1 + 1 / LANES) * cached:.3g} GB/s) / time measured",
        ),
    ]  # fmt: skip


def _solve_seconds(settings: Settings) -> tuple[Machine, float]:
    """A machine at rest and the CPU time [s] of one solve on it."""
    description = case(settings.default_grid, numerics={"scheme": SCHEME})
    machine = build_machine(description)
    system, parameters = machine_system(machine), parameter_vector(description)
    assert system.shifted is not None
    state = np.zeros(machine.size)
    for bearing in range(BEARINGS):
        machine.pressures(state, bearing)[:] = 1.0
    factors, work = np.zeros(system.shifted.factors_size), np.zeros(system.work_size)
    machine_factorise(0.0, state, parameters, _SHIFT, system.constants, system.layout, work, factors)
    right, lines, count = np.ones(machine.size * LANES), np.zeros(machine.size * LANES), settings.repetitions
    constants, layout = system.constants, system.layout
    both = seconds_each(lambda: _solves(count, factors, constants, layout, work, right, lines), count)
    return machine, both - seconds_each(lambda: _copies(count, right, lines), count)
