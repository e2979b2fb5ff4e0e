"""Compiled right-hand side of the rotor on two gas foil bearings, and its derivative (Eq. 16).

State s = {p_1 q_1 p_2 q_2 y}: the film pressures and foil displacements of either bearing, then the displacements and
velocities of the master nodes, y = {x_1 y_1 ... x_n y_n, velocities}:

    dx/dtau = v
    dv/dtau = -M^-1 K x - M^-1 (C + Omega G) v + M^-1 F + g                                                (Eq. 12)

Journal coordinates of a bearing are in units of its own clearance.
"""

from __future__ import annotations

from numba import njit

from .film import (
    AFTER,
    BEFORE,
    FILM_INTEGERS,
    FILM_SCALARS,
    FOIL,
    HERE,
    NODES,
    PERIODIC,
    PRESSURE,
    SPEED,
    STATIONS,
    THICKNESS_AFTER,
    THICKNESS_BEFORE,
    THICKNESS_HERE,
    THICKNESS_RATE,
    film_derivatives,
    film_force,
    film_force_derivatives,
    film_geometry,
    film_rates,
    foil_coefficients,
    pad_pressure,
)
from .kernels import RATES, TANGENT

# Integers of the machine, followed by FILM_INTEGERS for each bearing.
ROTOR_STATE, ROTOR_SIZE, ROTOR_CONSTANTS, JOURNAL, FILM_CONSTANTS = 0, 1, 2, 3, 5
MACHINE_INTEGERS = 7
BEARINGS = 2
COLUMN_CHUNK = 16  # columns of a block treated together: their film thicknesses stay in the first-level cache


@njit(cache=True)
def bearing_views(bearing, constants, layout):
    """Integers, scalars, arrays and the journal's clearance ratio of one bearing."""
    start = MACHINE_INTEGERS + bearing * FILM_INTEGERS
    integers = layout[start : start + FILM_INTEGERS]
    offset = layout[FILM_CONSTANTS + bearing]
    scalars = constants[offset + 1 : offset + 1 + FILM_SCALARS]
    return integers, scalars, constants[offset + 1 + FILM_SCALARS :], constants[offset]


@njit(cache=True)
def film_workspace(integers, work):
    """Thickness (nodes + 2), its rate (nodes) and padded pressures, then the remaining scratch."""
    nodes, stations = integers[NODES], integers[STATIONS]
    first, second = nodes + 2, 2 * nodes + 2
    third = second + stations * (nodes + 2)
    return work[:first], work[first:second], work[second:third], work[third:]


@njit(cache=True)
def bearing_rates(phase, state, parameters, bearing, constants, layout, work, out):
    """Film and foil rates of one bearing into ``out``; returns the force on its journal."""
    integers, scalars, arrays, clearance = bearing_views(bearing, constants, layout)
    thickness, thickness_rate, padded, scratch = film_workspace(integers, work)
    dof, size = layout[ROTOR_STATE] + layout[JOURNAL + bearing], layout[ROTOR_SIZE]
    journal = (state[dof] / clearance, state[dof + 1] / clearance,
               state[dof + size] / clearance, state[dof + size + 1] / clearance)  # fmt: skip
    film_geometry(
        phase, state, parameters, integers, scalars, arrays, journal,
        thickness, thickness_rate, out[integers[FOIL] :],
    )  # fmt: skip
    pad_pressure(state[integers[PRESSURE] :], integers, padded)
    film_rates(
        padded, parameters, integers, scalars, arrays, thickness, thickness_rate, out[integers[PRESSURE] :]
    )
    return film_force(padded, integers, scalars, arrays)


@njit(cache=True)
def rotor_views(constants, layout):
    """M^-1 K, M^-1 C, M^-1 G (size x size), M^-1 at the journals (size x 4) and the gravity acceleration."""
    size, start = layout[ROTOR_SIZE], layout[ROTOR_CONSTANTS]
    square = size * size
    stiffness = constants[start : start + square].reshape(size, size)
    damping = constants[start + square : start + 2 * square].reshape(size, size)
    gyroscopic = constants[start + 2 * square : start + 3 * square].reshape(size, size)
    influence = constants[start + 3 * square : start + 3 * square + 4 * size].reshape(size, 4)
    return stiffness, damping, gyroscopic, influence, constants[start + 3 * square + 4 * size :]


