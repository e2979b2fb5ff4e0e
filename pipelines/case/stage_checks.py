"""What a stage requires of its tables, beyond the form of each key.

These checks belong to the stage that is asked for: a table never stops a stage that does not read it.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from types import MappingProxyType
from typing import Any

from pipelines.case.calibrate_settings import calibration_inconsistencies
from pipelines.case.fields import MEASURES, Inconsistency, Path
from pipelines.case.models import Case
from pipelines.case.plausible import implausible_values
from pipelines.case.rotor import off_shaft
from pipelines.case.scales import PARAMETERS
from pipelines.case.torus_settings import torus_inconsistencies
from pipelines.case.transient_settings import transient_inconsistencies
from pipelines.case.units import Written, in_both

Check = Callable[[Case], Iterator[Inconsistency]]

NO_PERIOD = (
    'the stroboscopic period is 2 pi/Omega_ex: give excitation.frequency, or formulation = "autonomous" for '
    "self-excited cycles"
)
NO_EFFECT = "has no effect at displacement 0: nothing depends on the excitation frequency"
RESTING = (
    "the cycles are self-excited, and rings that move force their period upon them: give "
    'excitation.frequency, and continue_cycles.formulation = "stroboscopic"'
)
NO_UNBALANCE = (
    "nothing excites the rotor: give [unbalance] with planes and moments, or a grade with its rated speed"
)
AT_REST = (
    "the rings rest, and a survey seeks cycles that follow them: give excitation.displacement, or make it a "
    "parameter of the plane"
)
CLOSED = "times the largest of excitation.amplitudes must stay below 1: the ring closes the film"


def machine_inconsistencies(
    case: Case, resolved: Mapping[str, Any], written: Mapping[Path, Written]
) -> Iterator[Inconsistency]:
    """Values with which no stage can compute, each with its path in the case.

    ``resolved``: the case as plain data; ``written``: what the file has in SI units, by path in the case.
    """
    for table in ("bearings", "operation", "excitation", "unbalance"):
        yield from implausible_values(case, resolved, table, written)


def stage_inconsistencies(
    case: Case, stage: str, resolved: Mapping[str, Any], written: Mapping[Path, Written]
) -> Iterator[Inconsistency]:
    """Why a stage (of `STAGE_TABLES`) is impossible for a case, each reason with its path in the case.

    ``resolved``: the case as plain data; ``written``: what the file has in SI units, by path in the case.
    """
    doubtful: set[Path] = set()
    for table in STAGE_TABLES[stage]:
        for path, message in implausible_values(case, resolved, table, written):
            doubtful.add(path)
            yield path, message
    for path, message in _CHECKS.get(stage, _nothing)(case):
        if path not in doubtful:  # numbers in the wrong unit are judged no further
            yield path, message


def ranges_of_speed(case: Case) -> Iterator[tuple[str, tuple[float, float]]]:
    """Dotted key and ends of the ranges of speed along which equilibria are computed."""
    yield "linearize.speed_range", case.linearize.speed_range
    yield "criticals.speed_range", case.criticals.speed_range
    if case.coefficients.speed_range is not None:
        yield "coefficients.speed_range", case.coefficients.speed_range
    if case.unbalance is not None:
        yield "unbalance_response.speed_range", case.unbalance_response.speed_range


def _nothing(case: Case) -> Iterator[Inconsistency]:
    yield from ()


def _cycles(case: Case) -> Iterator[Inconsistency]:
    table, at = case.continue_cycles, ("continue_cycles",)
    yield from _along(case, table.parameter, table.range, at)
    if not (_is_self_excited(case) and table.parameter == "speed"):  # which begins at a Hopf point
        yield from _own_value(case, table.parameter, table.range, table.start, at)
    if _unforced(case) and (table.formulation == "stroboscopic" or table.parameter == "displacement"):
        yield (*at, "formulation"), NO_PERIOD


def _curves(case: Case) -> Iterator[Inconsistency]:
    table = case.track_curves
    for index, (name, interval) in enumerate(zip(table.parameters, table.ranges, strict=True)):
        for path, message in _along(case, name, interval, ()):
            key = "parameters" if path == ("parameter",) else "ranges"
            yield ("track_curves", key, index), message
        if name == "displacement" and _is_self_excited(case):
            yield ("track_curves", "parameters", index), RESTING
    if _unforced(case) and case.continue_cycles.formulation == "stroboscopic":
        yield ("continue_cycles", "formulation"), NO_PERIOD


def _set(case: Case) -> Iterator[Inconsistency]:
    """Errors of the curves to search; a machine without any is a result of the search, not an error."""
    if not _is_passive(case):
        yield from _curves(case)
        if case.bifurcation_set.certify:
            yield from _survey(case)


def _survey(case: Case) -> Iterator[Inconsistency]:
    parameters, own = case.track_curves.parameters, case.survey.ranges
    at: Path = ("track_curves",) if own is None else ("survey",)
    for index, (name, interval) in enumerate(zip(parameters, own or case.track_curves.ranges, strict=True)):
        if own is not None and name != "displacement" and interval[0] <= 0:
            yield (*at, "ranges", index), "must be > 0: this parameter is positive"
        for path, message in _along(case, name, interval, ()):
            key = ("track_curves", "parameters") if path == ("parameter",) else (*at, "ranges")
            yield (*key, index), message
    if _is_passive(case) and "displacement" not in parameters and "excitation_frequency" not in parameters:
        yield ("track_curves", "parameters"), AT_REST
    if _unforced(case) and "excitation_frequency" not in parameters:
        yield ("track_curves", "parameters"), NO_PERIOD


def _tori(case: Case) -> Iterator[Inconsistency]:
    table, at = case.continue_tori, ("continue_tori",)
    yield from _along(case, table.parameter, table.range, at)
    if table.origin == "unbalance":
        yield from _own_value(case, table.parameter, table.range, table.start, at)
    formulation = case.continue_cycles.formulation
    for path, message in torus_inconsistencies(table, case.excitation, formulation, case.unbalance):
        yield (*at, *path), message


def _transient(case: Case) -> Iterator[Inconsistency]:
    for path, message in transient_inconsistencies(case.transient, case.excitation):
        yield ("transient", *path), message


def _response(case: Case) -> Iterator[Inconsistency]:
    if case.unbalance is None:
        yield ("unbalance",), NO_UNBALANCE
    last = case.rotor.node_count - 1
    for index, node in enumerate(case.unbalance_response.probes):
        if node > last:
            yield ("unbalance_response", "probes", index), off_shaft(node, last)


def _calibration(case: Case) -> Iterator[Inconsistency]:
    if case.calibrate is None:
        yield (
            ("calibrate",),
            "no table [calibrate]: give [[calibrate.parameters]] (keys, range) and [[calibrate.targets]] "
            "(value); `agfb schema --md` describes them",
        )
        return
    document = case.model_dump(mode="json", exclude={"calibrate"})
    yield from calibration_inconsistencies(case.calibrate, document, case.with_values)


def _along(case: Case, name: str, interval: Sequence[float], at: Path) -> Iterator[Inconsistency]:
    """Whether the machine has the parameter, over the whole range."""
    scales = case.scales
    if name == "foil_stiffness" and any(bearing.foil.rigid for bearing in case.bearings):
        yield (*at, "parameter"), "a rigid bearing has no foil stiffness to continue"
    if name == "excitation_frequency" and _is_passive(case):
        yield (*at, "parameter"), NO_EFFECT
    if name == "displacement" and max(scales.ring_factors(case.excitation)) * interval[1] >= 1.0:
        yield (*at, "range"), CLOSED


def _own_value(
    case: Case, name: str, interval: Sequence[float], start: float | None, at: Path
) -> Iterator[Inconsistency]:
    """Whether a branch without ``start`` can begin at the case's own value."""
    low, high = interval
    value = case.parameters[PARAMETERS.index(name)]
    if start is None and not math.isnan(value) and not low <= value <= high:
        ends, own = (
            ", ".join(in_both(MEASURES[name], number, case.scales.si_per_unit) for number in numbers)
            for numbers in (interval, (value,))
        )
        yield (
            (*at, "range"),
            f"[{ends}] does not contain the case's own {name} = {own}, where the branch starts: give start, "
            "or another range",
        )


