"""The linear systems of an implicit step, (I - shift J) x = b, factored once and solved for lanes of columns.

J is the Jacobian of ``rates``.  Pressures of one axial line couple to the neighbouring lines only, foil
displacements to the pressures at their own angle, and the two films to the rotor only through the journals:

1.  The foil displacements dq_i = b_q/(1 + shift r) + c w.dp_i,  c = shift a/(1 + shift r), with w.dp_i the
    axial mean and a, r as in ``film``, are substituted into the film equations. These become block
    tridiagonal along theta with blocks of stations x stations:

        L_i dp_{i-1} + D_i dp_i + U_i dp_{i+1} = b_i + (terms in the journal's dX, dY, dX', dY')

2.  Block elimination,  D_i <- D_i - M_i U_{i-1}, M_i = L_i D_{i-1}^-1, gives dp = p^ + Z (dX, dY, dX', dY'),
    where p^ is the solution with the journal at rest. In a periodic film the last line is coupled to the
    first: this fills one more block column T and block row W.
3.  For given bearing forces F (four of them) the rotor is linear with constant coefficients,

        dv = v^ + shift S^-1 M^-1 F,   dx = b_x + shift dv
        S = I + shift M^-1 (C + Omega G) + shift^2 M^-1 K

    where v^ is the solution without forces. With F = F^ + Y (dX, dY, dX', dY'), F^ the force at p^, this
    gives a 4 x 4 system for F: the closing system.

The cost is linear in the number of lines along theta.  LANES columns cost as much as one.

The factors lie one after another, with m stations, r = nodes * m rows and n = ROTOR_SIZE:

    bearing 1 | foil (1 + m) | right (r, 3) | blocks (5, nodes, m, m) | journal (r, LANES) | force (2, r)
    bearing 2 | the same
    rotor     | header (2) | inverse (n, n) | flexible (n, n) | compliance (n, 4) | closing (3, 4, 4)
"""

from __future__ import annotations

from typing import Any, NamedTuple

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
    film_layout,
    foil_coefficients,
)
from .kernels import FACTORISE, SOLVE, assign, kernel
from .lanes import LANES, accumulate_lanes, set_lanes
from .rates import (
    BEARINGS,
    JOURNAL,
    ROTOR_SIZE,
    ROTOR_STATE,
    UNSIGNED,
    bearing_views,
    film_workspace_size,
    force_lanes,
    linearise_bearing,
    rotor_views,
)

JOURNAL_COORDINATES = 4  # dX, dY, dX', dY' of a bearing
FORCES = 2 * BEARINGS
_HEADER = 2  # the shift and the speed that the rotor's factors belong to


class FilmFactors(NamedTuple):
    """Factors of one bearing, and the offset at which they end.

    ``foil``: 1/(1 + shift r), then c times the weights of the axial mean; ``right``: weights in b of b_q at
    the node before, here and after; ``blocks``: LOWER -M, INVERSE D^-1, UPPER -D^-1 U, COLUMN -T, ROW -W;
    ``journal``: Z, flat, of which four columns are used; ``force``: derivative of the force with p.
    """

    foil: Any
    right: Any
    blocks: Any
    journal: Any
    force: Any
    end: Any


LOWER, INVERSE, UPPER, COLUMN, ROW = range(5)


@kernel()
def _film_factors(integers, start, factors):
    """Views of the factors of one bearing from ``start``."""
    nodes, stations = integers[NODES], integers[STATIONS]
    rows, block = nodes * stations, nodes * stations * stations
    a = start + 1 + stations
    b = a + 3 * rows
    c = b + 5 * block
    d = c + rows * LANES
    e = d + 2 * rows
    return FilmFactors(
        factors[start:a],
        factors[a:b].reshape(rows, 3),
        factors[b:c].reshape(5, nodes, stations, stations),
        factors[c:d],
        factors[d:e].reshape(2, rows),
        e,
    )


class RotorFactors(NamedTuple):
    """Factors of the rotor.

    ``header``: shift and speed that they belong to; ``inverse``: S^-1; ``flexible``: -shift S^-1 M^-1 K;
    ``compliance``: shift S^-1 M^-1 at the journals; ``closing``: three 4 x 4 matrices, the response of the
    forces to the journals' displacements, to their velocities with dx = shift dv, and the inverse of the
    closing system.
    """

    header: Any
    inverse: Any
    flexible: Any
    compliance: Any
    closing: Any


