"""Bifurcations of tori between two points of a branch: detected by the count of multipliers, located, named.

Multipliers of a torus come in circles, of which only the moduli r_0 >= r_1 >= ... have a meaning, so

    log r_k = 0,   k between the numbers of unstable multipliers at both ends,      dlambda/ds = 0 at a fold

are the test functions, evaluated on corrected tori inside the step. The circle that crosses tells the kind:

    two circles of one modulus                       quasi-periodic Hopf bifurcation
    a real one, mu > 0: with a turning parameter     fold (quasi-periodic saddle-node), else branch point
    a real one, mu < 0, or on a Moebius band         quasi-periodic period doubling

The member of a circle nearest to the middle is real on an orientable bundle; on a Moebius band its square
turns by the rotation.
"""

from __future__ import annotations

import cmath
import math
from collections.abc import Iterator
from dataclasses import dataclass
from enum import Enum

import numpy as np

from pipelines.bifurcations.roots import Node, zero
from pipelines.bifurcations.tori.invariant_curve import Torus
from pipelines.bifurcations.tori.problem import TorusUnknowns
from pipelines.bifurcations.tori.segment import TorusSegment
from pipelines.bifurcations.tori.stability import TorusSpectrum, converged_spectrum
from pipelines.orbits.system import Vector

UNDECIDED = -1  # number of unstable multipliers where growth rates do not tell it
_SAME_MODULUS = 1e-4  # relative difference of the moduli of two conjugate circles
_REAL = 0.05  # [rad] from 0 or pi within which a multiplier is real


class TorusEventKind(Enum):
    """Kinds of bifurcations of a torus along a branch."""

    FOLD = "the tori turn back: quasi-periodic saddle-node"
    BRANCH_POINT = "a real multiplier passes one, the tori go on: pitchfork or transcritical bifurcation"
    PERIOD_DOUBLING = "quasi-periodic period doubling"
    HOPF = "quasi-periodic Hopf bifurcation: a third frequency"
    UNKNOWN = "a modulus passes one; no eigenvalue tells the kind"


@dataclass(frozen=True)
class TorusEvent:
    """A bifurcation of tori.

    ``unknowns``: the torus there; ``moduli``: of its multipliers; ``arclength`` from the first point of the
    branch; ``destabilises``: whether fewer multipliers are unstable before its step than behind it, None
    where these numbers are equal or one is not known; ``residual``: of the test function, NaN where it was
    detected but not located: then the torus is the one behind it.
    """

    kind: TorusEventKind
    unknowns: TorusUnknowns
    moduli: Vector
    arclength: float
    destabilises: bool | None
    residual: float


@dataclass(frozen=True)
class TorusTests:
    """What the end of a step tells of bifurcations: moduli, their unstable number or -1, dlambda/ds."""

    moduli: Vector
    unstable: int
    turning: float

    @classmethod
    def of(cls, spectrum: TorusSpectrum, tangent: TorusUnknowns) -> TorusTests:
        """The tests of a torus with the unit tangent of its branch."""
        return cls(spectrum.moduli, unstable_number(spectrum), tangent.parameter)


def unstable_number(spectrum: TorusSpectrum) -> int:
    """Number of unstable multipliers, or ``UNDECIDED``."""
    return spectrum.unstable if spectrum.decided else UNDECIDED


def find_events(
    segment: TorusSegment, before: TorusTests, end: TorusSpectrum, arclength: float, tolerance: float
) -> tuple[TorusEvent, ...]:
    """The bifurcations on a segment, along the branch.

    ``before``: what its start tells; ``end``: the spectrum at its end; ``arclength``: of its start;
    ``tolerance``: of the places, in arclength.
    """
    after = TorusTests.of(end, segment.end_tangent)
    search = _Search(segment, before, after, end, arclength, max(tolerance / segment.length, 1e-14))
    return tuple(sorted(search.events(), key=lambda event: event.arclength))


