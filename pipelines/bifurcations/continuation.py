"""Pseudo-arclength continuation: the driver of branches of cycles, bifurcation curves and branches of tori.

    predict, correct, test, locate (one attempt of a tracer), store, adapt

All are piecewise cubic between corrected points with unit tangents, adapt their step to the effort of the
corrector, and close when they come back to their first point.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, fields, replace
from enum import Enum
from typing import Any, Generic, Protocol, Self, TypeVar, cast

import numpy as np

from pipelines.orbits.system import Vector, size_of
from pipelines.orbits.time_steps import RequiredSteps
from pipelines.orbits.vectors import Metric, Point

STEP_GROWTH = 1.1  # steps per period are raised beyond the need, so that they rarely grow again
_CLOSED = 0.05  # distance of the first point from the interpolated branch, in units of the step
_LONGEST = 0.1  # relative change of the period in a step of the maximum length, at most
_TOLD = 5  # points after which the error of the time steps is found anew
_AT_END = 1e-12  # of a range: rounding of a parameter on its end, which no digit of its own limits at zero
_SAME = 0.01  # distance within which two points are one, in units of the step: far above corrector errors


def validate_stepping(
    options: Any, ranges: tuple[tuple[float, float], ...], scales: tuple[float, ...]
) -> None:
    """Raise ValueError for ranges, parameter scales or options out of order.

    ``options`` have ``direction``, ``step``, ``minimum_step``, ``maximum_step``, ``max_points``,
    ``target_iterations`` and ``minimum_cosine``.
    """
    for interval in ranges:
        if not interval[0] < interval[1]:
            raise ValueError(f"range is {interval}; its first value must be below its second")
    if options.direction not in (-1, 1):
        raise ValueError(f"direction is {options.direction}; it must be 1 (up) or -1 (down)")
    if not 0.0 < options.minimum_step <= options.step <= options.maximum_step:
        raise ValueError(
            f"minimum_step {options.minimum_step}, step {options.step}, maximum_step {options.maximum_step}; "
            "they must be positive and in this order"
        )
    if options.max_points < 1 or options.target_iterations < 1:
        raise ValueError("max_points and target_iterations must be at least 1")
    if not -1.0 <= options.minimum_cosine < 1.0:
        raise ValueError(f"minimum_cosine is {options.minimum_cosine}; it must lie in [-1, 1)")
    if not min(scales) > 0.0:
        raise ValueError(f"parameter_scale is {min(scales)}; it must be positive")


def period_scale(state: Vector, period: float, maximum_step: float) -> float:
    """The change of an unknown period that counts as one, set by the first point.

    A relative change of the period counts like the same relative change of the state, so that no unit of time
    or state matters; where the first cycle is small, ``_LONGEST`` is a step of the maximum length.
    """
    return period / max(size_of(float(np.sqrt(np.mean(state**2)))), maximum_step / _LONGEST)


def hermite_weights(fraction: float, length: float) -> tuple[float, float, float, float]:
    """Weights of start, start tangent, end and end tangent in the cubic at a fraction of a segment."""
    t = fraction
    return (
        2 * t**3 - 3 * t**2 + 1,
        length * (t**3 - 2 * t**2 + t),
        3 * t**2 - 2 * t**3,
        length * (t**3 - t**2),
    )


def hermite_slopes(fraction: float, length: float) -> tuple[float, float, float, float]:
    """Derivatives by arclength of the weights of ``hermite_weights``."""
    t = fraction
    return ((6 * t**2 - 6 * t) / length, 3 * t**2 - 4 * t + 1, (6 * t - 6 * t**2) / length, 3 * t**2 - 2 * t)


def extrapolated(
    previous: tuple[Point, Point], newest: tuple[Point, Point], length: float, step: float
) -> Point:
    """The prediction a ``step`` beyond the newest point: the cubic through it and the previous one goes on.

    Both come with their unit tangents and are ``length`` apart; where that is zero the tangent goes on.
    """
    if not length > 0.0:
        return newest[0].plus(newest[1], step)
    first, *weights = hermite_weights(1.0 + step / length, length)
    guess = previous[0].scaled(first)
    for part, weight in zip((previous[1], *newest), weights, strict=True):
        guess = guess.plus(part, weight)
    return guess


def adapted_length(step: float, iterations: int, options: Any) -> float:
    """The next step length: longer if the corrector needed less than ``target_iterations``, else shorter."""
    factor = 2.0 ** ((options.target_iterations - iterations) / 2.0)
    return float(min(options.maximum_step, max(options.minimum_step, step * min(2.0, max(0.5, factor)))))


def one_history(
    first: Correction, second: Correction, names: tuple[str, ...] = ("residual_norms", "update_norms")
) -> Correction:
    """The second correction with the histories of both, so that the step length follows the whole effort."""
    both = {name: getattr(first, name) + getattr(second, name) for name in names}
    return replace(second, **both)  # type: ignore[type-var]


def told_error(state: Any) -> RequiredSteps | None:
    """What a point tells the next one of the error of its time steps; nothing at every fifth point."""
    return None if (state.index + 1) % _TOLD == 0 else steps_of(state)


def steps_of(state: Any) -> RequiredSteps:
    """The time steps of a point, with what is known of their error."""
    return RequiredSteps(state.steps, state.step_error, state.coarser_error)


State = TypeVar("State", bound="ResumableState")
Accepted = TypeVar("Accepted", bound="Step")
Correction = TypeVar("Correction")
Recorded = TypeVar("Recorded")
Found = TypeVar("Found")

Record = Callable[[Recorded, State, tuple[Found, ...]], None]
"""Takes every accepted point, the state that resumes behind it, and the bifurcations found before it."""
Limit = Callable[[Recorded], str | None]
"""Says why a branch ends before a point that is beyond a limit of the caller's; None where it does not."""


