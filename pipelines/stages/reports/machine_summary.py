"""What a case says of its machine before anything is computed: where typing errors of a drawing are seen.

The bearing number of a bearing is 6 mu Omega R^2/(p0 c^2), its own dimensionless speed.
"""

from __future__ import annotations

import math
from dataclasses import asdict, dataclass

from pipelines.case.models import Case
from pipelines.case.scales import PARAMETERS
from pipelines.machine.rotor_properties import rotor_properties
from pipelines.machine.shaft import assemble_rotor


@dataclass(frozen=True)
class BearingSummary:
    """One bearing: static load [N], bearing number at the operating speed, foil, stroke of the ring [um].

    ``foil_stiffness``: k c/p0, None for a rigid bearing; ``areal_stiffness``: k [N/m3]; ``stroke``: largest
    vertical displacement of the ring.
    """

    load: float
    bearing_number: float
    foil_stiffness: float | None
    areal_stiffness: float | None
    stroke: float


@dataclass(frozen=True)
class MachineSummary:
    """Mass [kg], centre of gravity from node 0 [m], and the bearings."""

    mass: float
    centre_of_gravity: float
    bearings: tuple[BearingSummary, ...]

    def as_dict(self) -> dict[str, object]:
        """Plain data, fit for JSON."""
        return asdict(self)

    def rows(self) -> list[tuple[str, str]]:
        """Names and values with units, for a table."""
        rows = [
            ("mass of the rotor", f"{self.mass:.4g} kg"),
            ("centre of gravity, from node 0", f"{1e3 * self.centre_of_gravity:.4g} mm"),
        ]
        for number, bearing in enumerate(self.bearings, start=1):
            foil = "rigid"
            if bearing.foil_stiffness is not None:
                foil = f"{bearing.foil_stiffness:.4g} ({bearing.areal_stiffness:.4g} N/m3)"
            rows += [
                (f"static load of bearing {number}", f"{bearing.load:.4g} N"),
                (f"bearing number {number} at the operating speed", f"{bearing.bearing_number:.4g}"),
                (f"foil stiffness of bearing {number}", foil),
                (f"stroke of ring {number}", f"{bearing.stroke:.4g} um"),
            ]
        return rows


def machine_summary(case: Case) -> MachineSummary:
    """The summary of a case's machine."""
    rotor = rotor_properties(assemble_rotor(case.rotor), [bearing.node for bearing in case.bearings])
    scales, values = case.scales, dict(zip(PARAMETERS, case.parameters, strict=True))
    factors = scales.ring_factors(case.excitation)
    bearings = []
    for load, own, factor in zip(rotor.bearing_loads, scales.bearings, factors, strict=True):
        clearance, rigid = own.clearance_ratio * scales.displacement, math.isinf(own.foil_stiffness)
        bearings.append(
            BearingSummary(
                load=load,
                bearing_number=values["speed"] * own.time_ratio,
                foil_stiffness=None if rigid else own.foil_stiffness,
                areal_stiffness=None if rigid else own.foil_stiffness * scales.pressure / clearance,
                stroke=1e6 * values["displacement"] * factor * clearance,
            )
        )
    return MachineSummary(rotor.mass, rotor.centre_of_gravity, tuple(bearings))