@dataclass(frozen=True)
class _Search:
    """The search for bifurcations on one segment; ``width``: of a place, in fractions."""

    segment: TorusSegment
    before: TorusTests
    after: TorusTests
    end: TorusSpectrum
    arclength: float
    width: float

    def events(self) -> Iterator[TorusEvent]:
        """Every bifurcation once."""
        turned = self.before.turning * self.after.turning < 0.0
        if turned:
            yield self._located(None)
        if UNDECIDED in (self.before.unstable, self.after.unstable):
            return
        first, last = sorted((self.before.unstable, self.after.unstable))
        index = first
        while index < last:
            event = self._located(index)
            index += 2 if event.kind is TorusEventKind.HOPF else 1
            folds_own = turned and event.kind is TorusEventKind.BRANCH_POINT
            if not folds_own:
                yield event

    def _located(self, index: int | None) -> TorusEvent:
        """The bifurcation at which the modulus number ``index`` is one; None: the fold."""
        tested: dict[float, tuple[Torus, TorusSpectrum, float]] = {}

        def test(fraction: float) -> float:
            if fraction not in tested:
                torus, spectrum = self._torus_at(fraction)
                tested[fraction] = torus, spectrum, self._test(torus, spectrum, index)
            return tested[fraction][2]

        try:
            fraction = zero(test, *self._ends(index), self.width)
            value = test(fraction)
        except _NotLocatedError:
            return self._event(index, self.segment.end, self.end, 1.0, math.nan)
        torus, spectrum, _ = tested[fraction]
        return self._event(index, torus.unknowns, spectrum, fraction, abs(value))

    def _test(self, torus: Torus, spectrum: TorusSpectrum, index: int | None) -> float:
        if index is not None:
            return _logarithm(spectrum.moduli, index)
        tangent = self.segment.tangent_of(torus)
        if tangent is None:
            raise _NotLocatedError
        return tangent.parameter

    def _ends(self, index: int | None) -> tuple[Node, Node]:
        ends = self.before, self.after
        if index is None:
            return Node(0.0, ends[0].turning), Node(1.0, ends[1].turning)
        low, high = (_logarithm(tests.moduli, index) for tests in ends)
        if not low * high < 0.0:  # a modulus within its error of one
            raise _NotLocatedError
        return Node(0.0, low), Node(1.0, high)

    def _torus_at(self, fraction: float) -> tuple[Torus, TorusSpectrum]:
        torus = self.segment.torus_at(fraction)
        if torus is None:
            raise _NotLocatedError
        torus, spectrum = converged_spectrum(self.segment.problem, torus)
        if not spectrum.complete:  # moduli from growth: too blunt for a place
            raise _NotLocatedError
        return torus, spectrum

    def _event(
        self,
        index: int | None,
        unknowns: TorusUnknowns,
        spectrum: TorusSpectrum,
        fraction: float,
        residual: float,
    ) -> TorusEvent:
        kind = TorusEventKind.FOLD if index is None else critical_kind(spectrum, index, unknowns.rotation)
        arclength = self.arclength + fraction * self.segment.length
        return TorusEvent(kind, unknowns, spectrum.moduli, arclength, self._destabilises(), residual)

    def _destabilises(self) -> bool | None:
        """Whether more multipliers are unstable at the end; None where their numbers do not tell."""
        before, after = self.before.unstable, self.after.unstable
        return None if UNDECIDED in (before, after) or before == after else after > before


class _NotLocatedError(Exception):
    """A torus inside the step did not converge, or has no complete spectrum."""


def _logarithm(moduli: Vector, index: int) -> float:
    if index >= len(moduli):
        raise _NotLocatedError
    return math.log(max(float(moduli[index]), float(np.finfo(float).tiny)))


def critical_kind(spectrum: TorusSpectrum, index: int, rotation: float) -> TorusEventKind:
    """The bifurcation at which the nontrivial multiplier number ``index`` crosses the unit circle."""
    if not spectrum.complete:
        return TorusEventKind.UNKNOWN
    multipliers = spectrum.multipliers
    if spectrum.trivial >= 0:
        multipliers = np.delete(multipliers, spectrum.trivial)
    critical, moduli = complex(multipliers[index]), np.abs(multipliers)
    others = np.delete(moduli, index)
    if np.any(np.abs(others - moduli[index]) <= _SAME_MODULUS * moduli[index]):
        return TorusEventKind.HOPF
    phase = abs(cmath.phase(critical))
    if phase <= _REAL:
        return TorusEventKind.BRANCH_POINT
    # on a Moebius band mu^2 = e^(+-i rho)
    turned = min(abs(cmath.phase(critical**2 * cmath.exp(sign * rotation))) for sign in (1j, -1j))
    if math.pi - phase <= _REAL or turned <= 2.0 * _REAL:
        return TorusEventKind.PERIOD_DOUBLING
    return TorusEventKind.UNKNOWN
