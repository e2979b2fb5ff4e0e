"""Tables of the gas, the foil bearings and the excitation of their rings."""

from __future__ import annotations

import math
from typing import Literal

from pydantic import ValidationInfo, field_validator

from pipelines.case.fields import (
    AMPLITUDE,
    FOIL_STIFFNESS,
    FREQUENCY,
    InconsistentError,
    Number,
    Table,
    UnitsTable,
    choice,
    given,
    quantity,
    require_one,
    table,
)


class Gas(Table):
    """The lubricating gas."""

    viscosity: float = quantity(
        "dynamic viscosity of the gas (isothermal)",
        "Pa s",
        above=0,
        at_most=1,
        because="without viscosity no pressure is generated; air at 20 degC has 1.8e-5 Pa s",
    )
    ambient_pressure: float = quantity(
        "pressure around the bearings",
        "Pa",
        at_least=1.0,
        at_most=1e9,
        because="the film is a compressible gas at ambient pressure; the atmosphere has 101325 Pa",
    )


class Bump(Table):
    """Geometry of the bump foil, from which its stiffness follows (Eq. 6, 7)."""

    pitch: float = quantity(
        "distance from bump to bump, S", "m", at_least=1e-6, at_most=1, because="bumps repeat along the foil"
    )
    half_length: float = quantity(
        "half length of a bump, l", "m", at_least=1e-6, at_most=1, because="a bump has a length"
    )
    thickness: float = quantity(
        "thickness of the bump foil, t", "m", at_least=1e-7, at_most=1, because="a foil has a thickness"
    )
    young_modulus: float = quantity(
        "Young's modulus of the bump foil", "Pa", at_least=1e6, because="SI units are Pa, not GPa"
    )
    poisson_ratio: float = quantity(
        "Poisson's ratio of the bump foil",
        "1",
        above=-1,
        at_most=0.5,
        because="an isotropic material is stable only for -1 < nu <= 1/2",
    )

    @field_validator("half_length")
    @classmethod
    def _within_pitch(cls, value: float, info: ValidationInfo) -> float:
        pitch = info.data.get("pitch")
        if pitch is not None and 2 * value > pitch:
            raise InconsistentError(
                f"must be at most half of pitch = {pitch:g} m: bumps would overlap otherwise"
            )
        return value


class Foil(UnitsTable):
    """The compliant foil: an elastic foundation with damping (Eq. 5-8)."""

    stiffness: float | None = quantity(
        "foil stiffness; dimensionless k_f = k c/p0",
        default=None,
        above=0,
        because="a foil without stiffness does not hold the film; use rigid = true for a plain bearing",
        measures="foil_stiffness",
        si_key="areal_stiffness",
    )
    areal_stiffness: float | None = quantity(
        "foil stiffness per area, k, whatever the units",
        "N/m3",
        None,
        at_least=1e-3,
        because="a foil without stiffness does not hold the film; use rigid = true for a plain bearing",
    )
    bump: Bump | None = table("bump geometry", None)
    rigid: bool = quantity("a plain bearing without foil", "", False)
    loss_factor: float | None = quantity(
        "loss factor eta; not needed for a rigid bearing",
        "1",
        None,
        above=0,
        at_most=1e3,
        because="the foil's rate is (p - k q)/c and c = eta k cannot be zero",
    )
    damping: Literal["proportional", "loss_factor"] = choice(
        "meaning of eta: `proportional` c = eta k (the paper's), `loss_factor` c = eta k/Omega",
        "proportional",
    )
    pressure: Literal["gauge", "absolute"] = choice(
        "pressure that loads the foil: `gauge` p - p0, `absolute` p (adds the constant 1/k_f)", "gauge"
    )

    @field_validator("rigid")
    @classmethod
    def _one_stiffness(cls, value: bool, info: ValidationInfo) -> bool:
        require_one(info, value, FOIL_STIFFNESS, "the stiffness of the foil")
        return value

    @field_validator("loss_factor")
    @classmethod
    def _damped(cls, value: float | None, info: ValidationInfo) -> float | None:
        # without any stiffness, "rigid" is refused and not among the data: both are missing
        unspecified = "rigid" not in info.data and given(info, FOIL_STIFFNESS[:-1]) == []
        if value is None and (info.data.get("rigid") is False or unspecified):
            raise InconsistentError("is missing: the foil's rate is (p - k q)/c and c = eta k cannot be zero")
        return value


class Bearing(Table):
    """One gas foil bearing."""

    node: int = quantity(
        "node of the journal; must be a master node", "", at_least=0, because="nodes are numbered from 0"
    )
    radius: float = quantity("radius R", "m", at_least=1e-5, at_most=10, because="the journal has a radius")
    length: float = quantity(
        "axial length L", "m", at_least=1e-5, at_most=10, because="a bearing without length carries no load"
    )
    clearance: float = quantity("radial clearance c", "m", at_least=1e-7, because="thinner is no gas film")
    film: Literal["edge", "periodic"] = choice(
        "`edge`: ambient pressure along the foil's edge line at edge_angle; `periodic`: uninterrupted film",
        "edge",
    )
    edge_angle: float = quantity(
        "angle theta_0 of the foil's edge line, from +x towards +y; gravity points to 3 pi/2",
        "rad",
        0.0,
        at_least=-2 * math.pi,
        at_most=2 * math.pi,
        because="an angle in rad, not in degrees",
    )
    clipping: Literal["gumbel", "smooth", "full"] = choice(
        "sub-ambient pressure in the gas force: `gumbel` counts it as ambient, `smooth` does so regularised, "
        "`full` keeps it",
        "gumbel",
    )
    smoothing: float = quantity(
        "half width of the regularisation of `smooth` about ambient pressure, relative to it",
        "1",
        0.01,
        above=0,
        at_most=1,
        because="a positive width makes the clipping smooth",
    )
    foil: Foil = table("the compliant foil")

    @field_validator("clearance")
    @classmethod
    def _thin(cls, value: float, info: ValidationInfo) -> float:
        radius = info.data.get("radius")
        if radius is not None and value > 0.05 * radius:
            raise InconsistentError(
                f"must be at most 0.05 x radius = {0.05 * radius:g} m: Reynolds' equation holds "
                "for thin films only"
            )
        return value


