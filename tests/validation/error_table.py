"""Errors of the film over grids, against closed form and reference tables.

``python -m tests.validation.error_table`` prints what error_table.md holds.  Every column is the largest
relative error over the rows of a table, in the Euclidean norm of the quantity named.
"""

from __future__ import annotations

import sys
from dataclasses import astuple, dataclass, fields

import numpy as np

from .films import (
    Array,
    ComplexArray,
    Film,
    Threshold,
    concentric_stiffness,
    film,
    reference_table,
    relative,
    threshold_masses,
)

GRIDS = {
    "central": ((24, 2), (32, 3), (40, 2), (40, 3), (64, 3), (64, 4), (96, 3), (96, 4)),
    "fourth_order": ((20, 4), (24, 2), (24, 3), (24, 4), (32, 3), (32, 4), (40, 4), (64, 4)),
}
DEFAULT_GRID = (32, 4)
DEFAULT_SCHEME = "fourth_order"

Errors = dict[str, dict[tuple[int, int], "GridErrors"]]  # by scheme and grid


@dataclass(frozen=True)
class GridErrors:
    """Largest relative errors of a grid."""

    concentric: float
    """Z of a concentric film and foil against the closed form, cases of concentric_dynamic_stiffness.csv."""
    rigid_static: float
    """Force of a plain bearing, rows of rigid_static_360.csv with eps <= 0.6 and Lambda <= 5."""
    static_full: float
    """Force of foil bearings with sub-ambient pressure, static_forces_gumbel_fine.csv."""
    static_gumbel: float
    """Force of foil bearings with Gümbel clipping, static_forces_gumbel_fine.csv."""
    coefficients: float
    """Matrices K and C, dynamic_coefficients.csv."""
    threshold_mass: float
    """Mass at which a rigid rotor becomes unstable, threshold_mass_eccentric.csv."""


def concentric_pair(
    grid: tuple[int, int], row: dict[str, str], scheme: str = "central"
) -> tuple[ComplexArray, ComplexArray]:
    """(computed, exact) Z of a row, shape (2, 2)."""
    slenderness, speed, ratio = float(row["L_over_D"]), float(row["Lambda"]), float(row["nu=omega/Omega"])
    stiffness, loss_factor = float(row["kf_bar"]), float(row["eta"])
    case = film(
        grid,
        slenderness=slenderness,
        speed=speed,
        foil_stiffness=stiffness,
        loss_factor=loss_factor,
        scheme=scheme,
    )
    exact = concentric_stiffness(slenderness, speed, 1j * speed * ratio, stiffness, loss_factor)
    return case.dynamic_stiffness((0.0, 0.0), [ratio])[0], exact


def rigid_static_error(grid: tuple[int, int], row: dict[str, str], scheme: str = "central") -> float:
    """Relative error of the force of a plain bearing; the table lists (-F_x, F_y) / 2 in units of p0 R L."""
    case = film(grid, slenderness=float(row["L_over_D"]), speed=float(row["Lambda"]), scheme=scheme)
    force = case.force((float(row["eps"]), 0.0))
    return relative(force * [-0.5, 0.5], np.array([float(row["Wr_over_p0LD"]), float(row["Wt_over_p0LD"])]))


def static_forces(
    grid: tuple[int, int], row: dict[str, str], scheme: str = "central"
) -> dict[str, tuple[Array, Array]]:
    """(computed, expected) force of a foil bearing for either clipping (the film does not feel it)."""
    place, position = row["theta_bc"], (float(row["X"]), float(row["Y"]))
    forces = {}
    unknowns = None
    for clipping in ("full", "gumbel"):
        case = film(
            grid,
            slenderness=float(row["L_over_D"]),
            speed=float(row["Lambda"]),
            foil_stiffness=float(row["kf_bar"]),
            periodic=place == "periodic_360",
            edge_angle=np.pi / 2 if place.endswith("pi/2") else 0.0,
            clipping=clipping,
            scheme=scheme,
        )
        unknowns = case.steady(position) if unknowns is None else unknowns
        expected = np.array([float(row[f"F{axis}_{clipping}"]) for axis in "xy"])
        forces[clipping] = case.state(unknowns, position).force, expected
    return forces


