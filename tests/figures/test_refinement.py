"""Errors of bifurcations as they are drawn on maps and diagrams."""

from __future__ import annotations

import numpy as np
import pytest
from matplotlib.colors import to_hex

from pipelines.datasets.schema import KINDS
from pipelines.figures import style
from pipelines.figures.bifurcation_diagram import draw_bifurcation_diagram
from pipelines.figures.contents import Table
from pipelines.figures.refinement import draw_refinement, error_bar, event_bars

MAP = ("excitation_frequency", "speed")


def refinement(**changes) -> Table:
    """A point refined in the speed, one in the excitation frequency, one with a bound, one that failed."""
    arrays = {
        "bifurcation": np.array(["neimark_sacker", "period_doubling", "neimark_sacker", "period_doubling"]),
        "status": np.array(["refined", "refined", "bound", "not_converged"]),
        "free": np.array(["speed", "excitation_frequency", "speed", "speed"]),
        "speed": np.array([1.2, 1.1, 1.0, 0.9]),
        "excitation_frequency": np.array([0.7, 0.8, 0.9, 0.95]),
        "displacement": np.full(4, 0.2),
        "foil_stiffness": np.full(4, 10.0),
        "value": np.array([1.2, 0.8, 1.0, 0.9]),
        "richardson": np.array([1.22, 0.79, 0.97, np.nan]),
        "richardson_error": np.array([0.002, 0.001, 0.01, np.nan]),
        "error": np.array([0.02, 0.01, 0.03, np.nan]),
    }
    assert set(arrays) <= {spec.name for spec in KINDS["refinement"].arrays}
    return Table(arrays | changes)


def drawn_lines(axes) -> list[list[tuple[float, float]]]:
    """Ends of the bars that have a length."""
    lines = [np.asarray(line.get_xydata(), dtype=float).round(9) for line in axes.get_lines()]
    return [[tuple(map(float, end)) for end in line] for line in lines if len(line) == 2]


def test_bars_lie_along_the_free_parameter() -> None:
    axes = style.new_figure(3.0).subplots()
    handles = draw_refinement(axes, refinement(), *MAP)
    assert drawn_lines(axes) == [
        [(0.7, 1.2), (0.7, 1.22)],
        [(0.8, 1.1), (0.79, 1.1)],
        [(0.9, 0.97), (0.9, 1.03)],
    ]
    crosses = [line.get_xydata().T for line in axes.get_lines() if line.get_marker() == "x"]
    assert [(float(x[0]), float(y[0])) for x, y in crosses] == [(0.7, 1.22), (0.79, 1.1)]
    whiskers = [np.ptp(path.vertices, axis=0) for part in axes.collections for path in part.get_paths()]
    np.testing.assert_allclose(whiskers, [[0.0, 0.004], [0.002, 0.0]], atol=1e-12)
    assert [handle.get_label() for handle in handles] == [
        "extrapolated from finer grids",
        "bound of the error",
    ]
    assert to_hex(handles[1].get_color()) == style.GREY.lower()


def test_the_other_way_round() -> None:
    axes = style.new_figure(3.0).subplots()
    draw_refinement(axes, refinement(), *MAP[::-1])
    assert drawn_lines(axes)[0] == [(1.2, 0.7), (1.22, 0.7)]


def test_what_is_on_neither_axis_or_failed_is_not_drawn() -> None:
    axes = style.new_figure(3.0).subplots()
    assert draw_refinement(axes, refinement(), "displacement", "foil_stiffness") == []
    assert error_bar(refinement(), 3) is None
    assert axes.get_lines() == []
    empty = Table({name: values[:0] for name, values in refinement().arrays.items()})
    assert draw_refinement(axes, empty, *MAP) == []


def matching(branch: Table) -> Table:
    """A refinement whose first row is the last event of the branch."""
    parameters = ("speed", "excitation_frequency", "displacement", "foil_stiffness")
    changes = {name: np.append(branch[f"event_{name}"][-1:], refinement()[name][1:]) for name in parameters}
    value = changes["speed"][0]
    return refinement(
        **changes,
        bifurcation=np.append(branch["event_kind"][-1:], refinement()["bifurcation"][1:]),
        richardson=np.append(value + 0.02, refinement()["richardson"][1:]),
        value=np.append(value, refinement()["value"][1:]),
    )


def test_events_are_recognised_by_their_parameters(branch) -> None:
    table = matching(branch)
    *others, last = event_bars(table, branch, "speed")
    assert others == [None] * len(others)
    value = float(branch["event_speed"][-1])
    assert last is not None
    assert last.ends == pytest.approx((value, value + 0.02))
    assert event_bars(table, branch, "displacement") == [None] * (len(others) + 1)
    assert event_bars(None, branch, "speed") == [None] * (len(others) + 1)
    moved = Table(branch.arrays | {"event_speed": branch["event_speed"] + 1e-6})
    assert set(event_bars(table, moved, "speed")) == {None}, "told of another branch"


def test_the_diagram_has_a_bar_at_every_mark_of_a_refined_event(view, branch) -> None:
    figure = draw_bifurcation_diagram(view, "speed", [branch], matching(branch))
    value = float(branch["event_speed"][-1])
    for axes, columns in zip(figure.axes[:3], (2, 2, 1), strict=True):
        bars = [line for line in drawn_lines(axes) if line[0][0] == pytest.approx(value, abs=1e-9)]
        bars = [bar for bar in bars if bar[1][0] == pytest.approx(value + 0.02, abs=1e-9)]
        marks = {
            round(float(line.get_ydata()[0]), 9)
            for line in axes.get_lines()
            if len(line.get_ydata()) == 1 and line.get_xdata()[0] == pytest.approx(value)
        }
        assert len(bars) == columns * view.bearings
        assert {bar[0][1] for bar in bars} == marks
    (legend,) = figure.legends
    assert "extrapolated from finer grids" in [text.get_text() for text in legend.get_texts()]
