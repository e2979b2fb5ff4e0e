"""The gas force on the journal, clipped within grid cells, and its derivative with every pressure (Eq. 9).

    F = -iint (p - 1)^+ (cos, sin) dtheta dz

Between the nodes the gauge pressure is a continuously differentiable, piecewise quadratic spline

    u(theta_i + x dtheta) = 1/2 P_{i-1} (1/2 - x)^2 + P_i (3/4 - x^2) + 1/2 P_{i+1} (1/2 + x)^2,   |x| <= 1/2
    P_i = p_i - (p_{i-1} - 2 p_i + p_{i+1}) / 8 - 1

which meets a smooth pressure at the nodes to third order.  Beside the foil edge, where u = 0 and the pressure
has a kink, one parabola covers 3/2 spacings and joins the spline with its slope.  The force is the integral
over the set where u > 0, whose ends move smoothly through the grid: the force is twice continuously
differentiable in time as long as the pressure crosses the ambient line with a slope.

The regularised clipping replaces u^+ by r(u), its convolution with the fourth-order kernel K(u/w)/w,

    K(t) = 105/64 (1 - t^2)^2 (1 - 3 t^2),  |t| < 1;      int K = 1,  int t^2 K = 0

so that r is three times continuously differentiable, equals u^+ where |u| >= w and changes integrals over a
smooth u by O(w^4).

Where a whole cell lies on the ambient line, u = 0, the positive part has two one-sided derivatives.  For a
perturbation e v and a weight w that both change sign after half a turn, the clipped integral is half of the
unclipped one,

    int (e v)^+ w = e/2 int v w + e/2 int |v| w,      int |v| w = 0

so half of the unclipped derivative is used there, in agreement with r'(0) = 1/2.
"""

from __future__ import annotations

import numpy as np

from pipelines.machine.kernels import kernel

from .film import (
    CLIPPING,
    FULL,
    GUMBEL,
    NODES,
    PERIODIC,
    REACH,
    SMOOTHING,
    SPACING,
    STATIONS,
    WIDE_REACH,
    film_layout,
    padded_nodes,
)

# Abscissae and weights of Gauss-Legendre quadrature on [0, 1], exact for r(u) cos: powers of x up to 18.
_GAUSS_POINTS = 0.5 + 0.5 * np.polynomial.legendre.leggauss(10)[0]
_GAUSS_WEIGHTS = 0.5 * np.polynomial.legendre.leggauss(10)[1]

# A cell lies on the ambient line if |p - 1| stays below this: the tolerance of equilibria leaves such errors.
AMBIENT = 1e-9

# Even part of r(t width) / width, whose odd part is t/2: powers 0, 2, ..., 8 of t.
_R0, _R2, _R4, _R6, _R8 = 35.0 / 512.0, 105.0 / 128.0, -175.0 / 256.0, 49.0 / 128.0, -45.0 / 512.0


@kernel(error_model="numpy")
def _power_integrals(a, b):
    """Integrals of 1, x, ..., x^4 from a to b."""
    a2, b2 = a * a, b * b
    return (
        b - a, (b2 - a2) / 2.0, (b2 * b - a2 * a) / 3.0, (b2 * b2 - a2 * a2) / 4.0,
        (b2 * b2 * b - a2 * a2 * a) / 5.0,
    )  # fmt: skip


@kernel(error_model="numpy")
def _roots_inside(c0, c1, c2, low, high):
    """The roots of c0 + c1 x + c2 x^2 in rising order, each moved to the nearest point of [low, high].

    The roots are computed as q/c2 and c0/q.  Without real roots, the vertex is returned twice.
    """
    c2 += 0.0  # not -0, which would put a root at the wrong infinity
    discriminant = c1 * c1 - 4.0 * c0 * c2
    if discriminant <= 0.0:
        vertex = low if c2 == 0.0 else min(max(-0.5 * c1 / c2, low), high)
        return vertex, vertex
    q = -0.5 * (c1 + np.copysign(np.sqrt(discriminant), c1))
    one, other = min(max(q / c2, low), high), min(max(c0 / q, low), high)
    return min(one, other), max(one, other)


