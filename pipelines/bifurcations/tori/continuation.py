"""Pseudo-arclength continuation of tori: predict, correct, test, store, adapt.

In the space u = (X, rho, lambda) a curve follows u_0 with unit tangent t at distance h when

    S(-rho) P(X) - X = 0,    phase(X) = 0 (rho unknown),    <t, u - u_0> = h

The number of angles follows the Fourier series from point to point.  Tori with unknown rotation form a smooth
family only between their resonances: near a rotation of p/q turns with small q the torus locks, and its
Fourier series does not fall.  Where steps get too short there, a leap seeks the torus whose rotation is as
far beyond p/q as that of the last one is before it, or a few times as far.  Without one the branch ends.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from pipelines.bifurcations.acceptance import StepRule, refusal
from pipelines.bifurcations.continuation import (
    Limit,
    Rejected,
    Tracer,
    adapted_length,
    bound_passed,
    follow,
    leaves_ranges,
    one_history,
)
from pipelines.bifurcations.tori.events import TorusEvent, TorusTests, find_events, unstable_number
from pipelines.bifurcations.tori.fourier import amplitudes, nearest_fraction, resampled, tail
from pipelines.bifurcations.tori.invariant_curve import Torus, TorusCorrection, correct_torus, torus_tangent
from pipelines.bifurcations.tori.problem import (
    TorusMetric,
    TorusProblem,
    TorusUnknowns,
    fixed_parameter,
    metric_of,
)
from pipelines.bifurcations.tori.segment import TorusSegment, reference_curve, rotation_known
from pipelines.bifurcations.tori.stability import TorusSpectrum, converged_spectrum
from pipelines.bifurcations.tori.torus import (
    TorusOptions,
    TorusPoint,
    TorusResult,
    TorusStart,
    TorusState,
    TorusStop,
)
from pipelines.orbits.system import Matrix, size_of
from pipelines.orbits.vectors import Constraint

_SPARE = 0.1  # share of the tolerance below which half of the angles are dropped
_ROUGH_STEP = 0.25  # of the step after a torus that was too rough: such an attempt is expensive
_NOTHING = 1e-3  # share of the deviation from the mean that a torus may not lose in a step
# Beside a resonance the rotation changes unevenly: a tangent there differs from the mean over a step by more
# than along a smooth curve.
_DOUBTFUL_DEFECT, _MISSED = 0.4, 0.25
_LARGEST_DENOMINATOR = 12  # of the resonances that are named
_LARGEST_CROSSED = 8  # denominator of the resonances that are leapt over
_LEAPS = (1.0, 2.0, 4.0, 8.0)  # distances beyond a resonance, in that before it
_LONGEST_LEAP = 2.0  # in steps of the maximum length


def continue_torus(
    problem: TorusProblem,
    start: TorusStart | TorusState,
    options: TorusOptions,
    record: Callable[[TorusPoint, TorusState, tuple[TorusEvent, ...]], None],
    limit: Limit[TorusPoint] | None = None,
    should_stop: Callable[[], bool] | None = None,
) -> TorusResult:
    """Trace a branch of tori from a guess, or resume it from a recorded state.

    ``record(point, state, events)`` is called once per accepted point, with the bifurcations before it;
    ``state`` is all that is needed to restart after it.  ``limit(point)`` returns a sentence when the point
    must not be accepted, which ends the branch before it.  ``should_stop()`` is asked after each recorded
    point.  The last point lies exactly on the end of the range.  Raises ValueError when the start lies
    outside the range; every other failure is a TorusResult.
    """
    metric = metric_of(problem, start.parameter, options.parameter_scale)
    tracer = _Tori(problem, options, metric)
    return follow(tracer, start, record, limit, should_stop)


@dataclass(frozen=True)
class _Step:
    """An accepted step: its point, the unit tangent there, its length, the bifurcations on it.

    ``leapt``: whether it leads over a resonance.
    """

    point: TorusPoint
    tangent: TorusUnknowns
    length: float
    found: tuple[TorusEvent, ...] = ()
    leapt: bool = False


@dataclass(frozen=True)
class _Tori(Tracer[TorusState, _Step]):
    """A branch of tori as the driver sees it."""

    problem: TorusProblem
    options: TorusOptions
    metric: TorusMetric
    stops = TorusStop

    def open(self, start: TorusStart) -> tuple[TorusPoint, TorusState] | Rejected:
        """Correct the guess at its fixed parameter and orient the branch."""
        problem, options = self.problem, self.options
        if not options.range[0] <= start.parameter <= options.range[1]:
            raise ValueError(f"the start {start.parameter} lies outside the range {options.range}")
        guess = TorusUnknowns(np.array(start.states, dtype=float), start.rotation, start.parameter)
        count = len(guess.states)
        constraint = fixed_parameter(problem, count, start.parameter)
        correction = correct_torus(problem, guess, constraint, start.bases, reference_curve(problem, guess))
        torus = correction.torus
        if torus is None:
            return Rejected(correction.stop.advice)
        if correction.rough:
            return Rejected(_roughness(problem, torus))
        if _collapsed(problem, torus.unknowns, guess):
            return Rejected(TorusStop.COLLAPSED.advice)
        torus, spectrum = converged_spectrum(problem, torus)
        row = TorusUnknowns(np.zeros_like(torus.unknowns.states), 0.0, float(options.direction))
        tangent = torus_tangent(problem, torus, row, reference_curve(problem, torus.unknowns))
        if tangent is None:
            return Rejected("the parameter turns at the first point")
        tangent = self.metric.unit(tangent)
        state = _state(problem, torus, spectrum, tangent, 0, options.step, 0.0)
        return TorusPoint(torus, spectrum, correction.residual_norms, correction.update_norms), state

    def stop_reason(self, state: TorusState) -> TorusStop | None:
        """Why the branch ends at a state; None if it continues."""
        if leaves_ranges((state.parameter,), (state.tangent_parameter,), (self.options.range,)):
            return TorusStop.RANGE
        return TorusStop.MAXIMUM_POINTS if state.index + 1 >= self.options.max_points else None

    def attempt(self, state: TorusState) -> _Step | Rejected:
        """One step: predict, correct, test; in place of the shortest one a leap over a resonance."""
        step = self._stepped(state)
        if isinstance(step, Rejected) and self.is_shortest(state):
            return self._leap(state) or step
        return step

    def _stepped(self, state: TorusState) -> _Step | Rejected:
        problem, metric = self.problem, self.metric
        correction = self._predict_and_correct(state)
        torus = correction.torus
        if torus is None:
            resonance = "" if rotation_known(problem, state.parameter) else f" ({_resonance(state.rotation)})"
            return Rejected(correction.stop.advice + resonance)
        if correction.rough:
            return Rejected(_roughness(problem, torus), TorusStop.ROUGH, _ROUGH_STEP)
        if _collapsed(problem, torus.unknowns, state.unknowns):
            return Rejected(f"at {state.parameter:.8g} the torus is nearly a cycle", TorusStop.COLLAPSED)
        before, tangent_before = state.unknowns.resampled(torus.count), state.tangent.resampled(torus.count)
        chord = torus.unknowns.minus(before)
        if metric.norm(chord) == 0.0:
            return Rejected("the corrector returned to the previous point")
        tangent = torus_tangent(problem, torus, metric.row(chord), reference_curve(problem, torus.unknowns))
        if tangent is None:
            return Rejected("the tangent is singular")
        tangent, end = metric.unit(tangent), torus.unknowns
        segment = TorusSegment(problem, metric, before, tangent_before, end, tangent, state.slow_bases)
        rule = StepRule(self.options.minimum_cosine, _MISSED, _DOUBTFUL_DEFECT, math.inf)
        message = refusal(metric, tangent_before, chord, tangent, rule, segment.missed_at)
        if message is not None:
            return Rejected(message)
        return self._accepted(state, segment, torus, correction)

    def _accepted(
        self,
        state: TorusState,
        segment: TorusSegment,
        torus: Torus,
        correction: TorusCorrection,
        leapt: bool = False,
    ) -> _Step:
        """The step along a segment from a state to a torus, with its spectrum and bifurcations."""
        torus, spectrum = converged_spectrum(self.problem, torus)
        point = TorusPoint(torus, spectrum, correction.residual_norms, correction.update_norms)
        events: tuple[TorusEvent, ...] = ()
        if self.options.events:
            before = TorusTests(state.moduli, state.unstable, state.tangent_parameter)
            events = find_events(segment, before, spectrum, state.arclength, self.options.event_tolerance)
        return _Step(point, segment.end_tangent, segment.length, events, leapt)

    def advance(self, state: TorusState, step: _Step) -> TorusState:
        """The state after an accepted step; the step length follows the count of the corrector."""
        point = step.point
        tried = self.options.step if step.leapt else state.step
        length = adapted_length(tried, point.iterations, self.options)
        index, arclength = state.index + 1, state.arclength + step.length
        return _state(self.problem, point.torus, point.spectrum, step.tangent, index, length, arclength)

    def _leap(self, state: TorusState) -> _Step | None:
        """The torus beyond the resonance ahead; None where there is none that the branch leads to.

        Its rotation is fixed instead of the arclength: rho = rho_r + s (rho_r - rho_0).
        """
        ahead = resonance_ahead(state.rotation, state.tangent_rotation)
        if rotation_known(self.problem, state.parameter) or ahead is None:
            return None
        for distance in _LEAPS:
            rotation = state.rotation + (1.0 + distance) * ahead
            length = (rotation - state.rotation) / state.tangent_rotation
            if length > _LONGEST_LEAP * self.options.maximum_step:
                return None
            guess = state.unknowns.plus(state.tangent, length)
            row = TorusUnknowns(np.zeros_like(guess.states), 1.0, 0.0)
            correction = correct_torus(
                self.problem, guess, Constraint(row, rotation), state.slow_bases, state.unknowns.states
            )
            if (step := self._landed(state, correction)) is not None:
                return step
        return None

    def _landed(self, state: TorusState, correction: TorusCorrection) -> _Step | None:
        """The step to a torus beyond a resonance; None where the branch does not lead there.

        Beside a resonance the angle runs unevenly, so that tangents tell nothing of the step; but parameter
        and rotation must proceed as before, and the torus must be near.
        """
        problem, metric, torus = self.problem, self.metric, correction.torus
        low, high = self.options.range
        if torus is None or correction.rough or not low <= torus.unknowns.parameter <= high:
            return None
        before, old = state.unknowns.resampled(torus.count), state.tangent.resampled(torus.count)
        chord = torus.unknowns.minus(before)
        tangent = torus_tangent(problem, torus, metric.row(chord), torus.unknowns.states)
        if tangent is None:
            return None
        tangent = metric.unit(tangent)
        tangent = tangent.scaled(math.copysign(1.0, tangent.rotation * old.rotation))
        proceeds = all(one.parameter * old.parameter > 0.0 for one in (chord, tangent))
        if not proceeds or metric.norm(chord) > _LONGEST_LEAP * self.options.maximum_step:
            return None
        segment = TorusSegment(problem, metric, before, old, torus.unknowns, tangent, state.slow_bases)
        return self._accepted(state, segment, torus, correction, leapt=True)

    def _predict_and_correct(self, state: TorusState) -> TorusCorrection:
        """Correct the tangent prediction on the arclength row.

        Beyond the end of the range the parameter is fixed to that end instead.
        """
        problem, ranges = self.problem, (self.options.range,)
        row = self.metric.row(state.tangent)
        guess = state.unknowns.plus(state.tangent, state.step)
        constraint = Constraint(row, row.dot(state.unknowns) + state.step)
        reference = reference_curve(problem, state.unknowns)
        passed = bound_passed((guess.parameter,), ranges)
        if passed is not None:
            return _correct_on_bound(problem, state, guess, passed[1], reference)
        correction = correct_torus(problem, guess, constraint, state.slow_bases, reference)
        if correction.torus is None:
            return correction
        found = correction.torus.unknowns
        passed = bound_passed((found.parameter,), ranges)
        if passed is None:
            return correction
        found = found.resampled(len(state.states))
        return one_history(correction, _correct_on_bound(problem, state, found, passed[1], reference))


def _correct_on_bound(
    problem: TorusProblem, state: TorusState, beyond: TorusUnknowns, bound: float, reference: Matrix | None
) -> TorusCorrection:
    """The torus at the end of the range, guessed between the state and a point beyond the end."""
    share = (bound - state.parameter) / (beyond.parameter - state.parameter)
    guess = state.unknowns.plus(beyond.minus(state.unknowns), share)
    constraint = fixed_parameter(problem, len(state.states), bound)
    return correct_torus(problem, guess, constraint, state.slow_bases, reference)


def _collapsed(problem: TorusProblem, unknowns: TorusUnknowns, before: TorusUnknowns) -> bool:
    """Whether the deviation from the mean reversed its direction since the last curve.

    Between them a torus with unknown rotation was a cycle, through which the same tori continue with
    half a turn of the angle.
    """
    if rotation_known(problem, unknowns.parameter):
        return False
    new, old = unknowns.states, resampled(before.states, len(unknowns.states))
    old = old - old.mean(axis=0)
    return bool(np.vdot(new - new.mean(axis=0), old) <= _NOTHING * np.vdot(old, old))


def _state(
    problem: TorusProblem,
    torus: Torus,
    spectrum: TorusSpectrum,
    tangent: TorusUnknowns,
    index: int,
    step: float,
    arclength: float,
) -> TorusState:
    count = _following_count(problem, torus)
    unknowns, tangent = torus.unknowns.resampled(count), tangent.resampled(count)
    bases = torus.bases if count == torus.count else torus.bases.resampled(count)
    bases = bases.grown(spectrum.columns, problem.options.basis)
    return TorusState(
        index=index,
        states=unknowns.states,
        rotation=unknowns.rotation,
        parameter=unknowns.parameter,
        tangent_states=tangent.states,
        tangent_rotation=tangent.rotation,
        tangent_parameter=tangent.parameter,
        step=step,
        arclength=arclength,
        bases=bases.columns,
        leading=bases.leading,
        moduli=spectrum.moduli,
        unstable=unstable_number(spectrum),
    )


def _following_count(problem: TorusProblem, torus: Torus) -> int:
    """Half of the angles, or a quarter, as long as they would be far more than enough."""
    count, fourier = torus.count, problem.fourier
    scale = size_of(torus.unknowns.states)
    found = amplitudes(torus.unknowns.states)
    while (half := (count - 1) // 2) >= fourier.fewest and half % 2 == 1:
        if tail(found[: half // 2 + 1]) > _SPARE * fourier.tolerance * scale:
            break
        count = half
    return count


def resonance_ahead(rotation: float, slope: float) -> float | None:
    """Turn [rad] from a rotation to the nearest resonance that it moves to; None where it stands still.

    Resonances are those with denominators up to ``_LARGEST_CROSSED``.
    """
    if slope == 0.0:
        return None
    turns = rotation / (2.0 * math.pi)
    sense = math.copysign(1.0, slope)
    distances = [
        (math.ceil(sense * turns * q) - sense * turns * q) / q for q in range(1, _LARGEST_CROSSED + 1)
    ]
    return sense * 2.0 * math.pi * min(distances)


def _resonance(rotation: float) -> str:
    p, q, distance = nearest_fraction(rotation, _LARGEST_DENOMINATOR)
    return f"the rotation, {rotation / (2.0 * math.pi):.6f} turns, is {distance:.1e} from {p}/{q}"


def _roughness(problem: TorusProblem, torus: Torus) -> str:
    """The Fourier error of a torus, its place and its nearest resonance, in words."""
    said = f"with {torus.count} angles {torus.error:.1e} is missing at {torus.unknowns.parameter:.8g}"
    return f"{said}; {_resonance(torus.unknowns.rotation)}"
