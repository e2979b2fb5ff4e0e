"""The machine and the operating point of a case: drawing, bearings, discs, units."""

from __future__ import annotations

from typing import Any

from pipelines.figures.axes import PARAMETER_AXES
from pipelines.figures.contents import CaseView, Table
from pipelines.figures.machine_drawing import draw_machine
from pipelines.figures.page import elements


def inputs(view: CaseView) -> list[str]:
    """The parameters of the case, which are its operating point."""
    rows: list[tuple[elements.Cell, ...]] = []
    for name, axis in PARAMETER_AXES.items():
        value = view.parameters.get(name)
        factor, _ = axis.dimensional(view.scales)
        rows.append((axis.title, value, None if value is None else value * factor, axis.unit))
    header = ("parameter", "dimensionless", "in units", "unit")
    return [elements.table(header, rows, "Operating point: the case's own parameters")]


def machine(view: CaseView) -> list[str]:
    """Drawing and tables of the machine."""
    if "bearing_node" not in view.machine:
        return []
    drawing = elements.picture(draw_machine(view), f"Rotor and bearings of {view.name} to scale")
    found = [drawing, *_rotor(view), _bearings(view)]
    if len(view.machine.optional("disc_node")):
        found.append(_discs(view))
    return found


def _rotor(view: CaseView) -> list[str]:
    """Mass, centre of gravity and bearing loads; nothing where the store lacks them."""
    rotor = view.machine.attributes.get("rotor")
    if rotor is None:
        return []
    rows: list[tuple[elements.Cell, ...]] = [
        ("mass", f"{rotor['mass']:.4g} kg"),
        ("centre of gravity, from node 0", f"{1e3 * rotor['centre_of_gravity']:.4g} mm"),
    ]
    for number, load in enumerate(rotor["bearing_loads"], start=1):
        rows.append((f"static load of bearing {number}", f"{load:.4g} N"))
    return [elements.table(("quantity", "value"), rows, "Rotor at rest")]


def _bearings(view: CaseView) -> str:
    table = view.machine
    rows: list[tuple[elements.Cell, ...]] = [
        (
            f"{place + 1}",
            f"{table['bearing_node'][place]}",
            1e3 * float(table["bearing_radius"][place]),
            1e3 * float(table["bearing_length"][place]),
            view.clearance(place),
        )
        for place in range(view.bearings)
    ]
    header = ("bearing", "node", "radius [mm]", "length [mm]", "clearance [µm]")
    return elements.table(header, rows, "Bearings")


def _discs(view: CaseView) -> str:
    table = view.machine
    columns = ("disc_mass", "disc_diametral_inertia", "disc_polar_inertia")
    rows: list[tuple[elements.Cell, ...]] = [
        (f"{place + 1}", f"{node}", *(_entry(table, name, place) for name in columns))
        for place, node in enumerate(table["disc_node"])
    ]
    header = ("disc", "node", "mass [kg]", "diametral inertia [kg m²]", "polar inertia [kg m²]")
    return elements.table(header, rows, "Discs")


def _entry(table: Table, name: str, place: int) -> float | None:
    values = table.optional(name)
    return float(values[place]) if len(values) else None


def units(view: CaseView, scales: dict[str, Any]) -> str:
    """What one dimensionless unit is."""
    rows: list[tuple[elements.Cell, ...]] = [
        ("rotating speed", scales["speed_rpm_per_unit"], "rpm"),
        ("frequency", scales["hertz_per_unit"], "Hz"),
        ("time", scales["time"], "s"),
        ("displacement", 1e6 * scales["displacement"], "µm"),
        ("pressure", scales["pressure"], "Pa"),
        ("areal foil stiffness", view.scales.stiffness, "GN/m³"),
    ]
    if "force" in scales:
        rows.append(("force", scales["force"], "N"))
    return elements.table(("one unit of", "is", ""), rows, "Units, set by the first bearing")
