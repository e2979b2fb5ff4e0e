"""Stability of an invariant curve: the spectrum of its linearised flow over the circle.

With V (N, k) the smooth slow bases and C(theta) = V(theta + rho)' M(theta) V(theta), the transfer operator

    (B w)(theta) = C(theta - rho) w(theta - rho),      (B w)^_m = e^(-i m rho) sum_n C^_(m-n) w^_n

carries fields around.  If B w = mu w then e^(i m theta) w belongs to mu e^(-i m rho): eigenvalues come in
circles, one for each multiplier of the curve, of which only the modulus has a meaning.  The members of a
circle have their centres of wave numbers, sum m abs(w^_m)^2 / sum abs(w^_m)^2, exactly one apart, so each
circle has one member with its centre in [-1/2, 1/2): the one that few wave numbers resolve best.  Two such of
a circle that is its own conjugate with centres at +-1/2 (a bundle that is a Moebius band) are told by their
eigenvalues and counted once.

A curve with unknown rotation has the multiplier 1 with the eigenfunction dx/dtheta.

The eigenproblem is made small: only the multipliers above a cut are sought, in the invariant subspaces of C
that hold them, and only as many wave numbers are taken as resolve their eigenfunctions.

The product of all multipliers of the subspaces is the mean growth of volume, exp of the mean of log |det C|:
where the selection misses it (a rotation by a simple fraction of a turn, where circles have many
eigenfunctions, or too few angles) the spectrum is not complete.  The growth of volumes under C along one long
orbit of the rotation then gives the moduli, less sharply but without any choice.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np

from pipelines.bifurcations.tori.fourier import Array, angles, applied, derivative, interpolated, shift_matrix
from pipelines.bifurcations.tori.invariant_curve import Torus
from pipelines.bifurcations.tori.problem import TorusProblem
from pipelines.bifurcations.tori.slow_bases import leading_columns, leading_coordinates, rearranged
from pipelines.bifurcations.tori.system import pass_from_all
from pipelines.orbits.floquet import Complex, deterministic_block
from pipelines.orbits.system import Vector

_FEWEST_WAVES = 4
_RESOLVED = 1e-5  # residual of the multipliers above the cut; their error is nearer to its square
_OUTSIDE = 1e-6  # distance from the unit circle within which a multiplier is reported as on it
_SAME_CENTRE = 0.25  # by which the centres of two members of a circle may miss an integer distance
_SAME_CIRCLE = 1e-3  # relative difference of eigenvalues that belong to one circle
_GROWTH_STEPS, _SETTLING_STEPS = 400, 60
_GROWTH_STARTS = (0.0, 0.7, 1.9)
_LOWEST = -700.0  # logarithm in the place of that of zero
_STALLED = 0.5  # a sweep that leaves more of the largest residual is the last: too few angles, not columns
_GROWTH_ERROR = 0.02  # relative error of moduli from growth
_VOLUME_ERROR = 1e-3  # of the logarithm of a multiplier, in the product of all


@dataclass(frozen=True)
class TorusSpectrum:
    """Multipliers of an invariant curve.

    ``multipliers`` (m,): one eigenvalue of every circle that was found, by falling modulus, m <= k, among
    them all above the cut (``checked_modulus`` of the options) when the spectrum is complete;
    ``residuals`` (m,): of B v = mu v for the whole state, norm of v one; ``trivial``: index of the multiplier
    1 of a curve with unknown rotation, else -1; ``growth`` (p,): moduli from growth along an orbit of the
    leading fields; ``columns`` (k,): the same of all columns of the bases, of which the last are rough;
    ``complete``: one multiplier for each leading field, with the right product.
    """

    multipliers: Complex
    residuals: Vector
    trivial: int
    growth: Vector
    columns: Vector
    complete: bool

    @property
    def moduli(self) -> Vector:
        """Nontrivial moduli by falling size; from the growth if the spectrum is not complete."""
        if self.complete:
            moduli = np.abs(self.multipliers)
            return moduli if self.trivial < 0 else np.delete(moduli, self.trivial)
        if self.trivial < 0:
            return self.growth
        return np.delete(self.growth, int(np.argmin(np.abs(self.growth - 1.0))))

    @property
    def unstable(self) -> int:
        """Number of multipliers outside the unit circle by more than their error."""
        return int(np.sum(self.moduli > 1.0 + (_OUTSIDE if self.complete else _GROWTH_ERROR)))

    @property
    def decided(self) -> bool:
        """Whether every modulus is far enough from one for growth rates to decide on its side."""
        return self.complete or not bool(np.any(np.abs(self.moduli - 1.0) <= _GROWTH_ERROR))


def converged_spectrum(problem: TorusProblem, torus: Torus) -> tuple[Torus, TorusSpectrum]:
    """The spectrum after as many further subspace iterations as its multipliers need, and the curve.

    The curve has the bases of the last iteration, with a new leading block.
    """
    torus, spectrum = _spectrum(problem, torus)
    before = math.inf
    for _ in range(problem.options.multiplier_sweeps):
        checked = np.abs(spectrum.multipliers) > problem.options.checked_modulus
        largest = float(np.max(spectrum.residuals[checked], initial=0.0))
        if torus.bases.whole or largest <= 2.0 * _RESOLVED or largest > _STALLED * before:
            break
        before = largest
        bases = torus.bases.following(torus.passed.columns, torus.unknowns.rotation)
        passed = pass_from_all(problem, torus.unknowns, bases.columns, True)
        torus, spectrum = _spectrum(problem, replace(torus, bases=bases, passed=passed))
    return torus, spectrum


def torus_spectrum(problem: TorusProblem, torus: Torus) -> TorusSpectrum:
    """The spectrum in the curve's own bases."""
    return _spectrum(problem, torus)[1]


