"""`agfb criticals`: Campbell diagram, critical speeds, resonances, full against condensed rotor."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pipelines.case.arrays import Array
from pipelines.case.models import Case
from pipelines.case.reading import NamedCase
from pipelines.case.units import Scale
from pipelines.datasets.branch import write_group
from pipelines.datasets.reading import read_group
from pipelines.datasets.schema import KINDS
from pipelines.datasets.store import Store, case_group, open_for_writing
from pipelines.machine.assembly import Machine, build_machine, parameter_vector
from pipelines.machine.condensation_check import CondensationComparison, compare_condensation
from pipelines.machine.critical_map import critical_map
from pipelines.orbits.equilibria.campbell import CampbellDiagram, campbell_diagram
from pipelines.orbits.equilibria.critical_speeds import (
    NO_EQUILIBRIUM,
    CriticalSpeed,
    CriticalSpeeds,
    Resonance,
    critical_speeds,
    parametric_resonances,
)
from pipelines.orbits.equilibria.equilibrium import machine_equilibrium
from pipelines.orbits.equilibria.linear import at_speed
from pipelines.orbits.equilibria.modes import logarithmic_decrements
from pipelines.stages.linear import missing_speeds
from pipelines.stages.linear.along_speed import direction_flags
from pipelines.stages.linear.condensed_modes import LinearBearings, checked_modes, linear_bearings
from pipelines.stages.results import (
    Progress,
    Report,
    Scalar,
    ShouldStop,
    StageResult,
    StopRequested,
    in_both_units,
)

COMPARED_MODES = 8
# The unbalance of the comparison: the rotor's mass, off its axis by this part of the clearance.
UNBALANCE_ECCENTRICITY = 0.01

# The critical speed map: points, modes of each direction, times the bearings' stiffness that it goes beyond.
MAP_POINTS, MAP_MODES, MAP_REACH = 41, 4, 30.0

NO_CRITICAL = "no critical speed lies inside the range"
UNDECIDED = "critical speeds may be missing"
SUCCESSFUL = missing_speeds.SUCCESSFUL | {NO_CRITICAL}  # reasons that are no failure


def criticals(named: NamedCase, store_path: Path, report: Report, should_stop: ShouldStop) -> StageResult:
    """Write the group ``criticals`` of a case at once; recomputed only if its table has changed."""
    store, group = open_for_writing(store_path), case_group(named.case_id, "criticals")
    request = named.case.criticals.model_dump(mode="json")
    if store.has_group(group) and read_group(store, group, ()).attributes.get("request") == request:
        return _result(named, store, group)
    machine, parameters = build_machine(named.case), parameter_vector(named.case)
    table = named.case.criticals
    total = table.points + table.unbalance_points

    def visit(done: int) -> None:
        if should_stop():
            raise StopRequested
        report(Progress("criticals", named.case_id, done, total))

    try:
        speeds = np.linspace(*table.speed_range, table.points)
        diagram = campbell_diagram(machine, parameters, speeds, visit, table.max_damping_ratio)
        critical = critical_speeds(machine, parameters, diagram, table.max_damping_ratio)
        linear = _linear_bearings(machine, parameters, named.case, diagram, visit)
    except StopRequested:
        return StageResult(named.case_id, True, "stopped on request")
    resonances = parametric_resonances([one.speed for one in critical.found], table.orders)
    arrays = _campbell_arrays(diagram) | _critical_arrays(machine, critical.found)
    arrays |= _resonance_arrays(resonances)
    attributes: dict[str, Any] = {"condensation_error": None, "caution": ""}
    if linear is not None:
        at_operation = int(np.argmin(np.abs(linear.speeds - parameters[0])))
        arrays |= _comparison_arrays(machine, _comparison(machine, named.case, linear, at_operation))
        speeds_found = [one.speed for one in critical.found]
        checked = checked_modes(machine, named.case, linear, at_operation, speeds_found)
        arrays |= checked.arrays | _map_arrays(machine, linear)
        attributes = {
            "condensation_error": checked.error,
            "caution": checked.caution,
            "compared_speed": float(linear.speeds[at_operation]),
            "unbalance_eccentricity": UNBALANCE_ECCENTRICITY,
        }
    attributes |= {"request": request, **_missing_attributes(diagram, critical, speeds)}
    write_group(store, group, "criticals", arrays, attributes)
    report(Progress("criticals", named.case_id, total, total))
    return _result(named, store, group)


def _missing_attributes(diagram: CampbellDiagram, critical: CriticalSpeeds, speeds: Array) -> dict[str, Any]:
    """Attributes that say what is missing: speeds without equilibrium, and doubts from the count of modes."""
    missing = [
        missing_speeds.entry(float(diagram.speeds[index]), reason)
        for index, reason in diagram.missing.items()
        if diagram.speeds[index] in speeds
    ]
    reason, advice = missing_speeds.ending(missing, len(speeds)), missing_speeds.advice(missing, len(speeds))
    if doubts := [one for one in critical.undecided if one.matters]:
        reason = UNDECIDED
        advice = "; ".join([str(doubts[0]), *([advice] if advice else [])])
    elif reason == missing_speeds.ALL_COMPUTED and critical.undecided:
        reason, advice = missing_speeds.SOME_MISSING, "; ".join(map(str, critical.undecided))
    elif reason == missing_speeds.ALL_COMPUTED and not critical.found:
        reason, advice = NO_CRITICAL, "widen criticals.speed_range or raise criticals.max_damping_ratio"
    counts = critical.counts[critical.counts >= 0].tolist()
    return {
        missing_speeds.ATTRIBUTE: missing,
        "inserted_speeds": len(diagram.speeds) - len(speeds),
        "undecided_stretches": [asdict(one) for one in critical.undecided],
        # between them lie the crossings, each -1 or +1, and the passages of criticals.max_damping_ratio
        "modes_above_synchronous": counts[:1] + counts[-1:],
        "crossings": sum(one.change for one in critical.found),
        "damping_passages": critical.passages,
        "stop_reason": reason,
        "stop_advice": advice,
    }


def _linear_bearings(
    machine: Machine, parameters: Array, case: Case, diagram: CampbellDiagram, visit: Any
) -> LinearBearings | None:
    """The films' synchronous coefficients along the range; None without any equilibrium."""
    table = case.criticals
    found: dict[float, Array] = {}
    guess = None
    for index, speed in enumerate(np.linspace(*table.speed_range, table.unbalance_points)):
        visit(table.points + index)
        at = at_speed(parameters, float(speed))
        state = _equilibrium(machine, at, diagram, float(speed), guess)
        if state is None:
            continue
        found[float(speed)] = guess = state
    return linear_bearings(machine, case, parameters, found) if found else None


