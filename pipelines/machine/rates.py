"""Compiled right-hand side of the rotor on two gas foil bearings, and its derivative (Eq. 16).

State s = {p_1 q_1 p_2 q_2 y}: the film pressures and foil displacements of either bearing, then the
displacements and velocities of the master nodes, y = {x_1 y_1 [alpha_1 beta_1] ..., velocities}, with the
slopes alpha, beta of the nodes that keep them:

    dx/dtau = v
    dv/dtau = -M^-1 K x - M^-1 (C + Omega G) v + M^-1 F + g                                           (Eq. 12)

Journal coordinates of a bearing are in units of its own clearance.

Integers and constants of the machine, with n = ROTOR_SIZE (see ``film`` for those of a bearing):

    layout    | ROTOR_STATE ... FILM_CONSTANTS (7) | bearing 1 (FILM_INTEGERS) | bearing 2 (the same)
    constants | clearance, scalars, arrays of bearing 1 | the same of bearing 2 | rotor
    rotor     | M^-1 K (n, n) | M^-1 C (n, n) | M^-1 G (n, n) | M^-1 at the journals (n, 4) | gravity (n)

``machine_tangent`` treats a block in chunks of LANES columns, each copied into one flat array. The rows of a
chunk are, for one bearing,

    | pressures        | foil  | dX, dY, dX', dY' | dh                | d(dh/dtau) |
      stations * nodes   nodes   4                  nodes + 2 reach     nodes
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from .film import (
    FILM_INTEGERS,
    FILM_SCALARS,
    FILM_SCRATCH,
    FOIL,
    NODES,
    PERIODIC,
    PRESSURE,
    REACH,
    SPEED,
    STATIONS,
    THICKNESS_RATE,
    film_derivatives,
    film_geometry,
    film_layout,
    film_rates,
    foil_coefficients,
    pad_pressure,
    padded_nodes,
    scratch_length,
    term_rows,
)
from .film_force import FORCE_SCRATCH, film_force
from .kernels import RATES, TANGENT, kernel
from .lanes import LANES, accumulate_lanes, add_lanes, borrowed, set_lanes

# Integers of the machine.
ROTOR_STATE, ROTOR_SIZE, ROTOR_CONSTANTS, JOURNAL, FILM_CONSTANTS = 0, 1, 2, 3, 5
MACHINE_INTEGERS = 7
BEARINGS = 2
UNSIGNED = np.uint64
_TWINS = 1e-10  # difference of pressures and distances; it changes multipliers by a tenth of that


@kernel()
def bearing_views(bearing, constants, layout):
    """Integers, scalars, arrays and the journal's clearance ratio of one bearing."""
    start = MACHINE_INTEGERS + bearing * FILM_INTEGERS
    integers = layout[start : start + FILM_INTEGERS]
    offset = layout[FILM_CONSTANTS + bearing]
    scalars = constants[offset + 1 : offset + 1 + FILM_SCALARS]
    return integers, scalars, constants[offset + 1 + FILM_SCALARS :], constants[offset]


@kernel()
def journal_coordinates(bearing, state, clearance, layout):
    """X, Y, dX/dtau, dY/dtau of a journal in units of its clearance."""
    dof, size = layout[ROTOR_STATE] + layout[JOURNAL + bearing], layout[ROTOR_SIZE]
    return (state[dof] / clearance, state[dof + 1] / clearance,
            state[dof + size] / clearance, state[dof + size + 1] / clearance)  # fmt: skip


