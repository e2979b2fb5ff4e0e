"""Tables of the operating point, the numerics and the stages."""

from __future__ import annotations

from typing import Literal

from pydantic import ValidationInfo, field_validator

from pipelines.case.fields import (
    SPEED,
    InconsistentError,
    Number,
    Parameter,
    Table,
    UnitsTable,
    arclength_step,
    choice,
    inside_range,
    most_points,
    parameter_range,
    positive_range,
    quantity,
    require_one,
    steps_in_order,
    table,
)
from pipelines.case.rotor import NodeNumber


class Operation(UnitsTable):
    """The operating point; exactly one of `speed` and `speed_rpm`."""

    speed: float | None = quantity(
        "rotating speed; dimensionless Omega (the bearing number of the first bearing)",
        default=None,
        above=0,
        because="the film carries by rotation",
        measures="speed",
        si_key="speed_rpm",
    )
    speed_rpm: float | None = quantity(
        "rotating speed in rpm, whatever the units",
        "rpm",
        None,
        above=0,
        because="the film carries by rotation",
    )

    @field_validator("speed_rpm")
    @classmethod
    def _one_speed(cls, value: float | None, info: ValidationInfo) -> float | None:
        require_one(info, value, SPEED, "the rotating speed")
        return value


class Numerics(Table):
    """Grid, schemes and tolerances."""

    circumferential: int = quantity(
        "circumferential intervals of the film grid",
        "",
        32,
        at_least=8,
        at_most=1024,
        because="fewer do not resolve the pressure wave, more do not fit in memory",
    )
    axial: int = quantity(
        "axial unknowns on the half film",
        "",
        4,
        at_least=1,
        at_most=32,
        because="Chebyshev collocation converges with 2 to 4; stiffness grows like its fourth power",
    )
    scheme: Literal["central", "backward", "fourth_order"] = choice(
        "differences along the circumference: `fourth_order`, `central` of second order, or the paper's "
        "`backward` convection of first order",
        "fourth_order",
    )
    axial_scheme: Literal["chebyshev", "uniform"] = choice(
        "`chebyshev` collocation or the paper's `uniform` differences", "chebyshev"
    )
    stepper: Literal["esdirk5", "rk4", "butcher6", "dopri8"] = choice(
        "Runge-Kutta method of the period map: `esdirk5` implicit; explicit ones for comparison: `rk4` the "
        "classical one, `butcher6`, `dopri8`",
        "esdirk5",
    )
    multiplier_tolerance: float = quantity(
        "largest error of the Floquet multipliers from the time steps of `esdirk5`",
        "1",
        1e-6,
        above=0,
        at_most=1e-1,
        because="steps are chosen by it",
    )
    steps_per_period: int | None = quantity(
        "time steps per excitation period; default: from multiplier_tolerance, or from stability if explicit",
        "",
        None,
        at_least=8,
        at_most=10_000_000,
        because="a period needs steps to be resolved",
    )
    newton_tolerance: float = quantity(
        "tolerance of Newton's method on the dimensionless residual",
        "1",
        1e-10,
        above=0,
        at_most=1e-3,
        because="events are located far below it otherwise",
    )
    newton_iterations: int = quantity(
        "maximum number of Newton iterations per point",
        "",
        12,
        at_least=1,
        at_most=1000,
        because="one iteration is the least",
    )
    multiplier_cut: float = quantity(
        "Floquet multipliers above this modulus are kept in the slow subspace",
        "1",
        1e-3,
        above=0,
        below=1,
        because="multipliers near the unit circle must be inside, decayed ones outside",
    )
    event_tolerance: float = quantity(
        "tolerance of located bifurcations in the parameter",
        "1",
        1e-8,
        above=0,
        at_most=1e-2,
        because="a bracket is halved until it is this narrow",
    )
    max_columns: int = quantity(
        "maximum number of columns of the slow subspace",
        "",
        64,
        at_least=2,
        at_most=4096,
        because="a pair of multipliers needs two columns",
    )


class Linearize(UnitsTable):
    """Equilibria and eigenvalues along the speed."""

    speed_range: tuple[Number, Number] = table("speeds from, to", (0.2, 1.6), measures="speed")
    points: int = quantity(
        "number of speeds; a failure if more than a tenth of them has no equilibrium",
        "",
        41,
        at_least=2,
        at_most=100_000,
        because="a range has two ends",
    )
    whirl_ratios: tuple[Number, ...] = table(
        "whirl frequency / rotating speed at which bearing stiffness and damping are given",
        (0.5, 1.0),
        unit="1",
        min_length=1,
        max_length=1000,
    )
    ring: Literal["mean", "undeformed"] = choice(
        "`mean`: rings at rest in their mean position; `undeformed`: the passive machine", "mean"
    )
    eigenvalues: int = quantity(
        "number of leading eigenvalues", "", 12, at_least=1, at_most=500, because="one is the least"
    )

    @field_validator("speed_range")
    @classmethod
    def _range(cls, value: tuple[float, float]) -> tuple[float, float]:
        return positive_range(value, "the film carries by rotation")

    @field_validator("whirl_ratios")
    @classmethod
    def _positive(cls, value: tuple[float, ...]) -> tuple[float, ...]:
        if min(value) <= 0:
            raise InconsistentError(
                "must be positive: damping is the quadrature part over the whirl frequency"
            )
        return value


