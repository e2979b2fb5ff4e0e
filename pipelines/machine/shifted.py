"""The linear systems of an implicit step, (I - shift J) x = b, factored once and solved for lanes of columns.

J is the Jacobian of ``rates``.  Pressures of one axial line couple to R = ``REACH`` (1 or 2) lines on either
side only, foil displacements to the pressures at their own angle, and the two films to the rotor only through
the journals:

1.  The foil displacements dq_i = b_q/(1 + shift r) + c w.dp_i,  c = shift a/(1 + shift r), with w.dp_i the
    axial mean and a, r as in ``film``, are substituted into the film equations. These become block
    banded along theta with blocks of stations x stations:

        sum_o A_{i,o} dp_{i+o} = b_i + (terms in the journal's dX, dY, dX', dY'),    -R <= o <= R

2.  Block elimination with D_i = A_{i,0} after it, U_{i,o} = D_i^-1 A_{i,o}, M_{i,o} = A_{i,-o} D_{i-o}^-1,

        A_{i,o'-o} <- A_{i,o'-o} - A_{i,-o} U_{i-o,o'},    o = R ... 1,  o' = 1 ... R

    gives dp = p^ + Z (dX, dY, dX', dY'), where p^ is the solution with the journal at rest. In a periodic
    film the last R lines, the seam, couple to the first: this fills R more block columns T and block rows W.
3.  For given bearing forces F (four of them) the rotor is linear with constant coefficients,

        dv = v^ + shift S^-1 M^-1 F,   dx = b_x + shift dv
        S = I + shift M^-1 (C + Omega G) + shift^2 M^-1 K

    where v^ is the solution without forces. With F = F^ + Y (dX, dY, dX', dY'), F^ the force at p^, this
    gives a 4 x 4 system for F: the closing system.

The cost is linear in the number of lines along theta.  LANES columns cost as much as one.  Films that are
twins (``rates.are_twins``), as on a symmetric rotor, are eliminated once: the second takes the factors of the
first.

The factors lie one after another, with m stations, r = nodes * m rows, n = ROTOR_SIZE, and s = R lines of the
seam or none:

    bearing 1 | foil (1 + m) | right (r, 2 R + 1) | lower (nodes, m, R m) | upper (nodes, m, (R + 1) m)
              | column (nodes, m, s m) | row (nodes, s m, m) | seam (s m, s m)
              | journal (r, LANES) | force (2, r)
    bearing 2 | the same
    rotor     | header (2) | inverse (n, n) | flexible (n, n) | compliance (n, 4) | closing (3, 4, 4)

While a film is solved its pressures lie line by line, ``film[i * m + j]``, so that a line and its neighbours
are one run of rows.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from .film import (
    NODES,
    PERIODIC,
    PRESSURE,
    REACH,
    SPEED,
    STATIONS,
    THICKNESS,
    THICKNESS_RATE,
    WIDE_REACH,
    film_layout,
    foil_coefficients,
    term_rows,
)
from .inverse import invert
from .kernels import FACTORISE, SOLVE, assign, kernel
from .lanes import LANES, QUAD, accumulate_lanes, add_lanes, borrowed, multiply_quads, set_lanes
from .rates import (
    BEARINGS,
    JOURNAL,
    ROTOR_SIZE,
    ROTOR_STATE,
    UNSIGNED,
    are_twins,
    bearing_views,
    film_workspace_size,
    linearise_bearing,
    neighbours,
    rotor_views,
)

JOURNAL_COORDINATES = 4  # dX, dY, dX', dY' of a bearing
FORCES = 2 * BEARINGS
_HEADER = 2  # the shift and the speed that the rotor's factors belong to
# Blocks of scratch space of an elimination: A_{i,o} of a line, -T of a line, the seam and its copy.
_ELIMINATION_BLOCKS = (2 * WIDE_REACH + 1) + WIDE_REACH + 2 * WIDE_REACH**2


class FilmFactors(NamedTuple):
    """Offsets of the factors of one bearing, and of what follows.

    ``foil``: 1/(1 + shift r), then c times the weights of the axial mean; ``right``: weights in b of b_q at
    the nodes around; ``lower``: [-M_R ... -M_1] of a line; ``upper``: [D^-1, -U_1 ... -U_R]; ``column``: -T;
    ``row``: -W; ``seam``: inverse of the equations of the seam; ``journal``: Z, of which four columns are
    used; ``force``: derivative of the force with p, station by station.
    """

    foil: Any
    right: Any
    lower: Any
    upper: Any
    column: Any
    row: Any
    seam: Any
    journal: Any
    force: Any
    end: Any


@kernel()
def _seam_lines(integers):
    """Number of lines of the seam."""
    return integers[REACH] if integers[PERIODIC] == 1 else 0


@kernel()
def _film_factors(integers, start):
    """Offsets of the factors of one bearing from ``start``, unsigned as the sums of ``lanes`` need them."""
    m, reach, seams = UNSIGNED(integers[STATIONS]), UNSIGNED(integers[REACH]), UNSIGNED(_seam_lines(integers))
    one, rows = UNSIGNED(1), UNSIGNED(integers[NODES]) * m
    right = start + one + m
    lower = right + (reach + reach + one) * rows
    upper = lower + reach * m * rows
    column = upper + (reach + one) * m * rows
    row = column + seams * m * rows
    seam = row + seams * m * rows
    journal = seam + seams * m * seams * m
    force = journal + rows * UNSIGNED(LANES)
    return FilmFactors(start, right, lower, upper, column, row, seam, journal, force, force + rows + rows)


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
    first = np.int64(start)
    a = first + _HEADER
    b = a + size * size
    c = b + size * size
    d = c + FORCES * size
    return RotorFactors(
        factors[first:a],
        factors[a:b].reshape(size, size),
        factors[b:c].reshape(size, size),
        factors[c:d].reshape(size, FORCES),
        factors[d : d + 3 * FORCES * FORCES].reshape(3, FORCES, FORCES),
    )


def factors_size(rotor_size: int, bearings: list[NDArray[np.int64]]) -> int:
    """Doubles that the factors of bearings with these integers on a rotor of that size need."""
    films = sum(int(_film_factors(integers, UNSIGNED(0)).end) for integers in bearings)
    return films + _HEADER + 2 * rotor_size**2 + FORCES * rotor_size + 3 * FORCES**2


def workspace_size(state_size: int, rotor_size: int, integers: NDArray[np.int64]) -> int:
    """Scratch doubles that ``machine_factorise`` and ``machine_solve`` need for such a bearing."""
    nodes, stations, reach = (int(integers[k]) for k in (NODES, STATIONS, REACH))
    lines = (reach * stations + 1) * LANES
    scratch = max(state_size + film_workspace_size(integers), _ELIMINATION_BLOCKS * stations**2, lines)
    terms = nodes * stations * int(term_rows(reach, stations).count)
    factorise = FORCES * (LANES + FORCES) + terms + scratch
    films = state_size * LANES  # the pressures of both bearings line by line
    return max(factorise, FORCES * LANES + films + max(lines, (rotor_size + FORCES) * LANES))


# A small matrix is given by a flat array, the offset of its first entry and the distance of its rows: a view
# of it would take longer than the product.  Offsets and sizes are unsigned, as elsewhere.


@kernel(error_model="numpy", inline="always")
def _product(sizes, a, at_a, row_a, b, at_b, row_b, add, out, at, row):
    rows, inner, columns = sizes
    for i in range(rows):
        for j in range(columns):
            total = 0.0
            for k in range(inner):
                total += a[at_a + i * row_a + k] * b[at_b + k * row_b + j]
            to = at + i * row + j
            out[to] = out[to] + total if add else -total


@kernel(error_model="numpy")
def _multiply(sizes, a, at_a, row_a, b, at_b, row_b, add, out, at, row):
    """out <- out + a b if ``add``, else - a b; ``sizes``: rows of a, columns of a, columns of b.

    ``out`` must not overlap a or b.
    """
    rows, inner, columns = sizes
    two, three, four, six, quad = UNSIGNED(2), UNSIGNED(3), UNSIGNED(4), UNSIGNED(6), UNSIGNED(QUAD)
    if inner == quad and columns == quad:
        multiply_quads((0,), rows, a, at_a, row_a, b, at_b, row_b, add, out, at, row)
    elif inner == quad and columns == quad + quad:
        multiply_quads((0, 0), rows, a, at_a, row_a, b, at_b, row_b, add, out, at, row)
    # the compiler unrolls loops of known length
    elif sizes == (three, three, three):
        _product((three, three, three), a, at_a, row_a, b, at_b, row_b, add, out, at, row)
    elif sizes == (three, three, six):
        _product((three, three, six), a, at_a, row_a, b, at_b, row_b, add, out, at, row)
    elif sizes == (two, two, two):
        _product((two, two, two), a, at_a, row_a, b, at_b, row_b, add, out, at, row)
    elif sizes == (two, two, four):
        _product((two, two, four), a, at_a, row_a, b, at_b, row_b, add, out, at, row)
    else:
        _product(sizes, a, at_a, row_a, b, at_b, row_b, add, out, at, row)


@kernel(error_model="numpy", inline="always")
def _gauss_jordan(n, matrix, at, row, out, to, row_out):
    for i in range(n):
        for j in range(n):
            out[to + i * row_out + j] = 1.0 if i == j else 0.0
    for column in range(n):
        own, own_out = at + column * row, to + column * row_out
        scale = 1.0 / matrix[own + column]
        for j in range(n):
            matrix[own + j] *= scale
            out[own_out + j] *= scale
        for i in range(n):
            if i != column:
                other, other_out = at + i * row, to + i * row_out
                factor = matrix[other + column]
                for j in range(n):
                    matrix[other + j] -= factor * matrix[own + j]
                    out[other_out + j] -= factor * out[own_out + j]


@kernel(error_model="numpy")
def _invert(n, matrix, at, row, out, to, row_out):
    """out = matrix^-1 of size n by Gauss-Jordan elimination; ``matrix`` is destroyed.

    Rows are not exchanged: the diagonal blocks of I - shift J are dominated by 1 and by conduction.
    """
    if n == 3:
        _gauss_jordan(UNSIGNED(3), matrix, at, row, out, to, row_out)
    elif n == 2:
        _gauss_jordan(UNSIGNED(2), matrix, at, row, out, to, row_out)
    elif n == 4:
        _gauss_jordan(UNSIGNED(4), matrix, at, row, out, to, row_out)
    else:
        _gauss_jordan(n, matrix, at, row, out, to, row_out)


class _Sizes(NamedTuple):
    """Unsigned sizes of an elimination.

    Nodes, stations, R, lines of the seam and those before it; entries in a row of A_{i,-R} ... A_{i,R}, of
    lower and of upper.
    """

    nodes: Any
    m: Any
    reach: Any
    seams: Any
    count: Any
    band: Any
    below: Any
    above: Any


@kernel()
def _sizes(integers):
    nodes, m, reach = UNSIGNED(integers[NODES]), UNSIGNED(integers[STATIONS]), UNSIGNED(integers[REACH])
    seams, below = UNSIGNED(_seam_lines(integers)), reach * m
    return _Sizes(nodes, m, reach, seams, nodes - seams, below + below + m, below, below + m)


@kernel(error_model="numpy")
def _film_blocks(terms, shift, factors, foil, integers, node, band):
    """A_{i,-R} ... A_{i,R} of one axial line into ``band`` (stations, (2 R + 1) stations)."""
    nodes, m, reach, _, _, width, _, _ = _sizes(integers)
    at, first, one = term_rows(integers[REACH], integers[STATIONS]), UNSIGNED(THICKNESS), UNSIGNED(1)
    pressure, here = first + reach + reach + one, UNSIGNED(at.here)
    for j in range(m):
        row, own = j * nodes + node, j * width + reach * m
        for o in range(reach + reach + one):
            by_foil, to = -shift * terms[first + o, row], j * width + o * m
            if o == reach:
                by_foil -= terms[THICKNESS_RATE, row]
            for k in range(m):  # foil + 1 + k: dq/dp_k; that of dq/dtau is 1/shift times this
                band[to + k] = by_foil * factors[foil + one + k]
            if o != reach:
                band[to + j] -= shift * terms[pressure + o, row]
        band[own + j] += 1.0
        for k in range(m):
            band[own + k] -= shift * terms[here + k, row]


@kernel(error_model="numpy")
def _copy(rows, columns, source, at, row, out, to, row_out):
    for i in range(rows):
        for j in range(columns):
            out[to + i * row_out + j] = source[at + i * row + j]


@kernel(error_model="numpy")
def _begin_seam(terms, shift, integers, at, factors, band, seam):
    """Fill ``seam`` and the factors' ``row`` with the equations of the seam, before lines are eliminated."""
    nodes, m, reach, seams, count, width, below, _ = _sizes(integers)
    one = UNSIGNED(1)
    factors[at.column : at.seam] = 0.0
    seam[: below * below] = 0.0
    for s in range(seams):
        _film_blocks(terms, shift, factors, at.foil, integers, count + s, band)
        for o in range(reach + reach + one):
            other = (count + s + nodes + o - reach) % nodes
            if other < count:
                _copy(m, m, band, o * m, width, factors, at.row + (other * below + s * m) * m, m)
            else:
                _copy(m, m, band, o * m, width, seam, s * m * below + (other - count) * m, below)


