"""Critical normal-form coefficients of the stroboscopic map phi (Kuznetsov, Elements, ch. 5, 9 and 10).

Cycles of unknown period have those of their return map: ``pipelines.bifurcations.normal_forms.section``.

With B = D2 phi, C = D3 phi at the critical cycle, M q = mu q of unit 2-norm, p'M = mu p', p'q = 1:

    fold               x -> x + a x^2              a = p.B(q, q) / 2
    period doubling    x -> -x + b x^3             b = p.[C(q, q, q) + 3 B(q, h)] / 6,    (I - M) h = B(q, q)
    Neimark-Sacker     w -> mu w (1 + d abs(w)^2)  d = p.[C(q, q, q*) + 2 B(q, h11) + B(q*, h20)] / (2 mu),
                                                   (I - M) h11 = B(q, q*),  (mu^2 - M) h20 = B(q, q)

B and C are first and second differences of the tangent map, which is itself exact: B(x, y) is the derivative
of M y along x.  A coefficient is computed from the fourth-order differences with the steps h and 2h and from
the second-order ones with h; their distance is the error estimate.  Where only the distance between maps is
wanted the second-order ones are enough, for half of the passes.  The tangent map has to be smooth
over the step: ``pipelines.bifurcations.normal_forms.smoothed`` sees to that where it is not.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial

import numpy as np

from pipelines.bifurcations.critical.critical_cycles import Critical, left_products
from pipelines.bifurcations.critical.cycle_manifold import ManifoldLinearisation, picard_iteration
from pipelines.bifurcations.detection import EventKind
from pipelines.bifurcations.normal_forms.section import on_section
from pipelines.bifurcations.plane import Position
from pipelines.orbits.floquet import Complex
from pipelines.orbits.system import Matrix, Vector

_SOLVE_TOLERANCE = 1e-7  # of the Picard part of h, h11 and h20 and of the left products
_SHORTER = 0.1  # step of the first derivatives, in steps of the second
_SHORTEST = 1e-3  # of a difference to one side: h against eps/h
_STRONG_RESONANCE = 1e-6  # distance of cos_theta from 1 or -1 below which d is not defined


@dataclass(frozen=True)
class NormalFormOptions:
    """``difference``: displacement of the largest entry of the state, relative to the orbit's."""

    difference: float = 2e-3

    def __post_init__(self) -> None:
        if not 0.0 < self.difference < 1.0:
            raise ValueError(f"difference is {self.difference}; it must lie between 0 and 1")


@dataclass(frozen=True)
class NormalForm:
    """a (its sign is that of q), b or d, which is complex.

    ``error``: estimate of all errors, ``real_error`` of those of the real part, on which the type depends;
    ``noise``: the part that the differences leave.  The rest is the distance between regularisations of the
    map (``pipelines.bifurcations.normal_forms.smoothed``), which kinks change tenfold from point to point.
    """

    kind: EventKind
    coefficient: complex
    error: float
    real_error: float
    noise: float

    @property
    def supercritical(self) -> bool:
        """Whether the solution born here is stable: b > 0, Re d < 0; False for a fold."""
        if self.kind is EventKind.PERIOD_DOUBLING:
            return self.coefficient.real > 0.0
        return self.kind is EventKind.NEIMARK_SACKER and self.coefficient.real < 0.0

    @property
    def decided(self) -> bool:
        """Whether the sign of b or Re d is larger than its error."""
        return abs(self.coefficient.real) > self.real_error


def normal_form(
    linear: ManifoldLinearisation, critical: Critical, options: NormalFormOptions
) -> NormalForm | None:
    """The normal form for the problem's kind; None for a neutral saddle or a singular linear system."""
    values = critical_coefficients(linear, critical, options)
    if values is None:
        return None
    noise = abs(complex(values[0] - values[1]))
    return NormalForm(linear.at.problem.kind, complex(values[0]), noise, noise, noise)


