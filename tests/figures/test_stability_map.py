"""The map of all curves and the tree of doubled branches: what is drawn, and how."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from matplotlib.figure import Figure

from pipelines.datasets.reading import read_group
from pipelines.figures.contents import Table
from pipelines.figures.drawing import draw_figures
from pipelines.figures.stability_map import (
    PlaneView,
    _draw_regularised,
    incomplete_ends,
    parts_of,
    point_labels,
    special_points,
)
from tests.figures import synthetic_store


@pytest.fixture(scope="module")
def store(tmp_path_factory):
    return synthetic_store.make_store(tmp_path_factory.mktemp("map") / "store", 40)


def view_of(store, *names):
    tables = {}
    for name in names:
        group = read_group(store, f"cases/kb10/{name}")
        tables[name] = Table(group.labelled(), group.attributes)
    return PlaneView.of(tables, {})


@pytest.mark.slow
def test_parts_change_their_look_where_the_type_changes(store):
    """At the Chenciner points in the middle of a step, not at the next row."""
    view = view_of(store, "ns/c000")
    (curve,) = view.curves
    parts = [(look, points) for look, points in parts_of(curve, view) if look.criticality != "unset"]
    assert [look.criticality for look, _ in parts] == ["supercritical", "subcritical"]
    assert all(look.bifurcation == "neimark_sacker" and not look.doubled for look, _ in parts)
    first, second = (points[:, 0] for _, points in parts)
    assert first.max() == pytest.approx(1.52, abs=1e-3)
    assert second.min() == pytest.approx(1.52, abs=1e-3)
    # solid and dashed
    assert len({str(look.options["linestyle"]) for look, _ in parts}) == 2


def test_samples_follow_the_cubics_between_the_rows(store):
    """The synthetic threshold is known in closed form: the drawn line is nearer than the rows' chords."""
    view = view_of(store, "ns/c000")
    (curve,) = view.curves
    points = np.concatenate([part for _, part in parts_of(curve, view)])
    f = points[:, 0]
    rise = 0.17 * np.exp(-(((f - 0.72) / 0.16) ** 2)) - 0.13 * np.exp(-(((f - 0.4) / 0.1) ** 2))
    exact = 1.03 + rise + 0.03 * np.sin(4 * f)
    chords = np.interp(f, curve.points[:, 0], curve.points[:, 1])
    assert np.max(np.abs(points[:, 1] - exact)) < 0.1 * np.max(np.abs(chords - exact))


def test_a_special_point_on_two_curves_is_marked_once(store):
    names = ("ns/c000", "ns/c001", "pd/c000")
    found = special_points(view_of(store, *names))
    alone = sum(len(special_points(view_of(store, name))) for name in names)
    kinds = [kind for kind, *_ in found]
    assert kinds.count("flip_neimark_sacker") == 1, "on the threshold and on the wall of the tongue"
    assert len(found) == alone - 1


def test_a_crowd_of_one_kind_shares_a_label(store):
    """Three in a chain are a crowd with their number, two are not; points of another kind keep their own."""
    view = view_of(store, "ns/c000")
    (low, high), (bottom, top) = (view.ranges[name] for name in (view.x, view.y))
    places = [0.10, 0.12, 0.14, 0.50, 0.52, 0.11]
    kinds = ["chenciner"] * 5 + ["resonance_3"]
    events = {
        "event_kind": np.array(kinds),
        f"event_{view.x}": low + (high - low) * np.array(places),
        f"event_{view.y}": np.full(len(places), 0.5 * (bottom + top)),
        "event_residual": np.zeros(len(places)),
    }
    crowded = replace(view, tables={"ns/c000": Table(events, {})})
    assert sorted(label.text for label in point_labels(crowded)) == ["3 CH", "CH", "CH", "resonance_3"]


@pytest.mark.slow
def test_curves_alone_make_a_map_and_lines_of_the_search_make_no_figure(store, tmp_path):
    written = draw_figures(store, tmp_path, kinds=("stability", "tree"))
    assert [path.name for path in written][-1] == "stability-map.png"
    assert any(path.name.startswith("tree") for path in written)
    every = draw_figures(store, tmp_path, kinds=("multipliers", "orbits", "film", "bifurcation"))
    assert not any("-s0" in path.name for path in every)


def test_parts_with_regularised_clipping_have_a_band(store):
    """From the row before the first such row to the row behind the last one; without one there is none."""
    group = read_group(store, "cases/kb10/ns/c000")
    arrays = group.labelled()
    widths = np.zeros(group.n_points)
    widths[[5, 6, 20]] = 0.01
    tables = {"ns/c000": Table({**arrays, "clipping_width": widths}, group.attributes)}
    view = PlaneView.of(tables, {})
    (curve,) = view.curves
    at = curve.arclength
    assert curve.regularised() == [(at[4], at[7]), (at[19], at[21])]
    axes = Figure().subplots()
    handles = _draw_regularised(axes, view)
    assert [handle.get_label() for handle in handles] == ["regularised clipping"]
    drawn = [line.get_xydata() for line in axes.lines]
    assert len(drawn) == 2
    for points, (first, last) in zip(drawn, ((4, 7), (19, 21)), strict=True):
        assert points[[0, -1]] == pytest.approx(curve.points[[first, last]])
    assert _draw_regularised(Figure().subplots(), view_of(store, "ns/c000")) == []


@pytest.mark.parametrize(
    ("stop", "incomplete"), [("range", 0), ("leaves_boundary", 0), ("minimum_step", 1), (None, 1)]
)
def test_the_end_of_a_curve_of_one_point_is_marked_where_more_of_it_lies_in_the_plane(stop, incomplete):
    """A direction that leaves the plane at once has a single point, of which no line can be drawn."""
    arrays = {"excitation_frequency": np.array([0.2]), "speed": np.array([1.1])}
    ended = {} if stop is None else {"stop_reason": stop}
    table = Table(arrays, {"bifurcation": "neimark_sacker", **ended})
    view = SimpleNamespace(tables={"ns/c001": table}, x="excitation_frequency", y="speed")
    assert incomplete_ends(view) == [("neimark_sacker", 0.2, 1.1)] * incomplete