@kernel()
def _rotor_factors(size, start, factors):
    """Views of the factors of the rotor from ``start``."""
    a = start + _HEADER
    b = a + size * size
    c = b + size * size
    d = c + FORCES * size
    return RotorFactors(
        factors[start:a],
        factors[a:b].reshape(size, size),
        factors[b:c].reshape(size, size),
        factors[c:d].reshape(size, FORCES),
        factors[d : d + 3 * FORCES * FORCES].reshape(3, FORCES, FORCES),
    )


def factors_size(rotor_size: int, grids: list[tuple[int, int]]) -> int:
    """Doubles that the factors of bearings with (nodes, stations) on a rotor of that size need."""
    films = sum(1 + stations + nodes * stations * (3 + 5 * stations + LANES + 2) for nodes, stations in grids)
    return films + _HEADER + 2 * rotor_size**2 + FORCES * rotor_size + 3 * FORCES**2


def workspace_size(state_size: int, rotor_size: int, nodes: int, stations: int) -> int:
    """Scratch doubles that ``machine_factorise`` and ``machine_solve`` need for such a bearing."""
    scratch = max(state_size + film_workspace_size(nodes, stations), 8 * stations**2)
    factorise = FORCES * (LANES + FORCES) + nodes * stations * (HERE + stations) + scratch
    return max(factorise, (FORCES + max(stations, rotor_size + FORCES)) * LANES)


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
    """out += sign a b for small square matrices; ``out`` must not be a or b."""
    n = a.shape[0]
    if n == 2:  # the compiler unrolls loops of known length
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
    """out = matrix^-1 by Gauss-Jordan elimination; ``matrix`` is destroyed.

    Rows are not exchanged: the diagonal blocks of I - shift J are dominated by 1 and by conduction.
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
            by_pressure = foil[1 + k]  # derivative of q with p_k; that of dq/dtau is 1/shift times this
            blocks[0, j, k] = before * by_pressure
            blocks[1, j, k] = here * by_pressure - shift * terms[HERE + k, row]
            blocks[2, j, k] = after * by_pressure
        blocks[0, j, j] -= shift * terms[BEFORE, row]
        blocks[1, j, j] += 1.0
        blocks[2, j, j] -= shift * terms[AFTER, row]


@kernel(error_model="numpy")
def _copy(matrix, out):
    """out = matrix, without the checks of numba's own assignment, which take long to compile."""
    for i in range(out.shape[0]):
        for j in range(out.shape[1]):
            out[i, j] = matrix[i, j]


@kernel(error_model="numpy")
def _eliminate(terms, shift, foil, integers, work, blocks):
    """Block elimination along theta into ``blocks`` (LOWER, INVERSE, UPPER, COLUMN, ROW)."""
    nodes, stations, periodic = integers[NODES], integers[STATIONS], integers[PERIODIC] == 1
    matrices = work[: 8 * stations * stations].reshape(8, stations, stations)
    # For a periodic film: blocks of the last line (seam), coupling of line i to it (column), of it to line i
    # (row).
    own, seam, column, row = matrices[:3], matrices[3:6], matrices[6], matrices[7]
    _film_blocks(terms, shift, foil, nodes, stations, nodes - 1, seam)
    _copy(seam[2], row)
    count = nodes - 1 if periodic else nodes
    for i in range(count):
        _film_blocks(terms, shift, foil, nodes, stations, i, own)
        lower, inverse, upper = blocks[LOWER, i], blocks[INVERSE, i], blocks[UPPER, i]
        lower[:, :] = 0.0
        upper[:, :] = 0.0
        if i == 0:
            _copy(own[0], column)
        else:
            # M_i = L_i D_{i-1}^-1,   D_i <- D_i - L_i (D_{i-1}^-1 U_{i-1})
            _multiply_add(own[0], blocks[INVERSE, i - 1], -1.0, lower)
            _multiply_add(own[0], blocks[UPPER, i - 1], 1.0, own[1])
            if periodic:
                _copy(column, own[0])
                column[:, :] = 0.0
                _multiply_add(lower, own[0], 1.0, column)
        _invert(own[1], inverse)
        if periodic:
            if i == count - 1:  # this line is also a direct neighbour of the last one
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
            _copy(row, own[0])
            row[:, :] = 0.0
            _multiply_add(own[0], upper, 1.0, row)
        else:
            _multiply_add(inverse, own[2], -1.0, upper)
    if periodic:
        _invert(seam[1], blocks[INVERSE, count])


