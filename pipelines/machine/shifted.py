"""The linear systems of an implicit step, (I - shift J) x = b, factored once and solved for lines of columns.

J is the Jacobian of ``rates``.  Pressures of one axial line couple to the neighbouring lines only, foil
displacements to the pressures at their own angle, and the two films to the rotor only through the journals:

1.  dq_i = b_q/(1 + shift r) + c w.dp_i,  c = shift a/(1 + shift r), is put into the film equations, which
    become block tridiagonal along theta with blocks of stations x stations:

        L_i dp_{i-1} + D_i dp_i + U_i dp_{i+1} = b_i + (terms in the journal's dX, dY, dX', dY')

2.  Block elimination,  D_i <- D_i - M_i U_{i-1}, M_i = L_i D_{i-1}^-1, gives dp = p^ + Z (dX, dY, dX', dY').
    In a periodic film the last line closes the ring: its coupling fills one more block column T and row W.
3.  With the bearing forces F (four of them) known, the rotor is linear with constant coefficients,

        dv = v^ + shift S^-1 M^-1 F,   dx = b_x + shift dv
        S = I + shift M^-1 (C + Omega G) + shift^2 M^-1 K

    and F = F^ + Y (dX, dY, dX', dY') closes a 4 x 4 system.

The cost is linear in the number of lines along theta.  A line of eight columns costs as much as one column.
"""

from __future__ import annotations

import numpy as np

from .film import (
    AFTER,
    BEFORE,
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
    foil_coefficients,
)
from .kernels import FACTORISE, SOLVE, kernel
from .lines import LINE, fold_line, set_line
from .rates import (
    BEARINGS,
    JOURNAL,
    ROTOR_SIZE,
    ROTOR_STATE,
    UNSIGNED,
    bearing_views,
    film_workspace_size,
    force_lines,
    linearise_bearing,
    rotor_views,
)

JOURNAL_COORDINATES = 4  # dX, dY, dX', dY' of a bearing
FORCES = 2 * BEARINGS
_HEADER = 2  # shift and speed for which the rotor's inverse stands


@kernel()
def _film_views(integers, start, factors):
    """Pieces of the factors of one bearing from ``start``, and where they end.

    foil (1 + stations): 1/(1 + shift r), then c times the weights of the axial mean; ``right`` (rows, 3):
    what b_q of the neighbouring angles adds to b; ``lower`` -M, ``inverse`` D^-1, ``upper`` -D^-1 U,
    ``column`` -T, ``row`` -W (nodes, stations, stations); ``journal`` Z (rows, LINE), four columns used;
    ``force`` (2, rows): derivative of the force with p.
    """
    nodes, stations = integers[NODES], integers[STATIONS]
    rows, block = nodes * stations, nodes * stations * stations
    a = start + 1 + stations
    b = a + 3 * rows
    c = b + 5 * block
    d = c + rows * LINE
    e = d + 2 * rows
    return (
        factors[start:a],
        factors[a:b].reshape(rows, 3),
        factors[b:c].reshape(5, nodes, stations, stations),
        factors[c:d],
        factors[d:e].reshape(2, rows),
        e,
    )


LOWER, INVERSE, UPPER, COLUMN, ROW = range(5)  # of the blocks above


@kernel()
def _closing_views(size, start, factors):
    """S^-1, -shift S^-1 M^-1 K (size, size), shift S^-1 M^-1 at the journals (size, 4), and the closing 4 x 4
    matrices: force response to the journals' displacements, to their velocities, and the inverse.
    """
    a = start + _HEADER
    b = a + size * size
    c = b + size * size
    d = c + FORCES * size
    return (
        factors[start:a],
        factors[a:b].reshape(size, size),
        factors[b:c].reshape(size, size),
        factors[c:d].reshape(size, FORCES),
        factors[d : d + 3 * FORCES * FORCES].reshape(3, FORCES, FORCES),
    )