@kernel(error_model="numpy")
def _couple_seam(i, integers, at, factors, band):
    """Write the blocks of line i that belong to the seam into the factors' ``column``."""
    nodes, m, reach, _, count, width, below, _ = _sizes(integers)
    for o in range(reach + reach + UNSIGNED(1)):
        other = (i + nodes + o - reach) % nodes
        if other >= count:
            to = at.column + i * m * below + (other - count) * m
            _copy(m, m, band, o * m, width, factors, to, below)


@kernel(error_model="numpy")
def _eliminate_line(i, integers, at, factors, band):
    """Eliminate the lines before line i from its equations ``band``, and compute its factors."""
    _, m, reach, seams, count, width, below, above = _sizes(integers)
    zero, one = UNSIGNED(0), UNSIGNED(1)
    square, wide, known = (m, m, m), (m, m, below), min(reach, i)
    for step in range(known):
        back = known - step
        own, pivot = (reach - back) * m, at.upper + (i - back) * m * above
        to = at.lower + i * m * below + own
        _multiply(square, band, own, width, factors, pivot, above, False, factors, to, below)
        _multiply(wide, band, own, width, factors, pivot + m, above, True, band, own + m, width)
        if seams > zero:
            pivot, to = at.column + (i - back) * m * below, at.column + i * m * below
            _multiply(wide, band, own, width, factors, pivot, below, True, factors, to, below)
    pivot = at.upper + i * m * above
    _invert(m, band, below, width, factors, pivot, above)
    ahead = min(reach, count - one - i)
    sizes = (m, m, ahead * m)
    _multiply(sizes, factors, pivot, above, band, below + m, width, False, factors, pivot + m, above)


