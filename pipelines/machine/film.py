"""The gas film and the foil of one bearing: compiled rates and their derivatives.

With pressure p, film thickness h, foil displacement q, journal position X, Y and P = p^2, convection weight w
(1/2 central, 1 backward) and film mobility m = t_0/t_b (1 unless the bearings differ):

    d(p h)/dtau = 1/2 [ (Phi_{i+1/2} - Phi_{i-1/2}) / dtheta ] + 1/4 m kappa^2 h^3 d^2P/dz^2           (Eq. 1)
    Phi_{i+1/2} = 1/2 m h_{i+1/2}^3 (P_{i+1} - P_i) / dtheta - Omega (w p_i h_i + (1-w) p_{i+1} h_{i+1})
    dp/dtau     = (d(p h)/dtau - p dh/dtau) / h                                                        (Eq. 2)
    h           = 1 - X cos(theta) - Y sin(theta) + q                                                  (Eq. 3)
    dq/dtau     = dq_r/dtau + a (p_m - 1) - r (q - q_r),   a = 1/c_f,  r = k_f/c_f                     (Eq. 8)

Here kappa = R / L_b, q_r is the displacement of the ring, p_m the axial mean of p, k_f and c_f are stiffness
and damping of the foil.

Padded arrays along theta have one more entry on either side, ``nodes + 2`` in all: the foil-edge line (p = 1,
the foil unloaded) or, for a periodic film, the opposite end.  Pressures of a bearing are stored station by
station: ``p[j * nodes + i]``.  The constants of a bearing lie one after another,

    | scalars      | cosine    | sine      | second_derivative   | side     | weights  |
      FILM_SCALARS   nodes + 2   nodes + 2   stations x stations   stations   stations

and ``arrays`` are all but the scalars: cosine and sine of theta, d^2/dz^2 at the stations and what the side
pressure adds to it, the weights of the axial mean.  ``film_layout`` has their offsets.
"""

from __future__ import annotations

from typing import Any, NamedTuple

from pipelines.machine.kernels import kernel

from .ring import ring_axes_at, ring_displacement_at, ring_rate_at

# Clipping of the pressure in the force integral (Eq. 9).
FULL, GUMBEL, SMOOTH = 0, 1, 2

# Integers of a bearing: sizes and switches, then the offset of its unknowns in the state.
NODES, STATIONS, PERIODIC, CLIPPING, LOSS_FACTOR_DAMPING, PRESSURE, FOIL = range(7)
FILM_INTEGERS = 7

# Scalars of a bearing.
(SPACING, MOBILITY, AXIAL_MOBILITY, CONVECTION_WEIGHT, LOSS_FACTOR, TIME_RATIO, STIFFNESS_RATIO, ABSOLUTE,
 SMOOTHING, RING_RADIUS, RING_RATIO, RING_AMPLITUDE, RING_PHASE) = range(13)  # fmt: skip
FILM_SCALARS = 13

# The parameter vector of a case (order of pipelines.case.scales.PARAMETERS).
SPEED, EXCITATION_FREQUENCY, DISPLACEMENT, FOIL_STIFFNESS = range(4)
# A fifth entry while the excitation is being switched: d delta/d tau. Without it the rate is zero.
DISPLACEMENT_RATE = 4


class FilmLayout(NamedTuple):
    """Offsets of a bearing's arrays; the cosine starts at zero."""

    sine: Any
    second_derivative: Any
    side: Any
    weights: Any


@kernel()
def film_layout(integers):
    """Offsets of a bearing's arrays.

    Views of all arrays would be reference-counted, which would take a twentieth of the rates' time.
    """
    padded, stations = integers[NODES] + 2, integers[STATIONS]
    side = 2 * padded + stations * stations
    return FilmLayout(padded, 2 * padded, side, side + stations)


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
    nodes, stations, at = integers[NODES], integers[STATIONS], film_layout(integers)
    cosine, sine = arrays[: at.sine], arrays[at.sine : at.second_derivative]
    inner_cosine, inner_sine, inner = cosine[1 : nodes + 1], sine[1 : nodes + 1], thickness[1 : nodes + 1]
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
    if integers[PERIODIC] == 1:
        thickness[0], thickness[nodes + 1] = thickness[nodes], thickness[1]
    else:
        for k in (0, nodes + 1):
            thickness[k] = 1.0 - journal[0] * cosine[k] - journal[1] * sine[k] + edge