@kernel(error_model="numpy")
def _solve_film(blocks, integers, work, lanes):
    """Solve for the pressures of a bearing in place, with the foil eliminated and the journal at rest.

    ``lanes`` starts with the pressures, ``work`` has room for ``stations`` rows of lanes.
    """
    nodes, stations, w = UNSIGNED(integers[NODES]), UNSIGNED(integers[STATIONS]), UNSIGNED(LANES)
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
                accumulate_lanes(lanes, to, lanes, to, lower, of, lanes, here - w, step, stations)
        if periodic:  # b_last <- b_last - W_i b_i
            for j in range(stations):
                of, to = i * block + j * stations, last + j * step
                accumulate_lanes(lanes, to, lanes, to, row, of, lanes, here, step, stations)
    for back in range(nodes):
        node = nodes - one - back
        here = node * w
        for j in range(stations):
            set_lanes(work, j * w, (1.0,), lanes, (here + j * step,))
            set_lanes(lanes, here + j * step, (0.0,), work, (j * w,))
        for j in range(stations):
            # x_i = D_i^-1 b_i - (D_i^-1 U_i) x_{i+1} - T_i x_last
            of, to = node * block + j * stations, here + j * step
            accumulate_lanes(lanes, to, lanes, to, inverse, of, work, UNSIGNED(0), w, stations)
            if node + one < count:
                accumulate_lanes(lanes, to, lanes, to, upper, of, lanes, here + w, step, stations)
            if periodic and node < count:
                accumulate_lanes(lanes, to, lanes, to, column, of, lanes, last, step, stations)


@kernel(error_model="numpy")
def _solve_bearing(factors, integers, work, lanes, force):
    """Solve for the pressures and the gas force (2 rows) of a bearing whose journal is at rest.

    The foil displacements are left at b_q / (1 + shift r); ``_move_journal`` completes them.
    """
    foil, right = factors.foil, factors.right
    nodes, stations, w = UNSIGNED(integers[NODES]), UNSIGNED(integers[STATIONS]), UNSIGNED(LANES)
    one, displacement = UNSIGNED(1), stations * nodes * w
    for i in range(nodes):
        set_lanes(lanes, displacement + i * w, (foil[0],), lanes, (displacement + i * w,))
    for j in range(stations):
        for i in range(nodes):
            r, here = j * nodes + i, displacement + i * w
            # at a foil edge the weight of the missing neighbour is zero
            before = here - w if i > 0 else here + (nodes - one) * w
            after = here + w if i + one < nodes else displacement
            weights = (1.0, right[r, 0], right[r, 1], right[r, 2])
            set_lanes(lanes, r * w, weights, lanes, (r * w, before, here, after))
    _solve_film(factors.blocks, integers, work, lanes)
    force_lanes(lanes, factors.force, force)


@kernel(error_model="numpy")
def _move_journal(factors, integers, journal, lanes):
    """Add the effect of the journal's motion (4 rows) on the pressures, and of the pressures on the foil."""
    foil, through_journal = factors.foil, factors.journal
    nodes, stations, w = UNSIGNED(integers[NODES]), UNSIGNED(integers[STATIONS]), UNSIGNED(LANES)
    one, four, displacement = UNSIGNED(1), UNSIGNED(JOURNAL_COORDINATES), stations * nodes * w
    for r in range(stations * nodes):
        accumulate_lanes(lanes, r * w, lanes, r * w, through_journal, r * w, journal, UNSIGNED(0), w, four)
    for i in range(nodes):
        to = displacement + i * w
        accumulate_lanes(lanes, to, lanes, to, foil, one, lanes, i * w, nodes * w, stations)


@kernel(error_model="numpy")
def _fill_right_sides(terms, shift, relaxation, scale, integers, arrays, right, journal):
    """Fill ``right`` of ``FilmFactors``, and ``journal`` with the right-hand sides whose solution is Z."""
    nodes, stations, sine = integers[NODES], integers[STATIONS], film_layout(integers).sine
    journal[:] = 0.0
    edge = integers[PERIODIC] == 0
    for j in range(stations):
        for i in range(nodes):
            r = j * nodes + i
            here, rate = terms[THICKNESS_HERE, r], terms[THICKNESS_RATE, r]
            right[r, 0] = 0.0 if edge and i == 0 else shift * terms[THICKNESS_BEFORE, r]
            right[r, 1] = shift * (here - relaxation * rate)
            right[r, 2] = 0.0 if edge and i == nodes - 1 else shift * terms[THICKNESS_AFTER, r]
        for k in range(2):  # dh = -dX cos - dY sin
            trig = arrays[k * sine : (k + 1) * sine]
            for i in range(nodes):
                r = j * nodes + i
                place = terms[THICKNESS_BEFORE, r] * trig[i] + terms[THICKNESS_HERE, r] * trig[i + 1]
                place += terms[THICKNESS_AFTER, r] * trig[i + 2]
                journal[r * LANES + k] = -shift * scale * place
                journal[r * LANES + 2 + k] = -shift * scale * terms[THICKNESS_RATE, r] * trig[i + 1]