@dataclass(frozen=True)
class Result(Generic[State]):
    """How a continuation ended.

    ``stop``: a member of the enumeration of its kind; ``message`` says more when a limit or a failed
    correction ended it.
    """

    stop: Any
    state: State | None
    message: str = ""


class Step(Protocol):
    """An accepted step: its point, and the bifurcations on it."""

    @property
    def point(self) -> Any:
        """The point to record."""

    @property
    def found(self) -> tuple[Any, ...]:
        """The bifurcations between the previous point and this one."""


@dataclass(frozen=True)
class Rejected:
    """Why a step is too long, or a start fails.

    ``ending``: the reason to stop if the step cannot be shorter (None: the smallest step); ``factor``: of the
    next attempt.
    """

    message: str
    ending: Enum | None = None
    factor: float = 0.5


class Tracer(ABC, Generic[State, Accepted]):
    """What a kind of continuation provides for the driver.

    ``options`` have ``minimum_step``; ``stops``: the enumeration of its reasons to stop, with ``LIMIT``,
    ``INTERRUPTED``, ``START_FAILED`` and ``MINIMUM_STEP``.
    """

    options: Any
    stops: Any

    @abstractmethod
    def open(self, start: Any) -> tuple[Any, State] | Rejected:
        """Correct a guess and orient the curve: its first point, and the state there."""

    @abstractmethod
    def stop_reason(self, state: State) -> Enum | None:
        """Why the curve ends at a state; it depends on the state alone, so that a restart ends there too."""

    @abstractmethod
    def attempt(self, state: State) -> Accepted | Rejected:
        """Predict, correct, test and locate one step; Rejected means that the step is too long."""

    @abstractmethod
    def advance(self, state: State, step: Accepted) -> State:
        """The state after an accepted step."""

    def ends_before(self, state: State, step: Accepted) -> tuple[Enum, str] | None:
        """Why the curve ends before a step that would be accepted, and a message."""
        return None

    def shortest_step(self, state: State) -> float:
        """The shortest step from a state."""
        return float(self.options.minimum_step)

    def is_shortest(self, state: State) -> bool:
        """Whether half of the step would be shorter than the shortest one."""
        return bool(0.5 * state.step < self.shortest_step(state))


def follow(
    tracer: Tracer[State, Accepted],
    start: Any,
    record: Record[Any, State, Any],
    limit: Limit[Any] | None = None,
    should_stop: Callable[[], bool] | None = None,
) -> Result[State]:
    """Trace a curve from a guess, or resume it from a recorded state (a `ResumableState`).

    ``record(point, state, found)`` is called once per accepted point; ``state`` is all that is needed to
    restart after it.  ``limit(point)`` returns a sentence when the point must not be accepted, which ends the
    curve before it.  ``should_stop()`` is asked after each recorded point.
    """
    stops = tracer.stops
    if isinstance(start, ResumableState):
        state = cast(State, start)
    else:
        opened = tracer.open(start)
        if isinstance(opened, Rejected):
            return Result(stops.START_FAILED, None, opened.message)
        point, state = opened
        if limit is not None and (message := limit(point)) is not None:
            return Result(stops.LIMIT, None, message)
        record(point, state, ())
    while (stop := tracer.stop_reason(state)) is None:
        if should_stop is not None and should_stop():
            return Result(stops.INTERRUPTED, state)
        step = tracer.attempt(state)
        if isinstance(step, Rejected):
            if tracer.is_shortest(state):
                return Result(step.ending or stops.MINIMUM_STEP, state, step.message)
            length = max(step.factor * state.step, tracer.shortest_step(state))
            state = replace(state, step=length)  # type: ignore[type-var]
            continue
        if limit is not None and (message := limit(step.point)) is not None:
            return Result(stops.LIMIT, state, message)
        if (ending := tracer.ends_before(state, step)) is not None:
            return Result(ending[0], state, ending[1])
        state = tracer.advance(state, step)
        record(step.point, state, step.found)
    return Result(stop, state)


