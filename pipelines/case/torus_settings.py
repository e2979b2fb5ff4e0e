"""Table of the tori: where branches of quasi-periodic orbits start and how they are continued."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Literal

from pydantic import field_validator

from pipelines.case.bearings import Excitation
from pipelines.case.fields import (
    Inconsistency,
    InconsistentError,
    Number,
    Parameter,
    UnitsTable,
    arclength_step,
    choice,
    inside_range,
    most_points,
    parameter_range,
    quantity,
    steps_in_order,
    table,
)
from pipelines.case.transient_settings import Unbalance

FEWEST_ANGLES = 15


class ContinueTori(UnitsTable):
    """Continuation of quasi-periodic orbits in one parameter."""

    origin: Literal["neimark_sacker", "unbalance"] = choice(
        "`neimark_sacker`: the tori born at every Neimark-Sacker point of a branch of cycles; `unbalance`: "
        "the motion of the rotor with the table [unbalance], with the frequencies of rings and rotor",
        "neimark_sacker",
    )
    branch: str = quantity(
        "branch whose Neimark-Sacker points tori are born at: `cycles/b000`, or a period-doubled one such as "
        "`cycles/d000`",
        "",
        "cycles/b000",
        pattern=r"^cycles/[bd][0-9]{3}$",
        because="it is one of those that `agfb continue-cycles` writes",
    )
    parameter: Parameter = choice(
        "parameter that is continued; `foil_stiffness` scales both foils together", "speed"
    )
    range: tuple[Number, Number] = table(
        "values of the parameter between which tori are followed", (0.2, 1.6), measured_by="parameter"
    )
    start: float | None = quantity(
        "value of the parameter where a branch with unbalance starts; default: the case's own value",
        default=None,
        measured_by="parameter",
    )
    direction: Literal["up", "down", "both"] = choice(
        "direction of the parameter at the start with unbalance; a torus leaves its Neimark-Sacker point on "
        "the side where it exists",
        "up",
    )
    amplitude: float = quantity(
        "size of the first torus beside its Neimark-Sacker point (largest state component)",
        "1",
        0.01,
        above=0,
        below=1,
        because="a torus of no size is the cycle",
    )
    step: float = arclength_step("first arclength step", 0.01)
    minimum_step: float = arclength_step("the branch ends when a step would be shorter", 1e-4)
    maximum_step: float = arclength_step("longest arclength step", 0.05)
    max_points: int = most_points("a branch ends after this many points", 100)
    tolerance: float = quantity(
        "largest error of the Fourier series of an invariant curve, largest state component",
        "1",
        1e-6,
        above=0,
        at_most=1e-2,
        because="it determines the number of angles; the clipped film is not analytic, so that each "
        "further digit is more expensive",
    )
    max_angles: int = quantity(
        f"maximum number of angles along an invariant curve, odd; raised from {FEWEST_ANGLES} as 2 M + 1 "
        "where the tolerance requires it",
        "",
        127,
        at_least=FEWEST_ANGLES,
        at_most=1023,
        because="the cost of a torus grows with their number",
    )

    @field_validator("max_angles")
    @classmethod
    def _odd(cls, value: int) -> int:
        if value % 2 == 0:
            raise InconsistentError("must be odd: an even number has a wave that a shift does not keep")
        return value

    _range = field_validator("range")(parameter_range)
    _start = field_validator("start")(inside_range)
    _steps = field_validator("maximum_step")(steps_in_order)


def torus_inconsistencies(
    stage: ContinueTori, excitation: Excitation, formulation: str, unbalance: Unbalance | None
) -> Iterator[Inconsistency]:
    """Why tori of this case are impossible; ``formulation``: of its cycles."""
    if stage.origin == "unbalance" and unbalance is None:
        yield ("origin",), "needs the table [unbalance], which says where the rotor is out of balance"
    if excitation.frequency is None and excitation.frequency_hz is None:
        yield (
            ("origin",),
            "tori are invariant curves of the map over an excitation period: give excitation.frequency",
        )
    elif stage.origin == "neimark_sacker" and formulation == "autonomous":
        yield (
            ("origin",),
            'tori are born at cycles of known period: set continue_cycles.formulation = "stroboscopic"',
        )