@kernel(error_model="numpy", inline="always")  # its one caller would compile all of it once more
def _factorise_bearing(phase, state, parameters, shift, bearing, constants, layout, work, factors, response):
    """Compute the factors of one film and the derivatives of its force with the journal's motion.

    ``response`` (2 rows of lanes) receives the derivatives with X, Y, dX/dtau, dY/dtau.
    """
    integers, scalars, arrays, clearance = bearing_views(bearing, constants, layout)
    rows = integers[NODES] * integers[STATIONS]
    count = rows * (HERE + integers[STATIONS])
    terms, work = work[:count].reshape(HERE + integers[STATIONS], rows), work[count:]
    foil, right, blocks, journal, force, _ = factors
    linearise_bearing(phase, state, parameters, bearing, constants, layout, work, terms, force)
    flexibility, relaxation = foil_coefficients(parameters, integers, scalars)
    foil[0] = 1.0 / (1.0 + shift * relaxation)
    weights = arrays[film_layout(integers).weights :]
    own = shift * flexibility * foil[0]
    for j in range(integers[STATIONS]):
        foil[1 + j] = own * weights[j]
    _fill_right_sides(terms, shift, relaxation, 1.0 / clearance, integers, arrays, right, journal)
    _eliminate(terms, shift, foil, integers, work, blocks)
    _solve_film(blocks, integers, work, journal)
    force_lanes(journal, force, response)


@kernel()
def _invert_if_finite(matrix, inverse):
    """Fill ``inverse``, with NaN if ``matrix`` is not finite: Newton's method of the stage then stops."""
    inverse[:, :] = np.nan
    if np.isfinite(np.sum(matrix)):
        _copy(np.linalg.inv(matrix), inverse)


@kernel()
def _factorise_rotor(shift, speed, constants, layout, start, factors):
    """Compute the rotor's factors, unless the stored ones belong to this shift and speed."""
    size = layout[ROTOR_SIZE]
    header, inverse, flexible, compliance, _ = _rotor_factors(size, start, factors)
    if header[0] == shift and header[1] == speed:
        return
    header[0], header[1] = shift, speed
    stiffness, damping, gyroscopic, influence, _ = rotor_views(constants, layout)
    resistance = np.empty((size, size))
    for i in range(size):
        for j in range(size):
            resistance[i, j] = 1.0 if i == j else 0.0
            resistance[i, j] += shift * (damping[i, j] + speed * gyroscopic[i, j])
            resistance[i, j] += shift * shift * stiffness[i, j]
    _invert_if_finite(resistance, inverse)
    by_stiffness, by_influence = inverse @ stiffness, inverse @ influence
    for i in range(size):
        for j in range(size):
            flexible[i, j] = -shift * by_stiffness[i, j]
        for j in range(FORCES):
            compliance[i, j] = shift * by_influence[i, j]


@kernel()
def _closing_workspace(work):
    """FORCES rows of lanes, a FORCES x FORCES matrix, and the rest."""
    a = FORCES * LANES
    b = a + FORCES * FORCES
    return work[:a], work[a:b].reshape(FORCES, FORCES), work[b:]


@kernel(FACTORISE, error_model="numpy")
def machine_factorise(phase, state, parameters, shift, constants, layout, work, factors):
    """Fill ``factors`` of I - shift J(phase, state) for ``machine_solve``.

    They must be zeros before the first call.
    """
    size, offset = layout[ROTOR_SIZE], np.int64(0)  # a literal 0 would compile all that takes it twice
    response, matrix, scratch = _closing_workspace(work)
    for bearing in range(BEARINGS):
        integers, _, _, _ = bearing_views(bearing, constants, layout)
        film = _film_factors(integers, offset, factors)
        own = response[2 * bearing * LANES : 2 * (bearing + 1) * LANES]
        _factorise_bearing(phase, state, parameters, shift, bearing, constants, layout, scratch, film, own)
        offset = film.end
    _factorise_rotor(shift, parameters[SPEED], constants, layout, offset, factors)
    _, _, _, compliance, closing = _rotor_factors(size, offset, factors)
    # F = F^ + Y_x (b_x + shift v) + Y_v v,   v = v^ + compliance F
    closing[:, :, :] = 0.0
    for i in range(FORCES):
        bearing = i // 2
        matrix[i, :] = 0.0
        matrix[i, i] = 1.0
        for k in range(2):
            by_place, by_velocity = response[i * LANES + k], response[i * LANES + 2 + k]
            closing[0, i, 2 * bearing + k] = by_place
            closing[1, i, 2 * bearing + k] = shift * by_place + by_velocity
            for j in range(FORCES):
                dof = layout[JOURNAL + bearing] + k
                matrix[i, j] -= closing[1, i, 2 * bearing + k] * compliance[dof, j]
    _invert_if_finite(matrix, closing[2])


