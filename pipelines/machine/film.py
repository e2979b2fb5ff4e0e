"""The gas film of one bearing on its foil: compiled rates, their derivatives, and the force on the journal.

With P = p^2, convection weight w (1/2 central, 1 backward) and film mobility m = t_0/t_b (1 unless the
bearings differ):

    d(p h)/dtau = 1/2 [ (Phi_{i+1/2} - Phi_{i-1/2}) / dtheta ] + 1/4 m kappa^2 h^3 d^2P/dz^2           (Eq. 1)
    Phi_{i+1/2} = 1/2 m h_{i+1/2}^3 (P_{i+1} - P_i) / dtheta - Omega (w p_i h_i + (1-w) p_{i+1} h_{i+1})
    dp/dtau     = (d(p h)/dtau - p dh/dtau) / h                                                        (Eq. 2)
    h           = 1 - X cos(theta) - Y sin(theta) + q                                                  (Eq. 3)
    dq/dtau     = dq_r/dtau + a (p_m - 1) - r (q - q_r),   a = 1/c_f,  r = k_f/c_f                     (Eq. 8)

Arrays along theta carry one pad on either side, ``nodes + 2`` entries: the foil-edge line (p = 1, the foil
unloaded) or, for a periodic film, the opposite end.  Pressures of a bearing are stored station by station:
``p[j * nodes + i]``.
"""

from __future__ import annotations

import numpy as np
from numba import njit

from .ring import ring_axes_at, ring_displacement_at, ring_rate_at

# Clipping of the pressure in the force integral (Eq. 9).
FULL, GUMBEL, SMOOTH = 0, 1, 2

# Integers of a bearing: sizes and switches, then the offset of its unknowns in the state.
NODES, STATIONS, PERIODIC, CLIPPING, LOSS_FACTOR_DAMPING, PRESSURE, FOIL = range(7)
FILM_INTEGERS = 7

# Scalars of a bearing, followed by its arrays: cosine, sine (nodes + 2), second_derivative (stations^2),
# side, weights.
(SPACING, MOBILITY, AXIAL_MOBILITY, CONVECTION_WEIGHT, LOSS_FACTOR, TIME_RATIO, STIFFNESS_RATIO, ABSOLUTE,
 SMOOTHING, RING_RADIUS, RING_RATIO, RING_AMPLITUDE, RING_PHASE) = range(13)  # fmt: skip
FILM_SCALARS = 13

# The parameter vector of a case (order of pipelines.case.PARAMETERS).
SPEED, EXCITATION_FREQUENCY, DISPLACEMENT, FOIL_STIFFNESS = range(4)

# Abscissae and weights of Gauss-Legendre quadrature on [0, 1]: resolves the regularised clipping inside a
# cell.
_GAUSS_POINTS = 0.5 + 0.5 * np.polynomial.legendre.leggauss(4)[0]
_GAUSS_WEIGHTS = 0.5 * np.polynomial.legendre.leggauss(4)[1]


@njit(cache=True, error_model="numpy")
def foil_coefficients(parameters, integers, scalars):
    """Flexibility a = 1/c_f and relaxation rate r = k_f/c_f of the foil (Eq. 8); a = 0 if rigid."""
    if integers[LOSS_FACTOR_DAMPING] == 1:  # c_f = eta k_f / Omega
        relaxation = parameters[SPEED] / scalars[LOSS_FACTOR]
    else:  # c_f = eta k_f, in the bearing's own time unit
        relaxation = 1.0 / (scalars[LOSS_FACTOR] * scalars[TIME_RATIO])
    if scalars[STIFFNESS_RATIO] == 0.0:
        return 0.0, relaxation
    return relaxation / (scalars[STIFFNESS_RATIO] * parameters[FOIL_STIFFNESS]), relaxation