@kernel(error_model="numpy")
def _eliminate_seam(i, integers, at, factors, spare, seam):
    """Eliminate line i from the equations of the seam."""
    _, m, reach, _, count, _, below, above = _sizes(integers)
    zero, one = UNSIGNED(0), UNSIGNED(1)
    pivot, column, row = at.upper + i * m * above, at.column + i * m * below, at.row + i * m * below
    _copy(m, below, factors, column, below, spare, zero, below)  # T = D^-1 column
    _multiply((m, m, below), factors, pivot, above, spare, zero, below, False, factors, column, below)
    _multiply((below, m, below), factors, row, m, factors, column, below, True, seam, zero, below)
    for offset in range(one, min(reach, count - one - i) + one):
        to, beside = row + offset * m * below, pivot + offset * m
        _multiply((below, m, m), factors, row, m, factors, beside, above, True, factors, to, m)
    _copy(below, m, factors, row, m, spare, zero, m)  # W = row D^-1
    _multiply((below, m, m), spare, zero, m, factors, pivot, above, False, factors, row, m)


@kernel(error_model="numpy")
def _eliminate(terms, shift, integers, work, at, factors):
    """Block elimination along theta into ``factors``, which are ``at`` these offsets."""
    _, m, _, seams, count, width, below, _ = _sizes(integers)
    zero, a = UNSIGNED(0), m * width
    b = a + m * below
    band, spare, seam = work[:a], work[a:b], work[b:]
    if seams > zero:
        _begin_seam(terms, shift, integers, at, factors, band, seam)
    for i in range(count):
        _film_blocks(terms, shift, factors, at.foil, integers, i, band)
        if seams > zero:
            _couple_seam(i, integers, at, factors, band)
        _eliminate_line(i, integers, at, factors, band)
        if seams > zero:
            _eliminate_seam(i, integers, at, factors, spare, seam)
    if seams > zero:
        _invert(below, seam, zero, below, factors, at.seam, below)


