"""Invented runs in time with their analysis, in the layout of a store: for drawing only."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from pipelines.datasets.branch import open_branch, write_group
from pipelines.datasets.schema import TRANSIENT_ANALYSIS
from pipelines.datasets.store import Store

Arrays = dict[str, NDArray[Any]]

PERIOD = 2 * np.pi / 0.7
SAMPLES, WINDOWS, PIECES, FREQUENCIES, POINTS = 800, 50, 20, 120, 60
COORDINATES = 14


def write_runs(store: Store, case: str) -> None:
    """Two run-ups, balanced and G 2.5, and a quasi-periodic run at constant speed."""
    grade = {"grade": 2.5, "planes": []}
    for number, (speeds, unbalance, motion) in enumerate(
        (((0.4, 1.3), None, "unsettled"), ((0.4, 1.3), grade, "unsettled"),
         ((1.25, 1.25), None, "quasi_periodic"))
    ):  # fmt: skip
        name = f"t{number:03d}"
        write_samples(store, f"cases/{case}/transient/{name}", speeds, unbalance)
        size = 0.05 + 0.1 * number
        attributes = {"source": f"transient/{name}", "skipped": {}, "energy_joules": 4.7e-4}
        group = f"cases/{case}/transient_analysis/{name}"
        write_group(store, group, TRANSIENT_ANALYSIS.kind, analysis(speeds, size, motion), attributes)


def _journal(time: NDArray[np.float64], size: float) -> NDArray[np.float64]:
    """Journals (times, 2, 2) on a torus of two frequencies."""
    x = 0.3 + size * np.cos(0.7 * time) + 0.4 * size * np.cos(0.33 * time)
    y = -0.35 + size * np.sin(0.7 * time) + 0.4 * size * np.sin(0.33 * time)
    one = np.stack([x, y], axis=-1)
    return np.stack([one, 0.95 * one], axis=-2)


def write_samples(
    store: Store, group: str, speeds: tuple[float, float], unbalance: dict[str, Any] | None
) -> None:
    """The samples of a run; most of their arrays are of no use for a drawing."""
    sizes = {"sample": SAMPLES, "checkpoint": 1, "coordinate": COORDINATES, "bearing": 2, "axis": 2,
             "component": 3, "extreme": 10, "plane": 0}  # fmt: skip
    static = {
        "coordinate_node": np.zeros(COORDINATES, dtype=np.int32),
        "coordinate_axis": np.zeros(COORDINATES, dtype=np.int8),
        "plane_node": np.zeros(0, dtype=np.int32),
        "plane_moment": np.zeros(0),
        "plane_phase": np.zeros(0),
    }
    attributes = {
        "request": {"transient": {"samples_per_period": 16.0}, "unbalance": unbalance},
        "parameters": [speeds[0], 0.7, 0.2, 10.0],
        "reference_period": PERIOD,
    }
    time = np.arange(SAMPLES) * PERIOD / 16.0
    unused = dict.fromkeys(
        ("minimum_film", "minimum_pressure", "maximum_pressure", "minimum_foil", "maximum_foil"), np.zeros(2)
    )
    rows = [
        {"time": t, "speed": speed, "angle": 0.0, "ring_displacement": 0.2,
         "displacement": np.zeros(COORDINATES), "journal": journal, **unused}
        for t, speed, journal in zip(
            time, np.linspace(*speeds, SAMPLES), _journal(time, 0.1), strict=True
        )
    ]  # fmt: skip
    with open_branch(store, group, "transient", sizes, static, attributes) as branch:
        branch.extend(rows)
        branch.finish("finished")


def analysis(speeds: tuple[float, float], size: float, motion: str) -> Arrays:
    """All arrays of an analysis."""
    last = SAMPLES * PERIOD / 16.0
    window, piece = np.linspace(0.0, last, WINDOWS), np.linspace(0.0, last, PIECES)
    frequency = np.linspace(0.0, 4.0, FREQUENCIES)
    peaks = sum(10.0**-k * np.exp(-(((frequency - 0.7 * (k + 1)) / 0.05) ** 2)) for k in range(4))
    peaks = (size * peaks + 1e-8)[:, None, None] * np.array([[1.0, 0.8], [0.9, 0.7]])
    grow = 1.0 + np.linspace(0.0, 1.0, WINDOWS)[:, None, None]
    energies = np.linspace(1.0, 3.0, WINDOWS)[:, None] * np.array([1e-2, 1e-3, 1e-30, 1e-6])
    found: Arrays = {
        "window_time": window,
        "window_speed": np.linspace(*speeds, WINDOWS),
        "envelope_low": np.array([[0.3, -0.35]] * 2) - size * grow,
        "envelope_high": np.array([[0.3, -0.35]] * 2) + size * grow,
        "mode_frequency": np.array([0.0, 1.5, 4.2, 8.1]),
        "mode_multiplicity": np.array([4, 2, 2, 2]),
        "kinetic_energy": energies,
        "strain_energy": energies * np.array([0.0, 2.0, 1.0, 1e2]),
        "frequency": frequency,
        "spectrum": peaks,
        "piece_time": piece,
        "piece_speed": np.linspace(*speeds, PIECES),
        "piece_frequency": frequency,
        "waterfall": np.repeat(peaks[None], PIECES, axis=0),
        "motion": np.array([TRANSIENT_ANALYSIS.array("motion").flag(motion)]),
        "section": np.array([0]),
        "stretch_begin": np.array([0.5 * last]),
        "section_points": np.array([POINTS]),
        "section_period": np.array([PERIOD]),
        "orbit_size": np.array([size]),
        "return_period": np.array([1, 2, 4, 8]),
        "return_distance": np.array([[0.9, 0.8, 0.7, 0.6]]),
        "growth_rate": np.array([1e-3]),
        "chaos": np.array([0.02]),
    }
    for by, period in (("ring", PERIOD), ("rotation", 2 * np.pi / 1.25)):
        times = np.arange(POINTS) * period
        found[f"{by}_section_time"] = times
        found[f"{by}_section_speed"] = np.linspace(*speeds, POINTS)
        found[f"{by}_section_journal"] = _journal(times, 0.1)
    return found