def _spectrum(problem: TorusProblem, torus: Torus) -> tuple[Torus, TorusSpectrum]:
    """The spectrum, and the curve with the leading block of its bases arranged for it."""
    known = problem.circle.rotation(torus.unknowns.parameter) is not None
    rotation, cut = torus.unknowns.rotation, problem.options.checked_modulus
    bases, images = torus.bases.columns, torus.passed.columns
    columns = growth_moduli(transport(bases, images, rotation), rotation)
    leading = leading_columns(columns, cut)
    coordinates = leading_coordinates(bases, images, rotation, leading, columns)
    frames, moved = bases @ coordinates, images @ coordinates
    compressed = transport(frames, moved, rotation)
    growth = growth_moduli(compressed, rotation)
    multipliers, fields = _circles(compressed, rotation, cut)
    values = _values(fields, torus.count)
    spectrum = TorusSpectrum(
        multipliers,
        _residuals(frames @ values, moved @ values, multipliers, rotation),
        -1 if known else _tangent_index(torus, frames @ values),
        growth,
        columns,
        _complete(multipliers, compressed),
    )
    if torus.bases.whole:
        return torus, spectrum
    arranged, images = rearranged(bases, images, coordinates)
    return replace(torus, bases=arranged, passed=replace(torus.passed, columns=images)), spectrum


def transport(frames: Array, images: Array, rotation: float) -> Array:
    """C(theta_j) = V(theta_j + rho)' M_j V_j for frames V (M, N, k) and their images M V, shape (M, k, k)."""
    if frames.shape[1] == frames.shape[2]:
        return images
    ahead = applied(shift_matrix(len(frames), rotation)[0], frames)
    return np.asarray(np.swapaxes(ahead, 1, 2) @ images)


def _circles(compressed: Array, rotation: float, cut: float) -> tuple[Complex, Complex]:
    """One eigenvalue of every circle and its eigenfunction, as from ``_one_of_each``.

    With as many wave numbers as the eigenvalues above the cut need.
    """
    count, fullest = len(compressed), len(compressed) // 2
    behind = applied(shift_matrix(count, -rotation)[0], compressed)  # C(theta - rho)
    waves = min(_FEWEST_WAVES, fullest)
    while True:
        multipliers, fields = _one_of_each(compressed, rotation, waves)
        turned = fields * np.exp(-1j * rotation * np.arange(-waves, waves + 1))[None, :, None]
        own = _values(fields, count)
        defect = _norms(behind @ _values(turned, count) - own * multipliers) / _norms(own)
        all_found = len(multipliers) == compressed.shape[1]
        if waves == fullest or (all_found and np.all(defect[np.abs(multipliers) > cut] <= _RESOLVED)):
            return multipliers, fields
        waves = min(2 * waves, fullest)


def growth_moduli(compressed: Array, rotation: float) -> Vector:
    """Moduli of the multipliers by falling size, from growth rates along the rotation.

    exp of the mean of log diag R in C Q = Q_next R along the rotation, weighted by the bump exp(-1/(t (1
    - t))), whose means converge faster than any power of the number of steps; the largest over a few
    starting angles.
    """
    width, starts = compressed.shape[1], np.array(_GROWTH_STARTS)
    time = np.arange(1, _GROWTH_STEPS + 1) / (_GROWTH_STEPS + 1.0)
    weights = np.exp(-1.0 / (time * (1.0 - time)))
    weights /= weights.sum()
    frames = np.linalg.qr(deterministic_block(width, width) + np.eye(width))[0]
    logarithms = np.zeros((_SETTLING_STEPS + _GROWTH_STEPS, len(starts), width))
    for step, row in enumerate(logarithms):
        frames, factors = np.linalg.qr(interpolated(compressed, starts + rotation * step) @ frames)
        with np.errstate(divide="ignore"):
            row[:] = np.log(np.abs(np.diagonal(factors, axis1=1, axis2=2)))
    means = np.tensordot(weights, np.maximum(logarithms[_SETTLING_STEPS:], _LOWEST), axes=1)
    return np.asarray(np.sort(np.exp(means.max(axis=0)))[::-1])


