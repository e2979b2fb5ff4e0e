"""The conclusions of `agfb report` in words: operating range and margin, for the terminal and the page."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

from agfb_cli.console import words

if TYPE_CHECKING:
    from pipelines.stages.reports.margin import BoundaryPoint, Margin
    from pipelines.stages.reports.operating_range import Best, OperatingRange, Stretch

Scales = Mapping[str, float]
Rows = tuple[list[str], list[tuple[str | None, ...]]]
"""Header and rows of a table; None where there is nothing to tell."""

UNCHANGED = 1e-9  # a change below it is rounding
BIFURCATIONS = {"fold": "fold", "period_doubling": "period doubling", "neimark_sacker": "Neimark-Sacker"}


def heading(case: str, ranges: OperatingRange, scales: Scales) -> str:
    """Heading of the table."""
    lowest = f"{_speed(ranges.speeds[0], scales)}"
    return f"{case}: bifurcation-free from speed {lowest} up to the first bifurcation"


def boundary_rows(ranges: OperatingRange, scales: Scales) -> Rows:
    """One row for every part of the boundary."""
    factor, unit, _ = _dimensional(ranges.parameter, scales)
    header = [words(ranges.parameter), unit, "up to speed", "rpm", "first bifurcation", "curve", ""]
    rows: list[tuple[str | None, ...]] = []
    for part in ranges.stretches():
        ends = part.first.abscissa, part.last.abscissa
        rows.append(
            (
                _interval(*ends, ".4f"),
                _interval(factor * ends[0], factor * ends[1], ".1f" if unit == "Hz" else ".4g"),
                *_reached(part, scales),
                _bifurcation(part),
                None if part.first.curve < 0 else ranges.curves[part.first.curve],
                "incomplete curve near" if part.caution else "",
            )
        )
    return header, rows


def _reached(part: Stretch, scales: Scales) -> tuple[str | None, str | None]:
    """Speeds reached in a part, dimensionless and in rpm."""
    if part.first.base == "unstable":
        return None, None
    rpm = scales["speed_rpm_per_unit"]
    least = "at least " if part.first.is_open else ""
    return (
        least + _interval(part.lowest, part.highest, ".4f"),
        least + _interval(rpm * part.lowest, rpm * part.highest, ".0f"),
    )


def _bifurcation(part: Stretch) -> str:
    if part.first.base == "unstable":
        return "unstable from the lowest speed"
    if part.first.is_open:
        return "none in the plane"
    if part.first.bifurcation == "fold":  # which is neither supercritical nor subcritical
        return "fold"
    kinds = [kind for kind in part.criticalities if kind != "unset"]
    known = " and ".join(kinds) + (
        ", partly unknown" if kinds and len(kinds) < len(part.criticalities) else ""
    )
    return BIFURCATIONS[part.first.bifurcation] + f", {known or 'type unknown'}"


def conclusions(ranges: OperatingRange, scales: Scales) -> list[str]:
    """The best excitation frequency and its gains, a sentence each."""
    if ranges.best is None:
        return ["no excitation frequency of the plane leaves a stable cycle at the lowest speed"]
    lines = [_best_sentence(ranges, ranges.best, scales)]
    least = "at least " if ranges.best.boundary.is_open else ""
    if ranges.passive_gain is not None and ranges.passive is not None:
        passive = _speed(ranges.passive, scales)
        lines.append(f"against displacement 0 (unstable from {passive}): {least}{ranges.passive_gain:+.1%}")
    reference = ranges.reference
    if reference is not None:
        where = f"against {words(ranges.parameter)} {reference.abscissa:.4g}"
        if ranges.reference_gain is not None:
            speed = _speed(reference.speed, scales)
            lines.append(f"{where} (up to {speed}): {least}{ranges.reference_gain:+.1%}")
        else:
            why = "no bifurcation in the plane" if reference.is_open else "unstable from the lowest speed"
            lines.append(f"{where}: gain not defined, {why}")
    return lines


def _best_sentence(ranges: OperatingRange, best: Best, scales: Scales) -> str:
    found = best.boundary
    frequency = _abscissa(ranges, found.abscissa, scales)
    from_to = f"{_speed(ranges.speeds[0], scales)} to {_speed(found.speed, scales)}"
    interval = " to ".join(_abscissa(ranges, value, scales) for value in best.interval)
    if found.is_open:
        return f"best: {words(ranges.parameter)} {frequency}, nothing bounds {from_to}, nor from {interval}"
    sentence = f"best: {words(ranges.parameter)} {frequency}, free from {from_to}"
    if ranges.passive is not None and best.interval[0] < best.interval[1] and found.speed > ranges.passive:
        sentence += f"; better than displacement 0 from {interval}"
    return sentence


def operating_point(ranges: OperatingRange, scales: Scales) -> str:
    """Where the machine runs, and whether its cycle is stable there, a sentence."""
    margin = ranges.margin
    if margin is None:
        return "operating point: not in the plane of the curves, so it has no margin"
    base = "stability not known from stored cycles" if margin.base == "unset" else margin.base
    place = f"speed {_speed(margin.speed, scales)}"
    abscissa = f"{words(margin.parameter)} {_abscissa(ranges, margin.abscissa, scales)}"
    return f"operating point: {place}, {abscissa}: {base}"


def margin_rows(margin: Margin, scales: Scales) -> Rows:
    """Changes from the operating point to the boundaries of stable cycles, a row for every direction."""
    name = words(margin.parameter)
    header = ["margin towards", "speed", name, "relative", "boundary", "curve"]
    rows = {
        "higher speed": margin.higher_speed,
        "lower speed": margin.lower_speed,
        f"higher {name}": margin.higher_abscissa,
        f"lower {name}": margin.lower_abscissa,
        "nearest": margin.nearest,
    }
    return header, [(title, *_seen(margin, point, scales)) for title, point in rows.items()]


def _seen(margin: Margin, point: BoundaryPoint | None, scales: Scales) -> tuple[str | None, ...]:
    """A boundary seen from the operating point: changes, relative distance, kind, curve."""
    if point is None:
        return None, None, None, "none in the plane", None
    speed = _change("speed", point.speed - margin.speed, scales)
    abscissa = _change(margin.parameter, point.abscissa - margin.abscissa, scales)
    kind = _kind(point.bifurcation, point.criticality)
    share = margin.relative(point)
    return speed, abscissa, None if share is None else f"{share:.1%}", kind, point.curve


def _change(parameter: str, value: float, scales: Scales) -> str | None:
    """A change of a parameter, in both units; None where there is no change."""
    from pipelines.case.units import rounded

    if abs(value) < UNCHANGED:
        return None
    factor, unit, _ = _dimensional(parameter, scales)
    sign = "+" if value > 0.0 else ""
    return f"{value:+.4f} ({sign}{rounded(factor * value)} {unit})"


def with_units(data: Mapping[str, Any], scales: Scales) -> dict[str, Any]:
    """The same data with every parameter in its SI unit beside it: speed, speed_rpm."""
    from pipelines.case.fields import MEASURES

    found: dict[str, Any] = {}
    for name, value in data.items():
        found[name] = with_units(value, scales) if isinstance(value, Mapping) else value
        parameter = name.removesuffix("_distance")
        if parameter in MEASURES and not isinstance(value, Mapping):
            factor, _, ending = _dimensional(parameter, scales)
            found[f"{name}_{ending}"] = None if value is None else value * factor
    return found


def _dimensional(parameter: str, scales: Scales) -> tuple[float, str, str]:
    """What a dimensionless 1 of a parameter is in its SI unit, this unit, and the ending of names with it."""
    from pipelines.case.fields import MEASURES, SI_UNITS
    from pipelines.datasets.dimensional import ENDINGS, scale_of_case

    quantity = MEASURES[parameter]
    return scale_of_case(scales)[quantity], SI_UNITS[quantity], ENDINGS[SI_UNITS[quantity]]


def _kind(bifurcation: str, criticality: str) -> str:
    """A bifurcation with its type, which a fold has not."""
    if bifurcation == "fold":
        return "fold"
    return f"{BIFURCATIONS[bifurcation]}, {'type unknown' if criticality == 'unset' else criticality}"


def _abscissa(ranges: OperatingRange, value: float, scales: Scales) -> str:
    return _in_both(ranges.parameter, value, scales)


def _speed(value: float, scales: Scales) -> str:
    return _in_both("speed", value, scales)


def _in_both(parameter: str, value: float, scales: Scales) -> str:
    from pipelines.case.fields import MEASURES
    from pipelines.case.units import in_both
    from pipelines.datasets.dimensional import scale_of_case

    return in_both(MEASURES[parameter], value, scale_of_case(scales), ".4f")


def _interval(low: float, high: float, form: str) -> str:
    """Two numbers with a dash, or one if they look alike."""
    first, last = format(low, form), format(high, form)
    return first if first == last or math.isclose(low, high) else f"{first} - {last}"
