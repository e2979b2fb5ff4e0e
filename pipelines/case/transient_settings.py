"""Tables of the rotor's unbalance and of transients."""

from __future__ import annotations

import math
import re
from collections.abc import Iterator, Sequence
from itertools import pairwise
from typing import Literal

from pydantic import ValidationInfo, field_validator

from pipelines.case.bearings import Bearing, Excitation
from pipelines.case.fields import (
    RATED_SPEED,
    Inconsistency,
    InconsistentError,
    Number,
    Table,
    Units,
    UnitsTable,
    choice,
    converted,
    given,
    quantity,
    require_one,
    table,
)
from pipelines.case.rotor import Rotor, off_shaft
from pipelines.case.scales import RPM_PER_RADIAN_PER_SECOND, Scales

MOST_KNOTS = 10_000
EQUILIBRIUM = "equilibrium"
_START = r"equilibrium|(cycles/b|transient/t)[0-9]{3}"
_GRAM_MILLIMETRE = 1e-6  # kg m
_MILLIMETRE = 1e-3  # m


class UnbalancePlane(Table):
    """A plane of the rotor with unbalance."""

    node: int = quantity(
        "node of the plane; any node of the shaft", "", at_least=0, because="nodes are numbered from 0"
    )
    moment: float | None = quantity(
        "unbalance of the plane; left out with a grade, which is split equally over the planes",
        "g mm",
        None,
        at_least=0,
        because="give the phase pi for the opposite side",
    )
    phase: float = quantity(
        "angular position of the unbalance on the rotor",
        "rad",
        0.0,
        at_least=-2 * math.pi,
        at_most=2 * math.pi,
        because="an angle in rad, not in degrees",
    )


class Unbalance(UnitsTable):
    """Planes with moments, or a grade G (ISO 21940-11): U = G m/Omega_rated with the rotor's mass m."""

    grade: float | None = quantity(
        "balance quality grade G; needs the rated speed",
        "mm/s",
        None,
        above=0,
        at_most=4000,
        because="grades of ISO 21940-11 range from G 0.4 to G 4000",
    )
    rated_speed: float | None = quantity(
        "speed for which the grade holds",
        default=None,
        above=0,
        because="U = G m/Omega_rated",
        measures="speed",
        si_key="rated_speed_rpm",
    )
    rated_speed_rpm: float | None = quantity(
        "speed in rpm for which the grade holds, whatever the units",
        "rpm",
        None,
        above=0,
        because="U = G m/Omega_rated",
    )
    planes: tuple[UnbalancePlane, ...] = table(
        "planes; with a grade and none given, the bearings' nodes in phase", (), max_length=500
    )

    @field_validator("rated_speed_rpm")
    @classmethod
    def _rated(cls, value: float | None, info: ValidationInfo) -> float | None:
        if "grade" not in info.data:
            return value
        if info.data["grade"] is not None:
            require_one(info, value, RATED_SPEED, "the speed for which the grade holds")
        elif value is not None or given(info, ("rated_speed",)):
            raise InconsistentError("belongs to a grade: give grade too, or leave the rated speed out")
        return value

    @field_validator("planes")
    @classmethod
    def _moments(cls, planes: tuple[UnbalancePlane, ...], info: ValidationInfo) -> tuple[UnbalancePlane, ...]:
        if "grade" not in info.data:
            return planes
        graded = info.data["grade"] is not None
        problems: list[str | Inconsistency] = []
        for index, plane in enumerate(planes):
            if graded and plane.moment is not None:
                problems.append(
                    ((index, "moment"), "the grade gives the moments: leave out moment, or grade")
                )
            if not graded and plane.moment is None:
                problems.append(
                    ((index, "moment"), "is missing: give the unbalance in g mm, or a grade for all")
                )
        if not graded and not planes:
            problems.append("needs at least one plane, or a grade")
        if problems:
            raise InconsistentError(*problems)
        return planes

    def moments(self, rotor: Rotor, bearings: Sequence[Bearing]) -> tuple[tuple[int, float, float], ...]:
        """Node, U [kg m] and phase [rad] of every plane."""
        if self.grade is None:
            return tuple(
                (plane.node, _GRAM_MILLIMETRE * (plane.moment or 0.0), plane.phase) for plane in self.planes
            )
        planes = self.planes or tuple(UnbalancePlane(node=bearing.node) for bearing in bearings)
        share = self.grade * _MILLIMETRE * rotor.mass / len(planes)
        return tuple((plane.node, share, plane.phase) for plane in planes)