def eccentric_film(
    grid: tuple[int, int], row: dict[str, str], scheme: str = "central"
) -> tuple[Film, tuple[float, float]]:
    """Bearing and journal position of a row of dynamic_coefficients.csv or threshold_mass_eccentric.csv."""
    case = film(
        grid,
        slenderness=float(row["L_over_D"]),
        speed=float(row["Lambda"]),
        foil_stiffness=float(row["kf_bar"]),
        loss_factor=float(row["eta"]),
        scheme=scheme,
    )
    return case, (float(row["X(=eps,Y=0)"]), 0.0)


def coefficients(
    grid: tuple[int, int], row: dict[str, str], scheme: str = "central"
) -> list[tuple[Array, Array]]:
    """(computed, expected) of K and of C, shape (2, 2)."""
    case, position = eccentric_film(grid, row, scheme)
    return [
        (computed[0], np.array([[float(row[f"{name}{i}{j}"]) for j in "xy"] for i in "xy"]))
        for name, computed in zip("KC", case.coefficients(position, [float(row["nu"])]), strict=True)
    ]


def eccentric_threshold(grid: tuple[int, int], row: dict[str, str], scheme: str = "central") -> Threshold:
    """The threshold of a row: that of half-frequency whirl, the highest whirl ratio at which one exists."""
    case, position = eccentric_film(grid, row, scheme)
    found = threshold_masses(case, position, np.linspace(0.35, 0.55, 6))
    return max(found, key=lambda threshold: threshold.whirl_ratio)


def grid_errors(grid: tuple[int, int], scheme: str = "central") -> GridErrors:
    """One line of the table."""
    static = [static_forces(grid, row, scheme) for row in reference_table("static_forces_gumbel_fine")]
    concentric = reference_table("concentric_dynamic_stiffness")
    return GridErrors(
        concentric=max(relative(*concentric_pair(grid, row, scheme)) for row in concentric),
        rigid_static=max(rigid_static_error(grid, row, scheme) for row in moderate_rows()),
        static_full=max(relative(*forces["full"]) for forces in static),
        static_gumbel=max(relative(*forces["gumbel"]) for forces in static),
        coefficients=max(
            relative(computed, expected)
            for row in reference_table("dynamic_coefficients")
            for computed, expected in coefficients(grid, row, scheme)
        ),
        threshold_mass=max(
            abs(eccentric_threshold(grid, row, scheme).mass / float(row["Mcrit_bar_per_bearing"]) - 1.0)
            for row in reference_table("threshold_mass_eccentric")
        ),
    )


def moderate_rows() -> list[dict[str, str]]:
    """Rows of rigid_static_360.csv with eps <= 0.6 and Lambda <= 5."""
    rows = reference_table("rigid_static_360")
    return [row for row in rows if float(row["eps"]) <= 0.6 and float(row["Lambda"]) <= 5.0]


def unknowns(grid: tuple[int, int]) -> int:
    """Pressures and foil displacements of a bearing whose film ends at the foil's edge."""
    return (grid[0] - 1) * (grid[1] + 1)


def all_errors() -> Errors:
    """The errors of every scheme on its grids."""
    return {scheme: {grid: grid_errors(grid, scheme) for grid in grids} for scheme, grids in GRIDS.items()}


def markdown(errors: Errors) -> str:
    """The table as Markdown text."""
    names = ["scheme", "grid", "unknowns of a bearing"]
    names += [field.name.replace("_", " ") for field in fields(GridErrors)]
    lines = ["| " + " | ".join(names) + " |", "|---" * len(names) + "|"]
    for scheme, grids in errors.items():
        for grid, row in grids.items():
            cells = " | ".join(f"{100.0 * value:.2f} %" for value in astuple(row))
            lines.append(f"| {scheme} | {grid[0]} × {grid[1]} | {unknowns(grid)} | {cells} |")
    return "\n".join(lines) + "\n"


if __name__ == "__main__":
    sys.stdout.write(markdown(all_errors()))
