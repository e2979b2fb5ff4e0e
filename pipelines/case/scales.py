"""Scales between SI units and the dimensionless variables of the computation.

The first bearing sets the scales of the whole machine:

    tau = t/t0,  t0 = 6 mu R^2/(p0 c^2),  Omega_bar = Omega t0 (the bearing number),  h_bar = h/c,
    F_bar = F/(p0 R L),  M_bar = m c/(p0 R L t0^2),  k_bar = k c/p0 (k: areal foil stiffness),  kappa = R/L.

The second bearing enters through its ratios to the first (`BearingScales`).
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Self

from pipelines.case.bearings import Bearing, Bump, Excitation, Foil, Gas
from pipelines.case.ring_statics import ring_displacement_from_load
from pipelines.case.settings import Operation

PARAMETERS = ("speed", "excitation_frequency", "displacement", "foil_stiffness")
"""Names of the continuation parameters, in the order of every parameter vector (all dimensionless)."""

RPM_PER_RADIAN_PER_SECOND = 60 / (2 * math.pi)


def film_time(viscosity: float, ambient_pressure: float, radius: float, clearance: float) -> float:
    """Time scale of a gas film, t0 = 6 mu R^2/(p0 c^2) [s]; all arguments SI."""
    return 6 * viscosity * radius**2 / (ambient_pressure * clearance**2)


def si_per_unit(time: float, clearance: float, ambient_pressure: float) -> dict[str, float]:
    """What a dimensionless number 1 is in the unit of each quantity of `SI_UNITS`; all arguments SI.

    rpm, Hz, s, um, N/m3: 60/(2 pi t0), 1/(2 pi t0), t0, 1e6 c, p0/c
    """
    return {
        "speed": RPM_PER_RADIAN_PER_SECOND / time,
        "frequency": 1 / (2 * math.pi * time),
        "time": time,
        "displacement": 1e6 * clearance,
        "foil_stiffness": ambient_pressure / clearance,
    }


def bump_stiffness(bump: Bump, ambient_pressure: float, clearance: float) -> float:
    """Dimensionless foil stiffness from bump geometry (Eq. 6, 7; the print lost the cube).

    k_bar = 1/alpha,  alpha = (2 p0 S/(c E)) (l/t)^3 (1 - nu^2)
    """
    slenderness = bump.half_length / bump.thickness
    compliance = (
        2
        * ambient_pressure
        * bump.pitch
        / (clearance * bump.young_modulus)
        * slenderness**3
        * (1 - bump.poisson_ratio**2)
    )
    return 1 / compliance


def foil_stiffness(foil: Foil, ambient_pressure: float, clearance: float) -> float:
    """Dimensionless foil stiffness k_bar = k c/p0 of a foil however it is given; inf for a rigid bearing."""
    if foil.stiffness is not None:
        return foil.stiffness
    if foil.areal_stiffness is not None:
        return foil.areal_stiffness * clearance / ambient_pressure
    if foil.bump is not None:
        return bump_stiffness(foil.bump, ambient_pressure, clearance)
    return math.inf


@dataclass(frozen=True)
class BearingScales:
    """One bearing's own scales, absolute and relative to the machine's (those of the first bearing)."""

    time: float
    """Own film time t_b [s]."""
    force: float
    """Own force scale p0 R L [N]."""
    length: float
    """Own length L [m]; slopes of the rotor are in units of c/L of the first bearing."""
    time_ratio: float
    """s_b = t_b/t0: the bearing's own dimensionless speed is s_b Omega_bar."""
    clearance_ratio: float
    """c_b/c: a journal displacement x_bar is x_bar/clearance_ratio in the bearing's own film thickness."""
    force_ratio: float
    """(p0 R L)_b/(p0 R L): the bearing's own dimensionless force times this acts on the rotor."""
    kappa: float
    """R/L of the bearing."""
    foil_stiffness: float
    """k_bar = k c_b/p0 of the bearing's foil; inf if rigid."""