def factors_size(rotor_size: int, grids: list[tuple[int, int]]) -> int:
    """Doubles that the factors of bearings with (nodes, stations) on a rotor of that size need."""
    films = sum(1 + stations + nodes * stations * (3 + 5 * stations + LINE + 2) for nodes, stations in grids)
    return films + _HEADER + 2 * rotor_size**2 + FORCES * rotor_size + 3 * FORCES**2


def workspace_size(state_size: int, rotor_size: int, nodes: int, stations: int) -> int:
    """Scratch doubles that ``machine_factorise`` and ``machine_solve`` need for such a bearing."""
    scratch = max(state_size + film_workspace_size(nodes, stations), 8 * stations**2)
    factorise = FORCES * (LINE + FORCES) + nodes * stations * (HERE + stations) + scratch
    return max(factorise, (FORCES + max(stations, rotor_size + FORCES)) * LINE)


@kernel(error_model="numpy", inline="always")
def _product(n, a, b, sign, out):
    for i in range(n):
        for j in range(n):
            total = 0.0
            for k in range(n):
                total += a[i, k] * b[k, j]
            out[i, j] += sign * total


@kernel(error_model="numpy")
def _multiply_add(a, b, sign, out):
    """out += sign a b for small square matrices, ``out`` another one than a and b."""
    n = a.shape[0]
    if n == 2:  # the compiler unrolls what it knows the size of
        _product(2, a, b, sign, out)
    elif n == 3:
        _product(3, a, b, sign, out)
    elif n == 4:
        _product(4, a, b, sign, out)
    else:
        _product(n, a, b, sign, out)


@kernel(error_model="numpy", inline="always")
def _gauss_jordan(n, matrix, out):
    for i in range(n):
        for j in range(n):
            out[i, j] = 1.0 if i == j else 0.0
    for column in range(n):
        scale = 1.0 / matrix[column, column]
        for j in range(n):
            matrix[column, j] *= scale
            out[column, j] *= scale
        for i in range(n):
            if i != column:
                factor = matrix[i, column]
                for j in range(n):
                    matrix[i, j] -= factor * matrix[column, j]
                    out[i, j] -= factor * out[column, j]


@kernel(error_model="numpy")
def _invert(matrix, out):
    """Gauss-Jordan elimination of a small matrix, which is destroyed.

    Without exchange of rows: the diagonal blocks of I - shift J are dominated by 1 and by conduction.
    """
    n = matrix.shape[0]
    if n == 2:
        _gauss_jordan(2, matrix, out)
    elif n == 3:
        _gauss_jordan(3, matrix, out)
    elif n == 4:
        _gauss_jordan(4, matrix, out)
    else:
        _gauss_jordan(n, matrix, out)


@kernel(error_model="numpy")
def _film_blocks(terms, shift, foil, nodes, stations, node, blocks):
    """L_i, D_i, U_i of one axial line into ``blocks`` (3, stations, stations)."""
    for j in range(stations):
        row = j * nodes + node
        before, after = -shift * terms[THICKNESS_BEFORE, row], -shift * terms[THICKNESS_AFTER, row]
        here = -shift * terms[THICKNESS_HERE, row] - terms[THICKNESS_RATE, row]
        for k in range(stations):
            by_pressure = foil[1 + k]  # dq by dp_k; d(dq/dtau) is that over shift
            blocks[0, j, k] = before * by_pressure
            blocks[1, j, k] = here * by_pressure - shift * terms[HERE + k, row]
            blocks[2, j, k] = after * by_pressure
        blocks[0, j, j] -= shift * terms[BEFORE, row]
        blocks[1, j, j] += 1.0
        blocks[2, j, j] -= shift * terms[AFTER, row]


