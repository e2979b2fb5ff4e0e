"""Bifurcation curves with exact tangents, written as a store keeps them: shapes known in closed form."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pipelines.datasets.branch import open_branch, write_group
from pipelines.datasets.schema import KINDS
from pipelines.datasets.store import Store, create_store

Arrays = dict[str, NDArray[Any]]
SCALES = {
    "time": 1.0 / (2.0 * np.pi * 300.0),
    "displacement": 2e-5,
    "pressure": 1e5,
    "speed_rpm_per_unit": 18000.0,
    "hertz_per_unit": 300.0,
}


def empty_store(path: Path, *cases: str) -> Store:
    """A store whose cases hold nothing yet."""
    named = {case: {"name": case, "parameters": {}, "scales": SCALES, "reconstruction": ""} for case in cases}
    return create_store(path, named, {"configuration": {}, "configuration_hash": "0"}, durable=False)


PLANE: tuple[tuple[float, float], tuple[float, float]] = ((0.2, 2.0), (0.2, 1.4))
Path2 = Callable[[NDArray[np.float64]], NDArray[np.float64]]


def curve_rows(path: Path2, ends: tuple[float, float], points: int) -> Arrays:
    """Rows of a curve ``path(a)`` (n, 2) = frequency and speed between two values of a, with exact tangents
    and an arclength that is exact to rounding.
    """
    low, high = ends
    values = np.linspace(low, high, points)
    place = path(values)
    step = 1e-30 * (1.0 if high > low else -1.0)
    # a complex step differentiates to rounding
    slope = path(values + 1j * step).imag / 1e-30
    nodes, weights = np.polynomial.legendre.leggauss(12)
    middle, half = 0.5 * (values[1:] + values[:-1]), 0.5 * np.diff(values)
    inner = path((middle[:, None] + half[:, None] * nodes + 1j * step).ravel()).imag / 1e-30
    pace = np.hypot(*inner.T).reshape(-1, 12)
    arclength = np.concatenate([[0.0], np.cumsum(np.abs(half) * (pace @ weights))])
    return {
        "excitation_frequency": place[:, 0].real,
        "speed": place[:, 1].real,
        "displacement": np.full(points, 0.2),
        "foil_stiffness": np.full(points, 10.0),
        "parameter_tangent": slope / np.hypot(*slope.T)[:, None],
        "arclength": arclength,
        "angle": np.full(points, 2.0),
        "unstable_count": np.zeros(points, dtype=np.int64),
        "criticality": np.ones(points, dtype=np.int8),
    }


def write_curve(
    store: Store,
    group: str,
    bifurcation: str,
    rows: Arrays,
    stop: str = "range",
    specials: tuple[tuple[str, float, float], ...] = (),
    **more: Any,
) -> None:
    """A curve with special points (kind, frequency, speed), each put behind the row nearest to it."""
    place = np.column_stack([rows["excitation_frequency"], rows["speed"]])
    points = len(place)
    events = []
    for kind, frequency, speed in specials:
        near = int(np.argmin(np.hypot(*(0.5 * (place[1:] + place[:-1]) - [frequency, speed]).T)))
        events.append({
            "event_kind": KINDS["curve"].array("event_kind").flag(kind), "event_after_point": near,
            "event_speed": speed, "event_excitation_frequency": frequency, "event_displacement": 0.2,
            "event_foil_stiffness": 10.0, "event_period": 9.0, "event_angle": 2.0, "event_residual": 1e-10,
            "event_tongue": -1, "event_width": np.nan,
        })  # fmt: skip
    events.sort(key=lambda event: event["event_after_point"])
    extra = {"period": 9.0, "step": 0.02, "kappa": 0.3, "kappa_slope": 0.0, "newton_iterations": 4,
             "normal_form": -1.0 + 0j, "normal_form_error": 0.01, "alignment": 0.5, "multiplier_count": 4,
             "steps_per_period": 50, "step_error": 1e-7, "coarser_error": 3e-6, "clipping_width": 0.0,
             "width_effect": 0.0, "grazing_gauge": -0.1, "grazing_bearing": 0, "grazing_angle": 1.0,
             "grazing_phase": 2.0}  # fmt: skip
    attributes = {"bifurcation": bifurcation, "parameters": ["excitation_frequency", "speed"],
                  "ranges": [list(interval) for interval in PLANE], "turns": 1,
                  "origin": {"group": "cycles/b000", "event": 0}, "half": 0, **more}  # fmt: skip
    with open_branch(
        store, group, "curve", {"point": points, "free": 2, "event": 32}, {}, attributes
    ) as writer:
        for point in range(points):
            row = extra | {name: values[point] for name, values in rows.items()}
            writer.commit(
                row, {"basis_columns": 8}, [e for e in events if e["event_after_point"] == point - 1]
            )
        if stop != "running":
            writer.finish(stop)


def oval(f: float, speed: float, width: float, height: float) -> Path2:
    """A closed curve around (f, speed)."""
    return lambda a: np.column_stack([f + width * np.cos(a), speed + height * np.sin(a)])


def write_set(store: Store, case: str, **more: Any) -> None:
    """How the plane was searched: three lines along the speed and two along the frequency."""
    arrays = {
        "line_parameter": np.array([0, 0, 0, 1, 1]),
        "line_fixed": np.array([0.5, 1.1, 1.7, 0.5, 1.1]),
        "line_low": np.array([0.25, 0.25, 0.25, 0.2, 0.2]),
        "line_high": np.array([1.4, 1.4, 1.4, 2.0, 2.0]),
        "line_round": np.zeros(5, dtype=int),
        "line_events": np.full(5, 2),
        "line_new_curves": np.ones(5, dtype=int),
        "line_complete": np.ones(5, dtype=int),
    }
    attributes = {"parameters": ["excitation_frequency", "speed"], "ranges": [list(i) for i in PLANE],
                  "rounds": 1, "covered": "5 lines", "complete": True, "lowest_speed": 0.25,
                  "passive_instability_speed": 1.05}  # fmt: skip
    write_group(store, f"cases/{case}/bifurcation_set", "bifurcation_set", arrays, attributes | more)


def write_cycles(
    store: Store, group: str, parameter: str, frequency: Any, speed: Any, unstable: Any, **more: Any
) -> None:
    """A branch of cycles of which only places and unstable multipliers are kept."""
    frequency, speed, unstable = np.broadcast_arrays(frequency, speed, unstable)
    attributes = {"parameter": parameter, **more}
    with open_branch(store, group, "cycles", {"point": len(speed)}, {}, attributes) as writer:
        zeros = {name: 0 for name, array in writer.arrays.items() if array.role == "row"}
        slots = {name: 0 for name, array in writer.arrays.items() if array.role == "slot"}
        for row in zip(frequency, speed, unstable, strict=True):
            place = dict(zip(("excitation_frequency", "speed", "unstable_count"), row, strict=True))
            writer.commit(zeros | place, slots)
        writer.finish("range")
