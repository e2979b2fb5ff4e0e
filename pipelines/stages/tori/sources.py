"""Where branches of tori begin: at a Neimark-Sacker point, or around the cycle of a rotor out of balance."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from typing import Any, Protocol

import numpy as np

from pipelines.bifurcations.arclength import continue_branch
from pipelines.bifurcations.branch import BranchPoint, BranchStart, BranchState, ContinuationOptions
from pipelines.bifurcations.detection import DetectionOptions, Event
from pipelines.bifurcations.switching import with_multiplied_period
from pipelines.bifurcations.tori.circle_map import PeriodCircle
from pipelines.bifurcations.tori.continuation import continue_torus
from pipelines.bifurcations.tori.problem import FourierOptions, TorusProblem
from pipelines.bifurcations.tori.slow_bases import constant_bases
from pipelines.bifurcations.tori.start import torus_from_event
from pipelines.bifurcations.tori.torus import TorusOptions, TorusPoint, TorusStart, TorusStop
from pipelines.case.models import Case
from pipelines.case.scales import PARAMETERS
from pipelines.case.torus_settings import FEWEST_ANGLES
from pipelines.machine.assembly import Machine
from pipelines.machine.unbalance import UNBALANCE, UnbalanceMass, unbalance_masses
from pipelines.orbits.machine_cycles import cycle_shape, unphysical
from pipelines.orbits.shooting import CycleProblem
from pipelines.orbits.time_runs.unbalanced_map import UNBALANCED_PARAMETERS, unbalanced_system
from pipelines.stages.cycles.problem import cycle_problem
from pipelines.stages.cycles.start import FirstCycle, Guard, NoStart, first_cycles
from pipelines.stages.job import Job, Origin
from pipelines.stages.parameter_columns import parameter_attributes
from pipelines.stages.tori.rows import torus_shape

BORN_AMPLITUDES = (1.0, 0.25, 4.0)  # of the first torus at a Neimark-Sacker point, in units of `amplitude`
_RAMP = TorusOptions(range=(0.0, 1.0), step=0.5, minimum_step=1e-2, maximum_step=0.5, events=False)


@dataclass(frozen=True)
class FirstTorus:
    """A guess of the first torus, its problem, and the direction in which the branch leaves it."""

    problem: TorusProblem
    start: TorusStart
    direction: int


class TorusSource(Protocol):
    """Where a branch of tori begins."""

    @property
    def beyond(self) -> str:
        """The advice for starting a branch beyond the resonance that ended it."""

    def attributes(self) -> dict[str, Any]:
        """The source as attributes of its group."""

    def problem(self, steps: int) -> TorusProblem:
        """The tori of the branch with a given number of time steps in a period."""

    def starts(self, job: Job) -> Iterator[FirstTorus | NoStart]:
        """Guesses of the first torus, the cheapest first; tried in this order until one converges."""


@dataclass(frozen=True)
class BornTori:
    """Tori born at the Neimark-Sacker point `event` of `cycles`, which close after `turns` periods."""

    case: Case
    origin: Origin
    cycles: CycleProblem
    event: Event
    turns: int
    fourier: FourierOptions

    @property
    def beyond(self) -> str:
        return "choose a larger continue_tori.amplitude"

    def attributes(self) -> dict[str, Any]:
        return {
            "origin": self.origin.as_dict(),
            "turns": self.turns,
            "fixed": _fixed(self.case, self.cycles.parameter, self.event.parameters),
        }

    def problem(self, steps: int) -> TorusProblem:
        circle = PeriodCircle(self.cycles.period_map, self.event.parameters, self.cycles.parameter, steps)
        return TorusProblem(circle, self.cycles.options, self.fourier)

    def starts(self, job: Job) -> Iterator[FirstTorus | NoStart]:
        for factor in BORN_AMPLITUDES:
            amplitude = factor * job.case.continue_tori.amplitude
            born = torus_from_event(self.cycles, self.event, amplitude, self.fourier)
            if born is not None:
                yield FirstTorus(born.problem, born.start, born.direction)
            else:
                yield NoStart(
                    "no torus was found beside the Neimark-Sacker point",
                    "set another continue_tori.amplitude; beside a strong resonance there may be none",
                )


@dataclass(frozen=True)
class UnbalancedTori:
    """The motion of the rotor with unbalance around the `cycles` of the balanced machine."""

    machine: Machine
    case: Case
    cycles: CycleProblem
    masses: tuple[UnbalanceMass, ...]
    direction: int
    fourier: FourierOptions

    @property
    def beyond(self) -> str:
        return "choose another continue_tori.start"

    def attributes(self) -> dict[str, Any]:
        return {
            "unbalance": [[mass.node, mass.moment, mass.phase] for mass in self.masses],
            "turns": 1,
            "fixed": _fixed(self.case, self.cycles.parameter, self.cycles.parameters),
        }

    def problem(self, steps: int) -> TorusProblem:
        parameters = np.zeros(len(UNBALANCED_PARAMETERS))
        parameters[: len(PARAMETERS)] = self.cycles.parameters
        parameters[UNBALANCE] = 1.0
        period_map = replace(self.cycles.period_map, system=unbalanced_system(self.machine, self.masses))
        circle = PeriodCircle(
            period_map, parameters, self.cycles.parameter, steps, angle="rotation_phase", frequency="speed"
        )
        return TorusProblem(circle, self.cycles.options, self.fourier)

    def starts(self, job: Job) -> Iterator[FirstTorus | NoStart]:
        """The balanced cycle, then the torus that grows out of it with the unbalance.

        Newton's method may take the cycle for the torus.
        """
        watch = Guard(self._cycle_limit, job.should_stop)
        for found in first_cycles(self.machine, self.case, self.cycles, watch):
            cycle = self._corrected(found.start) if isinstance(found, FirstCycle) else found
            if isinstance(cycle, NoStart):
                yield cycle
                continue
            problem = self.problem(cycle.steps)
            count = self.fourier.fewest
            start = TorusStart(
                np.tile(cycle.state, (count, 1)), constant_bases(cycle.basis, count), cycle.parameter
            )
            yield FirstTorus(problem, start, self.direction)
            grown = self._grown(problem, start, job)
            yield grown if isinstance(grown, NoStart) else FirstTorus(problem, grown, self.direction)

    def _corrected(self, guess: BranchStart) -> BranchState | NoStart:
        """The balanced cycle with its slow basis and the time steps that it needs."""
        options = ContinuationOptions(
            range=self.case.continue_tori.range, max_points=1, detection=DetectionOptions(kinds=())
        )
        result = continue_branch(self.cycles, guess, options, lambda *_: None)
        if result.state is None:
            return NoStart(f"the balanced cycle did not converge: {result.message}", result.stop.advice)
        return result.state

    def _grown(self, problem: TorusProblem, start: TorusStart, job: Job) -> TorusStart | NoStart:
        """The torus reached by raising the unbalance from zero."""
        circle = problem.circle
        assert isinstance(circle, PeriodCircle)
        growing = replace(circle, parameter="unbalance")
        minimum_film = self.case.continue_cycles.minimum_film

        def limit(point: TorusPoint) -> str | None:
            shape = torus_shape(self.machine, growing, point.torus.unknowns)
            return unphysical(shape.orbits, minimum_film)

        result = continue_torus(
            replace(problem, circle=growing),
            replace(start, parameter=0.0),
            _RAMP,
            lambda *_: None,
            limit,
            job.should_stop,
        )
        state = result.state
        if result.stop is TorusStop.RANGE and state is not None and state.parameter == 1.0:
            return TorusStart(state.states, state.slow_bases, start.parameter, state.rotation)
        reached, why = 0.0 if state is None else state.parameter, result.message or result.stop.advice
        return NoStart(
            f"no torus was found: raised from zero, the unbalance came to {reached:.3g} of its value: {why}",
            "lower the unbalance, or choose another continue_tori.start",
        )

    def _cycle_limit(self, point: BranchPoint) -> str | None:
        shape = cycle_shape(self.machine, point.cycle.image.orbit, point.cycle.parameters, snapshots=0)
        return unphysical(shape, self.case.continue_cycles.minimum_film)


def _fixed(case: Case, parameter: str, values: np.ndarray) -> dict[str, float | None]:
    """The constant parameters of a branch."""
    named = parameter_attributes(case, values[: len(PARAMETERS)])
    return {name: value for name, value in named.items() if name != parameter}


def fourier_options(case: Case) -> FourierOptions:
    """How many angles the curves of a case may have."""
    table = case.continue_tori
    return FourierOptions(table.tolerance, FEWEST_ANGLES, table.max_angles)


def forced_cycles(machine: Machine, case: Case) -> tuple[Case, CycleProblem]:
    """The cycles of a case along the parameter of its tori, and the case that asks for them."""
    table = case.continue_tori
    wanted = {
        "parameter": table.parameter,
        "range": table.range,
        "start": table.start,
        "formulation": "stroboscopic",
    }
    cycles = case.continue_cycles.model_copy(update=wanted)
    along = case.model_copy(update={"continue_cycles": cycles})
    return along, cycle_problem(machine, along)


def born_tori(job: Job, origin: Origin, event: Event, turns: int) -> BornTori:
    """The tori of a case at a Neimark-Sacker point."""
    case = job.case
    cycles = with_multiplied_period(forced_cycles(job.machine, case)[1], turns)
    return BornTori(case, origin, cycles, event, turns, fourier_options(case))


def unbalanced_tori(job: Job, direction: int) -> UnbalancedTori:
    """The tori of a case around its cycle."""
    along, cycles = forced_cycles(job.machine, job.case)
    masses = unbalance_masses(along)
    return UnbalancedTori(job.machine, along, cycles, masses, direction, fourier_options(along))
