"""Stores of the paper's cases with a threshold that is known in closed form."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from pathlib import Path

import numpy as np

from pipelines.datasets.store import Store, create_store
from tests.helpers.curves import SCALES, curve_rows, write_curve, write_set

BEND = 0.3


def threshold(peak: float, top: float) -> Callable[[np.ndarray], np.ndarray]:
    """A parabola of Neimark-Sacker points that reaches ``top`` at ``peak``."""
    return lambda f: np.column_stack([f, top - BEND * (f - peak) ** 2])


def store_of(path: Path, cases: Iterable[tuple[float, float]]) -> Store:
    """A store of cases (foil stiffness, displacement) that hold nothing; names say nothing of them."""
    named = {
        f"c{number}": {
            "name": f"c{number}",
            "parameters": {"speed": 0.3, "excitation_frequency": 0.7, "displacement": displacement,
                           "foil_stiffness": stiffness},
            "scales": SCALES,
            "reconstruction": "",
        }
        for number, (stiffness, displacement) in enumerate(cases)
    }  # fmt: skip
    return create_store(path, named, {"configuration": {}, "configuration_hash": "0"}, durable=False)


def write_threshold(store: Store, case: str, peak: float, top: float, **searched: object) -> None:
    write_set(store, case, **searched)
    rows = curve_rows(threshold(peak, top), (0.2, 2.0), 24)
    write_curve(store, f"cases/{case}/ns/c000", "neimark_sacker", rows)