@njit(cache=True, error_model="numpy")
def film_geometry(
    phase, state, parameters, integers, scalars, arrays, journal, thickness, thickness_rate, foil_rate
):
    """Fill film thickness h (padded), dh/dtau and dq/dtau (nodes); ``journal`` = X, Y, dX/dtau, dY/dtau (Eq.
    3, 8).
    """
    nodes, stations = integers[NODES], integers[STATIONS]
    cosine, sine = arrays[: nodes + 2], arrays[nodes + 2 : 2 * nodes + 4]
    weights = arrays[2 * nodes + 4 + stations * stations + stations :]
    pressure, foil = state[integers[PRESSURE] :], state[integers[FOIL] :]
    flexibility, relaxation = foil_coefficients(parameters, integers, scalars)

    moving = parameters[DISPLACEMENT] != 0.0
    radius = scalars[RING_RADIUS]
    axes = ring_axes_at(
        phase, parameters[DISPLACEMENT], parameters[EXCITATION_FREQUENCY],
        scalars[RING_RATIO], scalars[RING_AMPLITUDE], scalars[RING_PHASE],
    )  # fmt: skip

    for k in range(nodes + 2):
        thickness[k] = 1.0 - journal[0] * cosine[k] - journal[1] * sine[k]
    for i in range(nodes):
        load = scalars[ABSOLUTE]
        for j in range(stations):
            load += weights[j] * (pressure[j * nodes + i] - 1.0)
        ring, ring_rate = 0.0, 0.0
        if moving:
            c, s = cosine[i + 1], sine[i + 1]
            ring = ring_displacement_at(c, s, axes[0], axes[1], radius)
            ring_rate = ring_rate_at(c, s, axes[0], axes[1], axes[2], axes[3], radius)
        foil_rate[i] = ring_rate + flexibility * load - relaxation * (foil[i] - ring)
        thickness[i + 1] += foil[i]
        thickness_rate[i] = foil_rate[i] - journal[2] * cosine[i + 1] - journal[3] * sine[i + 1]
    if integers[PERIODIC] == 1:
        thickness[0], thickness[nodes + 1] = thickness[nodes], thickness[1]
    else:  # the edge carries no gauge pressure: the foil follows the ring there
        edge = scalars[ABSOLUTE] * flexibility / relaxation
        if moving:
            edge += ring_displacement_at(cosine[0], sine[0], axes[0], axes[1], radius)
        thickness[0] += edge
        thickness[nodes + 1] += edge


@njit(cache=True, error_model="numpy")
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


@njit(cache=True, error_model="numpy")
def film_rates(padded, parameters, integers, scalars, arrays, thickness, thickness_rate, pressure_rate):
    """Fill dp/dtau (Eq. 2) from the padded pressures; marches along theta carrying the flux Phi of the last
    face.
    """
    nodes, stations = integers[NODES], integers[STATIONS]
    second = arrays[2 * nodes + 4 :]
    side = second[stations * stations :]
    spacing, weight = scalars[SPACING], scalars[CONVECTION_WEIGHT]
    conduction = 0.5 * scalars[MOBILITY] / spacing
    speed = parameters[SPEED]
    for j in range(stations):
        row = j * (nodes + 2)
        last_flux = 0.0
        for k in range(nodes + 1):
            p, p_next, h, h_next = padded[row + k], padded[row + k + 1], thickness[k], thickness[k + 1]
            face = 0.5 * (h + h_next)
            flux = conduction * face * face * face * (p_next * p_next - p * p)
            flux -= speed * (weight * p * h + (1.0 - weight) * p_next * h_next)
            if k > 0:
                pressure_rate[j * nodes + k - 1] = 0.5 * (flux - last_flux) / spacing
            last_flux = flux
        for i in range(nodes):
            curvature = side[j]
            for other in range(stations):
                p = padded[other * (nodes + 2) + i + 1]
                curvature += second[j * stations + other] * p * p
            h = thickness[i + 1]
            storage = pressure_rate[j * nodes + i] + 0.25 * scalars[AXIAL_MOBILITY] * h * h * h * curvature
            pressure_rate[j * nodes + i] = (storage - padded[row + i + 1] * thickness_rate[i]) / h


# Derivative of dp/dtau at one node, in this order: dp_{i-1,j}, dp_{i+1,j}, dh_{i-1}, dh_i, dh_{i+1},
# d(dh_i/dtau), then dp_{i,l} for every station l.
BEFORE, AFTER, THICKNESS_BEFORE, THICKNESS_HERE, THICKNESS_AFTER, THICKNESS_RATE, HERE = range(7)