@kernel()
def are_twins(state, constants, layout):
    """Whether the films of two equal bearings are in one state, up to what a corrector leaves.

    So they are on a symmetric rotor, unless its motion loses the symmetry; one Jacobian then serves both.
    """
    one, _, _, clearance = bearing_views(0, constants, layout)
    other, _, _, other_clearance = bearing_views(1, constants, layout)
    for k in range(PRESSURE):
        if one[k] != other[k]:
            return False
    first, second = constants[layout[FILM_CONSTANTS] :], constants[layout[FILM_CONSTANTS + 1] :]
    for k in range(1 + FILM_SCALARS + film_layout(one).end):
        if first[k] != second[k]:
            return False
    journal = journal_coordinates(0, state, clearance, layout)
    beside = journal_coordinates(1, state, other_clearance, layout)
    largest = 0.0
    for k in range(4):
        largest = max(largest, abs(journal[k] - beside[k]))
    nodes = one[NODES]
    for at, rows in ((PRESSURE, nodes * one[STATIONS]), (FOIL, nodes)):
        own, another = state[one[at] : one[at] + rows], state[other[at] : other[at] + rows]
        for i in range(rows):
            largest = max(largest, abs(own[i] - another[i]))
    return largest <= _TWINS


@kernel()
def film_workspace(integers, work):
    """Padded thickness, its rate (nodes), padded pressures, scratch of the film and of the force."""
    nodes, padded, length = integers[NODES], padded_nodes(integers), scratch_length(integers)
    a = padded + nodes
    b = a + integers[STATIONS] * padded
    c = b + FILM_SCRATCH * length
    return (
        work[:padded],
        work[padded:a],
        work[a:b],
        work[b:c].reshape(FILM_SCRATCH, length),
        work[c : c + FORCE_SCRATCH * (nodes + 2)].reshape(FORCE_SCRATCH, nodes + 2),
    )


@kernel()
def bearing_rates(phase, state, parameters, bearing, constants, layout, work, out, gradient):
    """Write film and foil rates of one bearing into ``out``; returns the force on its journal.

    ``gradient``, unless it is empty, receives the derivatives of the force with the pressures.
    """
    integers, scalars, arrays, clearance = bearing_views(bearing, constants, layout)
    thickness, thickness_rate, padded, scratch, force_scratch = film_workspace(integers, work)
    journal = journal_coordinates(bearing, state, clearance, layout)
    film_geometry(
        phase, state, parameters, integers, scalars, arrays, journal,
        thickness, thickness_rate, out[integers[FOIL] :],
    )  # fmt: skip
    pad_pressure(state[integers[PRESSURE] :], integers, padded)
    film_rates(
        padded, parameters, integers, scalars, arrays, thickness, thickness_rate, out[integers[PRESSURE] :],
        scratch,
    )  # fmt: skip
    return film_force(padded, integers, scalars, arrays, gradient, force_scratch)


@kernel()
def rotor_views(constants, layout):
    """M^-1 K, M^-1 C, M^-1 G (size x size), M^-1 at the journals (size x 4) and the gravity acceleration."""
    size, start = layout[ROTOR_SIZE], layout[ROTOR_CONSTANTS]
    square = size * size
    stiffness = constants[start : start + square].reshape(size, size)
    damping = constants[start + square : start + 2 * square].reshape(size, size)
    gyroscopic = constants[start + 2 * square : start + 3 * square].reshape(size, size)
    influence = constants[start + 3 * square : start + 3 * square + 4 * size].reshape(size, 4)
    return stiffness, damping, gyroscopic, influence, constants[start + 3 * square + 4 * size :]


@kernel(RATES)
def machine_rates(phase, state, parameters, constants, layout, work, out):
    """ds/dtau of the whole machine (Eq. 16)."""
    state, parameters, constants = borrowed(state), borrowed(parameters), borrowed(constants)
    layout, work, out = borrowed(layout), borrowed(work), borrowed(out)
    force = work[:4]
    for bearing in range(BEARINGS):
        x, y = bearing_rates(
            phase, state, parameters, bearing, constants, layout, work[4:], out, work[:0].reshape(2, 0)
        )
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