@kernel(error_model="numpy")
def pad_pressure(pressure, integers, padded):
    """Copy the pressures into rows of ``nodes + 2`` entries with the film's ends filled in (Eq. 4)."""
    nodes, stations = integers[NODES], integers[STATIONS]
    for j in range(stations):
        row = j * (nodes + 2)
        for i in range(nodes):
            padded[row + 1 + i] = pressure[j * nodes + i]
        periodic = integers[PERIODIC] == 1
        padded[row] = padded[row + nodes] if periodic else 1.0
        padded[row + nodes + 1] = padded[row + 1] if periodic else 1.0


# Rows of scratch space, ``nodes + 2`` each: the conductance 1/2 m h^3 / dtheta of the faces between nodes,
# its derivative with the thickness at either node of the face, the flux Phi, 1/h at the nodes, d^2P/dz^2 at a
# station.
CONDUCTANCE, CONDUCTANCE_SLOPE, FLUX, INVERSE, CURVATURE = range(5)
FILM_SCRATCH = 5


@kernel(error_model="numpy")
def _fill_faces(integers, scalars, thickness, scratch):
    """Fill CONDUCTANCE, CONDUCTANCE_SLOPE and INVERSE of ``scratch``, which are the same at all stations."""
    nodes = integers[NODES]
    conduction = 0.5 * scalars[MOBILITY] / scalars[SPACING]
    conductance, slope = scratch[CONDUCTANCE], scratch[CONDUCTANCE_SLOPE]
    ahead, inverse, inner = thickness[1:], scratch[INVERSE], thickness[1 : nodes + 1]
    for k in range(nodes + 1):
        face = 0.5 * (thickness[k] + ahead[k])
        conductance[k] = conduction * face * face * face
        slope[k] = 1.5 * conduction * face * face
    for i in range(nodes):
        inverse[i] = 1.0 / inner[i]


@kernel(error_model="numpy")
def _fill_curvature(station, padded, integers, arrays, out):
    """d^2P/dz^2 of a station at every node, from all stations and the side pressure."""
    nodes, stations, at = integers[NODES], integers[STATIONS], film_layout(integers)
    second = arrays[at.second_derivative + station * stations :]
    out = out[:nodes]
    out[:] = arrays[at.side + station]
    for other in range(stations):
        start = other * (nodes + 2) + 1
        pressure, weight = padded[start : start + nodes], second[other]
        for i in range(nodes):
            out[i] += weight * pressure[i] * pressure[i]


@kernel(error_model="numpy")
def film_rates(
    padded, parameters, integers, scalars, arrays, thickness, thickness_rate, pressure_rate, scratch
):
    """Fill dp/dtau (Eq. 2) from the padded pressures; ``scratch`` (FILM_SCRATCH, nodes + 2)."""
    nodes, stations = integers[NODES], integers[STATIONS]
    scale, axial = 0.5 / scalars[SPACING], 0.25 * scalars[AXIAL_MOBILITY]
    behind = parameters[SPEED] * scalars[CONVECTION_WEIGHT]
    before = parameters[SPEED] - behind
    _fill_faces(integers, scalars, thickness, scratch)
    conductance, flux, inverse = scratch[CONDUCTANCE], scratch[FLUX], scratch[INVERSE]
    curvature, next_flux, ahead = scratch[CURVATURE], scratch[FLUX, 1:], thickness[1:]
    inner, swell = thickness[1 : nodes + 1], thickness_rate[:nodes]
    for j in range(stations):
        row = padded[j * (nodes + 2) : (j + 1) * (nodes + 2)]
        after, here = row[1:], row[1 : nodes + 1]
        rate = pressure_rate[j * nodes : (j + 1) * nodes]
        for k in range(nodes + 1):
            p, p_next = row[k], after[k]
            conducted = conductance[k] * (p_next * p_next - p * p)
            flux[k] = conducted - behind * p * thickness[k] - before * p_next * ahead[k]
        for i in range(nodes):
            rate[i] = scale * (next_flux[i] - flux[i])
        _fill_curvature(j, padded, integers, arrays, curvature)
        for i in range(nodes):
            h = inner[i]
            rate[i] += axial * h * h * h * curvature[i]
        for i in range(nodes):
            rate[i] = (rate[i] - here[i] * swell[i]) * inverse[i]


