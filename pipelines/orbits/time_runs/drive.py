"""Speed and ring excitation of a transient as functions of time, in pieces that are smooth.

The speed is piecewise linear, so that within a piece that starts at tau_0

    Omega = Omega_0 + a t,   phi = phi_0 + Omega_0 t + a t^2 / 2,   t = tau - tau_0

without any integration error. The phase of the rings grows with Omega_ex tau all the time. Their displacement
is constant or, while it is switched over a ramp of length L,

    delta = delta_0 + (delta_1 - delta_0) x^3 (10 - 15 x + 6 x^2),   x = t / L

whose first two derivatives vanish at both ends: displacement, velocity and acceleration of the ring are
continuous. A time step ends where a piece ends, so that the method keeps its order.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from pipelines.machine.film import DISPLACEMENT, DISPLACEMENT_RATE, EXCITATION_FREQUENCY, SPEED
from pipelines.machine.kernels import kernel

Array = NDArray[np.float64]

# Entries of a piece, with speed, angle and phase at its beginning; the last four are the same in all pieces.
BEGIN, LENGTH, OMEGA, ACCELERATION, ANGLE, RING_PHASE, DELTA_FROM, DELTA_TO, RAMP_BEGIN, RAMP = range(10)
PIECE_NUMBERS = 10


@kernel()
def set_drive(piece, t, parameters):  # type: ignore[no-untyped-def]
    """Write speed, ring displacement and its rate into ``parameters``, at the time ``t`` within a piece.

    Returns the rings' phase, the rotation angle and the angular acceleration.
    """
    parameters[SPEED] = piece[OMEGA] + piece[ACCELERATION] * t
    x = min(1.0, max(0.0, (piece[BEGIN] - piece[RAMP_BEGIN] + t) / piece[RAMP]))
    change = piece[DELTA_TO] - piece[DELTA_FROM]
    parameters[DISPLACEMENT] = piece[DELTA_FROM] + change * x * x * x * (10.0 - 15.0 * x + 6.0 * x * x)
    parameters[DISPLACEMENT_RATE] = change * 30.0 * x * x * (1.0 - x) * (1.0 - x) / piece[RAMP]
    ring = piece[RING_PHASE] + parameters[EXCITATION_FREQUENCY] * t
    angle = piece[ANGLE] + t * (piece[OMEGA] + 0.5 * piece[ACCELERATION] * t)
    return ring, angle, piece[ACCELERATION]


@dataclass(frozen=True)
class Switching:
    """A change of the rings' displacement from ``before`` to ``after``; it takes ``ramp`` from ``begin``."""

    before: float
    after: float
    begin: float = 0.0
    ramp: float = 0.0

    @property
    def constant(self) -> bool:
        return self.before == self.after


@dataclass(frozen=True)
class Drive:
    """``pieces`` (pieces, PIECE_NUMBERS) cover the run from 0 to ``duration``; everything dimensionless."""

    pieces: Array
    duration: float

    def piece_at(self, time: Array) -> NDArray[np.intp]:
        """Index of the piece of every time."""
        found = np.searchsorted(self.pieces[:, BEGIN], time, side="right") - 1
        return np.clip(found, 0, len(self.pieces) - 1)

    def speed(self, time: Array) -> Array:
        """Omega at times (any shape)."""
        piece = self.pieces[self.piece_at(time)]
        return np.asarray(piece[..., OMEGA] + piece[..., ACCELERATION] * (time - piece[..., BEGIN]))

    def angle(self, time: Array) -> Array:
        """phi [rad] at times, growing without reduction to a turn."""
        piece = self.pieces[self.piece_at(time)]
        t = time - piece[..., BEGIN]
        return np.asarray(piece[..., ANGLE] + t * (piece[..., OMEGA] + 0.5 * piece[..., ACCELERATION] * t))

    def ring_phase(self, time: Array, parameters: Array) -> Array:
        """Omega_ex tau plus the phase at the start [rad] at times, between -2 pi and 2 pi."""
        piece = self.pieces[self.piece_at(time)]
        phase = piece[..., RING_PHASE] + parameters[EXCITATION_FREQUENCY] * (time - piece[..., BEGIN])
        return np.asarray(np.fmod(phase, 2.0 * np.pi))

    def displacement(self, time: Array) -> Array:
        """delta at times."""
        piece = self.pieces[self.piece_at(time)]
        x = np.clip((time - piece[..., RAMP_BEGIN]) / piece[..., RAMP], 0.0, 1.0)
        step = x**3 * (10.0 - 15.0 * x + 6.0 * x * x)
        return np.asarray(piece[..., DELTA_FROM] + (piece[..., DELTA_TO] - piece[..., DELTA_FROM]) * step)

    def largest_speed(self) -> float:
        """The largest speed of the whole run."""
        ends = self.pieces[:, OMEGA] + self.pieces[:, ACCELERATION] * self.pieces[:, LENGTH]
        return float(max(self.pieces[:, OMEGA].max(), ends.max()))

    def moves_rings(self) -> bool:
        """Whether the rings are excited at any time."""
        return bool(np.any(self.pieces[:, DELTA_FROM : DELTA_TO + 1] != 0.0))


def make_drive(
    times: Sequence[float],
    speeds: Sequence[float],
    duration: float,
    switching: Switching,
    frequency: float,
    angle: float = 0.0,
    ring_phase: float = 0.0,
) -> Drive:
    """The drive of a run from a table of ``speeds`` over ``times``, between which the speed is linear.

    After the last time the speed is constant. ``angle`` and ``ring_phase`` [rad] are those at the start,
    ``frequency`` is Omega_ex. Raises ValueError for times that do not begin at 0 and rise, for speeds and
    durations that are not positive, and for a switching without a ramp.
    """
    if len(times) != len(speeds) or not times or times[0] != 0.0 or np.any(np.diff(times) <= 0.0):
        raise ValueError(f"times must begin at 0 and rise, one for each speed; given {list(times)}")
    if min(speeds) <= 0.0 or duration <= 0.0:
        raise ValueError("speeds and duration must be positive: the film carries by rotation")
    if not switching.constant and switching.ramp <= 0.0:
        raise ValueError("a ring that is switched without a ramp jumps; the ramp must be positive")
    marks = {0.0, *times}
    if not switching.constant:
        marks |= {switching.begin, switching.begin + switching.ramp}
    begins = sorted(mark for mark in marks if mark < duration)
    pieces = np.zeros((len(begins), PIECE_NUMBERS))
    pieces[:, DELTA_FROM], pieces[:, DELTA_TO] = switching.before, switching.after
    pieces[:, RAMP_BEGIN] = switching.begin
    pieces[:, RAMP] = 1.0 if switching.constant else switching.ramp
    for index, (begin, end) in enumerate(zip(begins, [*begins[1:], duration], strict=True)):
        piece = pieces[index]
        piece[BEGIN], piece[LENGTH] = begin, end - begin
        piece[OMEGA] = np.interp(begin, times, speeds)
        piece[ACCELERATION] = (np.interp(end, times, speeds) - piece[OMEGA]) / (end - begin)
        piece[ANGLE] = angle
        piece[RING_PHASE] = math.fmod(ring_phase + frequency * begin, 2.0 * math.pi)
        angle += (end - begin) * (piece[OMEGA] + 0.5 * piece[ACCELERATION] * (end - begin))
    return Drive(pieces, duration)
