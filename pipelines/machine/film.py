"""The gas film and the foil of one bearing: compiled rates and their derivatives.

With pressure p, film thickness h, foil displacement q, journal position X, Y, P = p^2 and film mobility
m = t_0/t_b (1 unless the bearings differ):

    d(p h)/dtau = 1/2 S + 1/4 m kappa^2 h^3 d^2P/dz^2                                                  (Eq. 1)
    S           = d/dtheta (1/2 m h^3 dP/dtheta - Omega p h)
    dp/dtau     = (d(p h)/dtau - p dh/dtau) / h                                                        (Eq. 2)
    h           = 1 - X cos(theta) - Y sin(theta) + q                                                  (Eq. 3)
    dq/dtau     = dq_r/dtau + a (p_m - 1) - r (q - q_r),   a = 1/c_f,  r = k_f/c_f                     (Eq. 8)

Here kappa = R / L_b, q_r is the displacement of the ring, p_m the axial mean of p, k_f and c_f are stiffness
and damping of the foil.

S_i is a difference of fluxes through the faces between nodes.  The narrow flux N takes h and dP/dtheta of a
face from the two nodes beside it, which makes schemes of second order, with backward convection of first:

    dtheta S_i = N_{i+1/2} - N_{i-1/2}

The scheme of fourth order has wide fluxes W, with h by (-1, 9, 9, -1)/16 and dtheta dP/dtheta by
(1, -27, 27, -1)/24 of four nodes, and uses N in the term that turns a difference into a derivative:

    dtheta S_i = W_{i+1/2} - W_{i-1/2} - (N_{i+3/2} - 3 N_{i+1/2} + 3 N_{i-1/2} - N_{i-3/2}) / 24

At the face beside a foil edge, W has h by (5, 15, -5, 1)/16 and dtheta dP/dtheta by (-23, 21, 3, -1)/24 from
the edge inwards, and the second difference of N is that of the next face, so that S beside the edge has no N.

Convection is linear in p h.  A row of S thus has ``reach`` = 1 or 2 neighbours on either side,

    dtheta S_i = sum_o conduction_{i,o} P_{i+o} - Omega convection_{i,o} (p h)_{i+o},   -reach <= o <= reach

Padded arrays along theta have ``reach`` more entries on either side: those of the opposite end of a periodic
film, or the foil-edge line (p = 1, the foil unloaded), repeated.  Pressures of a bearing are stored station
by station: ``p[j * nodes + i]``.  The constants of a bearing lie one after another,

    | scalars      | cosine | sine   | second_derivative   | side     | weights
      FILM_SCALARS   padded   padded   stations x stations   stations   stations
    | narrow        | convection
      2 reach + 2     3 (2 reach + 1)

and ``arrays`` are all but the scalars: cosine and sine of theta, d^2/dz^2 at the stations and what the side
pressure adds to it, the weights of the axial mean, the weights of N in dtheta S with a zero at either end,
and those of convection beside the first edge, elsewhere and beside the last edge.  ``film_layout`` has their
offsets.
"""

from __future__ import annotations

from typing import Any, NamedTuple

from pipelines.machine.kernels import kernel

from .ring import ring_axes_at, ring_displacement_at, ring_rate_at

# Clipping of the pressure in the force integral (Eq. 9).
FULL, GUMBEL, SMOOTH = 0, 1, 2

# Integers of a bearing: sizes and switches, then the offset of its unknowns in the state.
NODES, STATIONS, REACH, PERIODIC, CLIPPING, LOSS_FACTOR_DAMPING, PRESSURE, FOIL = range(8)
FILM_INTEGERS = 8

# Scalars of a bearing.
(SPACING, MOBILITY, AXIAL_MOBILITY, LOSS_FACTOR, TIME_RATIO, STIFFNESS_RATIO, ABSOLUTE, SMOOTHING,
 RING_RADIUS, RING_RATIO, RING_AMPLITUDE, RING_PHASE) = range(12)  # fmt: skip
FILM_SCALARS = 12