def _is_passive(case: Case) -> bool:
    return case.scales.ring_displacement(case.excitation) == 0.0


def _is_self_excited(case: Case) -> bool:
    table = case.continue_cycles
    return table.formulation == "autonomous" and _is_passive(case) and table.parameter != "displacement"


def _unforced(case: Case) -> bool:
    return case.excitation.frequency is None and case.excitation.frequency_hz is None


STAGE_TABLES: Mapping[str, tuple[str, ...]] = MappingProxyType(
    {
        "linearize": ("linearize",),
        "coefficients": ("coefficients", "linearize"),  # whose speed_range is the default
        "criticals": ("criticals",),
        "unbalance_response": ("unbalance_response",),
        "continue_cycles": ("continue_cycles", "linearize"),  # a whirl is sought along linearize.speed_range
        "track_pd": ("track_curves",),
        "track_ns": ("track_curves",),
        "track_folds": ("track_curves",),
        "bifurcation_set": ("bifurcation_set", "track_curves"),
        "survey": ("survey", "track_curves"),
        "refine": ("refine",),
        "transient": ("transient",),
        "continue_tori": ("continue_tori",),
        "calibrate": ("calibrate",),
    }
)
"""The tables of a case that a stage reads beside those of the machine, its own first."""
_CHECKS: Mapping[str, Check] = MappingProxyType(
    {
        "unbalance_response": _response,
        "continue_cycles": _cycles,
        "track_pd": _curves,
        "track_ns": _curves,
        "track_folds": _curves,
        "bifurcation_set": _set,
        "survey": _survey,
        "transient": _transient,
        "continue_tori": _tori,
        "calibrate": _calibration,
    }
)
