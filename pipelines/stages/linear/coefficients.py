"""`agfb coefficients`: stiffness and damping of the bearings over rotating speed and whirl frequency."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from pipelines.case.arrays import Array
from pipelines.case.models import Case
from pipelines.case.reading import NamedCase
from pipelines.case.units import in_both
from pipelines.datasets.branch import open_branch
from pipelines.datasets.reading import read_group
from pipelines.datasets.records import ENDED
from pipelines.datasets.store import case_group, open_for_writing
from pipelines.machine import film
from pipelines.machine.assembly import Machine, build_machine
from pipelines.orbits.equilibria.bearing_coefficients import machine_coefficients
from pipelines.orbits.equilibria.equilibrium import Equilibrium, equilibrium_along
from pipelines.orbits.equilibria.linear import at_speed
from pipelines.stages.linear import missing_speeds
from pipelines.stages.linear.along_speed import last_state, missing_entries, reference_parameters
from pipelines.stages.results import Progress, Report, ShouldStop, StageResult

GROUP = "coefficients"


def coefficients(named: NamedCase, store_path: Path, report: Report, should_stop: ShouldStop) -> StageResult:
    """Fill the group ``coefficients`` speed by speed; resumes after the last speed."""
    store, group = open_for_writing(store_path), case_group(named.case_id, GROUP)
    machine, case = build_machine(named.case), named.case
    parameters = reference_parameters(case, case.coefficients.ring)
    speeds, frequencies = rotating_speeds(case), whirl_frequencies(case)
    with open_branch(
        store, group, GROUP, _sizes(machine, case), _static(case), {"request": request_of(case)},
        renew=True,
    ) as branch:  # fmt: skip
        if branch.status != ENDED:
            reasons: dict[int, str] = {}
            for index in range(branch.n_points, len(speeds)):
                if should_stop():
                    return StageResult(named.case_id, True, "stopped on request")
                equilibrium = equilibrium_along(machine, parameters, speeds, index, last_state(branch))
                reasons[index] = equilibrium.reason
                at = at_speed(parameters, float(speeds[index]))
                branch.commit(_row(machine, at, frequencies, equilibrium))
                message = f"speed {in_both('speed', float(speeds[index]), case.scales.si_per_unit, '.4g')}"
                report(Progress(GROUP, named.case_id, index + 1, len(speeds), message))
            rows = read_group(store, group, ("speed", "state")).arrays
            missing = missing_entries(machine, parameters, rows, reasons)
            branch.finish(
                missing_speeds.ending(missing, len(speeds)),
                missing_speeds.advice(missing, len(speeds)),
                **{missing_speeds.ATTRIBUTE: missing},
            )
    return _result(named, read_group(store, group, ()).attributes)


def rotating_speeds(case: Case) -> Array:
    """The speeds of the table, dimensionless."""
    table = case.coefficients
    return np.linspace(*(table.speed_range or case.linearize.speed_range), table.points)


def whirl_frequencies(case: Case) -> Array:
    """The whirl frequencies of the table, dimensionless."""
    low, high = case.coefficients.frequency_range or (0.0, float(rotating_speeds(case)[-1]))
    return np.linspace(low, high, case.coefficients.frequencies)


def request_of(case: Case) -> dict[str, Any]:
    """What the group depends on beside the machine: its table, with the ranges that follow from others."""
    speeds, frequencies = rotating_speeds(case), whirl_frequencies(case)
    return case.coefficients.model_dump(mode="json") | {
        "speed_range": [float(speeds[0]), float(speeds[-1])],
        "frequency_range": [float(frequencies[0]), float(frequencies[-1])],
    }


def _sizes(machine: Machine, case: Case) -> dict[str, int]:
    table = case.coefficients
    return {
        "speed": table.points,
        "frequency": table.frequencies,
        "component": machine.size,
        "bearing": len(machine.bearings),
        "axis": 2,
        "row": 2,
        "column": 2,
    }


def _static(case: Case) -> dict[str, Any]:
    """The axis of frequencies, and the nodes of the bearings."""
    return {
        "frequency": whirl_frequencies(case),
        "bearing_node": np.array([table.node for table in case.bearings], dtype=np.int32),
    }


def _row(machine: Machine, parameters: Array, frequencies: Array, equilibrium: Equilibrium) -> dict[str, Any]:
    """One row of the group; a speed without equilibrium stores its residual and NaN otherwise."""
    speed, bearings = float(parameters[film.SPEED]), len(machine.bearings)
    state = np.full(machine.size, np.nan)
    stiffness = damping = np.full((len(frequencies), bearings, 2, 2), np.nan)
    if equilibrium.converged:
        state = equilibrium.state
        stiffness, damping = machine_coefficients(machine, parameters, state, frequencies)
    return {
        "speed": speed,
        "state": state,
        "journal": np.array([machine.journal(state, index)[:2] for index in range(bearings)]),
        "stiffness": stiffness,
        "damping": damping,
        "newton_iterations": equilibrium.iterations,
        "newton_residual": equilibrium.residual,
    }


def _result(named: NamedCase, attributes: Mapping[str, Any]) -> StageResult:
    summary = {"speeds": attributes["n_points"], "whirl frequencies": attributes["dimensions"]["frequency"]}
    summary |= missing_speeds.summary(attributes[missing_speeds.ATTRIBUTE], named.case.scales.si_per_unit)
    reason = attributes["stop_reason"]
    ok = reason in missing_speeds.SUCCESSFUL
    return StageResult(named.case_id, ok, reason, attributes["stop_advice"], summary)