# The parameter vector of a case (order of pipelines.case.scales.PARAMETERS).
SPEED, EXCITATION_FREQUENCY, DISPLACEMENT, FOIL_STIFFNESS = range(4)
# A fifth entry while the excitation is being switched: d delta/d tau. Without it the rate is zero.
DISPLACEMENT_RATE = 4

WIDE_REACH = 2  # of the scheme with wide fluxes
# Weights of h and of dtheta dP/dtheta in the wide flux with a zero at either end: inside, and beside the
# first edge.
FACE_MEAN = (0.0, -1.0 / 16.0, 9.0 / 16.0, 9.0 / 16.0, -1.0 / 16.0, 0.0)
FACE_SLOPE = (0.0, 1.0 / 24.0, -27.0 / 24.0, 27.0 / 24.0, -1.0 / 24.0, 0.0)
EDGE_MEAN = (0.0, 5.0 / 16.0, 15.0 / 16.0, -5.0 / 16.0, 1.0 / 16.0, 0.0)
EDGE_SLOPE = (0.0, -23.0 / 24.0, 21.0 / 24.0, 3.0 / 24.0, -1.0 / 24.0, 0.0)
EVEN, ODD = 1.0, -1.0  # how the weights beside the last edge mirror those beside the first


class FilmLayout(NamedTuple):
    """Offsets of a bearing's arrays; the cosine starts at zero."""

    sine: Any
    second_derivative: Any
    side: Any
    weights: Any
    narrow: Any
    convection: Any
    end: Any


@kernel()
def padded_nodes(integers):
    """Entries of a padded array along theta."""
    return integers[NODES] + 2 * integers[REACH]


@kernel()
def film_layout(integers):
    """Offsets of a bearing's arrays.

    Views of all arrays would be reference-counted, which would take a twentieth of the rates' time.
    """
    padded, stations = padded_nodes(integers), integers[STATIONS]
    side = 2 * padded + stations * stations
    narrow = side + 2 * stations
    convection = narrow + 2 * integers[REACH] + 2
    end = convection + 3 * (2 * integers[REACH] + 1)
    return FilmLayout(padded, 2 * padded, side, side + stations, narrow, convection, end)


@kernel(error_model="numpy")
def foil_coefficients(parameters, integers, scalars):
    """Flexibility a = 1/c_f and relaxation rate r = k_f/c_f of the foil (Eq. 8); a = 0 if rigid."""
    if integers[LOSS_FACTOR_DAMPING] == 1:  # c_f = eta k_f / Omega
        relaxation = parameters[SPEED] / scalars[LOSS_FACTOR]
    else:  # c_f = eta k_f, in the bearing's own time unit
        relaxation = 1.0 / (scalars[LOSS_FACTOR] * scalars[TIME_RATIO])
    if scalars[STIFFNESS_RATIO] == 0.0:
        return 0.0, relaxation
    return relaxation / (scalars[STIFFNESS_RATIO] * parameters[FOIL_STIFFNESS]), relaxation


# The loops below run over slices that start at zero, few arrays at a time: only then does the compiler
# vectorise them.