# Derivatives of dp/dtau at every row j * nodes + i with, in this order: p_{i-1,j}, p_{i+1,j}, h_{i-1}, h_i,
# h_{i+1}, dh_i/dtau, then p_{i,l} for every station l.
BEFORE, AFTER, THICKNESS_BEFORE, THICKNESS_HERE, THICKNESS_AFTER, THICKNESS_RATE, HERE = range(7)


@kernel(error_model="numpy")
def film_derivatives(
    padded, parameters, integers, scalars, arrays, thickness, thickness_rate, pressure_rate, terms, scratch
):
    """Fill ``terms`` (6 + stations, nodes * stations) with the derivatives of ``film_rates``.

    ``pressure_rate`` holds the rates that ``film_rates`` has computed.
    """
    nodes, stations = integers[NODES], integers[STATIONS]
    scale, axial = 0.5 / scalars[SPACING], 0.25 * scalars[AXIAL_MOBILITY]
    behind = parameters[SPEED] * scalars[CONVECTION_WEIGHT]
    before = parameters[SPEED] - behind
    _fill_faces(integers, scalars, thickness, scratch)
    left, right = scratch[CONDUCTANCE], scratch[CONDUCTANCE, 1:]
    left_slope, right_slope = scratch[CONDUCTANCE_SLOPE], scratch[CONDUCTANCE_SLOPE, 1:]
    inverse, curvature, h_before, h_after = scratch[INVERSE], scratch[CURVATURE], thickness, thickness[2:]
    h, swell = thickness[1 : nodes + 1], thickness_rate[:nodes]
    second = arrays[film_layout(integers).second_derivative :]
    for j in range(stations):
        row = padded[j * (nodes + 2) : (j + 1) * (nodes + 2)]
        p, p_after = row[1:], row[2:]
        own = terms[:, j * nodes : (j + 1) * nodes]
        term = own[BEFORE]
        for i in range(nodes):
            term[i] = scale * inverse[i] * (2.0 * left[i] * row[i] + behind * h_before[i])
        term = own[AFTER]
        for i in range(nodes):
            term[i] = scale * inverse[i] * (2.0 * right[i] * p_after[i] - before * h_after[i])
        term = own[THICKNESS_BEFORE]
        for i in range(nodes):
            through_face = left_slope[i] * (p[i] * p[i] - row[i] * row[i])
            term[i] = scale * inverse[i] * (behind * row[i] - through_face)
        term = own[THICKNESS_AFTER]
        for i in range(nodes):
            through_face = right_slope[i] * (p_after[i] * p_after[i] - p[i] * p[i])
            term[i] = scale * inverse[i] * (through_face - before * p_after[i])
        _fill_curvature(j, padded, integers, arrays, curvature)
        term, rate = own[THICKNESS_HERE], pressure_rate[j * nodes : (j + 1) * nodes]
        for i in range(nodes):
            term[i] = (3.0 * axial * h[i] * h[i] * curvature[i] - rate[i]) * inverse[i]
        for i in range(nodes):  # flux through both faces, whose h is the mean of both nodes, and convection
            through = right_slope[i] * (p_after[i] * p_after[i] - p[i] * p[i])
            through -= left_slope[i] * (p[i] * p[i] - row[i] * row[i])
            term[i] += scale * inverse[i] * (through - (behind - before) * p[i])
        term = own[THICKNESS_RATE]
        for i in range(nodes):
            term[i] = -p[i] * inverse[i]
        for other in range(stations):
            term, start = own[HERE + other], other * (nodes + 2) + 1
            pressure, weight = padded[start : start + nodes], 2.0 * axial * second[j * stations + other]
            for i in range(nodes):
                term[i] = weight * h[i] * h[i] * pressure[i]
        term = own[HERE + j]
        for i in range(nodes):
            through = 2.0 * (left[i] + right[i]) * p[i] + (behind - before) * h[i]
            term[i] -= inverse[i] * (scale * through + swell[i])