class Coefficients(UnitsTable):
    """Stiffness and damping of the bearings over the rotating speed and the whirl frequency."""

    speed_range: tuple[Number, Number] | None = table(
        "speeds from, to; default: `linearize.speed_range`", None, measures="speed"
    )
    points: int = quantity(
        "number of speeds; a failure if more than a tenth of them has no equilibrium",
        "",
        21,
        at_least=2,
        at_most=100_000,
        because="a range has two ends",
    )
    frequency_range: tuple[Number, Number] | None = table(
        "whirl frequencies from, to; default: from 0, where damping is the limit for slow "
        "motions, to the highest speed",
        None,
        measures="frequency",
    )
    frequencies: int = quantity(
        "number of whirl frequencies", "", 31, at_least=2, at_most=10_000, because="a range has two ends"
    )
    ring: Literal["mean", "undeformed"] = choice(
        "`mean`: rings at rest in their mean position; `undeformed`: the passive machine", "mean"
    )

    @field_validator("speed_range")
    @classmethod
    def _range(cls, value: tuple[float, float] | None) -> tuple[float, float] | None:
        return None if value is None else positive_range(value, "the film carries by rotation")

    @field_validator("frequency_range")
    @classmethod
    def _frequencies(cls, value: tuple[float, float] | None) -> tuple[float, float] | None:
        if value is not None and not 0.0 <= value[0] < value[1]:
            raise InconsistentError("must rise from 0 or a positive frequency")
        return value


class Criticals(UnitsTable):
    """Critical speeds, Campbell diagram and the table of parametric resonances."""

    speed_range: tuple[Number, Number] = table("speeds from, to", (0.1, 2.0), measures="speed")
    points: int = quantity(
        "number of speeds, more are inserted where modes come close; a failure if more than a tenth of them "
        "has no equilibrium",
        "",
        41,
        at_least=2,
        at_most=100_000,
        because="a range has two ends",
    )
    max_damping_ratio: float = quantity(
        "modes damped more than this, or than 0.9, are no critical speeds",
        "1",
        0.5,
        above=0,
        at_most=1,
        because="a damping ratio of 1 no longer oscillates",
    )
    orders: int = quantity(
        "largest order n of the resonances 2 Omega_j/n and |Omega_j +- Omega_k|/n",
        "",
        3,
        at_least=1,
        at_most=20,
        because="order 1 is the principal resonance",
    )
    unbalance_points: int = quantity(
        "speeds of the unbalance response that compares full and condensed rotor",
        "",
        200,
        at_least=2,
        at_most=100_000,
        because="a range has two ends",
    )

    @field_validator("speed_range")
    @classmethod
    def _range(cls, value: tuple[float, float]) -> tuple[float, float]:
        return positive_range(value, "the film carries by rotation")


class UnbalanceResponse(UnitsTable):
    """Amplitude and phase of the linearised machine under [unbalance], over the speed."""

    speed_range: tuple[Number, Number] = table("speeds from, to", (0.1, 2.0), measures="speed")
    points: int = quantity(
        "number of speeds, more are inserted where the response is curved; a failure if more than a tenth of "
        "them has no equilibrium",
        "",
        61,
        at_least=4,
        at_most=100_000,
        because="a peak is located on a cubic spline",
    )
    probes: tuple[NodeNumber, ...] = table(
        "nodes whose motion is stored and drawn; the bearings' nodes if left out", (), max_length=100
    )

    @field_validator("speed_range")
    @classmethod
    def _range(cls, value: tuple[float, float]) -> tuple[float, float]:
        return positive_range(value, "the film carries by rotation")

    @field_validator("probes")
    @classmethod
    def _once(cls, value: tuple[int, ...]) -> tuple[int, ...]:
        if len(set(value)) < len(value):
            raise InconsistentError("must name each node once")
        return value


class ContinueCycles(UnitsTable):
    """Continuation of limit cycles in one parameter."""

    parameter: Parameter = choice(
        "parameter that is continued; `foil_stiffness` scales both foils together", "speed"
    )
    range: tuple[Number, Number] = table(
        "values of the parameter between which the branch is followed", (0.2, 1.6), measured_by="parameter"
    )
    start: float | None = quantity(
        "value of the parameter where the branch starts; default: the case's own value",
        default=None,
        measured_by="parameter",
    )
    formulation: Literal["stroboscopic", "autonomous"] = choice(
        "`stroboscopic`: period map of the forced system; `autonomous`: unknown period with an integral "
        "phase condition (needed for self-excited whirl, displacement 0)",
        "stroboscopic",
    )
    step: float = arclength_step("first arclength step", 0.02)
    minimum_step: float = arclength_step("the branch ends when a step would be shorter", 1e-5)
    maximum_step: float = arclength_step("longest arclength step", 0.05)
    max_points: int = most_points("the branch ends after this many points", 200)
    minimum_film: float = quantity(
        "the branch ends where a film becomes thinner than this part of its clearance",
        "1",
        0.01,
        above=0,
        below=1,
        because="below it the journal touches the foil and the film equation no longer describes it",
    )
    amplitude: float = quantity(
        "size of the first self-excited cycle beside its Hopf point (largest state component)",
        "1",
        0.01,
        above=0,
        below=1,
        because="a cycle of no size is the equilibrium",
    )
    doublings: int = quantity(
        "how often branches of doubled cycles are followed: 1 for twice the period, 2 for four times, ...",
        "",
        0,
        at_least=0,
        at_most=5,
        because="every doubling doubles the cost of a point",
    )
    direction: Literal["up", "down", "both"] = choice(
        "direction of the parameter at the start; self-excited whirl leaves its Hopf point where it can", "up"
    )

    _range = field_validator("range")(parameter_range)
    _start = field_validator("start")(inside_range)
    _steps = field_validator("maximum_step")(steps_in_order)