@kernel(error_model="numpy")
def positive_moments(c0, c1, c2, low, high):
    """Integrals of 1, x, ..., x^4 over the part of [low, high] where c0 + c1 x + c2 x^2 > 0."""
    # u lies between its Bernstein coefficients.
    at_low, at_high = c0 + low * (c1 + low * c2), c0 + high * (c1 + high * c2)
    middle = c0 + 0.5 * c1 * (low + high) + c2 * low * high
    if (at_low <= 0.0) & (middle <= 0.0) & (at_high <= 0.0):
        return 0.0, 0.0, 0.0, 0.0, 0.0
    if (at_low >= 0.0) & (middle >= 0.0) & (at_high >= 0.0):
        return _power_integrals(low, high)
    # Between its roots u has the sign of -c2.
    one, other = _roots_inside(c0, c1, c2, low, high)
    m0, m1, m2, m3, m4 = _power_integrals(one, other)
    if c2 < 0.0:
        return m0, m1, m2, m3, m4
    p0, p1, p2, p3, p4 = _power_integrals(low, high)
    return p0 - m0, p1 - m1, p2 - m2, p3 - m3, p4 - m4


@kernel(error_model="numpy")
def is_ambient(left, middle, right):
    """Whether u with these Bernstein coefficients lies on the ambient line."""
    return (abs(left) <= AMBIENT) & (abs(middle) <= AMBIENT) & (abs(right) <= AMBIENT)


@kernel(error_model="numpy")
def _trigonometric(moments, spacing):
    """Moments of 1, x, x^2 with cos(dtheta x), then with sin(dtheta x), to second order in dtheta x."""
    m0, m1, m2, m3, m4 = moments
    half = 0.5 * spacing * spacing
    return m0 - half * m2, m1 - half * m3, m2 - half * m4, spacing * m1, spacing * m2, spacing * m3


@kernel(error_model="numpy")
def clipped_integrals(c0, c1, c2, low, high, spacing):
    """Integrals of u^+ cos(dtheta x) and u^+ sin(dtheta x) over [low, high], and their derivatives.

    u = c0 + c1 x + c2 x^2.  Returns the integral C with the cosine, its derivatives with c0, c1, c2, the
    integral S with the sine and its derivatives.  On the ambient line the derivatives are half of those
    without clipping.
    """
    k0, k1, k2, s0, s1, s2 = _trigonometric(positive_moments(c0, c1, c2, low, high), spacing)
    cosine, sine = c0 * k0 + c1 * k1 + c2 * k2, c0 * s0 + c1 * s1 + c2 * s2
    at_low, at_high = c0 + low * (c1 + low * c2), c0 + high * (c1 + high * c2)
    if is_ambient(at_low, c0 + 0.5 * c1 * (low + high) + c2 * low * high, at_high):
        k0, k1, k2, s0, s1, s2 = _trigonometric(_power_integrals(low, high), spacing)
        k0, k1, k2, s0, s1, s2 = 0.5 * k0, 0.5 * k1, 0.5 * k2, 0.5 * s0, 0.5 * s1, 0.5 * s2
    return cosine, k0, k1, k2, sine, s0, s1, s2


@kernel(error_model="numpy")
def regularised_positive_part(u, width):
    """The regularised positive part r(u) of the module's head, and its slope."""
    t = u / width
    if t >= 1.0:
        return u, 1.0
    if t <= -1.0:
        return 0.0, 0.0
    t2 = t * t
    value = 0.5 * t + _R0 + t2 * (_R2 + t2 * (_R4 + t2 * (_R6 + t2 * _R8)))
    slope = 0.5 + t * (2.0 * _R2 + t2 * (4.0 * _R4 + t2 * (6.0 * _R6 + t2 * 8.0 * _R8)))
    return width * value, slope