@njit(RATES, cache=True)
def machine_rates(phase, state, parameters, constants, layout, work, out):
    """ds/dtau of the whole machine (Eq. 16)."""
    force = work[:4]
    for bearing in range(BEARINGS):
        x, y = bearing_rates(phase, state, parameters, bearing, constants, layout, work[4:], out)
        force[2 * bearing], force[2 * bearing + 1] = x, y
    stiffness, damping, gyroscopic, influence, gravity = rotor_views(constants, layout)
    start, size = layout[ROTOR_STATE], layout[ROTOR_SIZE]
    position, velocity = state[start : start + size], state[start + size : start + 2 * size]
    speed = parameters[SPEED]
    for row in range(size):
        acceleration = gravity[row]
        for column in range(size):
            acceleration -= stiffness[row, column] * position[column]
            acceleration -= (damping[row, column] + speed * gyroscopic[row, column]) * velocity[column]
        for column in range(4):
            acceleration += influence[row, column] * force[column]
        out[start + row] = velocity[row]
        out[start + size + row] = acceleration


@njit(cache=True)
def linearise_bearing(phase, state, parameters, bearing, constants, layout, work, terms, gradient):
    """Fill the derivatives of a bearing's film (``terms``) and force (``gradient``) at a state."""
    integers, scalars, arrays, clearance = bearing_views(bearing, constants, layout)
    rates = work[: state.size]
    bearing_rates(phase, state, parameters, bearing, constants, layout, work[state.size :], rates)
    thickness, thickness_rate, padded, scratch = film_workspace(integers, work[state.size :])
    film_derivatives(
        padded, parameters, integers, scalars, arrays, thickness, thickness_rate, rates[integers[PRESSURE] :], terms
    )
    film_force_derivatives(padded, integers, scalars, arrays, gradient)


@njit(cache=True)
def film_tangent(block, first, last, parameters, terms, integers, scalars, arrays, journal, slope, slope_rate, out):
    """Film and foil rows of J @ block for the columns ``first:last``.

    ``journal`` (4 rows, chunk): dX, dY and their rates; ``slope`` (nodes + 2, chunk) receives dh, ``slope_rate`` d(dh/dtau).
    """
    nodes, stations = integers[NODES], integers[STATIONS]
    pressure, foil = integers[PRESSURE], integers[FOIL]
    weights = arrays[2 * nodes + 4 + stations * stations + stations :]
    flexibility, relaxation = foil_coefficients(parameters, integers, scalars)
    width = last - first
    for k in range(nodes + 2):
        cosine, sine = arrays[k], arrays[nodes + 2 + k]
        for c in range(width):
            slope[k, c] = -cosine * journal[0, c] - sine * journal[1, c]
    for i in range(nodes):
        cosine, sine = arrays[i + 1], arrays[nodes + 3 + i]
        for c in range(width):
            dq = block[foil + i, first + c]
            slope[i + 1, c] += dq
            slope_rate[i, c] = -relaxation * dq
        for j in range(stations):
            factor = flexibility * weights[j]
            for c in range(width):
                slope_rate[i, c] += factor * block[pressure + j * nodes + i, first + c]
        for c in range(width):
            out[foil + i, first + c] = slope_rate[i, c]
            slope_rate[i, c] -= cosine * journal[2, c] + sine * journal[3, c]
    if integers[PERIODIC] == 1:
        for c in range(width):
            slope[0, c], slope[nodes + 1, c] = slope[nodes, c], slope[1, c]
    for j in range(stations):
        for i in range(nodes):
            row = j * nodes + i
            to = pressure + row
            t = terms[row]
            for c in range(width):
                out[to, first + c] = (
                    t[THICKNESS_BEFORE] * slope[i, c]
                    + t[THICKNESS_HERE] * slope[i + 1, c]
                    + t[THICKNESS_AFTER] * slope[i + 2, c]
                    + t[THICKNESS_RATE] * slope_rate[i, c]
                )
            for l in range(stations):
                source = pressure + l * nodes + i
                for c in range(width):
                    out[to, first + c] += t[HERE + l] * block[source, first + c]
            before = pressure + j * nodes + (i - 1 if i > 0 else nodes - 1)
            after = pressure + j * nodes + (i + 1 if i < nodes - 1 else 0)
            if i > 0 or integers[PERIODIC] == 1:
                for c in range(width):
                    out[to, first + c] += t[BEFORE] * block[before, first + c]
            if i < nodes - 1 or integers[PERIODIC] == 1:
                for c in range(width):
                    out[to, first + c] += t[AFTER] * block[after, first + c]