@kernel(error_model="numpy")
def _eliminate(terms, shift, foil, integers, work, blocks):
    """Block elimination along theta into ``blocks`` (LOWER, INVERSE, UPPER, COLUMN, ROW)."""
    nodes, stations, periodic = integers[NODES], integers[STATIONS], integers[PERIODIC] == 1
    matrices = work[: 8 * stations * stations].reshape(8, stations, stations)
    # Of a periodic film: the last line, and what couples line i to it (column) and it to line i (row).
    own, seam, column, row = matrices[:3], matrices[3:6], matrices[6], matrices[7]
    _film_blocks(terms, shift, foil, nodes, stations, nodes - 1, seam)
    row[:, :] = seam[2]
    count = nodes - 1 if periodic else nodes
    for i in range(count):
        _film_blocks(terms, shift, foil, nodes, stations, i, own)
        lower, inverse, upper = blocks[LOWER, i], blocks[INVERSE, i], blocks[UPPER, i]
        lower[:, :] = 0.0
        upper[:, :] = 0.0
        if i == 0:
            column[:, :] = own[0]
        else:
            # M_i = L_i D_{i-1}^-1,   D_i <- D_i - L_i (D_{i-1}^-1 U_{i-1})
            _multiply_add(own[0], blocks[INVERSE, i - 1], -1.0, lower)
            _multiply_add(own[0], blocks[UPPER, i - 1], 1.0, own[1])
            if periodic:
                own[0, :, :] = column
                column[:, :] = 0.0
                _multiply_add(lower, own[0], 1.0, column)
        _invert(own[1], inverse)
        if periodic:
            if i == count - 1:  # the neighbour of the last line on both ways
                column += own[2]
                row += seam[0]
            else:
                _multiply_add(inverse, own[2], -1.0, upper)
            # T_i = D_i^-1 column,   W_i = row D_i^-1
            blocks[COLUMN, i] = 0.0
            blocks[ROW, i] = 0.0
            _multiply_add(inverse, column, -1.0, blocks[COLUMN, i])
            _multiply_add(row, inverse, -1.0, blocks[ROW, i])
            _multiply_add(row, blocks[COLUMN, i], 1.0, seam[1])
            own[0, :, :] = row
            row[:, :] = 0.0
            _multiply_add(own[0], upper, 1.0, row)
        else:
            _multiply_add(inverse, own[2], -1.0, upper)
    if periodic:
        _invert(seam[1], blocks[INVERSE, count])


@kernel(error_model="numpy")
def _solve_film(blocks, integers, work, lines):
    """Pressures of a bearing with its foil eliminated and its journal at rest, in place; ``lines`` starts
    with the pressures, ``work`` holds ``stations`` lines.
    """
    nodes, stations, w = UNSIGNED(integers[NODES]), UNSIGNED(integers[STATIONS]), UNSIGNED(LINE)
    one, block, step = UNSIGNED(1), stations * stations, nodes * w
    periodic = integers[PERIODIC] == 1
    last = (nodes - one) * w
    count = nodes - UNSIGNED(periodic)
    lower, inverse = blocks[LOWER].reshape(nodes * block), blocks[INVERSE].reshape(nodes * block)
    upper, column = blocks[UPPER].reshape(nodes * block), blocks[COLUMN].reshape(nodes * block)
    row = blocks[ROW].reshape(nodes * block)
    for i in range(count):
        here = i * w
        for j in range(stations):
            of, to = i * block + j * stations, here + j * step
            if i > 0:  # b_i <- b_i - M_i b_{i-1}
                fold_line(lines, to, lines, to, lower, of, lines, here - w, step, stations)
        if periodic:  # b_last <- b_last - W_i b_i
            for j in range(stations):
                of, to = i * block + j * stations, last + j * step
                fold_line(lines, to, lines, to, row, of, lines, here, step, stations)
    for back in range(nodes):
        node = nodes - one - back
        here = node * w
        for j in range(stations):
            set_line(work, j * w, (1.0,), lines, (here + j * step,))
            set_line(lines, here + j * step, (0.0,), work, (j * w,))
        for j in range(stations):
            # x_i = D_i^-1 b_i - (D_i^-1 U_i) x_{i+1} - T_i x_last
            of, to = node * block + j * stations, here + j * step
            fold_line(lines, to, lines, to, inverse, of, work, UNSIGNED(0), w, stations)
            if node + one < count:
                fold_line(lines, to, lines, to, upper, of, lines, here + w, step, stations)
            if periodic and node < count:
                fold_line(lines, to, lines, to, column, of, lines, last, step, stations)