@kernel(error_model="numpy")
def film_geometry(
    phase, state, parameters, integers, scalars, arrays, journal, thickness, thickness_rate, foil_rate
):
    """Fill film thickness h (padded), dh/dtau and dq/dtau (nodes) (Eq. 3, 8).

    ``journal`` = X, Y, dX/dtau, dY/dtau.
    """
    nodes, stations, first, at = integers[NODES], integers[STATIONS], integers[REACH], film_layout(integers)
    cosine, sine = arrays[: at.sine], arrays[at.sine : at.second_derivative]
    inner_cosine, inner_sine = cosine[first : nodes + first], sine[first : nodes + first]
    inner = thickness[first : nodes + first]
    weights = arrays[at.weights :]
    foil = state[integers[FOIL] : integers[FOIL] + nodes]
    flexibility, relaxation = foil_coefficients(parameters, integers, scalars)
    foil_rate, thickness_rate = foil_rate[:nodes], thickness_rate[:nodes]

    for i in range(nodes):
        foil_rate[i] = scalars[ABSOLUTE]
    for j in range(stations):  # the load p_m - 1
        start = integers[PRESSURE] + j * nodes
        pressure, weight = state[start : start + nodes], weights[j]
        for i in range(nodes):
            foil_rate[i] += weight * (pressure[i] - 1.0)
    for i in range(nodes):
        inner[i] = 1.0 - journal[0] * inner_cosine[i] - journal[1] * inner_sine[i] + foil[i]
    edge = scalars[ABSOLUTE] * flexibility / relaxation  # no gauge pressure: the foil follows the ring there
    if parameters[DISPLACEMENT] != 0.0:
        radius = scalars[RING_RADIUS]
        growth = parameters[DISPLACEMENT_RATE] if parameters.shape[0] > DISPLACEMENT_RATE else 0.0
        d_h, d_v, d_h_rate, d_v_rate = ring_axes_at(
            phase, parameters[DISPLACEMENT], parameters[EXCITATION_FREQUENCY],
            scalars[RING_RATIO], scalars[RING_AMPLITUDE], scalars[RING_PHASE], growth,
        )  # fmt: skip
        for i in range(nodes):
            c, s = inner_cosine[i], inner_sine[i]
            deflection = foil[i] - ring_displacement_at(c, s, d_h, d_v, radius)
            rate = ring_rate_at(c, s, d_h, d_v, d_h_rate, d_v_rate, radius)
            foil_rate[i] = rate + flexibility * foil_rate[i] - relaxation * deflection
        edge += ring_displacement_at(cosine[0], sine[0], d_h, d_v, radius)
    else:
        for i in range(nodes):
            foil_rate[i] = flexibility * foil_rate[i] - relaxation * foil[i]
    for i in range(nodes):
        thickness_rate[i] = foil_rate[i] - journal[2] * inner_cosine[i] - journal[3] * inner_sine[i]
    for k in range(first):
        last = nodes + first + k
        if integers[PERIODIC] == 1:
            thickness[k], thickness[last] = thickness[nodes + k], thickness[first + k]
        else:
            thickness[k] = 1.0 - journal[0] * cosine[k] - journal[1] * sine[k] + edge
            thickness[last] = 1.0 - journal[0] * cosine[last] - journal[1] * sine[last] + edge


@kernel(error_model="numpy")
def pad_pressure(pressure, integers, padded):
    """Copy the pressures into padded rows with the film's ends filled in (Eq. 4)."""
    nodes, stations, reach = integers[NODES], integers[STATIONS], integers[REACH]
    length, periodic = padded_nodes(integers), integers[PERIODIC] == 1
    for j in range(stations):
        row = padded[j * length : (j + 1) * length]
        for i in range(nodes):
            row[reach + i] = pressure[j * nodes + i]
        for k in range(reach):
            row[k] = row[nodes + k] if periodic else 1.0
            row[nodes + reach + k] = row[reach + k] if periodic else 1.0


# Rows of scratch space.  INVERSE: 1/h at the nodes; CURVATURE: d^2P/dz^2 and SQUARE: padded P at a station.
# At the faces, NARROW and WIDE: 1/2 m h^3 / dtheta of either flux, ..._SLOPE: their derivatives with the h of
# one node of the face and with that of the face, ..._CHANGE: those of the conducted fluxes at a station.
# CONDUCTION, CONVECTION: the weights in dtheta S, one row for each offset, with Omega in those of the latter.
(INVERSE, CURVATURE, SQUARE, NARROW, NARROW_SLOPE, NARROW_CHANGE, WIDE, WIDE_SLOPE, WIDE_CHANGE,
 CONDUCTION) = range(10)  # fmt: skip
CONVECTION = CONDUCTION + 2 * WIDE_REACH + 1
FILM_SCRATCH = CONVECTION + 2 * WIDE_REACH + 1


@kernel()
def scratch_length(integers):
    """Entries of a row of scratch space.

    The face behind node i has the place i + reach: ``_close_faces`` fills those outside the film.
    """
    return padded_nodes(integers) + 1