@kernel(error_model="numpy")
def regularised_integrals(c0, c1, c2, low, high, spacing, width):
    """The integrals and derivatives of ``clipped_integrals`` with r(u) in place of u^+.

    Between neighbouring roots of u = width and u = -width, r(u) is a polynomial in x, which Gauss quadrature
    integrates exactly, so that the integrals are as smooth as r.
    """
    upper_one, upper_other = _roots_inside(c0 - width, c1, c2, low, high)
    lower_one, lower_other = _roots_inside(c0 + width, c1, c2, low, high)
    # one pair of roots encloses the other
    ends = (low, lower_one, upper_one, upper_other, lower_other, high)
    if c2 >= 0.0:
        ends = (low, upper_one, lower_one, lower_other, upper_other, high)
    half = 0.5 * spacing * spacing
    cosine, k0, k1, k2, sine, s0, s1, s2 = 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
    for piece in range(5):
        start, length = ends[piece], ends[piece + 1] - ends[piece]
        middle = start + 0.5 * length
        if length == 0.0 or c0 + middle * (c1 + middle * c2) <= -width:
            continue
        for g in range(_GAUSS_POINTS.size):
            x, weight = start + length * _GAUSS_POINTS[g], length * _GAUSS_WEIGHTS[g]
            value, slope = regularised_positive_part(c0 + x * (c1 + x * c2), width)
            value, slope = weight * value, weight * slope
            even, odd = 1.0 - half * x * x, spacing * x
            cosine += value * even
            sine += value * odd
            k0 += slope * even
            k1 += slope * even * x
            k2 += slope * even * x * x
            s0 += slope * odd
            s1 += slope * odd * x
            s2 += slope * odd * x * x
    return cosine, k0, k1, k2, sine, s0, s1, s2


@kernel(error_model="numpy")
def cell_integrals(c0, c1, c2, low, high, integers, scalars):
    """The integrals of a cell, clipped or regularised as the bearing's setting says."""
    if integers[CLIPPING] == GUMBEL:
        return clipped_integrals(c0, c1, c2, low, high, scalars[SPACING])
    return regularised_integrals(c0, c1, c2, low, high, scalars[SPACING], scalars[SMOOTHING])


# Rows of scratch space, nodes + 2 each: the spline's P at the nodes, the derivatives of the force by it,
# and the kind of the spacing around each node: positive throughout (1), nowhere (0) or in part (-1).
COEFFICIENT, BY_X, BY_Y, KIND = range(4)
FORCE_SCRATCH = 4


@kernel(error_model="numpy")
def _fill_coefficients(row, integers, out):
    """P of a padded row of pressures; zero on a foil edge."""
    nodes = integers[NODES]
    inner, before, here, after = out[1 : nodes + 1], row[:nodes], row[1 : nodes + 1], row[2:]
    for i in range(nodes):
        inner[i] = 1.25 * here[i] - 0.125 * (before[i] + after[i]) - 1.0
    periodic = integers[PERIODIC] == 1
    out[0] = out[nodes] if periodic else 0.0
    out[nodes + 1] = out[1] if periodic else 0.0


@kernel(error_model="numpy")
def _apply_coefficients(by_coefficient, scale, integers, out):
    """Compute derivatives with the pressures of a row from those with P, and set the latter to zero."""
    nodes = integers[NODES]
    if integers[PERIODIC] == 1:
        by_coefficient[nodes] += by_coefficient[0]
        by_coefficient[1] += by_coefficient[nodes + 1]
        by_coefficient[0], by_coefficient[nodes + 1] = by_coefficient[nodes], by_coefficient[1]
    else:
        by_coefficient[0], by_coefficient[nodes + 1] = 0.0, 0.0
    before, here, after = by_coefficient[:nodes], by_coefficient[1 : nodes + 1], by_coefficient[2:]
    for i in range(nodes):
        out[i] = scale * (1.25 * here[i] - 0.125 * (before[i] + after[i]))
    by_coefficient[:] = 0.0


@kernel(error_model="numpy")
def _edge_force(scratch, edge, cosine, sine, integers, scalars, wanted):
    """Integral of u^+ (cos, sin) over the 3/2 spacings beside a foil edge.

    u is there the parabola that is zero at the edge and continues the spline.  Its coordinate runs from -1
    at the edge to 1/2, with 0 at the first node.
    """
    nodes = integers[NODES]
    node, other, turn = (1, 2, 1.0) if edge == 0 else (nodes, nodes - 1, -1.0)
    near, far = scratch[COEFFICIENT, node], scratch[COEFFICIENT, other]
    even, k0, k1, k2, odd, s0, s1, s2 = cell_integrals(
        (7.0 * near + far) / 9.0, (5.0 * far - near) / 9.0, (4.0 * far - 8.0 * near) / 9.0,
        -1.0, 0.5, integers, scalars,
    )  # fmt: skip
    c, s = cosine[node], turn * sine[node]
    if wanted:
        for direction, along, across in ((BY_X, c, -s), (BY_Y, turn * s, turn * c)):
            x0, x1, x2 = along * k0 + across * s0, along * k1 + across * s1, along * k2 + across * s2
            scratch[direction, node] += (7.0 * x0 - x1 - 8.0 * x2) / 9.0
            scratch[direction, other] += (x0 + 5.0 * x1 + 4.0 * x2) / 9.0
    return c * even - s * odd, turn * (s * even + c * odd)


