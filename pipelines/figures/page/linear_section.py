"""Linear behaviour of a case: instability speed, critical speeds, modes at the operating point, diagrams."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from pipelines.figures.bode import draw_bode
from pipelines.figures.campbell import draw_campbell
from pipelines.figures.contents import CaseView, Table
from pipelines.figures.operating_point import draw_operating_point
from pipelines.figures.page import elements

MODE = ("frequency_hertz", "frequency_rpm", "damping_ratio", "logarithmic_decrement")


def linear(view: CaseView, single: Mapping[str, Table]) -> list[str]:
    """What the groups linear, operating_point, criticals and unbalance_response tell."""
    found = []
    if (table := single.get("linear")) is not None:
        found.append(elements.paragraph(_instability(view, table)))
    if (table := single.get("operating_point")) is not None:
        found += _operating_point(view, table)
    if (table := single.get("criticals")) is not None:
        found.append(_critical_speeds(view, table))
        found.append(elements.picture(draw_campbell(view, table), f"Campbell diagram of {view.name}"))
    if (table := single.get("unbalance_response")) is not None:
        drawing = draw_bode(view, table, single.get("linear"))
        found.append(elements.picture(drawing, f"Unbalance response of {view.name}"))
    return found


def _instability(view: CaseView, table: Table) -> str:
    """Where the equilibrium loses its stability, as far as the computed speeds tell."""
    speed, attributes = table.attributes.get("instability_speed"), table.attributes
    if speed is not None:
        rpm = view.scales.rpm * speed
        sentence = f"The equilibrium loses its stability at the speed {speed:.4f} ({rpm:.0f} rpm)."
        also = " It is unstable at the lowest speed too." if attributes.get("unstable_from_start") else ""
        return sentence + also
    if attributes.get("unstable_from_start"):
        return "The equilibrium is unstable from the lowest speed on."
    if (hidden := attributes.get("instability_between")) is not None:
        low, high = hidden
        return (
            f"The equilibrium loses its stability between the speeds {low:.4g} and {high:.4g}, "
            "where some speeds have no equilibrium."
        )
    known = table["speed"][np.isfinite(table["minimum_film"]).all(axis=1)]
    if not len(known):
        return "No computed speed has an equilibrium."
    return (
        f"The equilibrium loses its stability nowhere between the speeds {known[0]:.4g} and {known[-1]:.4g}."
    )


def _critical_speeds(view: CaseView, table: Table) -> str:
    rows: list[tuple[elements.Cell, ...]] = [
        (
            f"{place + 1}",
            float(speed),
            view.scales.rpm * float(speed),
            view.scales.hertz * float(speed),
            float(table["critical_damping_ratio"][place]),
            str(table["critical_direction"][place]),
        )
        for place, speed in enumerate(table["critical_speed"])
    ]
    header = ("critical speed", "dimensionless", "rpm", "Hz", "damping ratio", "whirl")
    return elements.table(header, rows, "Critical speeds")


def _operating_point(view: CaseView, point: Table) -> list[str]:
    """Modes at the case's own speed, and the shaft under its weight."""
    if not point.attributes["equilibrium"]:
        return [elements.paragraph(f"No equilibrium at the operating speed: {point.attributes['reason']}.")]
    rows: list[tuple[elements.Cell, ...]] = [
        (f"{mode + 1}", *(float(point[name][mode]) for name in MODE), str(point["direction"][mode]))
        for mode in range(len(point["frequency_hertz"]))
    ]
    header = ("mode", "Hz", "rpm", "damping ratio", "logarithmic decrement", "whirl")
    speed, rpm = float(point.attributes["speed"]), float(point.attributes["speed_rpm"])
    title = f"Modes at the operating speed {speed:.4g} ({rpm:.0f} rpm)"
    drawing = draw_operating_point(view, point)
    return [elements.table(header, rows, title), elements.picture(drawing, f"Operating point of {view.name}")]
