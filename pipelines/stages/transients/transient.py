"""`agfb transient`: transients with changing speed, unbalance and switched excitation, block by block."""

from __future__ import annotations

from collections.abc import Iterator
from enum import Enum
from pathlib import Path
from typing import Any

import numpy as np

from pipelines.case.arrays import Array
from pipelines.case.reading import NamedCase
from pipelines.case.units import in_both
from pipelines.datasets.branch import BranchWriter, open_branch
from pipelines.datasets.reading import read_group
from pipelines.datasets.records import ENDED
from pipelines.datasets.store import Store, local_name, open_for_reading, open_for_writing
from pipelines.machine.extremes import FILM, HIGH_FOIL, HIGH_PRESSURE, LOW_FOIL, LOW_PRESSURE, OBSERVED
from pipelines.machine.rates import BEARINGS
from pipelines.orbits.time_runs.transient import Block, Position, Status, advance, starting_position
from pipelines.stages.job import coordinates
from pipelines.stages.results import Progress, Report, ShouldStop, StageResult, in_both_units
from pipelines.stages.transients.analysis import write_transient_analysis
from pipelines.stages.transients.run import Outlook, Run, outlook_of, prepare_run
from pipelines.stages.transients.start import CannotRunError

__all__ = ["CannotRunError", "Outlook", "RunStop", "outlook", "transient"]


class RunStop(Enum):
    """Why a run ended, with advice."""

    FINISHED = ("finished", "")
    TOUCH = (
        "touch",
        "the journal touches the foil of bearing {bearing}: its film shrinks to {value:.3g} of the clearance "
        "at the time {time:.6g} (limit {limit:g}); lower the unbalance, the excitation or the load, or the "
        "limit transient.minimum_film",
    )
    VACUUM = (
        "vacuum",
        "the pressure in bearing {bearing} falls below vacuum ({value:.3g} of ambient) at the time "
        "{time:.6g}: the film grid does not resolve it; raise numerics.circumferential",
    )
    NEWTON = (
        "newton",
        "the equations of the time step at {time:.6g} were not solved: raise transient.steps_per_period; "
        "where a film is about to close, the journal strikes the foil",
    )

    @property
    def word(self) -> str:
        """The reason as named in the store."""
        return str(self.value[0])

    @property
    def advice(self) -> str:
        """The advice, with placeholders for the bearing, its value, the limit and the time."""
        return str(self.value[1])


SUCCESSFUL = frozenset({RunStop.FINISHED.word, RunStop.TOUCH.word, RunStop.VACUUM.word})


def transient(named: NamedCase, store_path: Path, report: Report, should_stop: ShouldStop) -> StageResult:
    """Fill a group ``transient/t000``, ... of a case; resumes at the last checkpoint.

    The group whose tables [transient] and [unbalance] are these, or the next free one. The analysis of
    an ended run is written beside it, into ``transient_analysis``.
    """
    store = open_for_writing(store_path)
    try:
        run = prepare_run(named, store)
    except CannotRunError as error:
        return StageResult(named.case_id, False, error.reason, error.advice)
    sizes, static = _sizes(run), _static(run, named)
    with open_branch(store, run.group, "transient", sizes, static, run.attributes) as branch:
        if branch.status != ENDED:
            _follow(run, branch, named.case_id, report, should_stop)
        ended = branch.status == ENDED
    if ended:
        write_transient_analysis(store, run.machine, run.group)
    return _result(named, store, run.group)


def outlook(named: NamedCase, store_path: Path | None) -> Outlook:
    """What is left of a case's run, also without a store; computes a few steps and writes nothing.

    Raises CannotRunError, and StoreError for a store that cannot be read.
    """
    store = open_for_reading(store_path) if store_path is not None and store_path.exists() else None
    run = prepare_run(named, store)
    done = 0
    if store is not None and run.start is None:
        found = read_group(store, run.group, ("checkpoint_step",))
        if found.attributes["status"] == ENDED:
            return Outlook(0, 0.0)
        done = int(found["checkpoint_step"][-1])
    return outlook_of(run, done)


def _sizes(run: Run) -> dict[str, int]:
    return {
        "sample": run.plan.samples,
        "checkpoint": run.plan.blocks + 1,
        "coordinate": run.machine.rotor_freedoms,
        "bearing": BEARINGS,
        "axis": 2,
        "component": run.machine.size,
        "extreme": OBSERVED,
        "plane": len(run.masses),
    }


def _static(run: Run, named: NamedCase) -> dict[str, Any]:
    return {
        **coordinates(named.case),
        "plane_node": np.array([mass.node for mass in run.masses], dtype=np.int32),
        "plane_moment": np.array([mass.moment for mass in run.masses], dtype=float),
        "plane_phase": np.array([mass.phase for mass in run.masses], dtype=float),
    }