@kernel(error_model="numpy")
def _close_faces(faces, integers):
    """Fill the faces outside the film: with those of the opposite end, or zeros beyond an edge."""
    nodes, reach, periodic = integers[NODES], integers[REACH], integers[PERIODIC] == 1
    for k in range(reach):
        last = nodes + reach + 1 + k
        faces[k] = faces[nodes + k] if periodic else 0.0
        faces[last] = faces[reach + 1 + k] if periodic else 0.0


@kernel(error_model="numpy")
def _fill_wide_faces(values, weights, edge, mirror, integers, out):
    """Sums of padded ``values`` over the four nodes around every face."""
    nodes, faces, one, two, three = integers[NODES], out[WIDE_REACH:], values[1:], values[2:], values[3:]
    w1, w2, w3, w4 = weights[1], weights[2], weights[3], weights[4]
    for k in range(nodes + 1):
        faces[k] = w1 * values[k] + w2 * one[k] + w3 * two[k] + w4 * three[k]
    if integers[PERIODIC] == 0:
        first, last = 0.0, 0.0
        for s in range(1, 5):
            first += edge[s] * values[s]
            last += mirror * edge[s] * values[nodes + 3 - s]
        faces[0], faces[nodes] = first, last


@kernel(error_model="numpy")
def _fill_faces(integers, scalars, thickness, scratch):
    """Fill INVERSE, and NARROW and WIDE with their slopes, which are the same at all stations."""
    nodes, reach = integers[NODES], integers[REACH]
    factor = 0.5 * scalars[MOBILITY] / scalars[SPACING]
    conductance, slope = scratch[NARROW, reach:], scratch[NARROW_SLOPE, reach:]
    behind, ahead = thickness[reach - 1 :], thickness[reach:]
    inverse, inner = scratch[INVERSE], thickness[reach : nodes + reach]
    for k in range(nodes + 1):
        face = 0.5 * (behind[k] + ahead[k])
        conductance[k] = factor * face * face * face
        slope[k] = 1.5 * factor * face * face
    _close_faces(scratch[NARROW], integers)
    for i in range(nodes):
        inverse[i] = 1.0 / inner[i]
    if reach == WIDE_REACH:
        conductance, slope = scratch[WIDE, reach:], scratch[WIDE_SLOPE, reach:]
        _fill_wide_faces(thickness, FACE_MEAN, EDGE_MEAN, EVEN, integers, scratch[WIDE])
        for k in range(nodes + 1):
            face = conductance[k]
            conductance[k] = factor * face * face * face
            slope[k] = 3.0 * factor * face * face


@kernel(error_model="numpy")
def _fill_row(k, narrow, behind, before, faces, weights, edge, mirror, integers, out):
    """Fill what narrow and wide fluxes give to dtheta S at the offset k - reach.

    ``behind``, ``before``: weights of the narrow faces on either side of the node there.  Beside an edge
    there are wide fluxes alone.
    """
    nodes, last, one, other = integers[NODES], integers[NODES] - 1, narrow[k:], narrow[k + 1 :]
    if integers[REACH] < WIDE_REACH:
        for i in range(nodes):
            out[i] = behind * one[i] + before * other[i]
        return
    left, right, here, ahead = weights[k + 1], weights[k], faces[WIDE_REACH:], faces[WIDE_REACH + 1 :]
    for i in range(nodes):
        out[i] = behind * one[i] + before * other[i] + right * ahead[i] - left * here[i]
    if integers[PERIODIC] == 0:
        out[0] = right * here[1] - edge[k] * here[0]
        out[last] = mirror * edge[4 - k] * here[nodes] - left * here[last]


@kernel(error_model="numpy")
def _fill_rows(parameters, integers, scalars, arrays, thickness, scratch):
    """Fill CONDUCTION and CONVECTION, after the faces: they are the same at all stations."""
    nodes, reach, at = integers[NODES], integers[REACH], film_layout(integers)
    _fill_faces(integers, scalars, thickness, scratch)
    width, speed, last = 2 * reach + 1, parameters[SPEED], nodes - 1
    convection = arrays[at.convection :]
    for k in range(width):
        behind, before = arrays[at.narrow + k], -arrays[at.narrow + k + 1]
        _fill_row(
            k, scratch[NARROW], behind, before, scratch[WIDE], FACE_SLOPE, EDGE_SLOPE, ODD, integers,
            scratch[CONDUCTION + k],
        )  # fmt: skip
        out, weight = scratch[CONVECTION + k], speed * convection[width + k]
        for i in range(nodes):
            out[i] = weight
        if integers[PERIODIC] == 0:
            out[0], out[last] = speed * convection[k], speed * convection[2 * width + k]


