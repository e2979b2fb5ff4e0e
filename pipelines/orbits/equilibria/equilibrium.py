"""Equilibria by damped Newton with the sparse Jacobian: a film about a fixed journal, or a whole machine.

s <- s - t J(s)^-1 f(s),  t halved until the film stays open, the pressure positive and |f| decreases
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
from scipy import sparse
from scipy.sparse.linalg import splu

from pipelines.case.arrays import Array
from pipelines.machine import film
from pipelines.machine.assembly import Machine, with_grid
from pipelines.machine.bearing import Bearing, film_state, linearise_bearing
from pipelines.machine.regrid import regrid

# Equilibria are those of the machine with its rings resting in their mean position: excitation frequency 0.
MEAN_PHASE = 0.0

# A film thinner than this part of the clearance at one station may be none on a finer grid.
THIN = 0.1

# Circumferential intervals beyond which no finer grid is asked whether it has an equilibrium.
FINEST = 128


@dataclass(frozen=True)
class NewtonOptions:
    """When damped Newton stops: residual norm (maximum over components), iterations, smallest damping."""

    tolerance: float = 1e-11
    iterations: int = 60
    smallest_damping: float = 1e-4


@dataclass(frozen=True)
class Equilibrium:
    """A solution of f(s) = 0, or the last iterate with the reason why there is no solution."""

    state: Array
    residual: float
    iterations: int
    converged: bool
    reason: str


def damped_newton(
    residual: Callable[[Array], Array],
    jacobian: Callable[[Array], sparse.csc_array],
    feasible: Callable[[Array], bool],
    guess: Array,
    options: NewtonOptions,
) -> Equilibrium:
    """Solve ``residual(s) = 0`` from ``guess``; iterates stay ``feasible``."""
    state, value = guess.copy(), residual(guess)
    size = float(np.abs(value).max())
    for iteration in range(options.iterations):
        if size <= options.tolerance:
            return Equilibrium(state, size, iteration, True, "converged")
        try:
            step = splu(jacobian(state)).solve(value)
        except RuntimeError:
            return Equilibrium(state, size, iteration, False, "the Jacobian is singular")
        damping, norm = 1.0, np.linalg.norm(value)
        while damping >= options.smallest_damping:
            trial = state - damping * step
            if feasible(trial):
                trial_value = residual(trial)
                # Rounding keeps |f| from decreasing in the last iteration.
                if (
                    np.linalg.norm(trial_value) < (1.0 - 0.1 * damping) * norm
                    or size < 1e3 * options.tolerance
                ):
                    break
            damping *= 0.5
        else:
            return Equilibrium(
                state, size, iteration, False, "no step keeps the film open and reduces the residual"
            )
        state, value = trial, trial_value
        size = float(np.abs(value).max())
    converged = size <= options.tolerance
    reason = "converged" if converged else f"no convergence in {options.iterations} iterations"
    return Equilibrium(state, size, options.iterations, converged, reason)


def film_equilibrium(
    bearing: Bearing,
    position: Array,
    parameters: Array,
    guess: Array | None = None,
    options: NewtonOptions = NewtonOptions(),
) -> Equilibrium:
    """Steady film and foil u = {p q} of one bearing with its journal at rest at ``position`` = (X, Y)."""
    settings = bearing.settings
    still = at_rest(parameters)
    journal = np.array([position[0], position[1], 0.0, 0.0])
    if guess is None:
        guess = ambient_film(bearing, still)

    def feasible(unknowns: Array) -> bool:
        pressures = unknowns[: settings.nodes * settings.axial]
        thickness = film_state(bearing, unknowns, journal, MEAN_PHASE, still).thickness
        return bool(pressures.min() > 0.0 and thickness.min() > 0.0)

    return damped_newton(
        lambda u: film_state(bearing, u, journal, MEAN_PHASE, still).rates,
        lambda u: linearise_bearing(bearing, u, journal, MEAN_PHASE, still).unknowns,
        feasible,
        guess,
        options,
    )


def machine_equilibrium(
    machine: Machine, parameters: Array, guess: Array | None = None, options: NewtonOptions = NewtonOptions()
) -> Equilibrium:
    """Equilibrium of the whole machine with its rings in their mean position, state of shape (N,).

    Without success from the guess, or without a guess, the rotor's weight is put on the films step by step;
    then the equilibrium on a finer grid is tried as a start. The reason of a failure tells films that cannot
    carry the weight from a grid that is too coarse.
    """
    still = at_rest(parameters)
    result = _from_guesses(machine, still, guess, options)
    if result.converged:
        return result
    result, carried = _ramp_weight(machine, still, options)
    return result if result.converged else _from_finer_grid(machine, still, result, carried, options)


def equilibrium_along(
    machine: Machine, parameters: Array, speeds: Array, index: int, guess: Array | None = None
) -> Equilibrium:
    """Equilibrium at one of rising ``speeds``; ``guess``: the state at the speed below.

    Before it is given up, it is sought from both neighbouring speeds.  So it is where the film is ``THIN``: a
    coarse grid has false equilibria in which a single station carries.  Of several the one with the thickest
    film is taken.
    """
    still = _still_at(parameters, speeds[index])
    result = machine_equilibrium(machine, still, guess)
    if result.converged and _smallest_film(machine, result, still) > THIN:
        return result
    found = [result, _from_guesses(machine, still, None, NewtonOptions())]
    for other in (index - 1, index + 1):
        if 0 <= other < len(speeds):
            begin = _still_at(parameters, speeds[other])
            start = _from_guesses(machine, begin, guess if other < index else None, NewtonOptions())
            if start.converged:
                found.append(_follow_speed(machine, parameters, start, speeds[other], speeds[index]))
    converged = [one for one in found if one.converged]
    return max(converged, key=lambda one: _smallest_film(machine, one, still), default=result)


def _smallest_film(machine: Machine, equilibrium: Equilibrium, still: Array) -> float:
    """The smallest film thickness, rounded so that equal equilibria from two starts agree."""
    return round(float(machine.minimum_film(MEAN_PHASE, equilibrium.state, still).min()), 6)


def _follow_speed(
    machine: Machine, parameters: Array, start: Equilibrium, begin: float, end: float
) -> Equilibrium:
    """Follow an equilibrium from one speed to another; halve the step on failure."""
    result, done, step = start, 0.0, 0.25
    while done < 1.0 and step > 1e-3:
        ahead = min(1.0, done + step)
        still = _still_at(parameters, begin + ahead * (end - begin))
        trial = _carry(machine, still, result.state, 1.0, NewtonOptions())
        if trial.converged:
            result, done, step = trial, ahead, 1.5 * step
        else:
            step *= 0.5
    return result if done == 1.0 else replace(result, converged=False)


def _still_at(parameters: Array, speed: float) -> Array:
    """The parameters at another speed, with the rings at rest."""
    still = at_rest(parameters)
    still[film.SPEED] = speed
    return still


def _from_guesses(machine: Machine, still: Array, guess: Array | None, options: NewtonOptions) -> Equilibrium:
    """Equilibrium from the guess, if there is one, or from resting journals."""
    if guess is not None:
        result = _carry(machine, still, guess, 1.0, options)
        if result.converged:
            return result
    return _carry(machine, still, resting_guess(machine, still), 1.0, options)


def _from_finer_grid(
    machine: Machine, still: Array, failed: Equilibrium, carried: float, options: NewtonOptions
) -> Equilibrium:
    """Start from the equilibrium on a finer grid; on failure say whether a finer grid would help.

    ``carried``: share of the weight that the films carry on the machine's own grid.
    """
    grid = machine.bearings[0].settings
    share = f"{100.0 * carried:.1f} % of the rotor's weight at this speed"
    for factor in (2, 4):
        circumferential, axial = factor * grid.circumferential, grid.axial + factor // 2
        if circumferential > FINEST:
            break
        finer = with_grid(machine, circumferential, axial)
        found = _from_guesses(finer, still, None, options)
        if not found.converged:
            found, _ = _ramp_weight(finer, still, options)
        if not found.converged:
            continue
        result = _carry(machine, still, regrid(finer, machine, found.state), 1.0, options)
        if result.converged:
            return result
        smallest = finer.minimum_film(MEAN_PHASE, found.state, still).min()
        reason = (
            f"on the grid {grid.circumferential} x {grid.axial} the films carry only {share} "
            f"({failed.reason}), on {circumferential} x {axial} all of it with a smallest film of "
            f"{smallest:.2g} clearances; raise numerics.circumferential or lighten the rotor"
        )
        return replace(failed, reason=reason)
    reason = (
        f"the films carry only {share} ({failed.reason}); raise the speed, the bearing area or the "
        f"viscosity, or lighten the rotor"
    )
    return replace(failed, reason=reason)


def _carry(machine: Machine, still: Array, guess: Array, share: float, options: NewtonOptions) -> Equilibrium:
    """Equilibrium with a share of the rotor's weight, by damped Newton from ``guess``."""
    missing = np.zeros(machine.size)
    missing[machine.rotor_start :] = (1.0 - share) * machine.space.gravity

    def feasible(state: Array) -> bool:
        films = [machine.film(index, MEAN_PHASE, state, still) for index in range(len(machine.bearings))]
        return all(one.thickness.min() > 0.0 and one.padded_pressure.min() > 0.0 for one in films)

    return damped_newton(
        lambda s: machine.rates(MEAN_PHASE, s, still) - missing,
        lambda s: machine.jacobian(MEAN_PHASE, s, still),
        feasible,
        guess,
        options,
    )