class Ring(Table):
    """The active outer ring, loaded by two opposite forces (Appendix)."""

    inner_radius: float = quantity(
        "inner radius", "m", above=0, at_most=100, because="the ring surrounds the bearing"
    )
    thickness: float = quantity(
        "radial thickness", "m", at_least=1e-6, because="a ring without thickness has no stiffness"
    )
    width: float = quantity(
        "axial width", "m", at_least=1e-6, because="a ring without width has no stiffness"
    )
    young_modulus: float = quantity("Young's modulus", "Pa", at_least=1e6, because="SI units are Pa, not GPa")
    poisson_ratio: float = quantity(
        "Poisson's ratio",
        "1",
        above=-1,
        at_most=0.5,
        because="an isotropic material is stable only for -1 < nu <= 1/2",
    )

    @field_validator("thickness")
    @classmethod
    def _curved_beam(cls, value: float, info: ValidationInfo) -> float:
        radius = info.data.get("inner_radius")
        if radius is not None and value > radius:
            raise InconsistentError(
                f"must be at most inner_radius = {radius:g} m: the ring formulas are those of a curved beam"
            )
        return value


class Excitation(UnitsTable):
    """The harmonic deformation of the rings; the same frequency in both bearings."""

    displacement: float | None = quantity(
        "largest vertical displacement delta of the ring; dimensionless: / clearance of its bearing, in SI "
        "units that of the first bearing's ring; 0 is the passive bearing",
        default=None,
        at_least=0,
        below=1,
        because="a displacement of a whole clearance closes the film",
        measures="displacement",
    )
    load: float | None = quantity(
        "peak load F0 on the ring instead of displacement; needs [excitation.ring]",
        "N",
        None,
        at_least=0,
        because="the load presses the ring together",
    )
    frequency: float | None = quantity(
        "excitation frequency Omega_ex; may be left out without excitation (displacement 0)",
        default=None,
        above=0,
        because="the period is 2 pi/Omega_ex",
        measures="frequency",
        si_key="frequency_hz",
    )
    frequency_hz: float | None = quantity(
        "excitation frequency in Hz, whatever the units",
        "Hz",
        None,
        above=0,
        because="the period is 1/frequency",
    )
    ratio: float | None = quantity(
        "ratio rho = |d_h/d_v| of the ring's displacements; default: from ring, or that of a thin ring",
        "1",
        None,
        at_least=0,
        at_most=10,
        because="the ring widens sideways when it is pressed together",
    )
    ring: Ring | None = table("geometry of the ring", None)
    amplitudes: tuple[Number, Number] = table(
        "factor on the displacement of each bearing", (1.0, 1.0), unit="1"
    )
    phases: tuple[Number, Number] = table("phase of each bearing's ring", (0.0, 0.0), unit="rad")

    @field_validator("load")
    @classmethod
    def _one_amplitude(cls, value: float | None, info: ValidationInfo) -> float | None:
        require_one(info, value, AMPLITUDE, "the amplitude of the ring")
        return value

    @field_validator("frequency_hz")
    @classmethod
    def _one_frequency(cls, value: float | None, info: ValidationInfo) -> float | None:
        passive = info.data.get("displacement") == 0
        if not (passive and value is None and given(info, ("frequency",)) == []):
            require_one(info, value, FREQUENCY, "the excitation frequency")
        return value

    @field_validator("ring")
    @classmethod
    def _ring(cls, value: Ring | None, info: ValidationInfo) -> Ring | None:
        if value is None and info.data.get("load") is not None:
            raise InconsistentError(
                "is missing: the load F0 needs the ring's geometry to become a displacement"
            )
        if value is not None and info.data.get("ratio") is not None:
            raise InconsistentError("gives the ratio |d_h/d_v| already: give either ratio or ring")
        return value

    @field_validator("amplitudes")
    @classmethod
    def _open_film(cls, value: tuple[float, float], info: ValidationInfo) -> tuple[float, float]:
        if min(value) < 0:
            raise InconsistentError("must not be negative: give the phase pi for opposite motion")
        displacement = info.data.get("displacement") or 0.0
        if max(value) * displacement >= 1:
            raise InconsistentError(
                f"times displacement = {displacement:g} must stay below 1: the ring closes the film otherwise"
            )
        return value

    @field_validator("phases")
    @classmethod
    def _radians(cls, value: tuple[float, float]) -> tuple[float, float]:
        if max(abs(value[0]), abs(value[1])) > 2 * math.pi:
            raise InconsistentError("must lie within -2 pi and 2 pi: an angle in rad, not in degrees")
        return value