def _one_of_each(compressed: Array, rotation: float, waves: int) -> tuple[Complex, Complex]:
    """One eigenvalue of every circle, by falling modulus (m,), and its eigenfunction.

    The eigenfunction has coefficients of the wave numbers -L..L in the bases, (m, 2 L + 1, k), L =
    ``waves``.
    """
    width = compressed.shape[1]
    numbers = np.arange(-waves, waves + 1)
    values, vectors = np.linalg.eig(_transfer_matrix(compressed, rotation, waves))
    vectors = np.ascontiguousarray(vectors.T).reshape(len(values), len(numbers), width)
    weights = np.sum(np.abs(vectors) ** 2, axis=2)
    centres = weights @ numbers / np.sum(weights, axis=1)
    # nearest to the middle first; of a pair of conjugates the one with positive imaginary part
    order = np.lexsort((values.imag < 0.0, -np.abs(values), np.round(np.abs(centres), 6)))
    chosen: list[int] = []
    for index in order:
        if len(chosen) == width or abs(centres[index]) > 0.5 + _SAME_CENTRE:
            break
        if not any(_in_one_circle(values, centres, int(index), other, rotation) for other in chosen):
            chosen.append(int(index))
    chosen.sort(key=lambda index: -abs(values[index]))
    return np.asarray(values[chosen], dtype=complex), np.asarray(vectors[chosen], dtype=complex)


def _in_one_circle(values: Complex, centres: Vector, first: int, second: int, rotation: float) -> bool:
    """Whether mu_1 = mu_2 e^(-i m rho) where the centres are m apart, m not zero."""
    distance = float(centres[first] - centres[second])
    number = round(distance)
    if number == 0 or abs(distance - number) > _SAME_CENTRE:
        return False
    expected = values[second] * np.exp(-1j * number * rotation)
    return bool(abs(values[first] - expected) <= _SAME_CIRCLE * abs(expected))


def _transfer_matrix(compressed: Array, rotation: float, waves: int) -> Complex:
    """Blocks e^(-i m rho) C^_(m-n) for m, n = -L..L."""
    count, width, _ = compressed.shape
    half = count // 2
    spectrum = np.fft.fft(compressed, axis=0) / count  # wave number m at m modulo count
    numbers = np.arange(-waves, waves + 1)
    gaps = numbers[:, None] - numbers[None, :]
    blocks = spectrum[gaps % count] * (np.abs(gaps) <= half)[:, :, None, None]
    blocks = blocks * np.exp(-1j * numbers * rotation)[:, None, None, None]
    size = len(numbers) * width
    return np.asarray(np.swapaxes(blocks, 1, 2).reshape(size, size))


def _values(fields: Complex, count: int) -> Complex:
    """Eigenfunctions (m, 2 L + 1, k) at the angles, shape (M, k, m)."""
    waves = fields.shape[1] // 2
    phases = np.exp(1j * angles(count)[:, None] * np.arange(-waves, waves + 1)[None, :])
    return np.asarray(np.einsum("jw,mwk->jkm", phases, fields))


def _norms(values: Complex) -> Vector:
    """Norm of every field in values (M, ., m), shape (m,)."""
    return np.asarray(np.linalg.norm(values, axis=(0, 1)))


def _residuals(own: Complex, moved: Complex, multipliers: Complex, rotation: float) -> Vector:
    """Norms of D v - mu v over those of v, for fields v = ``own`` (M, N, m) with M v = ``moved``."""
    shift = shift_matrix(len(own), -rotation)[0].astype(complex)
    carried = (shift @ moved.reshape(len(own), -1)).reshape(moved.shape)
    return _norms(carried - own * multipliers) / _norms(own)


def _tangent_index(torus: Torus, functions: Complex) -> int:
    """The field of ``functions`` (M, N, m) that is most nearly parallel to dx/dtheta."""
    overlap = np.abs(np.tensordot(derivative(torus.unknowns.states), functions, axes=2)) / _norms(functions)
    return int(np.argmax(overlap))


def _complete(multipliers: Complex, compressed: Array) -> bool:
    """Whether there is one multiplier for every column, and their product is the mean growth of volume."""
    width = compressed.shape[1]
    if len(multipliers) < width:
        return False
    volume = float(np.mean(np.linalg.slogdet(compressed)[1]))
    found = float(np.sum(np.log(np.maximum(np.abs(multipliers), np.finfo(float).tiny))))
    return abs(found - volume) <= _VOLUME_ERROR * width