@njit(cache=True, error_model="numpy")
def film_derivatives(
    padded, parameters, integers, scalars, arrays, thickness, thickness_rate, pressure_rate, terms
):
    """Fill ``terms`` (nodes * stations, 6 + stations): the derivative of ``film_rates`` row by row."""
    nodes, stations = integers[NODES], integers[STATIONS]
    second = arrays[2 * nodes + 4 :]
    side = second[stations * stations :]
    spacing, w = scalars[SPACING], scalars[CONVECTION_WEIGHT]
    conduction = 0.5 * scalars[MOBILITY] / spacing
    axial = 0.25 * scalars[AXIAL_MOBILITY]
    speed = parameters[SPEED]
    for j in range(stations):
        for i in range(nodes):
            row = j * nodes + i
            here = j * (nodes + 2) + i + 1
            p_before, p, p_after = padded[here - 1], padded[here], padded[here + 1]
            h_before, h, h_after = thickness[i], thickness[i + 1], thickness[i + 2]
            left, right = 0.5 * (h_before + h), 0.5 * (h + h_after)
            conduct_left, conduct_right = conduction * left**3, conduction * right**3
            # d Phi / d h through the face thickness, the same for both of its nodes
            slope_left = 1.5 * conduction * left * left * (p * p - p_before * p_before)
            slope_right = 1.5 * conduction * right * right * (p_after * p_after - p * p)
            scale = 0.5 / (spacing * h)
            terms[row, BEFORE] = scale * (2.0 * conduct_left * p_before + speed * w * h_before)
            terms[row, AFTER] = scale * (2.0 * conduct_right * p_after - speed * (1.0 - w) * h_after)
            terms[row, THICKNESS_BEFORE] = scale * (-slope_left + speed * w * p_before)
            terms[row, THICKNESS_AFTER] = scale * (slope_right - speed * (1.0 - w) * p_after)
            terms[row, THICKNESS_RATE] = -p / h
            curvature = side[j]
            for other in range(stations):
                p_other = padded[other * (nodes + 2) + i + 1]
                weight = second[j * stations + other]
                curvature += weight * p_other * p_other
                terms[row, HERE + other] = 2.0 * axial * h * h * weight * p_other
            terms[row, HERE + j] -= (
                scale * (2.0 * (conduct_left + conduct_right) * p + speed * (2.0 * w - 1.0) * h)
                + thickness_rate[i] / h
            )
            terms[row, THICKNESS_HERE] = (
                scale * (slope_right - slope_left - speed * (2.0 * w - 1.0) * p)
                + (3.0 * axial * h * h * curvature - pressure_rate[row]) / h
            )


@njit(cache=True, error_model="numpy")
def _crossing_moments(positive, negative):
    """``positive_part_moments`` of a cell whose left end is positive and whose right end is negative."""
    t = positive / (positive - negative)  # u vanishes at x = t
    near, far, drift = t * (0.5 - t / 6.0), t * t / 6.0, t * (1.0 - t)
    near_slope = 0.5 - t / 3.0
    return (
        positive * near, positive * far,
        near + near_slope * drift, near_slope * t * t,
        far + t * drift / 3.0, t * t * t / 3.0,
    )  # fmt: skip


@njit(cache=True, error_model="numpy")
def positive_part_moments(left, right):
    """Moments of the positive part of a linear function over a unit cell, and their derivatives.

    With u(x) = left (1-x) + right x returns the integrals of u^+ (1-x) and u^+ x, then d/dleft and d/dright
    of each. They are continuously differentiable unless left = right = 0.
    """
    if left >= 0.0 and right >= 0.0:
        third, sixth = 1.0 / 3.0, 1.0 / 6.0
        return third * left + sixth * right, sixth * left + third * right, third, sixth, sixth, third
    if left <= 0.0 and right <= 0.0:
        return 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
    if left > 0.0:
        return _crossing_moments(left, right)
    far, near, far_right, far_left, near_right, near_left = _crossing_moments(right, left)
    return near, far, near_left, near_right, far_left, far_right