@kernel(error_model="numpy")
def _solve_film(factors, at, integers, work, film):
    """Solve for the pressures of a bearing in place, with the foil eliminated and the journal at rest.

    ``film`` holds them line by line, ``work`` has room for R stations + 1 rows of lanes.
    """
    _, m, reach, seams, count, _, below, above = _sizes(integers)
    one, first, w = UNSIGNED(1), UNSIGNED(0), UNSIGNED(LANES)
    line, zero, end, last = m * w, below * w, count * m * w, seams * m
    set_lanes(work, zero, (0.0,), film, (first,))
    for i in range(count):
        here, known = i * line, min(i, reach) * m
        if known > first:  # b_i <- b_i - M_{i,o} b_{i-o}
            for j in range(m):
                to, of = here + j * w, at.lower + (i * m + j + one) * below - known
                accumulate_lanes(film, to, film, to, factors, of, film, here - known * w, w, known)
        for k in range(last):  # b_seam <- b_seam - W_i b_i
            to, of = end + k * w, at.row + (i * last + k) * m
            accumulate_lanes(film, to, film, to, factors, of, film, here, w, m)
    for k in range(last):
        accumulate_lanes(work, k * w, work, zero, factors, at.seam + k * last, film, end, w, last)
    for k in range(last):
        set_lanes(film, end + k * w, (1.0,), work, (k * w,))
    for back in range(count):
        i = count - one - back
        here, known = i * line, (min(back, reach) + one) * m
        for j in range(m):  # x_i = D_i^-1 b_i - U_{i,o} x_{i+o} - T_i x_seam
            to, of = j * w, at.upper + (i * m + j) * above
            accumulate_lanes(work, to, work, zero, factors, of, film, here, w, known)
            if last > first:
                accumulate_lanes(
                    work, to, work, to, factors, at.column + (i * m + j) * last, film, end, w, last
                )
        for j in range(m):
            set_lanes(film, here + j * w, (1.0,), work, (j * w,))