def _comparison(
    machine: Machine, case: Case, linear: LinearBearings, at_operation: int
) -> CondensationComparison:
    """Full against condensed rotor: modes near the operating speed, unbalance response along the range."""
    return compare_condensation(
        machine.rotor, machine.condensed.masters, linear.bearings, linear.dimensional,
        unbalance=_unbalance(machine, case), modal_index=at_operation, modes=COMPARED_MODES,
        max_damping_ratio=case.criticals.max_damping_ratio, slopes=machine.condensed.slopes,
    )  # fmt: skip


def _equilibrium(
    machine: Machine, parameters: Array, diagram: CampbellDiagram, speed: float, guess: Array | None
) -> Array | None:
    """The equilibrium at a speed; it is not searched where the diagram has none on either side."""
    above = int(np.searchsorted(diagram.speeds, speed))
    if all(state is None for state in diagram.states[max(0, above - 1) : above + 1]):
        return None
    equilibrium = machine_equilibrium(machine, parameters, guess)
    return equilibrium.state if equilibrium.converged else None


def _unbalance(machine: Machine, case: Case) -> dict[int, complex]:
    """Unbalance [kg m] of ``UNBALANCE_ECCENTRICITY``, shared in phase by the discs.

    Without any disc by the bearings.
    """
    nodes = [disc.node for disc in case.rotor.discs] or [bearing.node for bearing in case.bearings]
    mass = float(machine.rotor.mass[0::4, 0::4].sum())
    share = mass * UNBALANCE_ECCENTRICITY * machine.scales.displacement / len(nodes)
    amounts: dict[int, complex] = dict.fromkeys(nodes, 0.0)
    for node in nodes:
        amounts[node] += share
    return amounts


def _campbell_arrays(diagram: CampbellDiagram) -> dict[str, Any]:
    return {
        "speed": diagram.speeds,
        "frequency": diagram.eigenvalues.imag,
        "damping_ratio": diagram.damping_ratios,
        "logarithmic_decrement": logarithmic_decrements(diagram.eigenvalues),
        "direction": np.where(
            np.isfinite(diagram.eigenvalues), direction_flags(diagram.directions), -1
        ).astype(np.int8),
    }


def _critical_arrays(machine: Machine, critical: list[CriticalSpeed]) -> dict[str, Any]:
    shapes = np.array([one.shape for one in critical], dtype=np.complex128)
    directions = np.array([one.direction for one in critical], dtype=np.int8)
    return {
        "critical_speed": np.array([one.speed for one in critical]),
        "critical_damping_ratio": np.array([one.damping_ratio for one in critical]),
        "critical_direction": direction_flags(directions),
        "critical_mode_shape": shapes.reshape(len(critical), machine.rotor.nodes, 2),
    }