def _follow(run: Run, branch: BranchWriter, case_id: str, report: Report, should_stop: ShouldStop) -> None:
    """Compute block after block from the last checkpoint, and commit each one."""
    position, scale = _position(run, branch), run.machine.scales.si_per_unit
    while position.step < run.plan.steps:
        if should_stop():
            return
        block = advance(run.driven, run.plan, position, run.parameters, run.limits)
        if block.end.step > position.step:
            rows = _rows(run, position.samples, block.samples, block.extremes)
            branch.extend(list(rows), [_checkpoint(run, block.end)])
        position = block.end
        if block.status is not Status.DONE:
            branch.finish(*_stop(run, block))
            return
        now = run.plan.time(position.step)
        speed = float(run.drive.speed(np.array(now)))
        message = f"time {in_both('time', now, scale)}, speed {in_both('speed', speed, scale, '.5g')}"
        report(Progress("transient", case_id, position.samples, run.plan.samples, message))
    branch.finish(RunStop.FINISHED.word)


def _position(run: Run, branch: BranchWriter) -> Position:
    """The last checkpoint; without one the start, which is committed first."""
    newest = branch.newest_event()
    if newest is not None:
        state, running = newest["checkpoint_state"], newest["checkpoint_extremes"]
        return Position(state, running, int(newest["checkpoint_step"]), branch.n_points)
    assert run.start is not None
    position = starting_position(run.driven, run.drive, run.parameters, run.start.state)
    samples = run.machine.masters(position.state)[None, :]
    rows = _rows(run, 0, samples, position.running[None, :])
    branch.extend(list(rows), [_checkpoint(run, position)])
    return position


def _rows(run: Run, first: int, samples: Array, extremes: Array) -> Iterator[dict[str, Any]]:
    """Rows of the group from the displacements of the masters and the extremes since the previous sample."""
    times = np.minimum((first + np.arange(len(samples))) * run.plan.interval, run.drive.duration)
    speeds, angles = run.drive.speed(times), run.drive.angle(times)
    displacements = run.drive.displacement(times)
    ratios = np.array([own.clearance_ratio for own in run.machine.scales.bearings])
    freedoms = np.array(run.machine.journal_freedoms)[:, None] + np.arange(2)
    journals = samples[:, freedoms] / ratios[:, None]
    observed = extremes.reshape(len(samples), OBSERVED // BEARINGS, BEARINGS)
    for k in range(len(samples)):
        yield {
            "time": times[k],
            "speed": speeds[k],
            "angle": angles[k],
            "ring_displacement": displacements[k],
            "displacement": samples[k],
            "journal": journals[k],
            "minimum_film": observed[k, FILM],
            "minimum_pressure": observed[k, LOW_PRESSURE],
            "maximum_pressure": -observed[k, HIGH_PRESSURE],
            "minimum_foil": observed[k, LOW_FOIL],
            "maximum_foil": -observed[k, HIGH_FOIL],
        }


def _checkpoint(run: Run, position: Position) -> dict[str, Any]:
    now = np.array(run.plan.time(position.step))
    return {
        "checkpoint_time": now,
        "checkpoint_step": float(position.step),
        "checkpoint_samples": position.samples,
        "checkpoint_speed": run.drive.speed(now),
        "checkpoint_angle": run.drive.angle(now),
        "checkpoint_ring_phase": run.drive.ring_phase(now, run.parameters),
        "checkpoint_ring_displacement": run.drive.displacement(now),
        "checkpoint_state": position.state,
        "checkpoint_extremes": position.running,
    }


def _stop(run: Run, block: Block) -> tuple[str, str]:
    """Reason and advice of a run that ended early."""
    now = run.plan.time(block.end.step)
    if block.status is Status.NEWTON:
        return RunStop.NEWTON.word, RunStop.NEWTON.advice.format(time=now)
    quantity, bearing = divmod(block.limit, BEARINGS)
    stop = RunStop.TOUCH if quantity == FILM else RunStop.VACUUM
    value, limit = block.end.running[block.limit], run.limits[block.limit]
    return stop.word, stop.advice.format(bearing=bearing + 1, value=value, time=now, limit=limit)


def _result(named: NamedCase, store: Store, group: str) -> StageResult:
    found = read_group(store, group, ("time", "speed", "minimum_film"))
    attributes = found.attributes
    reason = attributes["stop_reason"] or "stopped on request"
    ok = attributes["status"] != ENDED or reason in SUCCESSFUL
    summary: dict[str, Any] = {"group": local_name(group), "samples": found.n_points}
    if found.n_points:
        scale = named.case.scales.si_per_unit
        summary |= in_both_units("time", "time", float(found["time"][-1]), scale)
        summary |= in_both_units("speed", "speed", float(found["speed"][-1]), scale)
        summary["thinnest film"] = float(np.min(found["minimum_film"]))
    summary["steps per period"] = attributes["steps_per_period"]
    advice = attributes["stop_advice"]
    caution = f"the run ended early: {advice}" if ok and advice else ""
    return StageResult(named.case_id, ok, reason, advice, summary, caution=caution)