@njit(cache=True, error_model="numpy")
def edge_moments(near, following):
    """The moments of the cell between the ambient edge (x = 0) and its first node (x = 1), where u is
    ``near``.

    There the straight line through u(0) = 0 would change sign everywhere at once, a kink in the force.  The
    sign is taken from the parabola u = x (a + b x) through the next node too (``following``), whose root
    moves through the cell: u^+ = (straight line) + (negative part of the parabola).  Returns the moments with
    1 - x and x, then the derivative of each with ``near`` and ``following``.
    """
    a, b = 0.5 * (4.0 * near - following), 0.5 * (following - 2.0 * near)
    low, high = 0.0, 1.0  # where the parabola is negative
    if a >= 0.0 and near >= 0.0:
        high = 0.0
    elif a >= 0.0:
        low = a / (a - near)
    elif near > 0.0:
        high = a / (a - near)
    second = (high**2 - low**2) / 2.0
    third = (high**3 - low**3) / 3.0
    fourth = (high**4 - low**4) / 4.0
    at_edge, at_edge_slope = second - third, third - fourth
    return (
        near / 6.0 - a * at_edge - b * at_edge_slope, near / 3.0 - a * third - b * fourth,
        1.0 / 6.0 - 2.0 * at_edge + at_edge_slope, 0.5 * (at_edge - at_edge_slope),
        1.0 / 3.0 - 2.0 * third + fourth, 0.5 * (third - fourth),
    )  # fmt: skip


@njit(cache=True, error_model="numpy")
def regularised_moments(left, right, width):
    """The same moments for the smooth positive part (u + sqrt(u^2 + width^2)) / 2, by Gauss quadrature in the
    cell.
    """
    first, second, first_left, first_right, second_right = 0.0, 0.0, 0.0, 0.0, 0.0
    for g in range(_GAUSS_POINTS.size):
        x = _GAUSS_POINTS[g]
        u = left * (1.0 - x) + right * x
        root = np.sqrt(u * u + width * width)
        value = 0.5 * _GAUSS_WEIGHTS[g] * (u + root)
        slope = 0.5 * _GAUSS_WEIGHTS[g] * (1.0 + u / root)
        first += value * (1.0 - x)
        second += value * x
        first_left += slope * (1.0 - x) * (1.0 - x)
        first_right += slope * (1.0 - x) * x
        second_right += slope * x * x
    return first, second, first_left, first_right, first_right, second_right


@njit(cache=True, error_model="numpy")
def regularised_edge_moments(near, following, width):
    """``edge_moments`` with the negative part of the parabola smoothed: (sqrt(u^2 + width^2) - u) / 2."""
    edge, node = near / 6.0, near / 3.0
    edge_near, edge_following, node_near, node_following = 1.0 / 6.0, 0.0, 1.0 / 3.0, 0.0
    for g in range(_GAUSS_POINTS.size):
        x = _GAUSS_POINTS[g]
        by_near, by_following = (
            x * (2.0 - x),
            0.5 * x * (x - 1.0),
        )  # the parabola's slopes with its two values
        u = by_near * near + by_following * following
        root = np.sqrt(u * u + width * width)
        value = 0.5 * _GAUSS_WEIGHTS[g] * (root - u)
        slope = 0.5 * _GAUSS_WEIGHTS[g] * (u / root - 1.0)
        edge += value * (1.0 - x)
        node += value * x
        edge_near += slope * by_near * (1.0 - x)
        edge_following += slope * by_following * (1.0 - x)
        node_near += slope * by_near * x
        node_following += slope * by_following * x
    return edge, node, edge_near, edge_following, node_near, node_following


@njit(cache=True, error_model="numpy")
def cell_moments(left, right, integers, scalars):
    """Moments of the clipped pressure in a cell between two nodes, by the bearing's way of clipping."""
    if integers[CLIPPING] == GUMBEL:
        return positive_part_moments(left, right)
    return regularised_moments(left, right, scalars[SMOOTHING])


@njit(cache=True, error_model="numpy")
def end_moments(near, following, integers, scalars):
    """Moments of the clipped pressure in a cell beside the foil edge, by the bearing's way of clipping."""
    if integers[CLIPPING] == GUMBEL:
        return edge_moments(near, following)
    return regularised_edge_moments(near, following, scalars[SMOOTHING])