@kernel(error_model="numpy")
def _cut_force(scratch, k, cosine, sine, integers, scalars, wanted):
    """Integral of u^+ (cos, sin) over the spacing around node k, where u may change its sign."""
    coefficient = scratch[COEFFICIENT]
    before, here, after = coefficient[k - 1], coefficient[k], coefficient[k + 1]
    even, k0, k1, k2, odd, s0, s1, s2 = cell_integrals(
        0.125 * (before + 6.0 * here + after), 0.5 * (after - before), 0.5 * (before - 2.0 * here + after),
        -0.5, 0.5, integers, scalars,
    )  # fmt: skip
    c, s = cosine[k], sine[k]
    if wanted:
        for direction, along, across in ((BY_X, c, -s), (BY_Y, s, c)):
            x0, x1, x2 = along * k0 + across * s0, along * k1 + across * s1, along * k2 + across * s2
            scratch[direction, k - 1] += 0.125 * x0 - 0.5 * x1 + 0.5 * x2
            scratch[direction, k] += 0.75 * x0 - x2
            scratch[direction, k + 1] += 0.125 * x0 + 0.5 * x1 + 0.5 * x2
    return c * even - s * odd, s * even + c * odd


@kernel(error_model="numpy")
def _fill_kinds(scratch, first, last, integers, scalars):
    """Fill KIND of the nodes ``first`` to ``last``, with zero elsewhere.

    u lies between its Bernstein coefficients, which are the mean of P with either neighbour and P itself.
    """
    kind = scratch[KIND]
    kind[:] = 0.0
    own, count = kind[first : last + 1], last - first + 1
    margin = 0.0 if integers[CLIPPING] == GUMBEL else scalars[SMOOTHING]
    before, here = scratch[COEFFICIENT, first - 1 : last], scratch[COEFFICIENT, first : last + 1]
    after = scratch[COEFFICIENT, first + 1 : last + 2]
    for i in range(count):
        left, middle, right = before[i] + here[i], here[i], here[i] + after[i]
        whole = (left >= 2.0 * margin) & (middle >= margin) & (right >= 2.0 * margin)
        empty = (left <= -2.0 * margin) & (middle <= -margin) & (right <= -2.0 * margin)
        decided = (whole | empty) & ~is_ambient(0.5 * left, middle, 0.5 * right)
        own[i] = (1.0 if whole else 0.0) if decided else -1.0


@kernel(error_model="numpy", fastmath={"reassoc", "contract"})
def _whole_force(scratch, cosine, sine, integers, scalars, wanted):
    """Integral of u^+ (cos, sin) over the spacings where u is positive throughout.

    With k0, k2 and s1 from ``clipped_integrals`` over [-1/2, 1/2], a node contributes C = c0 k0 + c2 k2 and
    S = c1 s1.
    """
    nodes, spacing = integers[NODES], scalars[SPACING]
    k0, k2, s1 = 1.0 - spacing**2 / 24.0, 1.0 / 12.0 - spacing**2 / 160.0, spacing / 12.0
    own, beside, across = 0.75 * k0 - k2, 0.125 * k0 + 0.5 * k2, 0.5 * s1
    coefficient, kind = scratch[COEFFICIENT], scratch[KIND]
    before, here, after, kind_here = (
        coefficient[:nodes],
        coefficient[1 : nodes + 1],
        coefficient[2:],
        kind[1 : nodes + 1],
    )
    c, s = cosine[1 : nodes + 1], sine[1 : nodes + 1]
    x, y = 0.0, 0.0
    for i in range(nodes):
        even, odd = own * here[i] + beside * (before[i] + after[i]), across * (after[i] - before[i])
        x += kind_here[i] * (c[i] * even - s[i] * odd)
        y += kind_here[i] * (s[i] * even + c[i] * odd)
    if wanted:
        c_before, c_after, s_before, s_after = cosine[:nodes], cosine[2:], sine[:nodes], sine[2:]
        kind_before, kind_after = kind[:nodes], kind[2:]
        by_x, by_y = scratch[BY_X, 1 : nodes + 1], scratch[BY_Y, 1 : nodes + 1]
        for i in range(nodes):
            left, right = kind_before[i], kind_after[i]
            by_x[i] += own * kind_here[i] * c[i] + left * (beside * c_before[i] - across * s_before[i])
            by_x[i] += right * (beside * c_after[i] + across * s_after[i])
        for i in range(nodes):
            left, right = kind_before[i], kind_after[i]
            by_y[i] += own * kind_here[i] * s[i] + left * (beside * s_before[i] + across * c_before[i])
            by_y[i] += right * (beside * s_after[i] - across * c_after[i])
    return x, y