@kernel(error_model="numpy")
def _fill_curvature(station, padded, integers, arrays, out):
    """d^2P/dz^2 of a station at every node, from all stations and the side pressure."""
    nodes, stations, at = integers[NODES], integers[STATIONS], film_layout(integers)
    second = arrays[at.second_derivative + station * stations :]
    out, length = out[:nodes], padded_nodes(integers)
    out[:] = arrays[at.side + station]
    for other in range(stations):
        start = other * length + integers[REACH]
        pressure, weight = padded[start : start + nodes], second[other]
        for i in range(nodes):
            out[i] += weight * pressure[i] * pressure[i]


@kernel(error_model="numpy")
def film_rates(
    padded, parameters, integers, scalars, arrays, thickness, thickness_rate, pressure_rate, scratch
):
    """Fill dp/dtau (Eq. 2) from the padded pressures; ``scratch`` (FILM_SCRATCH, scratch_length)."""
    nodes, stations, reach = integers[NODES], integers[STATIONS], integers[REACH]
    scale, axial, length = 0.5 / scalars[SPACING], 0.25 * scalars[AXIAL_MOBILITY], padded_nodes(integers)
    _fill_rows(parameters, integers, scalars, arrays, thickness, scratch)
    inverse, curvature = scratch[INVERSE], scratch[CURVATURE]
    inner, swell = thickness[reach : nodes + reach], thickness_rate[:nodes]
    for j in range(stations):
        row = padded[j * length : (j + 1) * length]
        here, rate = row[reach : nodes + reach], pressure_rate[j * nodes : (j + 1) * nodes]
        for i in range(nodes):
            rate[i] = 0.0
        for k in range(2 * reach + 1):
            conducted, convected = scratch[CONDUCTION + k], scratch[CONVECTION + k]
            pressure, h = row[k:], thickness[k:]
            for i in range(nodes):
                p = pressure[i]
                rate[i] += p * (conducted[i] * p - convected[i] * h[i])
        _fill_curvature(j, padded, integers, arrays, curvature)
        for i in range(nodes):
            h = inner[i]
            rate[i] = scale * rate[i] + axial * h * h * h * curvature[i]
        for i in range(nodes):
            rate[i] = (rate[i] - here[i] * swell[i]) * inverse[i]


# Derivatives of dp/dtau at every row j * nodes + i: with dh_i/dtau, with h at the 2 reach + 1 offsets, with
# the pressures at these offsets through the fluxes along theta, and in all with p_{i,l} for every station l.
# Those with pressures on a foil edge are zero.
THICKNESS_RATE, THICKNESS = 0, 1


class TermRows(NamedTuple):
    """Rows of the derivatives with h_i, with p_i through the fluxes, with p_{i,0}, and their number."""

    thickness: Any
    pressure: Any
    here: Any
    count: Any


@kernel()
def term_rows(reach, stations):
    """The places of the derivatives."""
    thickness, width = THICKNESS + reach, 2 * reach + 1
    return TermRows(thickness, thickness + width, THICKNESS + 2 * width, THICKNESS + 2 * width + stations)


