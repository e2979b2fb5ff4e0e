"""Compiled right-hand side of the rotor on two gas foil bearings, and its derivative (Eq. 16).

State s = {p_1 q_1 p_2 q_2 y}: the film pressures and foil displacements of either bearing, then the
displacements and velocities of the master nodes, y = {x_1 y_1 [alpha_1 beta_1] ..., velocities}, slopes
where they are kept:

    dx/dtau = v
    dv/dtau = -M^-1 K x - M^-1 (C + Omega G) v + M^-1 F + g                                           (Eq. 12)

Journal coordinates of a bearing are in units of its own clearance.
"""

from __future__ import annotations

import numpy as np

from .film import (
    AFTER,
    BEFORE,
    FILM_INTEGERS,
    FILM_SCALARS,
    FILM_SCRATCH,
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
    film_geometry,
    film_rates,
    foil_coefficients,
    pad_pressure,
)
from .film_force import FORCE_SCRATCH, film_force
from .kernels import RATES, TANGENT, kernel
from .lines import LINE, add_line, fold_line, set_line

# Integers of the machine, followed by FILM_INTEGERS for each bearing.
ROTOR_STATE, ROTOR_SIZE, ROTOR_CONSTANTS, JOURNAL, FILM_CONSTANTS = 0, 1, 2, 3, 5
MACHINE_INTEGERS = 7
BEARINGS = 2
UNSIGNED = np.uint64


@kernel()
def bearing_views(bearing, constants, layout):
    """Integers, scalars, arrays and the journal's clearance ratio of one bearing."""
    start = MACHINE_INTEGERS + bearing * FILM_INTEGERS
    integers = layout[start : start + FILM_INTEGERS]
    offset = layout[FILM_CONSTANTS + bearing]
    scalars = constants[offset + 1 : offset + 1 + FILM_SCALARS]
    return integers, scalars, constants[offset + 1 + FILM_SCALARS :], constants[offset]


@kernel()
def film_workspace(integers, work):
    """Thickness (nodes + 2), its rate (nodes), padded pressures, scratch of the film and of the force."""
    padded = integers[NODES] + 2
    a = 2 * padded
    b = a + integers[STATIONS] * padded
    c = b + FILM_SCRATCH * padded
    return (
        work[:padded],
        work[padded : a - 2],
        work[a:b],
        work[b:c].reshape(FILM_SCRATCH, padded),
        work[c : c + FORCE_SCRATCH * padded].reshape(FORCE_SCRATCH, padded),
    )


@kernel()
def bearing_rates(phase, state, parameters, bearing, constants, layout, work, out, gradient):
    """Film and foil rates of one bearing into ``out``; returns the force on its journal and, unless
    ``gradient`` is empty, its derivatives there.
    """
    integers, scalars, arrays, clearance = bearing_views(bearing, constants, layout)
    thickness, thickness_rate, padded, scratch, force_scratch = film_workspace(integers, work)
    dof, size = layout[ROTOR_STATE] + layout[JOURNAL + bearing], layout[ROTOR_SIZE]
    journal = (state[dof] / clearance, state[dof + 1] / clearance,
               state[dof + size] / clearance, state[dof + size + 1] / clearance)  # fmt: skip
    film_geometry(
        phase, state, parameters, integers, scalars, arrays, journal,
        thickness, thickness_rate, out[integers[FOIL] :],
    )  # fmt: skip
    pad_pressure(state[integers[PRESSURE] :], integers, padded)
    film_rates(
        padded,
        parameters,
        integers,
        scalars,
        arrays,
        thickness,
        thickness_rate,
        out[integers[PRESSURE] :],
        scratch,
    )
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


# The tangent sweeps a block in chunks of columns, copied line by line into one flat array: a line holds one
# row of the chunk.  Offsets are unsigned, as ``lines`` asks for.


@kernel()
def gather_lines(block, first, width, row, rows, lines):
    """Copy ``rows`` rows of the columns ``first : first + width`` to lines, zeros beyond the width."""
    if width == LINE:
        values, columns = block.reshape(block.size), UNSIGNED(block.shape[1])
        source = UNSIGNED(row) * columns + UNSIGNED(first)
        for i in range(UNSIGNED(rows)):
            set_line(lines, i * UNSIGNED(LINE), (1.0,), values, (source + i * columns,))
        return
    for i in range(rows):
        for c in range(width):
            lines[i * LINE + c] = block[row + i, first + c]
        for c in range(width, LINE):
            lines[i * LINE + c] = 0.0