@kernel(error_model="numpy")
def _film_force(film, factors, at, integers, force):
    """Write the rows dF_x and dF_y of a bearing into ``force``; ``film`` holds the pressures line by line."""
    nodes, m, w = UNSIGNED(integers[NODES]), UNSIGNED(integers[STATIONS]), UNSIGNED(LANES)
    force[:] = 0.0
    for j in range(m):
        for k in range(UNSIGNED(2)):
            of = at.force + (k * m + j) * nodes
            accumulate_lanes(force, k * w, force, k * w, factors, of, film, j * w, m * w, nodes)


@kernel(error_model="numpy")
def _solve_bearing(factors, at, integers, work, lanes, film, force):
    """Solve for the pressures ``film`` and the gas force (2 rows) of a bearing whose journal is at rest.

    The foil displacements in ``lanes`` are left at b_q / (1 + shift r); ``_move_journal`` completes them.
    """
    nodes, stations, w = UNSIGNED(integers[NODES]), UNSIGNED(integers[STATIONS]), UNSIGNED(LANES)
    one, reach, displacement = UNSIGNED(1), UNSIGNED(integers[REACH]), stations * nodes * w
    width = reach + reach + one
    for i in range(nodes):
        set_lanes(lanes, displacement + i * w, (factors[at.foil],), lanes, (displacement + i * w,))
    for j in range(stations):
        for i in range(nodes):
            r, to = j * nodes + i, (i * stations + j) * w
            right = at.right + r * width + reach  # beyond a foil edge the weights are zero
            before, after = neighbours(i, one, nodes)
            weights = (1.0, factors[right - one], factors[right], factors[right + one])
            places = (r * w, displacement + before * w, displacement + i * w, displacement + after * w)
            set_lanes(film, to, weights, lanes, places)
            for k in range(one + one, reach + one):
                before, after = neighbours(i, k, nodes)
                add_lanes(film, to, factors[right - k], lanes, displacement + before * w)
                add_lanes(film, to, factors[right + k], lanes, displacement + after * w)
    _solve_film(factors, at, integers, work, film)
    _film_force(film, factors, at, integers, force)


