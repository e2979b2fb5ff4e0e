"""`agfb linearize`: equilibria along the speed, bearing coefficients, eigenvalues, instability speed."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pipelines.case.arrays import Array
from pipelines.case.models import Case
from pipelines.case.reading import NamedCase
from pipelines.case.units import Scale, in_both
from pipelines.datasets.branch import BranchWriter, open_branch
from pipelines.datasets.reading import read_group
from pipelines.datasets.records import ENDED
from pipelines.datasets.store import case_group, open_for_writing
from pipelines.machine import film
from pipelines.machine.assembly import Machine, build_machine
from pipelines.machine.rotor_modes import whirl_directions
from pipelines.orbits.equilibria.bearing_coefficients import machine_coefficients
from pipelines.orbits.equilibria.equilibrium import MEAN_PHASE, Equilibrium, at_rest, equilibrium_along
from pipelines.orbits.equilibria.linear import (
    Instability,
    at_speed,
    linear_point,
    linearised,
    locate_instability,
)
from pipelines.orbits.equilibria.modes import logarithmic_decrements, node_shapes
from pipelines.stages.linear import missing_speeds, operating_point
from pipelines.stages.linear.along_speed import (
    direction_flags,
    last_state,
    missing_entries,
    reference_parameters,
)
from pipelines.stages.linear.operating_point import write_operating_point
from pipelines.stages.results import Progress, Report, Scalar, ShouldStop, StageResult, in_both_units

HIDDEN = "the instability lies at speeds without equilibrium"


def linearize(named: NamedCase, store_path: Path, report: Report, should_stop: ShouldStop) -> StageResult:
    """Fill the group ``linear`` of a case, speed by speed from the lowest; resumes after the last speed."""
    store = open_for_writing(store_path)
    machine, parameters = (
        build_machine(named.case),
        reference_parameters(named.case, named.case.linearize.ring),
    )
    table = named.case.linearize
    speeds, scale = np.linspace(*table.speed_range, table.points), named.case.scales.si_per_unit
    group = case_group(named.case_id, "linear")
    write_operating_point(store, named, machine)
    with open_branch(
        store, group, "linear", _sizes(machine, named.case), {"whirl_ratio": np.array(table.whirl_ratios)},
        {"request": table.model_dump(mode="json")}, renew=True,
    ) as branch:  # fmt: skip
        if branch.status != ENDED:
            reasons: dict[int, str] = {}
            for index in range(branch.n_points, table.points):
                if should_stop():
                    return StageResult(named.case_id, True, "stopped on request")
                equilibrium = equilibrium_along(machine, parameters, speeds, index, last_state(branch))
                reasons[index] = equilibrium.reason
                at = at_speed(parameters, float(speeds[index]))
                branch.commit(_row(machine, at, named.case, equilibrium))
                message = f"speed {in_both('speed', float(speeds[index]), scale, '.4g')}"
                report(Progress("linearize", named.case_id, index + 1, table.points, message))
            rows = read_group(store, group, ("speed", "state", "eigenvalues")).arrays
            missing = missing_entries(machine, parameters, rows, reasons)
            _finish(
                branch,
                missing,
                {} if len(missing) == table.points else _instability(machine, parameters, rows),
            )
    attributes = read_group(store, group, ()).attributes
    at_operation = read_group(store, case_group(named.case_id, operating_point.GROUP))
    tables = operating_point.tables(at_operation)
    return _result(named.case_id, attributes, scale, at_operation.attributes, tables)


def _finish(branch: BranchWriter, missing: list[str], instability: dict[str, Any]) -> None:
    """Store how the range ended."""
    reason = missing_speeds.ending(missing, branch.n_points)
    advice = missing_speeds.advice(missing, branch.n_points)
    hidden = instability.get("instability_between")
    if hidden is not None and reason == missing_speeds.SOME_MISSING:
        reason, advice = HIDDEN, f"it begins between the speeds {hidden[0]:.4g} and {hidden[1]:.4g}; {advice}"
    attribute = {missing_speeds.ATTRIBUTE: missing} if missing else {}
    branch.finish(reason, advice, **({"instability_speed": None} | instability | attribute))


def _sizes(machine: Machine, case: Case) -> dict[str, int]:
    table = case.linearize
    return {
        "speed": table.points,
        "component": machine.size,
        "bearing": len(machine.bearings),
        "axis": 2,
        "eigenvalue": table.eigenvalues,
        "whirl_ratio": len(table.whirl_ratios),
        "row": 2,
        "column": 2,
    }


def _row(machine: Machine, parameters: Array, case: Case, equilibrium: Equilibrium) -> dict[str, Any]:
    """One row of the group; a speed without equilibrium stores its residual and NaN otherwise."""
    table, bearings = case.linearize, len(machine.bearings)
    stiffness = damping = np.full((len(table.whirl_ratios), bearings, 2, 2), np.nan)
    row: dict[str, Any] = {
        "speed": parameters[film.SPEED],
        "state": np.full(machine.size, np.nan),
        "journal": np.full((bearings, 2), np.nan),
        "minimum_film": np.full(bearings, np.nan),
        "eigenvalues": np.zeros(0, dtype=np.complex128),
        "eigenvalue_residual": np.zeros(0),
        "logarithmic_decrement": np.zeros(0),
        "damping_ratio": np.zeros(0),
        "direction": np.zeros(0, dtype=np.int8),
        "newton_iterations": equilibrium.iterations,
        "newton_residual": equilibrium.residual,
    }
    if equilibrium.converged:
        point = linearised(machine, parameters, equilibrium, table.eigenvalues)
        state, still = equilibrium.state, at_rest(parameters)
        eigenvalues = point.eigenpairs.values
        decrement = logarithmic_decrements(eigenvalues)
        directions = direction_flags(whirl_directions(node_shapes(machine, point.eigenpairs.vectors)))
        journals = np.array([machine.journal(state, index)[:2] for index in range(bearings)])
        row |= {
            "state": state,
            "journal": journals,
            "minimum_film": machine.minimum_film(MEAN_PHASE, state, still),
            "eigenvalues": eigenvalues,
            "eigenvalue_residual": point.eigenpairs.residuals,
            "logarithmic_decrement": decrement,
            "damping_ratio": -eigenvalues.real / np.abs(eigenvalues),
            "direction": np.where(np.isfinite(decrement), directions, -1).astype(np.int8),
        }
        whirl = np.array(table.whirl_ratios) * parameters[film.SPEED]
        stiffness, damping = machine_coefficients(machine, parameters, state, whirl)
    return row | {"bearing_stiffness": stiffness, "bearing_damping": damping}


def _instability(machine: Machine, parameters: Array, rows: Mapping[str, NDArray[Any]]) -> dict[str, Any]:
    """Attributes of the lowest Hopf point between two neighbouring speeds; None if there is none.

    None also where it lies beside a speed without equilibrium: then ``instability_between`` gives the
    speeds.
    """
    growth, speeds = leading_growth(rows["eigenvalues"]), rows["speed"]
    known = np.flatnonzero(np.isfinite(growth))
    from_start = bool(growth[known][:1] > 0.0)
    none = {"instability_speed": None, "unstable_from_start": from_start}
    for before, after in pairwise(known):
        if not growth[before] < 0.0 <= growth[after]:
            continue
        low, high = float(speeds[before]), float(speeds[after])
        if after > before + 1:
            return none | {"instability_between": [low, high]}
        hopf = hopf_between(machine, parameters, low, high, rows["state"][before])
        if hopf is not None:
            found = {
                "instability_speed": hopf.speed,
                "instability_frequency": hopf.frequency,
                "instability_growth": hopf.growth,
                "instability_growth_slope": hopf.growth_slope,
            }
            return found | ({"unstable_from_start": True} if from_start else {})
    return none


def leading_growth(eigenvalues: NDArray[np.complex128]) -> Array:
    """Largest real part of the oscillating eigenvalues of every row (rows, eigenvalues); NaN without any."""
    oscillating = np.isfinite(eigenvalues) & (eigenvalues.imag > 1e-6)
    growth = np.where(oscillating, eigenvalues.real, -np.inf).max(axis=1)
    return np.where(np.any(oscillating, axis=1), growth, np.nan)


def hopf_between(
    machine: Machine, parameters: Array, low: float, high: float, guess: Array
) -> Instability | None:
    """The Hopf point between two speeds with an equilibrium; None if no pair crosses."""
    lower = linear_point(machine, at_speed(parameters, low), 4, np.ascontiguousarray(guess))
    upper = linear_point(machine, at_speed(parameters, high), 4, np.ascontiguousarray(guess))
    if isinstance(lower, Equilibrium) or isinstance(upper, Equilibrium):
        return None
    try:
        return locate_instability(machine, parameters, lower, upper)
    except ValueError:  # the leading pair is not the one that crosses
        return None


def _result(
    case_id: str,
    attributes: Mapping[str, Any],
    scale: Scale,
    operation: Mapping[str, Any],
    tables: Mapping[str, Sequence[Mapping[str, Scalar]]],
) -> StageResult:
    speed = attributes.get("instability_speed")
    ok = attributes["stop_reason"] in missing_speeds.SUCCESSFUL
    summary: dict[str, Scalar] = {"speeds": attributes["n_points"]}
    summary |= in_both_units("instability speed", "speed", speed, scale)
    if speed is not None:
        summary |= in_both_units("whirl frequency", "frequency", attributes["instability_frequency"], scale)
    if attributes.get("unstable_from_start"):
        summary["unstable from the lowest speed"] = True
    elif speed is None and ok:
        highest = float(attributes["request"]["speed_range"][1])
        summary |= in_both_units("stable up to", "speed", highest, scale)
    summary |= missing_speeds.summary(attributes.get(missing_speeds.ATTRIBUTE, []), scale)
    summary["operating speed [rpm]"] = operation["speed_rpm"]
    reason, advice = attributes["stop_reason"], attributes["stop_advice"]
    return StageResult(case_id, ok, reason, advice, summary, tables=tables)
