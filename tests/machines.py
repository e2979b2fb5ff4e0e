"""Cases which tests of machine, orbits and stages share: the reconstructed rotor on two bearings."""

from __future__ import annotations

from typing import Any

from pipelines.case.models import Case

DISC = {"mass": 0.079, "diametral_inertia": 2.85e-5, "polar_inertia": 5.7e-5}
FOIL = {"stiffness": 10.0, "loss_factor": 0.425}
BEARING = {"radius": 0.014, "length": 0.0161, "clearance": 20.4e-6, "foil": FOIL}
# Differs from the first in every length, and so in its time, force and displacement scales.
OTHER_BEARING = {
    "radius": 0.017,
    "length": 0.012,
    "clearance": 31e-6,
    "foil": {"stiffness": 4.0, "loss_factor": 0.2},
}


def symmetric_rotor(**changes: Any) -> dict[str, Any]:
    """360 mm x 17.6 mm of steel, a disc at either end, masters symmetric about the middle."""
    return {
        "materials": {"steel": {"young_modulus": 206e9, "poisson_ratio": 0.3, "density": 7850.0}},
        "elements": [{"length": 0.360 / 14, "outer_diameter": 0.0176, "count": 14}],
        "discs": [{"node": 0, **DISC}, {"node": 14, **DISC}],
        "masters": (0, 2, 4, 7, 10, 12, 14),
        "rayleigh_stiffness": 2.43e-5,
        **changes,
    }


def case(
    grid: tuple[int, int] | None = None,
    *,
    bearings: tuple[dict[str, Any], dict[str, Any]] = (BEARING, BEARING),
    displacement: float = 0.2,
    speed: float = 1.0,
    numerics: dict[str, Any] | None = None,
    excitation: dict[str, Any] | None = None,
    **tables: Any,
) -> Case:
    """The reconstructed machine on the default film, or in second order on a grid N_theta x N_z.

    Whole tables or keys of some are replaced.
    """
    film = {} if grid is None else {"circumferential": grid[0], "axial": grid[1], "scheme": "central"}
    content = {
        "name": "reconstruction",
        "gas": {"viscosity": 1.85e-5, "ambient_pressure": 101325.0},
        "rotor": symmetric_rotor(),
        "bearings": [{"node": node, **bearing} for node, bearing in zip((2, 12), bearings, strict=True)],
        "excitation": {"displacement": displacement, "frequency": 0.7, **(excitation or {})},
        "operation": {"speed": speed},
        "numerics": {**film, **(numerics or {})},
        **tables,
    }
    return Case.model_validate(content)


def with_foil_stiffness(stiffness: float) -> tuple[dict[str, Any], dict[str, Any]]:
    """Two equal bearings with another dimensionless foil stiffness."""
    bearing = {**BEARING, "foil": {**FOIL, "stiffness": stiffness}}
    return bearing, bearing