def unbalance_moments(
    unbalance: Unbalance | None, rotor: Rotor, bearings: Sequence[Bearing], scales: Scales
) -> tuple[tuple[int, float, float], ...]:
    """Node, U [kg m] and phase [rad] of every plane of a case; none without a table.

    U = G m/Omega_rated, split equally over the planes, where a grade is given.
    """
    if unbalance is None:
        return ()
    planes = unbalance.moments(rotor, bearings)
    if unbalance.grade is None:
        return planes
    if unbalance.rated_speed is not None:
        rated = unbalance.rated_speed / scales.time
    else:
        assert unbalance.rated_speed_rpm is not None  # the table's own check
        rated = unbalance.rated_speed_rpm / RPM_PER_RADIAN_PER_SECOND
    return tuple((node, share / rated, phase) for node, share, phase in planes)


class Transient(Table):
    """Time integration, with the table [unbalance] if given."""

    start: str = quantity(
        "`equilibrium`, a branch of cycles of the same case such as `cycles/b000`, or an earlier run such as "
        "`transient/t000`",
        "",
        EQUILIBRIUM,
        because="a run starts from a state of the same case",
    )
    start_row: int | None = quantity(
        "row of the branch, or checkpoint of the run, counted from 0; default: the last one",
        "",
        None,
        at_least=0,
        because="rows are counted from 0",
    )
    units: Units = choice(
        "units of this table: `dimensionless`, or `si` for s and rpm; default: those of the file",
        "dimensionless",
    )
    duration: float = quantity(
        "duration of the run", default=500.0, above=0, because="time runs on", measures="time"
    )
    times: tuple[Number, ...] = table(
        "times of the table of speeds, from 0; the speed is linear in between and stays after the last",
        (),
        measures="time",
        max_length=MOST_KNOTS,
    )
    speeds: tuple[Number, ...] = table(
        "speeds at these times; default: constant, that of the start state (operation.speed at equilibrium)",
        (),
        measures="speed",
        max_length=MOST_KNOTS,
    )
    angle: float = quantity(
        "rotation angle at the start, from an equilibrium or a cycle; an earlier run sets its own angle",
        "rad",
        0.0,
    )
    excitation: Literal["on", "off", "switch_on", "switch_off"] = choice(
        "the rings: `on` and `off` all the time, or switched at switch_time", "on"
    )
    switch_time: float | None = quantity(
        "when the switching of the excitation begins",
        default=None,
        at_least=0,
        because="time starts at 0",
        measures="time",
    )
    switch_ramp: float | None = quantity(
        "how long the switching takes (a smooth step); default: one excitation period",
        default=None,
        above=0,
        because="a ring that jumps would strike the film",
        measures="time",
    )
    tolerance: float = quantity(
        "largest error of the state from the time steps, after the first reference period",
        "1",
        1e-6,
        above=0,
        at_most=1e-1,
        because="steps are chosen by it",
    )
    steps_per_period: int | None = quantity(
        "time steps per reference period: that of the rings, or of the fastest rotation where they rest; "
        "default: from tolerance",
        "",
        None,
        at_least=8,
        at_most=1_000_000,
        because="a period needs steps to be resolved",
    )
    samples_per_period: float = quantity(
        "stored samples per reference period; below 1 one sample in several periods",
        "1",
        64.0,
        above=0,
        at_most=100_000,
        because="a run stores something",
    )
    checkpoint_samples: int = quantity(
        "samples between two stored full states, which are also committed together",
        "",
        512,
        at_least=1,
        at_most=8192,
        because="what is not yet committed is held in memory and lost when the run is killed",
    )
    minimum_film: float = quantity(
        "the run ends where a film becomes thinner than this part of its clearance",
        "1",
        0.01,
        above=0,
        below=1,
        because="below it the journal touches the foil and the film equation no longer describes it",
    )

    _units = field_validator("units")(converted)

    @field_validator("start")
    @classmethod
    def _known_start(cls, value: str) -> str:
        if not re.fullmatch(_START, value):
            raise InconsistentError(
                "must be equilibrium, or a group of the same case: cycles/b000, ..., transient/t000, ..."
            )
        return value

    @field_validator("angle")
    @classmethod
    def _own_angle(cls, value: float, info: ValidationInfo) -> float:
        if value != 0.0 and str(info.data.get("start", "")).startswith("transient"):
            raise InconsistentError("must be left out: the earlier run sets the angle")
        return value

    @field_validator("start_row")
    @classmethod
    def _row_of_a_branch(cls, value: int | None, info: ValidationInfo) -> int | None:
        if value is not None and info.data.get("start") == EQUILIBRIUM:
            raise InconsistentError('has no meaning for start = "equilibrium": name a branch or a run there')
        return value

    @field_validator("times")
    @classmethod
    def _rising(cls, times: tuple[float, ...]) -> tuple[float, ...]:
        problems: list[str | Inconsistency] = []
        if times and times[0] != 0.0:
            problems.append(((0,), "must be 0: the table begins with the run"))
        for index, (before, after) in enumerate(pairwise(times), start=1):
            if after < 0.0:
                problems.append(((index,), "must not be negative: time starts at 0"))
            elif after <= before:
                why = "the speed cannot jump" if after == before else "time runs on"
                problems.append(((index,), f"must be above the time before it, {before:g}: {why}"))
        if problems:
            raise InconsistentError(*problems)
        return times

    @field_validator("speeds")
    @classmethod
    def _positive(cls, speeds: tuple[float, ...], info: ValidationInfo) -> tuple[float, ...]:
        problems: list[str | Inconsistency] = [
            ((index,), "must be > 0: the film carries by rotation, and a run cannot pass through standstill")
            for index, speed in enumerate(speeds)
            if speed <= 0.0
        ]
        if "times" in info.data and len(info.data["times"]) != len(speeds):
            count = len(info.data["times"])
            problems.append(f"has {len(speeds)} values for {count} times: one speed belongs to each time")
        if problems:
            raise InconsistentError(*problems)
        return speeds

    @field_validator("switch_time")
    @classmethod
    def _switched(cls, value: float | None, info: ValidationInfo) -> float | None:
        mode = str(info.data.get("excitation", "on"))
        if mode.startswith("switch") and value is None:
            raise InconsistentError(f'is missing: excitation = "{mode}" happens at a time')
        if not mode.startswith("switch") and value is not None:
            raise InconsistentError(
                f'has no meaning for excitation = "{mode}": choose switch_on or switch_off, or leave it out'
            )
        if value is not None and value >= info.data.get("duration", math.inf):
            raise InconsistentError("must lie before the end of the run (duration)")
        return value


def unbalance_on_shaft(unbalance: Unbalance | None, info: ValidationInfo) -> Unbalance | None:
    """Check that every plane of the unbalance lies on the shaft."""
    rotor: Rotor | None = info.data.get("rotor")
    if unbalance is None or rotor is None:
        return unbalance
    problems = [
        (("planes", index, "node"), off_shaft(plane.node, rotor.node_count - 1))
        for index, plane in enumerate(unbalance.planes)
        if plane.node >= rotor.node_count
    ]
    if problems:
        raise InconsistentError(*problems)
    return unbalance


def transient_inconsistencies(stage: Transient, excitation: Excitation) -> Iterator[Inconsistency]:
    """Why a transient is impossible with the case's excitation."""
    if stage.excitation.startswith("switch") and 0 in (excitation.displacement, excitation.load):
        yield ("excitation",), "there is nothing to switch: excitation.displacement is 0"