@kernel(error_model="numpy")
def _solve_bearing(views, integers, work, lines, force):
    """Pressures and gas force (2 lines) of a bearing whose journal is at rest; foil displacements are left at
    b_q / (1 + shift r).
    """
    foil, right, blocks, _, gradient, _ = views
    nodes, stations, w = UNSIGNED(integers[NODES]), UNSIGNED(integers[STATIONS]), UNSIGNED(LINE)
    one, displacement = UNSIGNED(1), stations * nodes * w
    for i in range(nodes):
        set_line(lines, displacement + i * w, (foil[0],), lines, (displacement + i * w,))
    for j in range(stations):
        for i in range(nodes):
            r, here = j * nodes + i, displacement + i * w
            # the factor of a neighbour that is not there is zero
            before = here - w if i > 0 else here + (nodes - one) * w
            after = here + w if i + one < nodes else displacement
            factors = (1.0, right[r, 0], right[r, 1], right[r, 2])
            set_line(lines, r * w, factors, lines, (r * w, before, here, after))
    _solve_film(blocks, integers, work, lines)
    force_lines(lines, gradient, force)


@kernel(error_model="numpy")
def _move_journal(views, integers, journal, lines):
    """Add what the journal's motion (4 lines) does to the pressures, then the pressures' part of the foil
    displacements.
    """
    foil, _, _, through_journal, _, _ = views
    nodes, stations, w = UNSIGNED(integers[NODES]), UNSIGNED(integers[STATIONS]), UNSIGNED(LINE)
    one, four, displacement = UNSIGNED(1), UNSIGNED(JOURNAL_COORDINATES), stations * nodes * w
    for r in range(stations * nodes):
        fold_line(lines, r * w, lines, r * w, through_journal, r * w, journal, UNSIGNED(0), w, four)
    for i in range(nodes):
        to = displacement + i * w
        fold_line(lines, to, lines, to, foil, one, lines, i * w, nodes * w, stations)


@kernel(error_model="numpy")
def _fill_right_sides(terms, shift, relaxation, scale, integers, arrays, views):
    """What b_q and the journal's coordinates are multiplied by (see ``_film_views``)."""
    nodes, stations = integers[NODES], integers[STATIONS]
    _, right, _, journal, _, _ = views
    journal[:] = 0.0
    edge = integers[PERIODIC] == 0
    for r in range(nodes * stations):
        i = r % nodes
        before, here = terms[THICKNESS_BEFORE, r], terms[THICKNESS_HERE, r]
        after, rate = terms[THICKNESS_AFTER, r], terms[THICKNESS_RATE, r]
        right[r, 0] = 0.0 if edge and i == 0 else shift * before
        right[r, 1] = shift * (here - relaxation * rate)
        right[r, 2] = 0.0 if edge and i == nodes - 1 else shift * after
        for k in range(2):  # dh = -dX cos - dY sin
            trig = arrays[k * (nodes + 2) : (k + 1) * (nodes + 2)]
            place = before * trig[i] + here * trig[i + 1] + after * trig[i + 2]
            journal[r * LINE + k] = -shift * scale * place
            journal[r * LINE + 2 + k] = -shift * scale * rate * trig[i + 1]


@kernel()
def _bearing_weights(integers, arrays):
    """Weights of the axial mean."""
    return arrays[2 * integers[NODES] + 4 + integers[STATIONS] * (integers[STATIONS] + 1) :]