def critical_coefficients(
    linear: ManifoldLinearisation, critical: Critical, options: NormalFormOptions, rough: bool = False
) -> Complex | None:
    """The coefficient by fourth-order and by second-order differences (2,); if ``rough`` by the latter (1,).

    None as in ``normal_form``.
    """
    kind = linear.at.problem.kind
    if linear.at.problem.period_map.autonomous:
        linear, critical = on_section(linear, critical)
    differences = partial(_Differences, linear, options=options, rough=rough)
    try:
        if kind is EventKind.FOLD:
            return _fold(linear, critical, differences)
        if kind is EventKind.PERIOD_DOUBLING:
            return _period_doubling(linear, critical, differences)
        if abs(critical.cos_theta) < 1.0 - _STRONG_RESONANCE:
            return _neimark_sacker(linear, critical, differences)
    except np.linalg.LinAlgError:
        pass
    return None


def _fold(linear: ManifoldLinearisation, critical: Critical, differences: _Along) -> Complex:
    q = critical.right / linear.at.length(critical.right)
    quadratic, _ = differences(q[:, 0]).of(q, linear.mapped(q))
    # a = p.B(q, q) / 2
    return 0.5 * _left(linear, critical, quadratic, q)[0]


def _period_doubling(linear: ManifoldLinearisation, critical: Critical, differences: _Along) -> Complex:
    q = critical.right / linear.at.length(critical.right)
    along = differences(q[:, 0])
    quadratic, cubic = along.of(q, linear.mapped(q))
    # (I - M) h = B(q, q), for all differences side by side
    h = _solve(linear, 1.0, quadratic.astype(complex)).real
    # b = p.[C(q, q, q) + 3 B(q, h)] / 6
    return _left(linear, critical, cubic + 3.0 * along.first(h), q)[0] / 6.0


def _left(linear: ManifoldLinearisation, critical: Critical, columns: Matrix, q: Matrix) -> Complex:
    """p.x for ``columns`` x with p.q = 1 for the real critical vectors ``q`` (N, m): (m, c)."""
    together = np.hstack([q, columns])
    phases, count = np.zeros(together.shape[1]), q.shape[1]
    products = left_products(linear, critical, together, phases, _SOLVE_TOLERANCE)
    return np.linalg.solve(products[:, :count], products[:, count:]).astype(complex)


def _neimark_sacker(linear: ManifoldLinearisation, critical: Critical, differences: _Along) -> Complex:
    mu, coefficients, left = _critical_pair(critical)
    q = critical.right @ coefficients
    parts = np.column_stack([q.real, q.imag])
    length = linear.at.length(parts)
    parts, left = parts / length, left * length
    centre = linear.mapped(parts)
    real, imaginary = (differences(np.ascontiguousarray(part)) for part in parts.T)
    by_real, cubic_real = real.of(parts, centre)
    by_imaginary, cubic_imaginary = imaginary.of(parts, centre)
    # columns: x, y by fine differences, then x, y by coarse ones
    x, y = slice(0, None, 2), slice(1, None, 2)
    xx, xy, yy = by_real[:, x], 0.5 * (by_real[:, y] + by_imaginary[:, x]), by_imaginary[:, y]
    # C(q, q, q*) = xxx + yyx + i (xxy + yyy)
    cubic = cubic_real[:, x] + cubic_imaginary[:, x] + 1j * (cubic_real[:, y] + cubic_imaginary[:, y])
    h11 = _solve(linear, 1.0, (xx + yy).astype(complex)).real
    h20 = _solve(linear, mu * mu, xx - yy + 2j * xy)
    columns = np.hstack([h11, h20.real, h20.imag])
    (x11, x20r, x20i), (y11, y20r, y20i) = (np.hsplit(d.first(columns), 3) for d in (real, imaginary))
    # B(q, h11) = x11 + i y11,   B(q*, h20) = (x - i y)(h20r + i h20i)
    total = cubic + 2.0 * (x11 + 1j * y11) + (x20r + y20i) + 1j * (x20i - y20r)
    # L'x with L'W = 1, then p = l'L'
    products = _left(linear, critical, np.hstack([total.real, total.imag]), critical.right)
    count = total.shape[1]
    return np.asarray(left @ (products[:, :count] + 1j * products[:, count:]) / (2.0 * mu))


