"""What is drawn is what the data say, seen on the artists of each figure."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from matplotlib.collections import PathCollection
from matplotlib.patches import Polygon, Rectangle

from pipelines.figures.axes import add_parameter_axis, gaps, limits
from pipelines.figures.bifurcation_diagram import draw_bifurcation_diagram, thread_events
from pipelines.figures.campbell import draw_campbell, largest_deflection, stretches
from pipelines.figures.condensation import draw_condensation
from pipelines.figures.contents import MissingDataError, Table
from pipelines.figures.linearization import draw_linearization, least_damped
from pipelines.figures.machine_drawing import draw_machine
from pipelines.figures.multipliers import draw_multipliers
from pipelines.figures.orbits import (
    draw_film,
    draw_orbits,
    last_stable_point,
    once_around,
    representative_points,
)
from pipelines.figures.style import FORMATS, new_figure, save_figure
from tests.helpers.faults import fault, full_disk


def without(table, *names):
    return Table({k: v for k, v in table.arrays.items() if k not in names}, table.attributes)


@pytest.fixture(scope="module")
def figures(view, branch, criticals, linear):
    return {
        "bifurcation": draw_bifurcation_diagram(view, "speed", [branch]),
        "multipliers": draw_multipliers(view, "speed", branch, "b000"),
        "orbits": draw_orbits(view, "speed", branch, "b000"),
        "film": draw_film(view, "speed", branch, "b000"),
        "machine": draw_machine(view),
        "campbell": draw_campbell(view, criticals),
        "condensation": draw_condensation(view, criticals),
        "linearization": draw_linearization(view, linear),
    }


KINDS = (
    "bifurcation", "multipliers", "orbits", "film", "machine", "campbell", "condensation", "linearization",
)  # fmt: skip


@pytest.mark.slow
@pytest.mark.parametrize("kind", KINDS)
def test_heading_legend_and_panels_keep_apart(figures, kind):
    figure = figures[kind]
    renderer = figure.canvas.get_renderer()
    whole = figure.bbox
    legends = [legend for part in (figure, *figure.subfigs) for legend in part.legends]
    heading = figure.get_suptitle()
    assert heading.startswith("kb10")
    boxes = [legend.get_window_extent(renderer) for legend in legends] + [
        figure._suptitle.get_window_extent()
    ]
    assert legends
    for box in boxes:
        assert whole.x0 <= box.x0 < box.x1 <= whole.x1
        assert whole.y0 <= box.y0 < box.y1 <= whole.y1
        for axes in figure.axes:
            assert not box.overlaps(axes.get_tightbbox(renderer))


@pytest.mark.parametrize("kind", FORMATS)
def test_a_full_disk_is_told_with_the_name_of_the_figure(tmp_path, kind):
    path = tmp_path / f"machine.{kind}"
    with fault(1, full_disk()), pytest.raises(OSError, match="No space left") as caught:
        save_figure(new_figure(1.0), path)
    assert caught.value.filename == str(path)
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize("kind", KINDS)
def test_the_note_on_the_machine_is_shown(figures, kind):
    notes = [text.get_text() for text in figures[kind].artists if hasattr(text, "get_text")]
    assert notes == ["Invented numbers."]


def test_no_note_where_the_case_has_none(view):
    assert not draw_machine(replace(view, note="")).artists


def test_events_lie_on_the_curve_and_split_the_stability(branch):
    curve = thread_events(branch, "speed", branch["speed"][:, None])
    np.testing.assert_allclose(curve.parameter[curve.event_rows], [0.5, 0.62, 1.2], rtol=0, atol=0)
    assert np.all(np.diff(curve.parameter) > 0)
    # the value drawn is the speed itself, so a straight line through the neighbours gives it back
    np.testing.assert_allclose(curve.values[:, 0], curve.parameter, atol=1e-12)
    middle = 0.5 * (curve.parameter[1:] + curve.parameter[:-1])
    expected = (middle < 0.5) | ((middle > 0.62) & (middle < 1.2))
    np.testing.assert_array_equal(curve.stable, expected)


def test_a_fold_between_two_points_of_equal_parameter_is_drawn_in_between():
    arrays = {
        "speed": np.array([0.9, 1.0, 1.0, 0.9]),
        "unstable_count": np.array([0, 0, 1, 1]),
        "state": np.array([[0.0], [1.0], [2.0], [3.0]]),
        "event_kind": np.array(["fold"]),
        "event_after_point": np.array([1]),
        "event_speed": np.array([1.02]),
        "event_state": np.array([[1.25]]),
        "event_residual": np.array([1e-12]),
    }
    curve = thread_events(Table(arrays), "speed", np.array([[0.0], [1.0], [2.0], [3.0]]))
    np.testing.assert_allclose(curve.parameter, [0.9, 1.0, 1.02, 1.0, 0.9])
    np.testing.assert_allclose(curve.values[:, 0], [0.0, 1.0, 1.25, 2.0, 3.0])
    np.testing.assert_array_equal(curve.stable, [True, True, False, False])


def test_without_events_a_stretch_is_stable_when_both_its_ends_are(branch):
    names = [name for name in branch.arrays if name.startswith("event_")]
    curve = thread_events(without(branch, *names), "speed", branch["speed"][:, None])
    stable = branch["unstable_count"] == 0
    np.testing.assert_array_equal(curve.stable, stable[1:] & stable[:-1])


def test_bifurcation_diagram_dashes_what_is_unstable(figures, branch):
    for axes in figures["bifurcation"].axes:
        lines = [line for line in axes.get_lines() if len(line.get_xdata()) > 1]
        solid = [line for line in lines if line.get_linestyle() == "-"]
        dashed = [line for line in lines if line.get_linestyle() == "--"]
        spans = {(round(l.get_xdata()[0], 6), round(l.get_xdata()[-1], 6)) for l in dashed}  # noqa: E741
        assert spans == {(0.5, 0.62), (1.2, 1.3)}
        assert {(round(l.get_xdata()[0], 6), round(l.get_xdata()[-1], 6)) for l in solid} == {  # noqa: E741
            (0.3, 0.5),
            (0.62, 1.2),
        }


def test_bifurcation_diagram_shows_the_stored_extremes(figures, branch, view):
    vertical = figures["bifurcation"].axes[0]
    drawn = np.concatenate([line.get_ydata() for line in vertical.get_lines()])
    for bearing in range(2):
        column = view.journal_coordinates(bearing)[1]
        for extreme in ("orbit_minimum", "orbit_maximum"):
            assert np.isin(branch[extreme][:, column], drawn).all()


def test_every_multiplier_is_drawn_and_no_padding(figures, branch):
    plane = figures["multipliers"].axes[0]
    (points,) = [c for c in plane.collections if isinstance(c, PathCollection)]
    values = np.asarray(branch["multipliers"])
    known = values[np.isfinite(values)]
    np.testing.assert_array_equal(points.get_offsets(), np.column_stack([known.real, known.imag]))
    rows = np.nonzero(np.isfinite(values))[0]
    np.testing.assert_array_equal(points.get_array(), branch["speed"][rows])


def test_located_crossings_are_marked_at_their_angle(figures):
    close = figures["multipliers"].axes[1]
    marks = sorted(float(line.get_xdata()[0]) for line in close.get_lines() if line.get_marker() != "None")
    np.testing.assert_allclose(marks, [np.degrees(2.05), 180.0, 180.0])


def test_dimensional_axes_are_the_dimensionless_ones_scaled(view):
    for parameter, factor in (("speed", 18000.0), ("excitation_frequency", 300.0), ("displacement", 20.0),
                              ("foil_stiffness", 5.0)):  # fmt: skip
        figure = new_figure(2.0)
        axes = figure.subplots()
        axes.set_xlim(0.2, 1.4)
        add_parameter_axis(axes, parameter, view.scales)
        figure.draw_without_rendering()
        (second,) = axes.child_axes
        np.testing.assert_allclose(second.get_xlim(), (0.2 * factor, 1.4 * factor))


def test_limits_ignore_what_is_not_finite():
    assert limits([1.0, np.nan, 3.0], 0.0) == (1.0, 3.0)
    assert limits([np.nan]) == (0.0, 1.0)
    low, high = limits([2.0])
    assert low < 2.0 < high


def test_machine_is_to_scale(figures, view):
    axes = figures["machine"].axes[0]
    assert axes.get_aspect() == 1.0
    drawn = [p.get_bbox() for p in axes.patches if isinstance(p, Rectangle)]
    drawn += [p.get_path().get_extents() for p in axes.patches if isinstance(p, Polygon)]
    boxes = [(box.x0, box.width, box.height) for box in drawn]
    length, diameter = 360.0 / 14, 17.6
    shafts = [box for box in boxes if np.isclose(box[2], diameter)]
    np.testing.assert_allclose(sorted(x for x, _, _ in shafts), np.arange(14) * length)
    np.testing.assert_allclose([width for _, width, _ in shafts], length)
    assert sum(np.isclose(height, 8.0) for _, _, height in boxes) == 4  # bores of the hollow part
    assert sum(np.isclose(height, 54.0) for _, _, height in boxes) == 2  # discs
    bearings = [x + 0.5 * width for x, width, _ in boxes if np.isclose(width, 16.1)]
    np.testing.assert_allclose(sorted(set(np.round(bearings, 6))), np.round([2 * length, 12 * length], 6))


def test_machine_numbers_every_node_and_names_its_materials(figures):
    axes = figures["machine"].axes[0]
    assert {str(node) for node in range(15)} <= {text.get_text() for text in axes.texts}
    (legend,) = figures["machine"].legends
    assert {"steel", "titanium"} <= {text.get_text() for text in legend.get_texts()}


def test_mode_shape_is_shown_when_farthest_from_the_axis():
    rng = np.random.default_rng(7)
    shape = rng.normal(size=(9, 2)) + 1j * rng.normal(size=(9, 2))
    turned = largest_deflection(shape)
    reach = np.linalg.norm(turned.real)
    for angle in np.linspace(0.0, 2.0 * np.pi, 181):
        assert np.linalg.norm(np.real(turned * np.exp(1j * angle))) <= reach * (1 + 1e-12)
    assert np.max(np.linalg.norm(turned, axis=1)) == pytest.approx(1.0)
    # one factor for all nodes: the shape itself is kept
    ratio = turned / shape
    np.testing.assert_allclose(ratio, ratio[0, 0] * np.ones_like(ratio))


def test_campbell_marks_the_critical_speeds_on_the_synchronous_line(figures, criticals):
    axes = figures["campbell"].axes[0]
    marks = [line.get_xydata()[0] for line in axes.get_lines() if line.get_marker() == "o"]
    np.testing.assert_allclose(marks, np.repeat(criticals["critical_speed"][:, None], 2, axis=1))


def test_campbell_without_criticals_and_resonances(view, criticals):
    empty = {
        name: values[:0] if name.startswith(("critical_", "resonance_")) else values
        for name, values in criticals.arrays.items()
    }
    figure = draw_campbell(view, Table(empty))
    assert len(figure.subfigs) == 1


def test_linearization_without_an_instability(figures, view, linear):
    figure = draw_linearization(view, Table(linear.arrays, {"instability_speed": None}))
    assert "instability" not in figure.get_suptitle()
    assert "instability" in figures["linearization"].get_suptitle()


def test_orbits_are_closed_and_of_points_along_the_whole_branch(figures, branch, view):
    points = representative_points(branch)
    assert points[0] == 0
    assert points[-1] == len(branch["speed"]) - 1
    whole = figures["orbits"].axes[0]
    x, y = view.journal_coordinates(0)
    closed = [line.get_xydata() for line in whole.get_lines() if len(line.get_xdata()) > 10]
    assert len(closed) == len(points)
    for line, point in zip(closed, points, strict=True):
        np.testing.assert_array_equal(line[0], line[-1])
        np.testing.assert_array_equal(line[:-1], branch["orbit"][point][:, [x, y]])


def test_film_is_that_of_the_last_stable_cycle(figures, branch):
    point = last_stable_point(branch)
    assert branch["speed"][point] < 1.2 < branch["speed"][point + 1]
    pressure = figures["film"].axes[0]
    drawn = [line.get_ydata() for line in pressure.get_lines() if len(line.get_xdata()) > 2]
    np.testing.assert_array_equal(drawn, branch["film_pressure"][point, ::2, 0])


def test_film_is_shown_once_around_from_its_edge():
    nodes = np.array([105.0, 120.0, 435.0, np.nan])  # an edge at 90 degrees, padded
    assert once_around(nodes) == (90.0, 450.0)


def test_a_bifurcation_that_was_not_located_is_hollow(view, branch):
    residual = branch["event_residual"].copy()
    residual[1] = np.nan
    figure = draw_bifurcation_diagram(
        view, "speed", [Table({**branch.arrays, "event_residual": residual}, branch.attributes)]
    )
    marks = [line for line in figure.axes[0].get_lines() if line.get_marker() == "D"]
    hollow = {float(line.get_xdata()[0]) for line in marks if line.get_markerfacecolor() == "white"}
    assert hollow == {0.62}


def test_campbell_lines_leave_a_point_with_its_direction():
    values = stretches(np.arange(5.0), np.array([False, True, False, False, True]))
    np.testing.assert_array_equal(values, [np.nan, 1.0, 2.0, np.nan, 4.0])


def test_growth_axis_is_made_for_the_least_damped_eigenvalues():
    eigenvalues = np.array([[-9.0 + 1j, -0.1 + 1j, 0.2 + 0j, np.nan, -0.3 - 1j, -0.4 + 2j, -0.5 + 1j]])
    chosen = np.isfinite(eigenvalues) & (eigenvalues.imag >= 0)
    np.testing.assert_allclose(least_damped(eigenvalues, chosen), [[0.2, -0.1, -0.4, -0.5]])


def test_a_missing_array_is_named(view, branch):
    with pytest.raises(MissingDataError, match="film_pressure"):
        draw_film(view, "speed", without(branch, "film_pressure"), "b000")


@pytest.mark.parametrize(
    ("present", "expected"),
    [
        ([1, 1, 1, 1], []),
        ([1, 0, 1, 1], [(0.0, 2.0)]),
        ([0, 0, 1, 1], [(0.0, 2.0)]),
        ([1, 1, 1, 0], [(2.0, 3.0)]),
        ([0, 0, 0, 0], [(0.0, 3.0)]),
    ],
)
def test_gaps_lie_between_the_points_with_results(present, expected):
    assert gaps(np.arange(4.0), np.array(present, dtype=bool)) == expected


def shaded(axes):
    """Stretches of x that are shaded."""
    return [(patch.get_x(), patch.get_x() + patch.get_width()) for patch in axes.patches]


def with_gap(table, *names):
    """The table with the speeds 3 and 4 lost."""
    arrays = {name: values.copy() for name, values in table.arrays.items()}
    for name in names:
        arrays[name][3:5] = np.nan
    return Table(arrays, table.attributes)


def test_speeds_without_equilibrium_are_a_gap_in_the_campbell_diagram(figures, view, criticals):
    assert shaded(figures["campbell"].axes[0]) == []
    lost = with_gap(criticals, "frequency", "damping_ratio")
    figure = draw_campbell(view, lost)
    low, high = criticals["speed"][2], criticals["speed"][5]
    assert shaded(figure.axes[0]) == [pytest.approx((low, high))]
    assert "no equilibrium" in [text.get_text() for text in figure.subfigs[0].legends[0].get_texts()]
    for lines in figure.axes[0].collections:
        for segment in lines.get_segments():
            assert not (low < segment[:, 0].mean() < high)


def test_speeds_without_equilibrium_are_a_gap_in_the_linearization(view, linear):
    lost = with_gap(linear, "journal", "minimum_film", "eigenvalues", "bearing_stiffness", "bearing_damping")
    figure = draw_linearization(view, lost)
    panels = [axes for axes in figure.axes if "speed" in axes.get_xlabel()]
    assert len(panels) == 7
    for axes in panels:
        assert shaded(axes) == [pytest.approx((linear["speed"][2], linear["speed"][5]))]