@kernel(error_model="numpy")
def _factorise_bearing(phase, state, parameters, shift, bearing, constants, layout, work, views, response):
    """Factors of one film; ``response`` (2 lines): gas force by the journal's X, Y, dX/dtau, dY/dtau."""
    integers, scalars, arrays, clearance = bearing_views(bearing, constants, layout)
    rows = integers[NODES] * integers[STATIONS]
    count = rows * (HERE + integers[STATIONS])
    terms, work = work[:count].reshape(HERE + integers[STATIONS], rows), work[count:]
    foil, _, blocks, journal, force, _ = views
    linearise_bearing(phase, state, parameters, bearing, constants, layout, work, terms, force)
    flexibility, relaxation = foil_coefficients(parameters, integers, scalars)
    foil[0] = 1.0 / (1.0 + shift * relaxation)
    foil[1:] = shift * flexibility * foil[0] * _bearing_weights(integers, arrays)[: integers[STATIONS]]
    _fill_right_sides(terms, shift, relaxation, 1.0 / clearance, integers, arrays, views)
    _eliminate(terms, shift, foil, integers, work, blocks)
    _solve_film(blocks, integers, work, journal)
    force_lines(journal, force, response)


@kernel()
def _invert_if_finite(matrix, inverse):
    """The inverse, or NaN where the equations have left their domain: the solver of the stage sees that."""
    inverse[:, :] = np.nan
    if np.isfinite(np.sum(matrix)):
        inverse[:, :] = np.linalg.inv(matrix)


@kernel()
def _factorise_rotor(shift, speed, constants, layout, start, factors):
    """The rotor's constant matrices, unless they already stand for this shift and speed."""
    size = layout[ROTOR_SIZE]
    header, inverse, flexible, compliance, _ = _closing_views(size, start, factors)
    if header[0] == shift and header[1] == speed:
        return
    header[0], header[1] = shift, speed
    stiffness, damping, gyroscopic, influence, _ = rotor_views(constants, layout)
    resistance = np.eye(size) + shift * (damping + speed * gyroscopic) + shift * shift * stiffness
    _invert_if_finite(resistance, inverse)
    flexible[:, :] = -shift * (inverse @ stiffness)
    compliance[:, :] = shift * (inverse @ influence)


@kernel(FACTORISE)
def machine_factorise(phase, state, parameters, shift, constants, layout, work, factors):
    """Factors of I - shift J(phase, state) for ``machine_solve``; ``factors`` start as zeros."""
    size, offset = layout[ROTOR_SIZE], 0
    response = work[: FORCES * LINE]
    matrix, scratch = (
        work[FORCES * LINE : FORCES * (LINE + FORCES)].reshape(FORCES, FORCES),
        work[FORCES * (LINE + FORCES) :],
    )
    for bearing in range(BEARINGS):
        integers, _, _, _ = bearing_views(bearing, constants, layout)
        views = _film_views(integers, offset, factors)
        own = response[2 * bearing * LINE : 2 * (bearing + 1) * LINE]
        _factorise_bearing(phase, state, parameters, shift, bearing, constants, layout, scratch, views, own)
        offset = views[5]
    _factorise_rotor(shift, parameters[SPEED], constants, layout, offset, factors)
    _, _, _, compliance, closing = _closing_views(size, offset, factors)
    # F = F^ + Y_x (b_x + shift v) + Y_v v,   v = v^ + compliance F
    closing[:, :, :] = 0.0
    for i in range(FORCES):
        bearing = i // 2
        matrix[i, :] = 0.0
        matrix[i, i] = 1.0
        for k in range(2):
            by_place, by_velocity = response[i * LINE + k], response[i * LINE + 2 + k]
            closing[0, i, 2 * bearing + k] = by_place
            closing[1, i, 2 * bearing + k] = shift * by_place + by_velocity
            for j in range(FORCES):
                dof = layout[JOURNAL + bearing] + k
                matrix[i, j] -= closing[1, i, 2 * bearing + k] * compliance[dof, j]
    _invert_if_finite(matrix, closing[2])


