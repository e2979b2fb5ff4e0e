"""The map of a survey: its colours and hatches are those of the cells, alone and under curves."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from matplotlib.collections import QuadMesh
from matplotlib.figure import Figure

from pipelines.datasets.reading import read_group
from pipelines.datasets.store import Store
from pipelines.figures.case_tables import read_case
from pipelines.figures.contents import Table
from pipelines.figures.drawing import draw_figures
from pipelines.figures.survey import SurveyMap, draw_survey
from tests.figures.synthetic_store import make_store
from tests.helpers.surveys import write_survey


def drawn(store: Store) -> Figure:
    held = read_case(store, "kb10", ("survey", "curve"), print, [])
    assert held is not None
    return draw_survey(held.view, held.single["survey"], held.curves)


def labels(figure: Figure) -> list[str]:
    return [text.get_text() for text in figure.legends[0].get_texts()]


def meshes(figure: Figure) -> list[np.ndarray]:
    """Values of the cells of both charts."""
    found = [[one for one in axes.collections if isinstance(one, QuadMesh)] for axes in figure.axes]
    return [np.ma.filled(mesh.get_array().astype(float), np.nan) for (mesh, *_) in filter(None, found)]


def test_cells_have_their_growth_and_kind(tmp_path: Path) -> None:
    store = make_store(tmp_path / "a.zarr", parts=("machine",))
    write_survey(store, "kb10")
    figure = drawn(store)
    growth, kinds = meshes(figure)[:2]
    rows = read_group(store, "cases/kb10/survey")
    np.testing.assert_array_equal(growth, rows["growth_rate"])
    unstable = rows["unstable_count"] > 0
    np.testing.assert_array_equal(np.isnan(kinds), ~unstable)
    assert set(kinds[unstable & (rows["along"] < 1.0)]) == {3.0}, "period doubling, palest"
    assert set(kinds[unstable & (rows["along"] >= 1.0)]) == {1.0}, "four multipliers of a pair: darker"
    told = labels(figure)
    assert "growth rate 0" in told
    assert "no cycle found" in told
    assert "unstable: fold (LPC)" not in told
    assert "Neimark–Sacker (NS)" not in told, "there is no curve"
    (hatched,) = figure.axes[0].patches
    assert hatched.get_xy() == pytest.approx((0.1, 0.1)), "the first cell: half a cell below the ranges"


def test_curves_of_the_same_plane_lie_above(tmp_path: Path) -> None:
    store = make_store(tmp_path / "a.zarr", parts=("machine", "curves"))
    write_survey(store, "kb10")
    figure = drawn(store)
    assert "Neimark–Sacker (NS)" in labels(figure)
    for axes in figure.axes[:2]:
        assert len(axes.lines) > 1


def test_a_running_survey_is_drawn_as_far_as_it_is(tmp_path: Path) -> None:
    store = make_store(tmp_path / "a.zarr", parts=("machine",))
    write_survey(store, "kb10", lines=1)
    figure = drawn(store)
    assert "(running)" in str(figure.get_suptitle())
    assert meshes(figure)[0].shape == (1, 10)
    for lines, number in ((None, 1), (0, 1)):
        path = tmp_path / f"{lines}.zarr"
        write_survey(make_store(path, parts=("machine",)), "kb10", lines=lines)
        folders = [tmp_path / f"{lines}-{copy}" for copy in "ab"]
        files = [draw_figures(path, folder, kinds=("survey",)) for folder in folders]
        assert [len(each) for each in files] == [number, number]
        assert files[0][0].name == "survey.png"
        assert files[0][0].read_bytes() == files[1][0].read_bytes()


def test_a_plane_whose_first_parameter_runs_up(tmp_path: Path) -> None:
    """Speed along the lines, displacement across: the map has the displacement on its x axis."""
    store = make_store(tmp_path / "a.zarr", parts=("machine",))
    write_survey(store, "kb10", parameters=("speed", "displacement"))
    group = read_group(store, "cases/kb10/survey")
    turned = SurveyMap.of(Table(group.labelled(), group.attributes))
    assert (turned.x, turned.y) == ("displacement", "speed")
    np.testing.assert_array_equal(turned.arrays["growth_rate"], group["growth_rate"].T)
    np.testing.assert_array_equal(turned.abscissae, group["across"])