@kernel()
def linearise_bearing(phase, state, parameters, bearing, constants, layout, work, terms, gradient):
    """Fill the derivatives of a bearing's film (``terms``) and force (``gradient``) at a state."""
    integers, scalars, arrays, _ = bearing_views(bearing, constants, layout)
    rates = work[: state.size]
    bearing_rates(phase, state, parameters, bearing, constants, layout, work[state.size :], rates, gradient)
    thickness, thickness_rate, padded, scratch, _ = film_workspace(integers, work[state.size :])
    film_derivatives(
        padded, parameters, integers, scalars, arrays, thickness, thickness_rate, rates[integers[PRESSURE] :],
        terms, scratch,
    )  # fmt: skip


# Offsets into the rows of a chunk are unsigned, as the sums of ``lanes`` need them.


class ChunkRows(NamedTuple):
    """Offsets of the rows of foil, journal, dh and d(dh/dtau) in a chunk; the pressures start at zero."""

    foil: Any
    journal: Any
    slope: Any
    slope_rate: Any


@kernel()
def chunk_rows(integers):
    """The offsets of a bearing's chunks."""
    nodes, stations, w = UNSIGNED(integers[NODES]), UNSIGNED(integers[STATIONS]), UNSIGNED(LANES)
    foil = stations * nodes * w
    journal = foil + nodes * w
    slope = journal + UNSIGNED(4) * w
    return ChunkRows(foil, journal, slope, slope + UNSIGNED(padded_nodes(integers)) * w)


@kernel()
def gather_lanes(block, first, width, row, rows, lanes):
    """Copy ``rows`` rows of the columns ``first : first + width``, zeros beyond the width."""
    if width == LANES:
        values, columns = block.reshape(block.size), UNSIGNED(block.shape[1])
        source = UNSIGNED(row) * columns + UNSIGNED(first)
        for i in range(UNSIGNED(rows)):
            set_lanes(lanes, i * UNSIGNED(LANES), (1.0,), values, (source + i * columns,))
        return
    for i in range(rows):
        for c in range(width):
            lanes[i * LANES + c] = block[row + i, first + c]
        for c in range(width, LANES):
            lanes[i * LANES + c] = 0.0


@kernel()
def scatter_lanes(lanes, first, width, row, rows, block):
    """Copy rows of lanes back to a block."""
    if width == LANES:
        values, columns = block.reshape(block.size), UNSIGNED(block.shape[1])
        to = UNSIGNED(row) * columns + UNSIGNED(first)
        for i in range(UNSIGNED(rows)):
            set_lanes(values, to + i * columns, (1.0,), lanes, (i * UNSIGNED(LANES),))
        return
    for i in range(rows):
        for c in range(width):
            block[row + i, first + c] = lanes[i * LANES + c]


@kernel(error_model="numpy")
def foil_lanes(lanes, parameters, integers, scalars, arrays, clearance, out):
    """Compute the foil rows of J @ chunk into ``out``, and dh and d(dh/dtau) of the chunk for the film rows.

    The journal's rows of the chunk are in the machine's displacement unit; ``clearance`` is the bearing's
    clearance in that unit.
    """
    nodes, stations, w = UNSIGNED(integers[NODES]), UNSIGNED(integers[STATIONS]), UNSIGNED(LANES)
    flexibility, relaxation = foil_coefficients(parameters, integers, scalars)
    at, scale, first = film_layout(integers), 1.0 / clearance, UNSIGNED(integers[REACH])
    sines, weights = UNSIGNED(at.sine), arrays[at.weights :]
    foil, journal, slope, slope_rate = chunk_rows(integers)
    x, y, x_rate, y_rate = journal, journal + w, journal + w + w, journal + w + w + w
    for k in range(UNSIGNED(padded_nodes(integers))):
        # dh = -dX cos - dY sin + dq
        cosine, sine = arrays[k] * scale, arrays[sines + k] * scale
        to = slope + k * w
        if k < first or k >= nodes + first:
            set_lanes(lanes, to, (-cosine, -sine), lanes, (x, y))
        else:
            set_lanes(lanes, to, (-cosine, -sine, 1.0), lanes, (x, y, foil + (k - first) * w))
    for i in range(nodes):
        # d(dq/dtau) = -r dq + a dp_m,   d(dh/dtau) = d(dq/dtau) - d(dX/dtau) cos - d(dY/dtau) sin
        cosine, sine = arrays[first + i] * scale, arrays[sines + first + i] * scale
        here, rate = foil + i * w, slope_rate + i * w
        set_lanes(out, here, (-relaxation,), lanes, (here,))
        for j in range(stations):
            add_lanes(out, here, flexibility * weights[j], lanes, (j * nodes + i) * w)
        set_lanes(lanes, rate, (-cosine, -sine), lanes, (x_rate, y_rate))
        add_lanes(lanes, rate, 1.0, out, here)
    if integers[PERIODIC] == 1:
        for k in range(first):
            set_lanes(lanes, slope + k * w, (1.0,), lanes, (slope + (nodes + k) * w,))
            set_lanes(lanes, slope + (nodes + first + k) * w, (1.0,), lanes, (slope + (first + k) * w,))