@kernel()
def scatter_lines(lines, first, width, row, rows, block):
    """Copy lines back to rows of a block."""
    if width == LINE:
        values, columns = block.reshape(block.size), UNSIGNED(block.shape[1])
        to = UNSIGNED(row) * columns + UNSIGNED(first)
        for i in range(UNSIGNED(rows)):
            set_line(values, to + i * columns, (1.0,), lines, (i * UNSIGNED(LINE),))
        return
    for i in range(rows):
        for c in range(width):
            block[row + i, first + c] = lines[i * LINE + c]


@kernel(error_model="numpy")
def foil_lines(lines, parameters, integers, scalars, arrays, clearance, out):
    """Foil rows of J, and dh and d(dh/dtau) for the film rows.

    Lines of a chunk: the bearing's pressures and foil displacements, the journal's dX, dY and their rates (in
    the machine's displacement unit), then room for dh (nodes + 2) and d(dh/dtau) (nodes).
    """
    nodes, stations, w = UNSIGNED(integers[NODES]), UNSIGNED(integers[STATIONS]), UNSIGNED(LINE)
    flexibility, relaxation = foil_coefficients(parameters, integers, scalars)
    weights = arrays[2 * integers[NODES] + 4 + integers[STATIONS] * (integers[STATIONS] + 1) :]
    scale, foil = 1.0 / clearance, stations * nodes * w
    journal = foil + nodes * w
    slope = journal + UNSIGNED(4) * w
    slope_rate = slope + (nodes + UNSIGNED(2)) * w
    x, y, x_rate, y_rate = journal, journal + w, journal + w + w, journal + w + w + w
    for k in range(nodes + UNSIGNED(2)):
        # dh = -dX cos - dY sin + dq
        cosine, sine = arrays[k] * scale, arrays[nodes + UNSIGNED(2) + k] * scale
        to = slope + k * w
        if k == 0 or k > nodes:
            set_line(lines, to, (-cosine, -sine), lines, (x, y))
        else:
            set_line(lines, to, (-cosine, -sine, 1.0), lines, (x, y, foil + (k - UNSIGNED(1)) * w))
    for i in range(nodes):
        # d(dq/dtau) = -r dq + a dp_m,   d(dh/dtau) = d(dq/dtau) - d(dX/dtau) cos - d(dY/dtau) sin
        cosine, sine = arrays[i + UNSIGNED(1)] * scale, arrays[nodes + UNSIGNED(3) + i] * scale
        here, rate = foil + i * w, slope_rate + i * w
        set_line(out, here, (-relaxation,), lines, (here,))
        for j in range(stations):
            add_line(out, here, flexibility * weights[j], lines, (j * nodes + i) * w)
        set_line(lines, rate, (-cosine, -sine), lines, (x_rate, y_rate))
        add_line(lines, rate, 1.0, out, here)
    if integers[PERIODIC] == 1:
        last = slope + nodes * w
        set_line(lines, slope, (1.0,), lines, (last,))
        set_line(lines, last + w, (1.0,), lines, (slope + w,))


@kernel(error_model="numpy")
def film_lines(lines, terms, integers, out):
    """Film rows of J from the lines that ``foil_lines`` has completed; ``terms`` as in
    ``film.film_derivatives``.
    """
    nodes, stations, w = UNSIGNED(integers[NODES]), UNSIGNED(integers[STATIONS]), UNSIGNED(LINE)
    one, step = UNSIGNED(1), nodes * w
    slope = (stations * nodes + nodes + UNSIGNED(4)) * w
    slope_rate = slope + (nodes + UNSIGNED(2)) * w
    periodic = integers[PERIODIC] == 1
    for j in range(stations):
        for i in range(nodes):
            row = j * nodes + i
            to, dh, rate, station = row * w, slope + i * w, slope_rate + i * w, i * w
            before, after = terms[BEFORE, row], terms[AFTER, row]
            left, right = to - w, to + w
            if i == 0:
                left, before = to + (nodes - one) * w, before if periodic else 0.0
            if i == nodes - one:
                right, after = to - (nodes - one) * w, after if periodic else 0.0
            factors = (
                terms[THICKNESS_BEFORE, row], terms[THICKNESS_HERE, row], terms[THICKNESS_AFTER, row],
                terms[THICKNESS_RATE, row], before, after,
            )  # fmt: skip
            set_line(out, to, factors, lines, (dh, dh + w, dh + w + w, rate, left, right))
            for other in range(stations):
                add_line(out, to, terms[UNSIGNED(HERE) + other, row], lines, station + other * step)