@dataclass(frozen=True)
class Scales:
    """Scales of a machine; dimensional = scale x dimensionless."""

    time: float
    """t0 [s]."""
    displacement: float
    """Clearance c of the first bearing [m]."""
    force: float
    """p0 R L of the first bearing [N]."""
    mass: float
    """force t0^2/c [kg]."""
    pressure: float
    """Ambient pressure p0 [Pa]."""
    bearings: tuple[BearingScales, ...]

    @classmethod
    def of(cls, gas: Gas, bearings: Sequence[Bearing]) -> Self:
        """Scales of bearings in a gas; the first bearing sets the scales of the machine."""
        first = bearings[0]
        p0 = gas.ambient_pressure
        time = film_time(gas.viscosity, p0, first.radius, first.clearance)
        force = p0 * first.radius * first.length
        own = []
        for bearing in bearings:
            own_time = film_time(gas.viscosity, p0, bearing.radius, bearing.clearance)
            own_force = p0 * bearing.radius * bearing.length
            own.append(
                BearingScales(
                    time=own_time,
                    force=own_force,
                    length=bearing.length,
                    time_ratio=own_time / time,
                    clearance_ratio=bearing.clearance / first.clearance,
                    force_ratio=own_force / force,
                    kappa=bearing.radius / bearing.length,
                    foil_stiffness=foil_stiffness(bearing.foil, p0, bearing.clearance),
                )
            )
        return cls(
            time=time,
            displacement=first.clearance,
            force=force,
            mass=force * time**2 / first.clearance,
            pressure=p0,
            bearings=tuple(own),
        )

    @property
    def stiffness(self) -> float:
        """Scale of rotor stiffness, force/c [N/m]."""
        return self.force / self.displacement

    @property
    def damping(self) -> float:
        """Scale of rotor damping, force t0/c [N s/m]."""
        return self.force * self.time / self.displacement

    def bearing_stiffness(self, bearing: int) -> float:
        """Scale of stiffness p0 R L/c of a bearing itself [N/m]; times t0 it is that of its damping."""
        own = self.bearings[bearing]
        return own.force / (own.clearance_ratio * self.displacement)

    @property
    def si_per_unit(self) -> dict[str, float]:
        """What a dimensionless 1 is in rpm, Hz, s, um, N/m3, by quantity of `SI_UNITS`."""
        return si_per_unit(self.time, self.displacement, self.pressure)

    @property
    def speed_rpm_per_unit(self) -> float:
        """Rotating speed in rpm at Omega_bar = 1."""
        return self.si_per_unit["speed"]

    @property
    def hertz_per_unit(self) -> float:
        """Frequency in Hz at the dimensionless angular frequency 1."""
        return self.si_per_unit["frequency"]

    def speed_rpm(self, speed: float) -> float:
        """Rotating speed [rpm] of a dimensionless speed."""
        return speed * self.speed_rpm_per_unit

    def speed_from_rpm(self, speed_rpm: float) -> float:
        """Dimensionless speed of a rotating speed [rpm]."""
        return speed_rpm / self.speed_rpm_per_unit

    def hertz(self, frequency: float) -> float:
        """Frequency [Hz] of a dimensionless angular frequency."""
        return frequency * self.hertz_per_unit

    def from_hertz(self, hertz: float) -> float:
        """Dimensionless angular frequency of a frequency [Hz]."""
        return hertz / self.hertz_per_unit

    def parameter_values(
        self, excitation: Excitation, operation: Operation
    ) -> tuple[float, float, float, float]:
        """Values in the order of `PARAMETERS`, NaN for a parameter that the machine does not have.

        Without excitation there need be no excitation frequency. The foil stiffness is that of the first
        bearing that has a foil; there is none where both are rigid.
        """
        if operation.speed is not None:
            speed = operation.speed
        else:
            assert operation.speed_rpm is not None
            speed = self.speed_from_rpm(operation.speed_rpm)
        if excitation.frequency_hz is not None:
            frequency = self.from_hertz(excitation.frequency_hz)
        else:
            frequency = math.nan if excitation.frequency is None else excitation.frequency
        return speed, frequency, self.ring_displacement(excitation), self._foil_stiffness()

    def _foil_stiffness(self) -> float:
        stiffnesses = (bearing.foil_stiffness for bearing in self.bearings)
        return next((value for value in stiffnesses if math.isfinite(value)), math.nan)

    def ring_displacement(self, excitation: Excitation) -> float:
        """Largest vertical displacement of the rings over c: as given, or caused by the load on the ring."""
        if excitation.displacement is not None:
            return excitation.displacement
        assert excitation.ring is not None  # the table's own checks
        assert excitation.load is not None
        return ring_displacement_from_load(excitation.ring, excitation.load) / self.displacement

    def ring_factors(self, excitation: Excitation) -> tuple[float, float]:
        """Displacement of each bearing's ring over its own clearance, relative to the common displacement.

        A displacement is given in clearances of either bearing; a load moves both rings by the same length.
        """
        own = [1.0 if excitation.load is None else bearing.clearance_ratio for bearing in self.bearings]
        return excitation.amplitudes[0] / own[0], excitation.amplitudes[1] / own[1]