@kernel()
def neighbours(i, distance, nodes):
    """The nodes ``distance`` before and behind node i, around the film; all are unsigned."""
    before = i - distance if i >= distance else i + nodes - distance
    after = i + distance if i + distance < nodes else i + distance - nodes
    return before, after


@kernel(error_model="numpy")
def film_lanes(lanes, terms, integers, out):
    """Compute the film rows of J @ chunk into ``out``, after ``foil_lanes`` has completed the chunk.

    ``terms`` as in ``film.film_derivatives``: those with pressures on a foil edge are zero.
    """
    nodes, stations, w = UNSIGNED(integers[NODES]), UNSIGNED(integers[STATIONS]), UNSIGNED(LANES)
    one, reach, step = UNSIGNED(1), UNSIGNED(integers[REACH]), nodes * w
    at = term_rows(integers[REACH], integers[STATIONS])
    thickness, pressure, own = UNSIGNED(at.thickness), UNSIGNED(at.pressure), UNSIGNED(at.here)
    _, _, slope, slope_rate = chunk_rows(integers)
    for j in range(stations):
        for i in range(nodes):
            row, first, dh, station = j * nodes + i, j * step, slope + (i + reach) * w, i * w
            to = row * w
            before, after = neighbours(i, one, nodes)
            factors = (
                terms[THICKNESS_RATE, row], terms[thickness, row], terms[thickness - one, row],
                terms[thickness + one, row], terms[pressure - one, row], terms[pressure + one, row],
            )  # fmt: skip
            sources = (slope_rate + i * w, dh, dh - w, dh + w, first + before * w, first + after * w)
            set_lanes(out, to, factors, lanes, sources)
            for k in range(one + one, reach + one):
                before, after = neighbours(i, k, nodes)
                add_lanes(out, to, terms[thickness - k, row], lanes, dh - k * w)
                add_lanes(out, to, terms[thickness + k, row], lanes, dh + k * w)
                add_lanes(out, to, terms[pressure - k, row], lanes, first + before * w)
                add_lanes(out, to, terms[pressure + k, row], lanes, first + after * w)
            for other in range(stations):
                add_lanes(out, to, terms[own + other, row], lanes, station + other * step)


@kernel(error_model="numpy")
def force_lanes(lanes, gradient, force):
    """Write the rows dF_x and dF_y of a bearing into ``force``; ``lanes`` begins with its pressures."""
    rows, w = UNSIGNED(gradient.shape[1]), UNSIGNED(LANES)
    flat = gradient.reshape(UNSIGNED(2) * rows)
    force[:] = 0.0
    for k in range(UNSIGNED(2)):
        accumulate_lanes(force, k * w, force, k * w, flat, k * rows, lanes, UNSIGNED(0), w, rows)


