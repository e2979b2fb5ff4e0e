"""Speeds of a range without equilibrium: how the stages over this range report them."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from pipelines.case.units import Scale
from pipelines.stages.results import Scalar

# A stage fails where more than this share of its speeds has no equilibrium.
LARGEST_SHARE = 0.1
NAMED = 6  # speeds that a message names

ATTRIBUTE = "speeds_without_equilibrium"
ALL_COMPUTED = "all speeds are computed"
SOME_MISSING = "some speeds have no equilibrium"
MANY_MISSING = "too many speeds have no equilibrium"
NO_EQUILIBRIUM = "no speed of the range has an equilibrium"
SUCCESSFUL = frozenset({ALL_COMPUTED, SOME_MISSING})


def entry(speed: float, reason: str) -> str:
    """The stored data of a speed without equilibrium."""
    return f"speed {speed:.4g}: {reason}"


def ending(missing: Sequence[str], total: int) -> str:
    """Why a stage ends that found no equilibrium at some speeds, each an ``entry``."""
    if not missing:
        return ALL_COMPUTED
    if len(missing) == total:
        return NO_EQUILIBRIUM
    return SOME_MISSING if len(missing) <= LARGEST_SHARE * total else MANY_MISSING


def named(missing: Sequence[str]) -> str:
    """The speeds, a few of them by value."""
    return _few(_speeds(missing))


def named_in_both(missing: Sequence[str], scales: Mapping[str, float] | None) -> str:
    """The same, in rpm too where the ``scales`` of the case are stored."""
    if scales is None or not missing:
        return named(missing)
    found = summary(missing, {"speed": scales["speed_rpm_per_unit"]})
    return f"{found['without equilibrium']}; {found['without equilibrium [rpm]']} rpm"


def summary(missing: Sequence[str], scale: Scale) -> dict[str, Scalar]:
    """The speeds as part of a summary, in both units."""
    rpm = [f"{float(speed) * scale['speed']:.0f}" for speed in _speeds(missing)]
    return {"without equilibrium": named(missing), "without equilibrium [rpm]": _few(rpm)} if missing else {}


def _speeds(missing: Sequence[str]) -> list[str]:
    return [one.partition(":")[0].removeprefix("speed ") for one in missing]


def _few(speeds: Sequence[str]) -> str:
    more = f" and {len(speeds) - NAMED} more" if len(speeds) > NAMED else ""
    return ", ".join(speeds[:NAMED]) + more


def advice(missing: Sequence[str], total: int) -> str:
    """The speeds, and the reason at the highest."""
    if not missing:
        return ""
    return f"{len(missing)} of {total} speeds have none: {named(missing)}; at {missing[-1]}"