@kernel(error_model="numpy")
def _move_journal(factors, at, integers, journal, film, lanes):
    """Write ``film`` and the effect of the journal's motion (4 rows) to the pressures; complete the foil."""
    nodes, m, w = UNSIGNED(integers[NODES]), UNSIGNED(integers[STATIONS]), UNSIGNED(LANES)
    one, four, zero, displacement = UNSIGNED(1), UNSIGNED(JOURNAL_COORDINATES), UNSIGNED(0), m * nodes * w
    for j in range(m):
        for i in range(nodes):
            to, of = (j * nodes + i) * w, (i * m + j) * w
            accumulate_lanes(lanes, to, film, of, factors, at.journal + of, journal, zero, w, four)
    for i in range(nodes):
        to = displacement + i * w
        accumulate_lanes(lanes, to, lanes, to, factors, at.foil + one, lanes, i * w, nodes * w, m)


@kernel(error_model="numpy")
def _fill_right_sides(terms, shift, relaxation, scale, integers, arrays, right, journal):
    """Fill ``right`` of ``FilmFactors``, and ``journal`` with the right-hand sides whose solution is Z."""
    nodes, stations, reach = integers[NODES], integers[STATIONS], integers[REACH]
    sine, edge, width = film_layout(integers).sine, integers[PERIODIC] == 0, 2 * reach + 1
    journal[:] = 0.0
    for j in range(stations):
        for i in range(nodes):
            r, to = j * nodes + i, (i * stations + j) * LANES
            rate, cosine, sine_here = terms[THICKNESS_RATE, r], arrays[i + reach], arrays[sine + i + reach]
            x, y = 0.0, 0.0
            for k in range(width):  # dh = -dX cos - dY sin
                by_thickness, other = terms[THICKNESS + k, r], i + k - reach
                beyond = edge and (other < 0 or other >= nodes)
                right[r * width + k] = 0.0 if beyond else shift * by_thickness
                x += by_thickness * arrays[i + k]
                y += by_thickness * arrays[sine + i + k]
            right[r * width + reach] -= shift * relaxation * rate
            journal[to], journal[to + 1] = -shift * scale * x, -shift * scale * y
            journal[to + 2], journal[to + 3] = (
                -shift * scale * rate * cosine,
                -shift * scale * rate * sine_here,
            )


@kernel(error_model="numpy")
def _factorise_bearing(
    phase, state, parameters, shift, bearing, constants, layout, work, at, factors, response
):
    """Compute the factors of one film and the derivatives of its force with the journal's motion.

    ``response`` (2 rows of lanes) receives the derivatives with X, Y, dX/dtau, dY/dtau.
    """
    integers, scalars, arrays, clearance = bearing_views(bearing, constants, layout)
    stations = integers[STATIONS]
    rows, count = integers[NODES] * stations, term_rows(integers[REACH], stations).count
    terms, work = work[: count * rows].reshape(count, rows), work[count * rows :]
    foil, right = factors[at.foil : at.right], factors[at.right : at.lower]
    journal, force = factors[at.journal : at.force], factors[at.force : at.end].reshape(2, rows)
    linearise_bearing(phase, state, parameters, bearing, constants, layout, work, terms, force)
    flexibility, relaxation = foil_coefficients(parameters, integers, scalars)
    foil[0] = 1.0 / (1.0 + shift * relaxation)
    weights = arrays[film_layout(integers).weights :]
    own = shift * flexibility * foil[0]
    for j in range(stations):
        foil[1 + j] = own * weights[j]
    _fill_right_sides(terms, shift, relaxation, 1.0 / clearance, integers, arrays, right, journal)
    _eliminate(terms, shift, integers, work, at, factors)
    _solve_film(factors, at, integers, work, journal)
    _film_force(journal, factors, at, integers, response)


