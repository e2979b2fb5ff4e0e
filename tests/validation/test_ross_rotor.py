"""A rotor saved by ROSS and imported has the eigenvalues that ROSS's own matrices give it."""

from __future__ import annotations

import csv
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from pipelines.case.imports.draft import draft_text
from pipelines.case.imports.ross import read_ross
from pipelines.case.reading import read_cases
from pipelines.case.rotor import Rotor
from pipelines.machine.rotor_modes import oscillating_modes
from pipelines.machine.shaft import assemble_rotor
from tests.helpers.configurations import MODELS

ROOT = Path(__file__).parents[2]
MODEL = MODELS / "ross_rotor.toml"
TABLE = ROOT / "tests" / "reference" / "ross_rotor_eigenvalues.csv"
BEARING = (
    "bearings.radius=0.0125",
    "bearings.length=0.02",
    "bearings.clearance=2e-5",
    "bearings.foil.areal_stiffness=5e9",
    "bearings.foil.loss_factor=0.4",
)


@pytest.fixture(scope="module")
def rotor() -> Rotor:
    """With the foil bearings elsewhere, ROSS's bearings are linear supports."""
    imported = replace(read_ross(MODEL.read_text(), MODEL.name), foil_nodes=(0, 9))
    text = draft_text(imported, "mine")
    assert text.count("\n[[rotor.supports]] # BearingElement_") == 2
    (named,) = read_cases(text, "mine.toml", BEARING)
    return named.case.rotor


def eigenvalues_by_speed() -> dict[float, list[complex]]:
    table: dict[float, list[complex]] = {}
    with TABLE.open() as file:
        for row in csv.DictReader(line for line in file if not line.startswith("#")):
            value = complex(float(row["real"]), float(row["imaginary"]))
            table.setdefault(float(row["speed"]), []).append(value)
    return table


@pytest.mark.parametrize(("speed", "expected"), eigenvalues_by_speed().items())
def test_eigenvalues_agree_with_ross(rotor: Rotor, speed: float, expected: list[complex]) -> None:
    found = oscillating_modes(assemble_rotor(rotor), speed).eigenvalues[: len(expected)]
    np.testing.assert_allclose(np.abs(found), np.abs(expected), rtol=1e-9)
    assert np.max(np.abs(found - expected) / np.abs(expected)) < 1e-9