@kernel()
def add_force(force, first, width, bearing, constants, layout, out):
    """Add M^-1 dF of one bearing to the rotor's accelerations."""
    size = layout[ROTOR_SIZE]
    to = layout[ROTOR_STATE] + size
    _, _, _, influence, _ = rotor_views(constants, layout)
    for row in range(size):
        x, y = influence[row, 2 * bearing], influence[row, 2 * bearing + 1]
        for c in range(width):
            out[to + row, first + c] += x * force[c] + y * force[LANES + c]


@kernel()
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


@kernel()
def tangent_workspace(integers, work):
    """Split scratch space into terms, force gradient, a chunk, its image, rows of the force, and the rest."""
    nodes, stations = integers[NODES], integers[STATIONS]
    rows, terms = nodes * stations, term_rows(integers[REACH], stations).count
    a = rows * terms
    b = a + rows * 2
    c = b + (rows + 2 * nodes + 4 + padded_nodes(integers)) * LANES
    d = c + (rows + nodes) * LANES
    e = d + 2 * LANES
    return (
        work[:a].reshape(terms, rows),
        work[a:b].reshape(2, rows),
        work[b:c],
        work[c:d],
        work[d:e],
        work[e:],
    )


@kernel(TANGENT)
def machine_tangent(phase, state, block, parameters, constants, layout, work, out):
    """J(phase, state) @ block: linearise both bearings, then treat the block in chunks of columns."""
    state, block, parameters, constants = (
        borrowed(state),
        borrowed(block),
        borrowed(parameters),
        borrowed(constants),
    )
    layout, work, out = borrowed(layout), borrowed(work), borrowed(out)
    columns, start, size = block.shape[1], layout[ROTOR_STATE], layout[ROTOR_SIZE]
    two = np.int64(2)  # a literal 2 would be compiled on its own
    rotor_tangent(block, parameters[SPEED], constants, layout, out)
    for bearing in range(BEARINGS):
        integers, scalars, arrays, clearance = bearing_views(bearing, constants, layout)
        unknowns = integers[NODES] * (integers[STATIONS] + 1)
        journal, row = start + layout[JOURNAL + bearing], integers[PRESSURE]
        terms, gradient, lanes, image, force, scratch = tangent_workspace(integers, work)
        linearise_bearing(phase, state, parameters, bearing, constants, layout, scratch, terms, gradient)
        for first in range(0, columns, LANES):
            width = min(LANES, columns - first)
            gather_lanes(block, first, width, row, unknowns, lanes)
            gather_lanes(block, first, width, journal, two, lanes[unknowns * LANES :])
            gather_lanes(block, first, width, journal + size, two, lanes[(unknowns + 2) * LANES :])
            foil_lanes(lanes, parameters, integers, scalars, arrays, clearance, image)
            film_lanes(lanes, terms, integers, image)
            scatter_lanes(image, first, width, row, unknowns, out)
            force_lanes(lanes, gradient, force)
            add_force(force, first, width, bearing, constants, layout, out)


def film_workspace_size(integers: NDArray[np.int64]) -> int:
    """Doubles of ``film_workspace``."""
    nodes, padded = int(integers[NODES]), int(padded_nodes(integers))
    film = (1 + int(integers[STATIONS])) * padded + nodes + FILM_SCRATCH * int(scratch_length(integers))
    return film + FORCE_SCRATCH * (nodes + 2)


def workspace_size(state_size: int, integers: NDArray[np.int64]) -> int:
    """Scratch doubles that ``machine_rates`` and ``machine_tangent`` need for such a bearing."""
    nodes, stations, reach = (int(integers[k]) for k in (NODES, STATIONS, REACH))
    rows = nodes * stations
    chunk = (2 * rows + 3 * nodes + 6 + int(padded_nodes(integers))) * LANES
    terms = rows * (int(term_rows(reach, stations).count) + 2)
    return terms + chunk + state_size + film_workspace_size(integers) + BEARINGS * 2