@kernel()
def _factorise_rotor(shift, speed, constants, layout, start, factors):
    """Compute the rotor's factors, unless the stored ones belong to this shift and speed."""
    size = layout[ROTOR_SIZE]
    header, inverse, flexible, compliance, _ = _rotor_factors(size, start, factors)
    if header[0] == shift and header[1] == speed:
        return
    header[0], header[1] = shift, speed
    stiffness, damping, gyroscopic, influence, _ = rotor_views(constants, layout)
    for i in range(size):
        for j in range(size):
            resistance = damping[i, j] + speed * gyroscopic[i, j] + shift * stiffness[i, j]
            flexible[i, j] = shift * resistance + (1.0 if i == j else 0.0)
    invert(flexible, inverse)
    flexible[:, :] = 0.0
    compliance[:, :] = 0.0
    for i in range(size):
        for k in range(size):
            factor = shift * inverse[i, k]
            for j in range(size):
                flexible[i, j] -= factor * stiffness[k, j]
            for j in range(FORCES):
                compliance[i, j] += factor * influence[k, j]


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
    state, parameters, constants = borrowed(state), borrowed(parameters), borrowed(constants)
    layout, work, factors = borrowed(layout), borrowed(work), borrowed(factors)
    size, offset = layout[ROTOR_SIZE], UNSIGNED(0)
    response, matrix, scratch = _closing_workspace(work)
    twins = are_twins(state, constants, layout)
    for bearing in range(BEARINGS):
        integers, _, _, _ = bearing_views(bearing, constants, layout)
        at, own = _film_factors(integers, offset), response[2 * bearing * LANES : 2 * (bearing + 1) * LANES]
        if bearing > 0 and twins:
            assign(factors[offset : at.end], factors[:offset])
            assign(own, response)
        else:
            _factorise_bearing(
                phase, state, parameters, shift, bearing, constants, layout, scratch, at, factors, own
            )
        offset = at.end
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
    invert(matrix, closing[2])


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
    factors, constants, layout = borrowed(factors), borrowed(constants), borrowed(layout)
    work, lanes = borrowed(work), borrowed(lanes)
    force, journal, films = work[: FORCES * LANES], work[: FORCES * LANES], work[FORCES * LANES :]
    scratch, offset = films[layout[ROTOR_STATE] * LANES :], UNSIGNED(0)
    for bearing in range(BEARINGS):
        integers, _, _, _ = bearing_views(bearing, constants, layout)
        at, first = _film_factors(integers, offset), integers[PRESSURE] * LANES
        own = force[2 * bearing * LANES : 2 * (bearing + 1) * LANES]
        _solve_bearing(factors, at, integers, scratch, lanes[first:], films[first:], own)
        offset = at.end
    _solve_rotor(_rotor_factors(layout[ROTOR_SIZE], offset, factors), layout, lanes, force, scratch)
    offset = UNSIGNED(0)
    for bearing in range(BEARINGS):
        integers, _, _, _ = bearing_views(bearing, constants, layout)
        at, first = _film_factors(integers, offset), integers[PRESSURE] * LANES
        place = (layout[ROTOR_STATE] + layout[JOURNAL + bearing]) * LANES
        velocity = place + layout[ROTOR_SIZE] * LANES
        assign(journal[: 2 * LANES], lanes[place:])
        assign(journal[2 * LANES :], lanes[velocity:])
        _move_journal(factors, at, integers, journal, films[first:], lanes[first:])
        offset = at.end