@kernel(error_model="numpy")
def _thickness_derivatives(row, integers, scalars, arrays, thickness, scratch, own):
    """Fill the derivatives of dp/dtau at a station with h at all offsets, h_i in the axial flow left out."""
    nodes, reach = integers[NODES], integers[REACH]
    scale, length, narrow = 0.5 / scalars[SPACING], padded_nodes(integers), film_layout(integers).narrow
    square, inverse, slope, change = (
        scratch[SQUARE], scratch[INVERSE], scratch[NARROW_SLOPE, reach:], scratch[NARROW_CHANGE, reach:],
    )  # fmt: skip
    for i in range(length):
        square[i] = row[i] * row[i]
    before, after = square[reach - 1 :], square[reach:]
    for i in range(nodes + 1):
        change[i] = slope[i] * (after[i] - before[i])
    _close_faces(scratch[NARROW_CHANGE], integers)
    if reach == WIDE_REACH:
        _fill_wide_faces(square, FACE_SLOPE, EDGE_SLOPE, ODD, integers, scratch[WIDE_CHANGE])
        slope, change = scratch[WIDE_SLOPE, reach:], scratch[WIDE_CHANGE, reach:]
        for i in range(nodes + 1):
            change[i] *= slope[i]
    for k in range(2 * reach + 1):
        term, pressure, convected = own[THICKNESS + k], row[k:], scratch[CONVECTION + k]
        _fill_row(
            k, scratch[NARROW_CHANGE], arrays[narrow + k], arrays[narrow + k + 1], scratch[WIDE_CHANGE],
            FACE_MEAN, EDGE_MEAN, EVEN, integers, term,
        )  # fmt: skip
        for i in range(nodes):
            term[i] = scale * inverse[i] * (term[i] - convected[i] * pressure[i])


@kernel(error_model="numpy")
def _pressure_derivatives(row, integers, scalars, thickness, scratch, own):
    """Fill the derivatives of dp/dtau at a station with its pressures along theta, through the fluxes."""
    nodes, reach = integers[NODES], integers[REACH]
    scale, inverse, first = 0.5 / scalars[SPACING], scratch[INVERSE], THICKNESS + 2 * reach + 1
    for k in range(2 * reach + 1):
        term, pressure, h = own[first + k], row[k:], thickness[k:]
        conducted, convected = scratch[CONDUCTION + k], scratch[CONVECTION + k]
        for i in range(nodes):
            term[i] = scale * inverse[i] * (2.0 * conducted[i] * pressure[i] - convected[i] * h[i])
    if integers[PERIODIC] == 0:
        for k in range(reach):  # the offset k - reach of the first nodes, and its opposite of the last ones
            for i in range(reach - k):
                own[first + k, i], own[first + 2 * reach - k, nodes - 1 - i] = 0.0, 0.0


@kernel(error_model="numpy")
def film_derivatives(
    padded, parameters, integers, scalars, arrays, thickness, thickness_rate, pressure_rate, terms, scratch
):
    """Fill ``terms`` (``term_rows``, nodes * stations) with the derivatives of ``film_rates``.

    ``pressure_rate`` and ``scratch`` hold what ``film_rates`` has computed.
    """
    nodes, stations, reach = integers[NODES], integers[STATIONS], integers[REACH]
    axial, length, at = 0.25 * scalars[AXIAL_MOBILITY], padded_nodes(integers), term_rows(reach, stations)
    inverse, curvature, second = scratch[INVERSE], scratch[CURVATURE], film_layout(integers).second_derivative
    h, swell = thickness[reach : nodes + reach], thickness_rate[:nodes]
    for j in range(stations):
        row = padded[j * length : (j + 1) * length]
        own, p = terms[:, j * nodes : (j + 1) * nodes], row[reach : nodes + reach]
        _thickness_derivatives(row, integers, scalars, arrays, thickness, scratch, own)
        _pressure_derivatives(row, integers, scalars, thickness, scratch, own)
        _fill_curvature(j, padded, integers, arrays, curvature)
        term, rate = own[at.thickness], pressure_rate[j * nodes : (j + 1) * nodes]
        for i in range(nodes):
            term[i] += (3.0 * axial * h[i] * h[i] * curvature[i] - rate[i]) * inverse[i]
        term = own[THICKNESS_RATE]
        for i in range(nodes):
            term[i] = -p[i] * inverse[i]
        for other in range(stations):
            term, start = own[at.here + other], other * length + reach
            pressure = padded[start : start + nodes]
            weight = 2.0 * axial * arrays[second + j * stations + other]
            for i in range(nodes):
                term[i] = weight * h[i] * h[i] * pressure[i]
        term, through = own[at.here + j], own[at.pressure]
        for i in range(nodes):
            term[i] += through[i] - inverse[i] * swell[i]
