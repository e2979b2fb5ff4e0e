"""Rotors with one disc at either end: two that criticals were lost of, and random ones."""

from __future__ import annotations

from dataclasses import asdict, dataclass
from typing import Any

import numpy as np

from pipelines.case.models import Case
from tests.machines import BEARING, case, symmetric_rotor


@dataclass(frozen=True)
class EndDisc:
    mass: float  # kg
    diametral_inertia: float  # kg m2
    polar_inertia: float  # kg m2


@dataclass(frozen=True)
class TwoDiscRotor:
    """360 mm x 17.6 mm of steel with a disc at either end, on two equal bearings."""

    discs: tuple[EndDisc, EndDisc]
    clearance: float  # m
    foil_stiffness: float  # dimensionless
    loss_factor: float
    rayleigh_stiffness: float  # s

    def case(self, grid: tuple[int, int], **tables: Any) -> Case:
        foil = {"stiffness": self.foil_stiffness, "loss_factor": self.loss_factor}
        bearing = {**BEARING, "clearance": self.clearance, "foil": foil}
        discs = [{"node": node, **asdict(disc)} for node, disc in zip((0, 14), self.discs, strict=True)]
        rotor = symmetric_rotor(discs=discs, rayleigh_stiffness=self.rayleigh_stiffness)
        return case(grid, bearings=(bearing, bearing), displacement=0.0, rotor=rotor, **tables)


# On 24 x 2 the film closes at the edge of the foil between the speeds 0.103 and 0.209.
HEAVY_ON_SOFT_FOILS = TwoDiscRotor(
    (EndDisc(0.38136, 3.5063e-4, 4.6979e-4), EndDisc(0.17246, 1.8558e-4, 3.1974e-4)),
    clearance=2.82976e-5,
    foil_stiffness=1.08198,
    loss_factor=0.29366,
    rayleigh_stiffness=1e-6,
)

# Forward and backward whirl of one shape are synchronous at 0.4108 and 0.4145.
CLOSE_CRITICALS = TwoDiscRotor(
    (
        EndDisc(0.1328836773, 4.311866659e-4, 7.132199947e-4),
        EndDisc(0.0829450248, 1.531067592e-4, 2.409379846e-4),
    ),
    clearance=1.9364064239e-5,
    foil_stiffness=12.3456175244,
    loss_factor=0.2825330822,
    rayleigh_stiffness=0.0,
)


def random_rotor(seed: int) -> TwoDiscRotor:
    """Light and heavy discs, alike (close pairs) or not, on soft and stiff foils."""
    draw = np.random.default_rng(seed)

    def between(low: float, high: float) -> float:
        return float(np.exp(draw.uniform(np.log(low), np.log(high))))

    def disc() -> EndDisc:
        mass = between(0.02, 0.4)
        diametral = mass * between(2e-4, 4e-3)
        return EndDisc(mass, diametral, diametral * draw.uniform(1.0, 1.95))

    first = disc()
    second = first if draw.random() < 0.25 else disc()
    return TwoDiscRotor(
        (first, second),
        clearance=between(1.5e-5, 3e-5),
        foil_stiffness=between(1.0, 50.0),
        loss_factor=between(0.05, 0.6),
        rayleigh_stiffness=float(draw.choice([0.0, 1e-6, 2.43e-5])),
    )