@kernel(error_model="numpy")
def _station_force(scratch, cosine, sine, integers, scalars, wanted):
    """Integral of u^+ (cos, sin) over theta / dtheta at the station whose P is in ``scratch``."""
    nodes, periodic, kind = integers[NODES], integers[PERIODIC] == 1, scratch[KIND]
    first, last = (1, nodes) if periodic else (2, nodes - 1)
    _fill_kinds(scratch, first, last, integers, scalars)
    x, y = 0.0, 0.0
    for k in range(first, last + 1):
        if kind[k] < 0.0:
            kind[k] = 0.0
            own_x, own_y = _cut_force(scratch, k, cosine, sine, integers, scalars, wanted)
            x, y = x + own_x, y + own_y
    if periodic:
        kind[0], kind[nodes + 1] = kind[nodes], kind[1]
    else:
        for edge in range(2):
            own_x, own_y = _edge_force(scratch, edge, cosine, sine, integers, scalars, wanted)
            x, y = x + own_x, y + own_y
    own_x, own_y = _whole_force(scratch, cosine, sine, integers, scalars, wanted)
    return x + own_x, y + own_y


@kernel(error_model="numpy")
def _full_weight(k, integers):
    """Weight of the padded node k in the integral of the whole pressure over theta / dtheta.

    The trapezoidal sum is spectrally accurate on a periodic film. On one with an edge, where p = 1 and has a
    kink, Gregory's weights 7/6 and 23/24 of the two nodes beside it make it as accurate as the scheme of
    fourth order.
    """
    if integers[PERIODIC] == 1 or integers[REACH] < WIDE_REACH:
        return 1.0
    from_edge = min(k, integers[NODES] + 1 - k)
    if from_edge > 2:
        return 1.0
    return 7.0 / 6.0 if from_edge == 1 else 23.0 / 24.0


@kernel(error_model="numpy")
def film_force(padded, integers, scalars, arrays, gradient, scratch):
    """Gas force on the journal (F_x, F_y).

    ``gradient`` (2, nodes * stations), unless it is empty, receives the derivative with every pressure.
    ``scratch`` (FORCE_SCRATCH, nodes + 2).
    """
    nodes, stations, wanted = integers[NODES], integers[STATIONS], gradient.shape[1] > 0
    at, length, first = film_layout(integers), padded_nodes(integers), integers[REACH] - 1
    cosine, sine = arrays[first : at.sine], arrays[at.sine + first : at.second_derivative]
    weights = arrays[at.weights :]
    scratch[BY_X], scratch[BY_Y] = 0.0, 0.0
    x, y = 0.0, 0.0
    for j in range(stations):
        scale = -scalars[SPACING] * weights[j]
        row = padded[j * length + first : (j + 1) * length - first]
        if integers[CLIPPING] == FULL:
            for k in range(1, nodes + 1):
                weight = scale * _full_weight(k, integers)
                x += weight * (row[k] - 1.0) * cosine[k]
                y += weight * (row[k] - 1.0) * sine[k]
                if wanted:
                    at_node = j * nodes + k - 1
                    gradient[0, at_node], gradient[1, at_node] = weight * cosine[k], weight * sine[k]
            continue
        _fill_coefficients(row, integers, scratch[COEFFICIENT])
        own_x, own_y = _station_force(scratch, cosine, sine, integers, scalars, wanted)
        x, y = x + scale * own_x, y + scale * own_y
        if wanted:
            for k in range(2):
                _apply_coefficients(
                    scratch[BY_X + k], scale, integers, gradient[k, j * nodes : (j + 1) * nodes]
                )
    return x, y