@kernel(error_model="numpy")
def _solve_rotor(factors, layout, lanes, force, work):
    """Solve for rotor displacements and velocities in place.

    ``force`` (4 rows): the gas forces with the journals at rest.
    """
    header, inverse, flexible, compliance, closing = factors
    size, w, four = UNSIGNED(layout[ROTOR_SIZE]), UNSIGNED(LANES), UNSIGNED(FORCES)
    position = UNSIGNED(layout[ROTOR_STATE]) * w
    velocity = position + size * w
    free, total = work[: layout[ROTOR_SIZE] * LANES], work[layout[ROTOR_SIZE] * LANES :]
    by_velocity, by_position = inverse.reshape(size * size), flexible.reshape(size * size)
    pushed, matrix = compliance.reshape(size * four), closing.reshape(UNSIGNED(3) * four * four)
    for i in range(size):  # v^ = S^-1 b_v - shift S^-1 M^-1 K b_x
        of, to = i * size, i * w
        set_lanes(free, to, (0.0,), lanes, (position,))
        accumulate_lanes(free, to, free, to, by_velocity, of, lanes, velocity, w, size)
        accumulate_lanes(free, to, free, to, by_position, of, lanes, position, w, size)
    for i in range(four):  # F^ + Y_x b_x + (shift Y_x + Y_v) v^
        of, to = i * four, i * w
        bearing = i // UNSIGNED(2)
        dof, k = UNSIGNED(layout[JOURNAL + bearing]) * w, bearing + bearing
        accumulate_lanes(force, to, force, to, matrix, of + k, lanes, position + dof, w, UNSIGNED(2))
        accumulate_lanes(force, to, force, to, matrix, (four + i) * four + k, free, dof, w, UNSIGNED(2))
    for i in range(four):
        set_lanes(total, i * w, (0.0,), force, (i * w,))
        of = (four + four + i) * four
        accumulate_lanes(total, i * w, total, i * w, matrix, of, force, UNSIGNED(0), w, four)
    for i in range(size):  # v = v^ + compliance F,   x = b_x + shift v
        to = velocity + i * w
        accumulate_lanes(lanes, to, free, i * w, pushed, i * four, total, UNSIGNED(0), w, four)
        set_lanes(lanes, position + i * w, (1.0, header[0]), lanes, (position + i * w, to))


@kernel(SOLVE)
def machine_solve(factors, constants, layout, work, lanes):
    """lanes <- (I - shift J)^-1 lanes for LANES columns; ``lanes`` (size * LANES,) holds them row by row."""
    force, journal, scratch = work[: FORCES * LANES], work[: FORCES * LANES], work[FORCES * LANES :]
    offset = np.int64(0)
    for bearing in range(BEARINGS):
        integers, _, _, _ = bearing_views(bearing, constants, layout)
        film, own = _film_factors(integers, offset, factors), lanes[integers[PRESSURE] * LANES :]
        at = 2 * bearing * LANES
        _solve_bearing(film, integers, scratch, own, force[at : at + 2 * LANES])
        offset = film.end
    _solve_rotor(_rotor_factors(layout[ROTOR_SIZE], offset, factors), layout, lanes, force, scratch)
    offset = np.int64(0)
    for bearing in range(BEARINGS):
        integers, _, _, _ = bearing_views(bearing, constants, layout)
        film, own = _film_factors(integers, offset, factors), lanes[integers[PRESSURE] * LANES :]
        place = (layout[ROTOR_STATE] + layout[JOURNAL + bearing]) * LANES
        velocity = place + layout[ROTOR_SIZE] * LANES
        assign(journal[: 2 * LANES], lanes[place:])
        assign(journal[2 * LANES :], lanes[velocity:])
        _move_journal(film, integers, journal, own)
        offset = film.end
