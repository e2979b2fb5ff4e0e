"""Numbers given in the wrong unit: rpm, Hz or N/m3 where a dimensionless number belongs.

A speed that no shaft survives was not meant. The circumference of a rotating ring bears the stress rho v^2,
so that steel and titanium end at v = sqrt(sigma/rho) = 500 m/s and carbon fibre at 1000 m/s. With twice that
nothing is refused that can be built, and room is left for studies at bearing numbers beyond all machines; a
1000 that means rpm, read as the dimensionless speed of a typical bearing, is 27 km/s. The same angular
velocity bounds the excitation frequency: the ring would have to swing faster than any journal turns.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

from pipelines.case.calibrate_settings import NO_SPEEDS
from pipelines.case.fields import Inconsistency, Path
from pipelines.case.models import Case
from pipelines.case.scales import Scales

FASTEST_SURFACE = 2000.0  # m/s
STIFFEST_FOIL = 1e6  # a pressure of p0 moves it by a millionth of the clearance
SLOWEST_SPEED = 10.0  # rpm
SLOWEST_FILM = 1e-3  # dimensionless: a film of this bearing number carries nothing
SPEED, FREQUENCY, STIFFNESS, RPM = "speed", "excitation_frequency", "foil_stiffness", "rpm"


@dataclass(frozen=True)
class _Value:
    """Numbers at a path of a case, and what they measure: one of the words above, or another parameter."""

    path: Path
    measures: str
    numbers: Sequence[float | None]


def implausible_values(case: Case, table: str) -> Iterator[Inconsistency]:
    """The values in one of the case's tables that seem to have another unit than their key."""
    if getattr(case, table) is None:
        return
    scales = case.scales
    fastest = FASTEST_SURFACE / max(bearing.radius for bearing in case.bearings) * scales.time
    for value in _values(case, table):
        given = [number for number in value.numbers if number is not None]
        if not given:
            continue
        largest = max(given)
        if value.measures == SPEED and largest > fastest:
            yield value.path, _too_fast(scales, given, fastest)
        elif value.measures == FREQUENCY and largest > fastest:
            yield value.path, _too_frequent(scales, given, fastest)
        elif value.measures == STIFFNESS and largest > STIFFEST_FOIL:
            yield value.path, _too_stiff(scales, given)
        elif value.measures == RPM:
            yield from ((value.path, message) for message in _rpm(scales, given, fastest))


def _values(case: Case, table: str) -> Iterator[_Value]:
    """The numbers of a table whose unit can be mistaken."""
    if table == "operation":
        yield _Value((table, "speed"), SPEED, [case.operation.speed])
        yield _Value((table, "speed_rpm"), RPM, [case.operation.speed_rpm])
    elif table == "excitation":
        yield _Value((table, "frequency"), FREQUENCY, [case.excitation.frequency])
    elif table == "linearize":
        yield _Value((table, "speed_range"), SPEED, case.linearize.speed_range)
    elif table == "criticals":
        yield _Value((table, "speed_range"), SPEED, case.criticals.speed_range)
    elif table == "unbalance_response":
        yield _Value((table, "speed_range"), SPEED, case.unbalance_response.speed_range)
    elif table in ("continue_cycles", "continue_tori"):
        branch = getattr(case, table)
        yield _Value((table, "range"), branch.parameter, branch.range)
        yield _Value((table, "start"), branch.parameter, [branch.start])
    elif table == "track_curves":
        plane = zip(case.track_curves.parameters, case.track_curves.ranges, strict=True)
        for index, (parameter, interval) in enumerate(plane):
            yield _Value((table, "ranges", index), parameter, interval)
    elif table == "survey" and case.survey.ranges is not None:
        plane = zip(case.track_curves.parameters, case.survey.ranges, strict=True)
        for index, (parameter, interval) in enumerate(plane):
            yield _Value((table, "ranges", index), parameter, interval)
    elif table == "unbalance" and case.unbalance is not None:
        yield _Value((table, "rated_speed"), SPEED, [case.unbalance.rated_speed])
        yield _Value((table, "rated_speed_rpm"), RPM, [case.unbalance.rated_speed_rpm])
    elif table == "transient":
        measures = SPEED if case.transient.units == "dimensionless" else RPM
        yield _Value((table, "speeds"), measures, case.transient.speeds)
    elif table == "calibrate":
        yield from _calibration_values(case)


