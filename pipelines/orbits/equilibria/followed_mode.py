"""One mode followed between two speeds at which it is known, and its crossing of the synchronous line.

    g(Omega) = Im lambda(Omega) - Omega = 0

At any other speed it is found by its eigenvector, from the nearest speed at which it is known.
"""

from __future__ import annotations

from dataclasses import dataclass

from scipy.optimize import brentq

from pipelines.case.arrays import Array
from pipelines.machine.assembly import Machine
from pipelines.orbits.equilibria.equilibrium import machine_equilibrium
from pipelines.orbits.equilibria.linear import at_speed
from pipelines.orbits.equilibria.modes import ModeSet, match_modes, modes_at

# How often the way is halved to a speed at which the mode cannot be told from others.
HALVINGS = 10
# What g may be at a crossing: a larger one is a jump to another mode.
LARGEST_EXCESS = 1e-6


class LostModeError(Exception):
    """A mode is not found at a ``speed`` between two at which it is known."""

    def __init__(self, speed: float) -> None:
        super().__init__(f"the mode is lost at speed {speed:g}")
        self.speed = speed


@dataclass(frozen=True)
class FollowedMode:
    """A mode by its index in the mode sets of the speeds at which it is ``known``; these sets grow.

    ``state``: an equilibrium nearby; ``top``: see ``modes_at``.
    """

    machine: Machine
    parameters: Array
    state: Array | None
    top: float
    known: dict[float, tuple[ModeSet, int]]

    def at(self, speed: float) -> tuple[ModeSet, int]:
        """The modes at a speed, and the index of this mode.  Raises LostModeError."""
        if speed not in self.known:
            at = at_speed(self.parameters, speed)
            equilibrium = machine_equilibrium(self.machine, at, self.state)
            if not equilibrium.converged:
                raise LostModeError(speed)
            modes = modes_at(self.machine, at, equilibrium.state, self.top)
            nearest, number = self.known[min(self.known, key=lambda other: abs(other - speed))]
            partner = match_modes(nearest, modes).partner[number]
            if partner < 0:
                raise LostModeError(speed)
            self.known[speed] = modes, partner
        return self.known[speed]

    def excess(self, speed: float) -> float:
        """g of the mode.  Raises LostModeError."""
        modes, number = self.at(speed)
        return float(modes.eigenvalues[number].imag) - speed

    def crossing(self, low: float, high: float) -> float:
        """The speed where g changes its sign between two speeds.  Raises LostModeError."""
        lost = LostModeError(low)
        for _ in range(HALVINGS):
            try:
                speed = float(brentq(self.excess, low, high, xtol=1e-10))
            except LostModeError as error:
                lost = error
                low, high = self._bracket_around(low, lost.speed, high)
                continue
            if abs(self.excess(speed)) <= LARGEST_EXCESS:
                return speed
            break
        raise lost

    def _bracket_around(self, low: float, lost: float, high: float) -> tuple[float, float]:
        """A narrower bracket on either side of the speed at which the mode is lost."""
        sign = self.excess(low)
        for speed in (0.5 * (low + lost), 0.5 * (lost + high)):
            if low < speed < high:
                try:
                    below = self.excess(speed) * sign > 0.0
                except LostModeError:
                    continue
                low, high = (speed, high) if below else (low, speed)
        return low, high