@kernel(error_model="numpy")
def _solve_rotor(views, layout, lines, force, work):
    """Rotor displacements and velocities in place, from the gas forces (4 lines) with the journals at
    rest.
    """
    header, inverse, flexible, compliance, closing = views
    size, w, four = UNSIGNED(layout[ROTOR_SIZE]), UNSIGNED(LINE), UNSIGNED(FORCES)
    position = UNSIGNED(layout[ROTOR_STATE]) * w
    velocity = position + size * w
    free, total = work[: layout[ROTOR_SIZE] * LINE], work[layout[ROTOR_SIZE] * LINE :]
    by_velocity, by_position = inverse.reshape(size * size), flexible.reshape(size * size)
    pushed, matrix = compliance.reshape(size * four), closing.reshape(UNSIGNED(3) * four * four)
    for i in range(size):  # v^ = S^-1 b_v - shift S^-1 M^-1 K b_x
        of, to = i * size, i * w
        set_line(free, to, (0.0,), lines, (position,))
        fold_line(free, to, free, to, by_velocity, of, lines, velocity, w, size)
        fold_line(free, to, free, to, by_position, of, lines, position, w, size)
    for i in range(four):  # F^ + Y_x b_x + (shift Y_x + Y_v) v^
        of, to = i * four, i * w
        bearing = i // UNSIGNED(2)
        dof, k = UNSIGNED(layout[JOURNAL + bearing]) * w, bearing + bearing
        fold_line(force, to, force, to, matrix, of + k, lines, position + dof, w, UNSIGNED(2))
        fold_line(force, to, force, to, matrix, (four + i) * four + k, free, dof, w, UNSIGNED(2))
    for i in range(four):
        set_line(total, i * w, (0.0,), force, (i * w,))
        of = (four + four + i) * four
        fold_line(total, i * w, total, i * w, matrix, of, force, UNSIGNED(0), w, four)
    for i in range(size):  # v = v^ + compliance F,   x = b_x + shift v
        to = velocity + i * w
        fold_line(lines, to, free, i * w, pushed, i * four, total, UNSIGNED(0), w, four)
        set_line(lines, position + i * w, (1.0, header[0]), lines, (position + i * w, to))


@kernel(SOLVE)
def machine_solve(factors, constants, layout, work, lines):
    """lines <- (I - shift J)^-1 lines for LINE columns; ``lines`` (size * LINE,) holds them row by row."""
    force, journal, scratch = work[: FORCES * LINE], work[: FORCES * LINE], work[FORCES * LINE :]
    offset = 0
    for bearing in range(BEARINGS):
        integers, _, _, _ = bearing_views(bearing, constants, layout)
        views, own = _film_views(integers, offset, factors), lines[integers[PRESSURE] * LINE :]
        at = 2 * bearing * LINE
        _solve_bearing(views, integers, scratch, own, force[at : at + 2 * LINE])
        offset = views[5]
    _solve_rotor(_closing_views(layout[ROTOR_SIZE], offset, factors), layout, lines, force, scratch)
    offset = 0
    for bearing in range(BEARINGS):
        integers, _, _, _ = bearing_views(bearing, constants, layout)
        views, own = _film_views(integers, offset, factors), lines[integers[PRESSURE] * LINE :]
        place = (layout[ROTOR_STATE] + layout[JOURNAL + bearing]) * LINE
        velocity = place + layout[ROTOR_SIZE] * LINE
        journal[: 2 * LINE] = lines[place : place + 2 * LINE]
        journal[2 * LINE :] = lines[velocity : velocity + 2 * LINE]
        _move_journal(views, integers, journal, own)
        offset = views[5]