def leaves_ranges(
    values: Iterable[float], slopes: Iterable[float], ranges: Sequence[tuple[float, float]]
) -> bool:
    """Whether a parameter lies on the end of its range, up to rounding, and its slope points outwards."""
    return any(
        (value >= high - _AT_END * (high - low) and slope > 0.0)
        or (value <= low + _AT_END * (high - low) and slope < 0.0)
        for value, slope, (low, high) in zip(values, slopes, ranges, strict=True)
    )


def bound_passed(values: Iterable[float], ranges: Sequence[tuple[float, float]]) -> tuple[int, float] | None:
    """The first parameter outside its range by more than rounding, and the end that it passed."""
    for which, (value, (low, high)) in enumerate(zip(values, ranges, strict=True)):
        rounding = _AT_END * (high - low)
        if value > high + rounding:
            return which, high
        if value < low - rounding:
            return which, low
    return None


class CubicPiece(ABC, Generic[Point]):
    """The curve between two corrected points: the cubic through them with their unit tangents."""

    metric: Metric[Point]

    @abstractmethod
    def ends(self) -> tuple[Point, Point, Point, Point]:
        """Start, unit tangent there, end, unit tangent there."""

    @property
    def chord(self) -> Point:
        """The vector from start to end."""
        start, _, end, _ = self.ends()
        return end.minus(start)

    @property
    def length(self) -> float:
        """Length of the chord."""
        return self.metric.norm(self.chord)

    def guess(self, fraction: float) -> Point:
        """The cubic at a fraction."""
        return self._combined(hermite_weights(fraction, self.length))

    def direction(self, fraction: float) -> Point:
        """Derivative of the cubic by arclength."""
        return self._combined(hermite_slopes(fraction, self.length))

    def _combined(self, weights: tuple[float, float, float, float]) -> Point:
        start, *others = self.ends()
        combined = start.scaled(weights[0])
        for part, weight in zip(others, weights[1:], strict=True):
            combined = combined.plus(part, weight)
        return combined

    def passes(self, first: Point, arclength: float) -> bool:
        """Whether the piece passes through, or stops just before, the ``first`` point of the curve.

        ``arclength``: from the first point to the start of the piece.
        """
        length, chord = self.length, self.chord
        if arclength <= 2.0 * length:
            return False
        fraction = self.metric.inner(first.minus(self.ends()[0]), chord) / length**2
        # what is left to the first point beyond the segment would make a needlessly short step
        if not 0.0 < fraction <= 1.0 + _CLOSED:
            return False
        return self.metric.norm(first.minus(self.guess(fraction))) <= _CLOSED * length


def returned(state: Any, at: Point, metric: Metric[Point]) -> bool:
    """Whether ``at`` is the first point again; ``state`` has ``start``, ``arclength`` and ``step``."""
    left = state.arclength > 2.0 * state.step
    return bool(left and metric.norm(at.minus(state.start)) <= _SAME * state.step)


class ResumableState:
    """A frozen dataclass of arrays and numbers from which a continuation resumes with the same bits."""

    step: float

    def arrays(self) -> dict[str, Any]:
        """Field name to array or number."""
        return {item.name: getattr(self, item.name) for item in fields(cast(Any, self))}

    @classmethod
    def from_arrays(cls, arrays: dict[str, Any]) -> Self:
        """The inverse of ``arrays``.

        Arrays are copied into C order, on which the bits of a product depend.
        """
        kinds = {"index": int, "steps": int, "leading": int, "unstable": int}
        values: dict[str, Any] = {
            name: np.array(value, order="C") if np.ndim(value) else kinds.get(name, float)(value)
            for name, value in arrays.items()
        }
        return cls(**values)
