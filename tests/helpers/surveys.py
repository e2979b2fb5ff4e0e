"""A survey in the layout of a store, whose growth rate and kinds are known in closed form."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from pipelines.datasets.branch import open_branch, write_group
from pipelines.datasets.schema import KINDS
from pipelines.datasets.store import Store
from tests.helpers.curves import PLANE

SPEC = KINDS["survey"]


def write_survey(
    store: Store,
    case: str,
    onset: float = 0.9,
    points: tuple[int, int] = (10, 7),
    lines: int | None = None,
    parameters: Sequence[str] = ("excitation_frequency", "speed"),
) -> None:
    """Growth speed - onset; period doublings below frequency 1, else Neimark-Sacker points.

    The first cell has no cycle.  ``lines``: so many are computed; all by default.
    """
    along, across = (np.linspace(*limits, number) for limits, number in zip(PLANE, points, strict=True))
    attributes = {
        "request": {},
        "parameters": list(parameters),
        "ranges": [list(limits) for limits in PLANE],
        "constants": {"displacement": 0.2, "foil_stiffness": None},
    }
    sizes = {"cell": points[0], "line": points[1]}
    with open_branch(store, f"cases/{case}/survey", "survey", sizes, {"along": along}, attributes) as branch:
        for number in range(points[1] if lines is None else lines):
            branch.commit(_line(along, float(across[number]), onset, number))
        if lines is None:
            branch.finish("all lines are computed")


def write_certificate(store: Store, case: str, disagreeing: tuple[int, int] | None = (4, 7)) -> None:
    """All cells agree but one, given as line and cell; one of three random points is not decided."""
    along, across = np.linspace(*PLANE[0], 10), np.linspace(*PLANE[1], 7)
    found = np.where(across[:, None] > 0.9, 2, 0) + np.zeros((7, 10), dtype=int)
    verdict = np.zeros((7, 10), dtype=int)
    if disagreeing is not None:
        verdict[disagreeing] = 1
    points = np.array([0.5, 1.0, 1.5])
    arrays = {
        "along": along,
        "across": across,
        "found": found,
        "expected": np.where(verdict == 1, 0, found),
        "verdict": verdict,
        "nearest": np.full((7, 10), 1.05j),
        "pair_along": np.zeros((7, 9), dtype=int),
        "pair_across": np.zeros((6, 10), dtype=int),
        "point_along": points,
        "point_across": points[::-1] / 1.5,
        "point_found": np.array([0, 0, -1]),
        "point_expected": np.array([0, 0, -1]),
        "point_verdict": np.array([0, 0, 2]),
        "point_nearest": np.full(3, -0.9 + 0j),
        "asked_parameter": np.array([0]),
        "asked_fixed": np.array([along[7]]),
    }
    attributes = {
        "parameters": ["excitation_frequency", "speed"],
        "resolution": [float(np.diff(along)[0]), float(np.diff(across)[0])],
        "certified": disagreeing is None,
        "share_at_most": 0.5,
    }
    write_group(store, f"cases/{case}/certificate/r000", "certificate", arrays, attributes)


def _line(along: np.ndarray, across: float, onset: float, number: int) -> dict[str, Any]:
    growth = np.full(len(along), across - onset)
    doubling = along < 1.0
    names = np.where(doubling, "period_doubling", "neimark_sacker")
    kinds = np.array([SPEC.array("bifurcation").flag(str(name)) for name in names], dtype=np.int8)
    row: dict[str, Any] = {
        "across": across,
        "status": np.zeros(len(along), dtype=np.int8),
        "growth_rate": growth,
        "multiplier": np.exp(growth) * np.where(doubling, -1.0, 1.0j),
        "nearest_multiplier": np.exp(growth) * np.where(doubling, -1.0, 1.0j),
        "bifurcation": kinds,
        "unstable_count": np.where(growth > 0.0, np.where(doubling, 1, 4), 0),
        "minimum_film": np.full(len(along), 0.3),
        "method": np.zeros(len(along), dtype=np.int8),
        "miss": np.full(len(along), 1e-4),
        "steps_per_period": np.full(len(along), 16),
        "step_error": np.full(len(along), 1e-4),
    }
    if number == 0:
        row["status"][0] = SPEC.array("status").flag("no_cycle")
        row["growth_rate"][0] = np.nan
    return row