@kernel(error_model="numpy")
def force_lines(lines, gradient, force):
    """Lines dF_x and dF_y of a bearing into ``force`` (2 lines); ``lines`` begins with its pressures."""
    rows, w = UNSIGNED(gradient.shape[1]), UNSIGNED(LINE)
    flat = gradient.reshape(UNSIGNED(2) * rows)
    force[:] = 0.0
    for k in range(UNSIGNED(2)):
        fold_line(force, k * w, force, k * w, flat, k * rows, lines, UNSIGNED(0), w, rows)


@kernel()
def add_force(force, first, width, bearing, constants, layout, out):
    """Add M^-1 dF of one bearing to the rotor's accelerations."""
    size = layout[ROTOR_SIZE]
    to = layout[ROTOR_STATE] + size
    _, _, _, influence, _ = rotor_views(constants, layout)
    for row in range(size):
        x, y = influence[row, 2 * bearing], influence[row, 2 * bearing + 1]
        for c in range(width):
            out[to + row, first + c] += x * force[c] + y * force[LINE + c]


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
def tangent_workspace(nodes, stations, work):
    """Split scratch space into terms, force gradient, lines, their image, force lines, and the rest."""
    rows = nodes * stations
    a = rows * (HERE + stations)
    b = a + rows * 2
    c = b + (rows + 3 * nodes + 6) * LINE
    d = c + (rows + nodes) * LINE
    e = d + 2 * LINE
    return (
        work[:a].reshape(HERE + stations, rows),
        work[a:b].reshape(2, rows),
        work[b:c],
        work[c:d],
        work[d:e],
        work[e:],
    )


@kernel(TANGENT)
def machine_tangent(phase, state, block, parameters, constants, layout, work, out):
    """J(phase, state) @ block: linearise both bearings, then sweep the block in chunks of columns."""
    columns, start, size = block.shape[1], layout[ROTOR_STATE], layout[ROTOR_SIZE]
    rotor_tangent(block, parameters[SPEED], constants, layout, out)
    for bearing in range(BEARINGS):
        integers, scalars, arrays, clearance = bearing_views(bearing, constants, layout)
        unknowns = integers[NODES] * (integers[STATIONS] + 1)
        journal, row = start + layout[JOURNAL + bearing], integers[PRESSURE]
        terms, gradient, lines, image, force, scratch = tangent_workspace(
            integers[NODES], integers[STATIONS], work
        )
        linearise_bearing(phase, state, parameters, bearing, constants, layout, scratch, terms, gradient)
        for first in range(0, columns, LINE):
            width = min(LINE, columns - first)
            gather_lines(block, first, width, row, unknowns, lines)
            gather_lines(block, first, width, journal, 2, lines[unknowns * LINE :])
            gather_lines(block, first, width, journal + size, 2, lines[(unknowns + 2) * LINE :])
            foil_lines(lines, parameters, integers, scalars, arrays, clearance, image)
            film_lines(lines, terms, integers, image)
            scatter_lines(image, first, width, row, unknowns, out)
            force_lines(lines, gradient, force)
            add_force(force, first, width, bearing, constants, layout, out)


def film_workspace_size(nodes: int, stations: int) -> int:
    """Doubles of ``film_workspace``."""
    return (2 + stations + FILM_SCRATCH + FORCE_SCRATCH) * (nodes + 2)


def workspace_size(state_size: int, nodes: int, stations: int) -> int:
    """Scratch doubles that ``machine_rates`` and ``machine_tangent`` need for such a bearing."""
    film = film_workspace_size(nodes, stations)
    rows = nodes * stations
    lines = (2 * rows + 4 * nodes + 8) * LINE
    return rows * (HERE + stations + 2) + lines + state_size + film + BEARINGS * 2
