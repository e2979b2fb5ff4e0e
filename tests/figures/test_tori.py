"""Figures of tori: what is drawn is what the data say."""

from __future__ import annotations

import numpy as np
import pytest

from pipelines.figures.contents import Table
from pipelines.figures.drawing import draw_figures
from pipelines.figures.tori import CURVES, draw_section, draw_tori


@pytest.fixture
def tori(synthetic):
    return Table(synthetic.tori(), {"parameter": "speed", "origin": {"group": "cycles/b000", "event": 2}})


def test_the_extent_of_stable_tori_is_solid_and_that_of_others_dashed(view, tori, branch):
    figure = draw_tori(view, "speed", [tori], [branch])
    vertical, horizontal, rotation = figure.axes[:3]
    stable = tori["unstable_count"] == 0
    for axes, axis in ((vertical, 1), (horizontal, 0)):
        lines = [line for line in axes.get_lines() if line.get_color() in ("#0072B2", "#D55E00")]
        for extreme in ("orbit_minimum", "orbit_maximum"):
            for bearing in range(2):
                values = tori[extreme][:, view.journal_coordinates(bearing)[axis]]
                solid = np.concatenate([line.get_ydata() for line in lines if line.get_linestyle() == "-"])
                dashed = np.concatenate([line.get_ydata() for line in lines if line.get_linestyle() == "--"])
                assert np.isin(values[stable], solid).all()
                assert np.isin(values[~stable], dashed).all()
                assert not np.isin(values[stable][:-1], dashed).any()
    drawn = np.concatenate([line.get_xydata() for line in rotation.get_lines()])
    np.testing.assert_allclose(np.unique(drawn[:, 1]), np.unique(tori["rotation"] / (2.0 * np.pi)))


def test_cycles_are_shown_around_the_tori_with_their_bifurcations(view, tori, branch):
    figure = draw_tori(view, "speed", [tori], [branch])
    low, high = figure.axes[0].get_xlim()
    assert low < 1.2 < tori["speed"][-1] < high < tori["speed"][-1] + 0.1
    marks = [line for line in figure.axes[0].get_lines() if line.get_marker() == "o"]
    assert any(line.get_xdata()[0] == pytest.approx(1.2) for line in marks)
    labels = [text.get_text() for text in figure.legends[0].get_texts()]
    assert "cycles" in labels
    assert "cycles" not in [t.get_text() for t in draw_tori(view, "speed", [tori]).legends[0].get_texts()]


def test_open_stability_is_not_drawn_as_stable(view, tori):
    counts = tori["unstable_count"].copy()
    counts[3:] = -1
    figure = draw_tori(view, "speed", [Table({**tori.arrays, "unstable_count": counts}, tori.attributes)])
    solid = [line for line in figure.axes[2].get_lines() if line.get_linestyle() == "-"]
    assert max(line.get_xdata().max() for line in solid) == tori["speed"][2]
    assert "unstable or open" in [text.get_text() for text in figure.legends[0].get_texts()]


def test_invariant_curves_are_closed_and_coloured_by_the_parameter(view, tori):
    figure = draw_section(view, "speed", tori, "q000")
    for bearing, axes in enumerate(figure.axes[:2]):
        lines = axes.get_lines()
        assert len(lines) == CURVES
        x, y = view.journal_coordinates(bearing)
        for line in lines:
            points = line.get_xydata()
            np.testing.assert_array_equal(points[0], points[-1])
            match = np.all(np.isclose(tori["section_curve"][:, :, [x, y]], points[:-1]), axis=(1, 2))
            (point,) = np.flatnonzero(match)
            assert (line.get_linestyle() == "-") == (tori["unstable_count"][point] == 0)
        assert len({line.get_color() for line in lines}) == CURVES


def test_each_origin_has_its_diagram_and_each_branch_its_section(synthetic, tmp_path):
    store = synthetic.make_store(tmp_path / "store", 6, parts=("machine", "cycles", "tori"))
    synthetic.write_tori(store, 5, "u000", unbalance=[[2, 1e-7, 0.0]])
    synthetic.write_tori(store, 0, "u001", unbalance=[[2, 1e-7, 0.0]])
    said = []
    written = draw_figures(store, tmp_path / "out", kinds=("tori", "section"), notify=said.append)
    assert [path.name for path in written] == [
        "tori-speed.png",
        "tori-speed-unbalance.png",
        "section-q000.png",
        "section-u000.png",
        "section-u001.png",
    ]
    assert said == []


def test_one_torus_is_drawn_as_points(view, synthetic):
    one = Table(synthetic.tori(1), {"parameter": "speed", "unbalance": []})
    assert all(line.get_marker() == "o" for line in draw_tori(view, "speed", [one]).axes[0].get_lines())
    assert len(draw_section(view, "speed", one, "u000").axes[0].get_lines()) == 1