def _resonance_arrays(resonances: list[Resonance]) -> dict[str, Any]:
    kind = KINDS["criticals"].array("resonance_kind")
    return {
        "resonance_frequency": np.array([one.frequency for one in resonances]),
        "resonance_j": np.array([one.first for one in resonances], dtype=np.int32),
        "resonance_k": np.array([one.second for one in resonances], dtype=np.int32),
        "resonance_order": np.array([one.order for one in resonances], dtype=np.int32),
        "resonance_kind": np.array([kind.flag(one.kind) for one in resonances], dtype=np.int8),
    }


def _comparison_arrays(machine: Machine, comparison: CondensationComparison) -> dict[str, Any]:
    """The comparison in dimensionless frequencies and amplitudes over the clearance."""
    modal, scales = comparison.modal, machine.scales
    masters = list(machine.condensed.masters)

    def amplitudes(response: NDArray[np.complex128]) -> Array:
        """Largest displacement along the ellipse of every master, (speeds, masters), over the clearance."""
        x, y = response[:, masters, 0], response[:, masters, 1]
        # semi-major axis of the orbit Re((x, y) exp(i t))
        squares = np.abs(x) ** 2 + np.abs(y) ** 2
        return np.asarray(np.sqrt(0.5 * (squares + np.abs(x**2 + y**2))) / scales.displacement)

    return {
        "full_frequency": modal.full_frequency * scales.time,
        "condensed_frequency": modal.condensed_frequency * scales.time,
        "full_decrement": modal.full_decrement,
        "condensed_decrement": modal.condensed_decrement,
        "mac": modal.mac,
        "unbalance_speed": comparison.speeds * scales.time,
        "response_node": np.array(masters, dtype=np.int32),
        "unbalance_full": amplitudes(comparison.unbalance_full),
        "unbalance_condensed": amplitudes(comparison.unbalance_condensed),
    }


def _map_arrays(machine: Machine, linear: LinearBearings) -> dict[str, Any]:
    """The critical speed map about the stiffness that the bearings have, dimensionless speeds."""
    direct = np.stack([np.diagonal(each.stiffness, axis1=1, axis2=2) for each in linear.bearings], axis=1)
    positive = direct[direct > 0.0]
    low, high = (positive.min(), positive.max()) if positive.size else (machine.scales.stiffness,) * 2
    stiffness = np.logspace(np.log10(low / MAP_REACH), np.log10(high * MAP_REACH), MAP_POINTS)
    nodes = [bearing.node for bearing in linear.bearings]
    maps = [critical_map(machine.rotor, nodes, stiffness, MAP_MODES, backward) for backward in (False, True)]
    return {
        "support_stiffness": stiffness,
        "map_forward": maps[0] * machine.scales.time,
        "map_backward": maps[1] * machine.scales.time,
        "direct_stiffness": direct,
    }


def _result(named: NamedCase, store: Store, group: str) -> StageResult:
    scale = named.case.scales.si_per_unit
    content = read_group(store, group, ("speed", "critical_speed", "resonance_frequency"))
    critical, resonances = content.arrays["critical_speed"], content.arrays["resonance_frequency"]
    lowest = float(critical[0]) if critical.size else None
    summary: dict[str, Scalar] = {"critical speeds": int(critical.size)}
    summary |= in_both_units("lowest", "speed", lowest, scale)
    summary["resonances"] = int(resonances.size)
    attributes = content.attributes
    summary["condensation error"] = attributes.get("condensation_error")
    summary |= _without_equilibrium(attributes, scale)
    reason = attributes["stop_reason"]
    advice, caution = attributes["stop_advice"], attributes.get("caution", "")
    return StageResult(named.case_id, reason in SUCCESSFUL, reason, advice, summary, caution=caution)


def _without_equilibrium(attributes: Mapping[str, Any], scale: Scale) -> dict[str, Scalar]:
    """Speeds of the range without equilibrium, or the intervals between them; empty without any."""
    if missing := attributes[missing_speeds.ATTRIBUTE]:
        return missing_speeds.summary(missing, scale)
    gaps = [one for one in attributes["undecided_stretches"] if one["reason"] == NO_EQUILIBRIUM]
    if not gaps:
        return {}
    rpm = scale["speed"]
    return {
        "without equilibrium": ", ".join(f"{gap['low']:.4g} to {gap['high']:.4g}" for gap in gaps),
        "without equilibrium [rpm]": ", ".join(
            f"{rpm * gap['low']:.0f} to {rpm * gap['high']:.0f}" for gap in gaps
        ),
    }