def _critical_pair(critical: Critical) -> tuple[complex, Complex, Complex]:
    """mu with positive imaginary part on the circle, the coefficients c of q = W c and l with l'L' = p'."""
    multipliers, right = np.linalg.eig(critical.matrix)
    upper = int(np.argmax(multipliers.imag))
    coefficients = right[:, upper]
    left = np.linalg.inv(right)[upper]
    mu = complex(multipliers[upper])
    return mu / abs(mu), coefficients, left


_Along = Callable[[Vector], "_Differences"]


@dataclass(frozen=True)
class _Differences:
    """Derivatives of M along one direction by passes beside the cycle."""

    linear: ManifoldLinearisation
    direction: Vector
    options: NormalFormOptions
    rough: bool

    @property
    def step(self) -> float:
        return self.options.difference * self.linear.scale / float(np.max(np.abs(self.direction)))

    def of(self, columns: Matrix, centre: Matrix) -> tuple[Matrix, Matrix]:
        """First and second derivatives of M columns, given M ``columns`` at the ``centre``.

        Each (N, 2 c), fourth order with h and 2h, then second order with h; if ``rough`` (N, c), the latter.
        """
        h = self.step
        m1, p1 = (self._beside(k * h, columns) for k in (-1, 1))
        first, second = (p1 - m1) / (2.0 * h), (p1 + m1 - 2.0 * centre) / (h * h)
        if self.rough:
            return first, second
        m2, p2 = (self._beside(k * h, columns) for k in (-2, 2))
        finer = (8.0 * (p1 - m1) - (p2 - m2)) / (12.0 * h)
        fourth = (16.0 * (p1 + m1) - (p2 + m2) - 30.0 * centre) / (12.0 * h * h)
        return np.hstack([finer, first]), np.hstack([fourth, second])

    def first(self, columns: Matrix) -> Matrix:
        """First derivatives of M columns from one pair of passes with a shorter step.

        With this step second derivatives would be lost in rounding.  If ``rough`` from one pass with a still
        shorter one, and the columns along the orbit of the cycle.
        """
        if self.rough:
            h = _SHORTEST * self.step
            return (self._beside(h, columns) - self.linear.mapped(columns)) / h
        h = _SHORTER * self.step
        return (self._beside(h, columns) - self._beside(-h, columns)) / (2.0 * h)

    def _beside(self, distance: float, columns: Matrix) -> Matrix:
        way = Position(self.direction, 0.0, np.zeros(2))
        return self.linear.at.beside(way, distance, self.linear.image).tangent(columns).columns


def _solve(linear: ManifoldLinearisation, value: complex, columns: Complex) -> Complex:
    """(value - M)^-1 columns: Picard sweeps outside the slow subspace, a small system inside."""
    count, basis = columns.shape[1], linear.basis
    matrix = np.array([[value.real, value.imag], [-value.imag, value.real]])
    real = np.hstack([columns.real, columns.imag])
    # q value = Q (M q + x) as a real pair [Re q, Im q]
    inverse = np.asarray(np.kron(np.linalg.inv(matrix), np.eye(count)), dtype=np.float64)
    picard = picard_iteration(
        linear.at, linear.image, basis, real, inverse, _SOLVE_TOLERANCE, sizes=1.0 / linear.scale
    )
    # (H - value) a = -V'(x + M q)
    sources = columns + picard.image[:, :count] + 1j * picard.image[:, count:]
    projected = basis.T @ linear.image.columns
    inside = np.linalg.solve(value * np.eye(len(projected)) - projected, basis.T @ sources)
    return np.asarray(basis @ inside + picard.columns[:, :count] + 1j * picard.columns[:, count:])