def _ramp_weight(machine: Machine, still: Array, options: NewtonOptions) -> tuple[Equilibrium, float]:
    """Follow the equilibrium while the weight grows from nothing to all; halve the increment on failure.

    Gives the share of the weight that is reached too, and in the reason of a failure what stood in the way.
    """
    carried, step = 0.0, 0.1
    result = _carry(
        machine, still, resting_guess(machine, still, eccentricity=0.0, share=0.0), carried, options
    )
    obstacle = result.reason
    while result.converged and carried < 1.0 and step > 1e-3:
        share = min(1.0, carried + step)
        trial = _carry(machine, still, result.state, share, options)
        if trial.converged:
            result, carried, step = trial, share, 1.5 * step
        else:
            obstacle, step = trial.reason, 0.5 * step
    if carried == 1.0:
        return result, carried
    return replace(result, converged=False, reason=obstacle), carried


def at_rest(parameters: Array) -> Array:
    """The parameters with the rings at rest in their mean position (no rate: frequency 0)."""
    still = np.array(parameters, dtype=np.float64)
    still[film.EXCITATION_FREQUENCY] = 0.0
    return still


def ambient_film(bearing: Bearing, parameters: Array) -> Array:
    """Unknowns of a bearing at ambient pressure with the foil resting on the ring."""
    settings = bearing.settings
    pressures = settings.nodes * settings.axial
    unknowns = np.concatenate([np.ones(pressures), np.zeros(settings.nodes)])
    # q = 0 gives dq/dtau = a (p_m - 1) + r q_r: one relaxation time of it is the foil at rest
    relaxation = film.foil_coefficients(parameters, bearing.integers, bearing.scalars)[1]
    unknowns[pressures:] = (
        film_state(bearing, unknowns, np.zeros(4), MEAN_PHASE, parameters).rates[pressures:] / relaxation
    )
    return unknowns