@njit(cache=True, error_model="numpy")
def film_force(padded, integers, scalars, arrays):
    """Gas force on the journal F = -iint (p-1)^+ (cos, sin) dtheta dz (Eq. 9), clipped below grid level.

    The cell moments are divided by (2 + cos(dtheta)) / 3, which makes the force of an unclipped film the
    trapezoidal sum: spectrally accurate on a smooth film.
    """
    nodes, stations = integers[NODES], integers[STATIONS]
    cosine, sine = arrays[: nodes + 2], arrays[nodes + 2 : 2 * nodes + 4]
    weights = arrays[2 * nodes + 4 + stations * stations + stations :]
    cells = (
        nodes + integers[PERIODIC]
    )  # from node k to k + 1 of a padded row; those beside an edge come after
    horizontal, vertical = 0.0, 0.0
    for j in range(stations):
        row = padded[j * (nodes + 2) : (j + 1) * (nodes + 2)]
        x, y = 0.0, 0.0
        if integers[CLIPPING] == FULL:
            for k in range(1, nodes + 1):
                x += (row[k] - 1.0) * cosine[k]
                y += (row[k] - 1.0) * sine[k]
        else:
            for k in range(1, cells):
                left, right, _, _, _, _ = cell_moments(row[k] - 1.0, row[k + 1] - 1.0, integers, scalars)
                x += left * cosine[k] + right * cosine[k + 1]
                y += left * sine[k] + right * sine[k + 1]
            for edge, near, following in ((0, 1, 2), (nodes + 1, nodes, nodes - 1)):
                if integers[PERIODIC] == 0:
                    outer, inner, _, _, _, _ = end_moments(
                        row[near] - 1.0, row[following] - 1.0, integers, scalars
                    )
                    x += outer * cosine[edge] + inner * cosine[near]
                    y += outer * sine[edge] + inner * sine[near]
        horizontal += weights[j] * x
        vertical += weights[j] * y
    scale = -scalars[SPACING] * clipping_normaliser(integers, scalars)
    return scale * horizontal, scale * vertical


@njit(cache=True, error_model="numpy")
def clipping_normaliser(integers, scalars):
    """Factor that turns the sum of cell moments of a positive film into the trapezoidal sum."""
    return 1.0 if integers[CLIPPING] == FULL else 3.0 / (2.0 + np.cos(scalars[SPACING]))


@njit(cache=True, error_model="numpy")
def film_force_derivatives(padded, integers, scalars, arrays, gradient):
    """Fill ``gradient`` (nodes * stations, 2): derivative of the force with every pressure."""
    nodes, stations = integers[NODES], integers[STATIONS]
    cosine, sine = arrays[: nodes + 2], arrays[nodes + 2 : 2 * nodes + 4]
    weights = arrays[2 * nodes + 4 + stations * stations + stations :]
    factor = -scalars[SPACING] * clipping_normaliser(integers, scalars)
    cells = (
        nodes + integers[PERIODIC]
    )  # from node k to k + 1 of a padded row; those beside an edge come after
    gradient[:, :] = 0.0
    for j in range(stations):
        scale = factor * weights[j]
        row = padded[j * (nodes + 2) : (j + 1) * (nodes + 2)]
        own = gradient[j * nodes : (j + 1) * nodes]
        if integers[CLIPPING] == FULL:
            for i in range(nodes):
                own[i, 0], own[i, 1] = scale * cosine[i + 1], scale * sine[i + 1]
            continue
        for k in range(1, cells):
            _, _, ll, lr, rl, rr = cell_moments(row[k] - 1.0, row[k + 1] - 1.0, integers, scalars)
            own[k - 1, 0] += scale * (ll * cosine[k] + rl * cosine[k + 1])
            own[k - 1, 1] += scale * (ll * sine[k] + rl * sine[k + 1])
            own[k % nodes, 0] += scale * (lr * cosine[k] + rr * cosine[k + 1])
            own[k % nodes, 1] += scale * (lr * sine[k] + rr * sine[k + 1])
        for edge, near, following in ((0, 1, 2), (nodes + 1, nodes, nodes - 1)):
            if integers[PERIODIC] == 0:
                _, _, en, ef, nn, nf = end_moments(row[near] - 1.0, row[following] - 1.0, integers, scalars)
                own[near - 1, 0] += scale * (en * cosine[edge] + nn * cosine[near])
                own[near - 1, 1] += scale * (en * sine[edge] + nn * sine[near])
                own[following - 1, 0] += scale * (ef * cosine[edge] + nf * cosine[near])
                own[following - 1, 1] += scale * (ef * sine[edge] + nf * sine[near])