@njit(cache=True)
def force_tangent(block, first, last, gradient, bearing, integers, constants, layout, force, out):
    """Add M^-1 dF of one bearing to the rotor rows of the columns ``first:last``; ``force`` (2, chunk) is scratch."""
    width, pressure = last - first, integers[PRESSURE]
    force[:, :] = 0.0
    for row in range(gradient.shape[0]):
        x, y = gradient[row, 0], gradient[row, 1]
        for c in range(width):
            force[0, c] += x * block[pressure + row, first + c]
            force[1, c] += y * block[pressure + row, first + c]
    size = layout[ROTOR_SIZE]
    to = layout[ROTOR_STATE] + size
    _, _, _, influence, _ = rotor_views(constants, layout)
    for row in range(size):
        x, y = influence[row, 2 * bearing], influence[row, 2 * bearing + 1]
        for c in range(width):
            out[to + row, first + c] += x * force[0, c] + y * force[1, c]


@njit(cache=True)
def rotor_tangent(block, speed, constants, layout, out):
    """Rotor rows of J @ block without the bearing forces."""
    stiffness, damping, gyroscopic, _, _ = rotor_views(constants, layout)
    start, size, columns = layout[ROTOR_STATE], layout[ROTOR_SIZE], block.shape[1]
    for row in range(size):
        to = start + size + row
        for c in range(columns):
            out[start + row, c] = block[to, c]
            out[to, c] = 0.0
        for column in range(size):
            k, d = stiffness[row, column], damping[row, column] + speed * gyroscopic[row, column]
            for c in range(columns):
                out[to, c] -= k * block[start + column, c] + d * block[start + size + column, c]


@njit(cache=True)
def journal_tangent(block, first, last, dof, size, clearance, journal):
    """Displacement and velocity of a journal, in units of its clearance, for the columns ``first:last``."""
    for c in range(first, last):
        journal[0, c - first] = block[dof, c] / clearance
        journal[1, c - first] = block[dof + 1, c] / clearance
        journal[2, c - first] = block[dof + size, c] / clearance
        journal[3, c - first] = block[dof + size + 1, c] / clearance


@njit(cache=True)
def tangent_workspace(nodes, stations, work):
    """Split scratch space into terms, force gradient, thickness slope and its rate, and the rest."""
    rows = nodes * stations
    a = rows * (HERE + stations)
    b = a + rows * 2
    c = b + (nodes + 2) * COLUMN_CHUNK
    d = c + nodes * COLUMN_CHUNK
    return (
        work[:a].reshape(rows, HERE + stations),
        work[a:b].reshape(rows, 2),
        work[b:c].reshape(nodes + 2, COLUMN_CHUNK),
        work[c:d].reshape(nodes, COLUMN_CHUNK),
        work[d:],
    )


@njit(TANGENT, cache=True)
def machine_tangent(phase, state, block, parameters, constants, layout, work, out):
    """J(phase, state) @ block: linearise both bearings, then sweep the block in chunks of columns."""
    rotor_tangent(block, parameters[SPEED], constants, layout, out)
    journal = work[: 4 * COLUMN_CHUNK].reshape(4, COLUMN_CHUNK)
    force = work[4 * COLUMN_CHUNK : 6 * COLUMN_CHUNK].reshape(2, COLUMN_CHUNK)
    for bearing in range(BEARINGS):
        integers, scalars, arrays, clearance = bearing_views(bearing, constants, layout)
        nodes, stations, columns = integers[NODES], integers[STATIONS], block.shape[1]
        dof = layout[ROTOR_STATE] + layout[JOURNAL + bearing]
        terms, gradient, slope, slope_rate, scratch = tangent_workspace(nodes, stations, work[6 * COLUMN_CHUNK :])
        linearise_bearing(phase, state, parameters, bearing, constants, layout, scratch, terms, gradient)
        for first in range(0, columns, COLUMN_CHUNK):
            last = min(first + COLUMN_CHUNK, columns)
            journal_tangent(block, first, last, dof, layout[ROTOR_SIZE], clearance, journal)
            film_tangent(
                block, first, last, parameters, terms, integers, scalars, arrays, journal, slope, slope_rate, out
            )
            force_tangent(block, first, last, gradient, bearing, integers, constants, layout, force, out)


def workspace_size(state_size: int, nodes: int, stations: int) -> int:
    """Scratch doubles that ``machine_rates`` and ``machine_tangent`` need for bearings of at most this size."""
    film = 2 * nodes + 2 + stations * (nodes + 2)
    rows = nodes * stations
    block = rows * (HERE + stations + 2) + (2 * nodes + 2) * COLUMN_CHUNK
    return 6 * COLUMN_CHUNK + block + state_size + film