def resting_guess(
    machine: Machine, parameters: Array, eccentricity: float = 0.3, share: float = 1.0
) -> Array:
    """A state with both journals at rest at this eccentricity, 45 degrees after the load line.

    The films are in equilibrium there, and the rotor bends under this share of its weight.
    """
    state = np.zeros(machine.size)
    position = eccentricity * np.sqrt(0.5) * np.array([1.0, -1.0])
    targets = np.zeros(machine.rotor_freedoms)
    held = np.zeros(machine.rotor_freedoms)
    for index, bearing in enumerate(machine.bearings):
        state[machine.film_unknowns(index)] = film_equilibrium(bearing, position, parameters).state
        freedoms = slice(machine.journal_freedoms[index], machine.journal_freedoms[index] + 2)
        targets[freedoms] = position * machine.scales.bearings[index].clearance_ratio
        held[freedoms] = 1.0
    # the rotor hangs in springs at its journals, far stiffer than itself: (K + k E E') x = F + k E X
    start, size = machine.rotor_start, machine.rotor_freedoms
    acceleration = machine.space.constant[size:, :size]
    spring = 1e3 * np.abs(acceleration).max() * np.diag(held)
    state[start : start + size] = np.linalg.solve(
        spring - acceleration, share * machine.space.gravity[size:] + spring @ targets
    )
    return state
