"""Numbers given in the wrong unit: rpm, Hz or N/m3 where a dimensionless number belongs.

A speed that no shaft survives was not meant. The circumference of a rotating ring bears the stress rho v^2,
so that steel and titanium end at v = sqrt(sigma/rho) = 500 m/s and carbon fibre at 1000 m/s. With twice that
nothing is refused that can be built, and room is left for studies at bearing numbers beyond all machines; a
1000 that means rpm, read as the dimensionless speed of a typical bearing, is 27 km/s. The same angular
velocity bounds the excitation frequency: the ring would have to swing faster than any journal turns.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from typing import Any

from pipelines.case.fields import SI_UNITS, Inconsistency, Path
from pipelines.case.measuring import measured
from pipelines.case.models import Case
from pipelines.case.scales import Scales
from pipelines.case.units import Written

FASTEST_SURFACE = 2000.0  # m/s
STIFFEST_FOIL = 1e6  # a pressure of p0 moves it by a millionth of the clearance
SOFTEST_FOIL = 1e-6  # a pressure of p0 moves it by a million clearances
SLOWEST_SPEED = 10.0  # rpm
SLOWEST_FILM = 1e-3  # dimensionless: a film of this bearing number carries nothing
SLOWEST_RING = 2.5  # Hz
SLOWEST_EXCITATION = 1e-2  # dimensionless: the machine follows such rings as if they were at rest
SMALLEST_STROKE = 1e-4  # of the clearance
HINT = '; for rpm, Hz, s, um and N/m3 write units = "si" in the table or at the top of the file'


def implausible_values(
    case: Case, resolved: Mapping[str, Any], table: str, written: Mapping[Path, Written]
) -> Iterator[Inconsistency]:
    """The values in one of the case's tables that seem to have another unit than their key.

    ``resolved``: the case as plain data; ``written``: what the file has in SI units, by path in the case.
    """
    scales = case.scales
    fastest = FASTEST_SURFACE / max(bearing.radius for bearing in case.bearings) * scales.time
    for each in measured(type(case), resolved, table):
        given = [number for number in each.numbers if number is not None]
        converted = any(each.path[:length] in written for length in range(1, len(each.path) + 1))
        if not given or str(each.path[-1]).endswith("step"):  # an arclength may have any size
            continue
        if converted and not each.in_si:
            given = [scales.si_per_unit[each.quantity] * number for number in given]
        if table == "bearings" and not converted:
            continue  # any stiffness may be studied
        if converted or each.in_si:
            problem = _of_si(scales, each.quantity, given, fastest, converted)
        else:
            problem = _of_dimensionless(scales, each.quantity, given, fastest)
        if problem:
            yield each.path, problem


def _of_dimensionless(scales: Scales, measure: str, given: Sequence[float], fastest: float) -> str:
    """Why dimensionless numbers seem to be SI; "" if they do not."""
    largest = max(given)
    if measure == "speed" and largest > fastest:
        return _too_fast(scales, given, fastest) + HINT
    if measure == "frequency" and largest > fastest:
        return _too_frequent(scales, given, fastest) + HINT
    if measure == "foil_stiffness" and largest > STIFFEST_FOIL:
        return _too_stiff(scales, given) + HINT
    return ""


def _of_si(scales: Scales, measure: str, given: Sequence[float], fastest: float, by_units: bool) -> str:
    """Why numbers in rpm, Hz, um or N/m3 seem to be dimensionless, or impossible; "" if they do not.

    ``by_units``: the unit is that of the table, not that of the key.
    """
    per_unit, unit = scales.si_per_unit[measure], SI_UNITS[measure]
    largest, smallest = max(given) / per_unit, min(given) / per_unit
    if measure == "speed" and largest > fastest:
        return f"above {fastest * per_unit:.4g} rpm the journal's surface exceeds {FASTEST_SURFACE:g} m/s"
    if by_units and measure == "frequency" and largest > fastest:
        return f"above {fastest * per_unit:.4g} Hz the ring would swing faster than any journal turns"
    doubt = {
        "speed": min(given) < SLOWEST_SPEED and smallest < SLOWEST_FILM,
        "frequency": by_units and max(given) < SLOWEST_RING and largest < SLOWEST_EXCITATION,
        "foil_stiffness": by_units and largest < SOFTEST_FOIL,
        "displacement": by_units and 0 < largest < SMALLEST_STROKE,
    }
    why = {
        "speed": f"at {min(given):g} rpm no gas film carries",
        "frequency": f"rings at {max(given):g} Hz are at rest for this machine",
        "foil_stiffness": f"a foil of {max(given):g} N/m3 does not hold the film",
        "displacement": f"{max(given):g} um is nothing to a clearance of {scales.displacement * 1e6:g} um",
    }
    if not doubt.get(measure, False):
        return ""
    meant = _shown([number * per_unit for number in given], 4)
    return f"in {unit}: {why[measure]}; the dimensionless {_shown(given)} {_are(given)} {meant} {unit}"


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


def _are(given: Sequence[float]) -> str:
    return "are" if len(given) > 1 else "is"


def _shown(numbers: Sequence[float], digits: int = 9) -> str:
    """A number, or the first few of several."""
    words = [f"{number:.{digits}g}" for number in numbers[:4]] + ["..."] * (len(numbers) > 4)
    return words[0] if len(numbers) == 1 else f"[{', '.join(words)}]"
