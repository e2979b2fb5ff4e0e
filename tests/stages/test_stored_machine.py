"""Cones, discs by dimensions and axial forces in a store: written, read by xarray, checked and drawn."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
import xarray
from matplotlib.patches import Rectangle

from pipelines.case.reading import read_cases
from pipelines.datasets.integrity import verify
from pipelines.datasets.reading import read_group
from pipelines.datasets.store import open_for_reading
from pipelines.figures.case_tables import read_case
from pipelines.figures.machine_drawing import draw_machine
from pipelines.stages.scheduling.preparation import prepare_store
from tests.helpers.tiny import CONFIG

CONES = (
    "rotor.elements.outer_diameter_right=0.0316",
    "rotor.elements.inner_diameter_right=0.014",
    "rotor.elements.axial_force=250.0",
    "rotor.discs.0={ node = 0, outer_diameter = 0.06, inner_diameter = 0.02, width = 0.01 }",
)
NEW = (
    "disc_outer",
    "disc_inner",
    "disc_width",
    "element_outer_right",
    "element_inner_right",
    "element_axial_force",
)


def stored(folder: Path, overrides: tuple[str, ...]) -> Path:
    path = folder / "machine.zarr"
    prepare_store(path, read_cases(CONFIG.read_text(), CONFIG.name, overrides), ["agfb"])
    return path


def test_both_ends_of_cones_are_stored(tmp_path: Path) -> None:
    path = stored(tmp_path, CONES)
    machine = xarray.open_datatree(path, engine="zarr", consolidated=False)[
        "cases/smoke/machine"
    ].to_dataset()
    ends = np.linspace(0.0176, 0.0316, 15)
    np.testing.assert_allclose(machine["element_outer"], ends[:-1], rtol=1e-14)
    np.testing.assert_allclose(machine["element_outer_right"], ends[1:], rtol=1e-14)
    np.testing.assert_allclose(machine["element_inner_right"], 1e-3 * np.arange(1.0, 15.0), rtol=1e-14)
    assert machine["element_axial_force"].values.tolist() == [250.0] * 14
    mass = 7850.0 * np.pi / 4 * (0.06**2 - 0.02**2) * 0.01
    assert float(machine["disc_mass"][0]) == pytest.approx(mass, rel=1e-14)
    np.testing.assert_array_equal(machine["disc_width"], [0.01, np.nan])
    assert verify(open_for_reading(path)) == []


def test_a_machine_of_cylinders_has_the_arrays_of_earlier_versions(tmp_path: Path) -> None:
    machine = read_group(open_for_reading(stored(tmp_path, ())), "cases/smoke/machine")
    assert not set(NEW) & set(machine.arrays)


def test_cones_are_drawn_with_both_ends(tmp_path: Path) -> None:
    store = open_for_reading(stored(tmp_path, CONES))
    tables = read_case(store, "smoke", ["machine"], pytest.fail, [])
    assert tables is not None
    axes = draw_machine(tables.view).axes[0]
    shapes = [patch.get_xy() for patch in axes.patches if hasattr(patch, "get_xy") and not patch.get_hatch()]
    corners = [np.round(shape, 6).tolist() for shape in shapes if np.shape(shape) == (5, 2)]
    length = 1e3 * 0.36 / 14
    assert [
        [0.0, -8.8], [0.0, 8.8], [round(length, 6), 9.3], [round(length, 6), -9.3], [0.0, -8.8]
    ] in corners  # fmt: skip
    assert len(corners) == 28  # each element and its bore
    boxes = [patch.get_bbox() for patch in axes.patches if isinstance(patch, Rectangle)]
    rings = sorted((box.y0, box.y1) for box in boxes if box.x0 == -5.0 and box.width == 10.0)
    assert rings == [(-30.0, -10.0), (10.0, 30.0)]  # the disc by dimensions; the other is a thin plate
