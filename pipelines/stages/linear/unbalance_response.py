"""`agfb unbalance-response`: amplitude and phase over the speed, and amplification factors."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pipelines.case.models import Case
from pipelines.case.reading import NamedCase
from pipelines.datasets.branch import write_group
from pipelines.datasets.reading import read_group
from pipelines.datasets.store import Store, case_group, open_for_writing
from pipelines.machine.assembly import build_machine, parameter_vector
from pipelines.machine.unbalance import UnbalanceMass, unbalance_masses
from pipelines.orbits.equilibria.synchronous_response import (
    Peak,
    SynchronousResponse,
    peaks,
    synchronous_response,
)
from pipelines.stages.linear import missing_speeds
from pipelines.stages.results import Progress, Report, Scalar, ShouldStop, StageResult, StopRequested

GROUP = "unbalance_response"
SMALL = 0.1  # of the smallest film: a larger motion of a journal is no longer linear
AXES = ("x", "y")


def unbalance_response(
    named: NamedCase, store_path: Path, report: Report, should_stop: ShouldStop
) -> StageResult:
    """Write the group ``unbalance_response`` of a case at once; recomputed only for another request."""
    store, group = open_for_writing(store_path), case_group(named.case_id, GROUP)
    request = request_of(named.case)
    if store.has_group(group) and read_group(store, group, ()).attributes.get("request") == request:
        return _result(named, store, group)
    table, masses = named.case.unbalance_response, unbalance_masses(named.case)
    machine = build_machine(named.case)

    def visit(done: int) -> None:
        if should_stop():
            raise StopRequested
        report(Progress(GROUP, named.case_id, done, table.points))

    try:
        speeds = np.linspace(*table.speed_range, table.points)
        probes = probe_nodes(named.case)
        found = synchronous_response(machine, parameter_vector(named.case), masses, probes, speeds, visit)
    except StopRequested:
        return StageResult(named.case_id, True, "stopped on request")
    arrays = _response_arrays(found, masses, probes) | _peak_arrays(found, probes)
    missing = [
        missing_speeds.entry(speed, reason)
        for speed, reason in sorted(found.missing.items())
        if speed in speeds
    ]
    attributes = {
        "request": request,
        missing_speeds.ATTRIBUTE: missing,
        "inserted_speeds": len(found.speeds) + len(missing) - len(speeds),
        "stop_reason": missing_speeds.ending(missing, len(speeds)),
        "stop_advice": missing_speeds.advice(missing, len(speeds)),
        "largest_motion": float(found.gap.max(initial=0.0)),
    }
    write_group(store, group, GROUP, arrays, attributes)
    report(Progress(GROUP, named.case_id, table.points, table.points))
    return _result(named, store, group)


def request_of(case: Case) -> dict[str, Any]:
    """What the group depends on beside the machine: its table and the unbalance."""
    unbalance = None if case.unbalance is None else case.unbalance.model_dump(mode="json")
    return case.unbalance_response.model_dump(mode="json") | {"unbalance": unbalance}


def probe_nodes(case: Case) -> tuple[int, ...]:
    """The probes of the table; by default the bearings' nodes."""
    return case.unbalance_response.probes or tuple(bearing.node for bearing in case.bearings)


def _response_arrays(
    found: SynchronousResponse, masses: Sequence[UnbalanceMass], probes: Sequence[int]
) -> dict[str, NDArray[Any]]:
    return {
        "speed": found.speeds,
        "plane_node": np.array([mass.node for mass in masses], dtype=np.int32),
        "plane_moment": np.array([mass.moment for mass in masses]),
        "plane_phase": np.array([mass.phase for mass in masses]),
        "probe_node": np.array(probes, dtype=np.int32),
        "response": found.displacement,
        "journal_motion": found.gap,
    }


def _peak_arrays(found: SynchronousResponse, probes: Sequence[int]) -> dict[str, NDArray[Any]]:
    """Resonances of every probe and axis, all planes together, by probe, axis and speed."""
    total = found.displacement.sum(axis=1)
    rows: list[tuple[int, int, Peak]] = [
        (probe, axis, peak)
        for probe in range(len(probes))
        for axis in range(len(AXES))
        for peak in peaks(found.speeds, total[:, probe, axis])
    ]
    return {
        "peak_probe": np.array([probe for probe, _, _ in rows], dtype=np.int32),
        "peak_axis": np.array([axis for _, axis, _ in rows], dtype=np.int8),
        "peak_speed": np.array([peak.speed for _, _, peak in rows]),
        "peak_amplitude": np.array([peak.amplitude for _, _, peak in rows]),
        "peak_phase": np.array([peak.phase for _, _, peak in rows]),
        "peak_low": np.array([peak.low for _, _, peak in rows]),
        "peak_high": np.array([peak.high for _, _, peak in rows]),
        "peak_amplification": np.array([peak.amplification for _, _, peak in rows]),
    }


def _result(named: NamedCase, store: Store, group: str) -> StageResult:
    content = read_group(store, group, ("speed", "peak_speed", "peak_amplification"))
    attributes, factors = content.attributes, content.arrays["peak_amplification"]
    known = factors[np.isfinite(factors)]
    summary: dict[str, Scalar] = {
        "speeds": len(content.arrays["speed"]),
        "resonances": len(factors),
        "largest amplification": float(known.max()) if known.size else None,
    }
    summary |= missing_speeds.summary(attributes[missing_speeds.ATTRIBUTE], named.case.scales.si_per_unit)
    motion, caution = attributes["largest_motion"], ""
    if motion > SMALL:
        caution = (
            f"a journal moves by {motion:.2g} of its smallest film: too much for a linear response, "
            "`agfb transient` computes it"
        )
    reason = attributes["stop_reason"]
    successful = reason in missing_speeds.SUCCESSFUL
    return StageResult(named.case_id, successful, reason, attributes["stop_advice"], summary, caution=caution)