def _calibration_values(case: Case) -> Iterator[_Value]:
    settings = case.calibrate
    assert settings is not None
    yield _Value(("calibrate", "speed_range"), SPEED, settings.speed_range)
    for index, target in enumerate(settings.targets):
        at: Path = ("calibrate", "targets", index)
        if target.quantity not in NO_SPEEDS:
            yield _Value((*at, "value"), SPEED, [target.value])
        elif target.quantity == "corner_frequency":
            yield _Value((*at, "value"), FREQUENCY, [target.value])
        yield _Value((*at, "value_rpm"), RPM, [target.value_rpm])
        yield _Value((*at, "speed_range"), SPEED, target.speed_range or ())
        yield _Value((*at, "speeds"), SPEED, target.speeds or ())
        yield _Value((*at, "frequency_range"), FREQUENCY, target.frequency_range or ())


def _too_fast(scales: Scales, given: Sequence[float], fastest: float) -> str:
    """The message for rpm given as a dimensionless speed."""
    meant = _shown([scales.speed_from_rpm(number) for number in given], 4)
    return (
        f"a dimensionless speed, Omega t0 with t0 = {scales.time:.3g} s: {_shown(given[-1:])} would be "
        f"{scales.speed_rpm(given[-1]):.3g} rpm, and above {fastest:.4g} the journal's surface exceeds "
        f"{FASTEST_SURFACE:g} m/s; {_shown(given)} rpm {_are(given)} {meant}"
    )


def _too_frequent(scales: Scales, given: Sequence[float], fastest: float) -> str:
    """The message for Hz given as a dimensionless frequency."""
    meant = _shown([scales.from_hertz(number) for number in given], 4)
    return (
        f"a dimensionless frequency, omega t0 with t0 = {scales.time:.3g} s: {_shown(given[-1:])} would be "
        f"{scales.hertz(given[-1]):.3g} Hz, and above {fastest:.4g} the ring would swing faster than any "
        f"journal turns; {_shown(given)} Hz {_are(given)} {meant}"
    )


def _too_stiff(scales: Scales, given: Sequence[float]) -> str:
    """The message for an areal stiffness given as a dimensionless stiffness."""
    meant = _shown([number * scales.displacement / scales.pressure for number in given], 4)
    return (
        f"a dimensionless stiffness, k c/p0: above {STIFFEST_FOIL:g} a foil is rigid; {_shown(given)} N/m3 "
        f"{_are(given)} {meant}"
    )


def _rpm(scales: Scales, given: Sequence[float], fastest: float) -> Iterator[str]:
    """The message for rpm that no shaft survives, or a dimensionless speed given as rpm."""
    largest, smallest = max(given), min(given)
    if scales.speed_from_rpm(largest) > fastest:
        most = scales.speed_rpm(fastest)
        yield f"above {most:.4g} rpm the journal's surface exceeds {FASTEST_SURFACE:g} m/s"
    elif smallest < SLOWEST_SPEED and scales.speed_from_rpm(smallest) < SLOWEST_FILM:
        meant = _shown([scales.speed_rpm(number) for number in given], 4)
        yield (
            f"in rpm: at {smallest:g} rpm no gas film carries; the dimensionless {_shown(given)} "
            f"{_are(given)} {meant} rpm"
        )


def _are(given: Sequence[float]) -> str:
    return "are" if len(given) > 1 else "is"


def _shown(numbers: Sequence[float], digits: int = 9) -> str:
    """A number, or the first few of several."""
    words = [f"{number:.{digits}g}" for number in numbers[:4]] + ["..."] * (len(numbers) > 4)
    return words[0] if len(numbers) == 1 else f"[{', '.join(words)}]"
