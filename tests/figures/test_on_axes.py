"""The main figures on axes of one's own draw what the figures of `agfb figures` draw."""

from __future__ import annotations

import numpy as np
import pytest
from matplotlib.figure import Figure

from pipelines.figures import on_axes
from pipelines.figures.contents import MissingDataError
from pipelines.figures.drawing import _plans
from tests.figures import synthetic_store


@pytest.fixture(scope="module")
def store(tmp_path_factory):
    parts = ("machine", "cycles", "curves", "runs")
    return synthetic_store.make_store(tmp_path_factory.mktemp("axes") / "store", 12, parts=parts)


@pytest.fixture
def axes():
    return Figure().subplots()


def drawn(axes):
    return [line.get_xydata() for line in axes.get_lines()]


def panels(store, stem):
    """The axes of a whole figure."""
    kinds = ["stability", "bifurcation", "envelope"]
    plans = _plans(store, "kb10", kinds, lambda message: None, [], asked=True)
    (plan,) = [plan for plan in plans if plan.stem == stem]
    return plan.draw().axes


@pytest.mark.parametrize(
    ("draw", "stem", "panel"),
    [
        (on_axes.stability_map, "stability-map", 0),
        (on_axes.branch, "bifurcation-speed", 0),
        (lambda store, axes: on_axes.branch(store, axes, direction="horizontal"), "bifurcation-speed", 1),
        (on_axes.transient, "envelope-t000", 0),
        (lambda store, axes: on_axes.transient(store, axes, bearing=2), "envelope-t000", 1),
    ],
)
def test_the_lines_are_those_of_the_figure(store, axes, draw, stem, panel):
    handles = draw(store.path, axes)
    assert handles
    whole = drawn(panels(store, stem)[panel])
    assert len(whole) == len(drawn(axes)) > 1
    for one, other in zip(whole, drawn(axes), strict=True):
        np.testing.assert_array_equal(one, other)
    assert axes.get_xlabel()
    assert axes.get_ylabel()


def test_what_is_missing_is_named(store, axes, tmp_path):
    with pytest.raises(MissingDataError, match="no branch 'b007'; it has b000"):
        on_axes.branch(store, axes, name="b007")
    with pytest.raises(MissingDataError, match="no transient 't009'; it has t000, t001, t002"):
        on_axes.transient(store, axes, name="t009")
    with pytest.raises(MissingDataError, match="no curves over displacement and speed"):
        on_axes.stability_map(store, axes, plane=("speed", "displacement"))
    with pytest.raises(ValueError, match="no case 'kb3' but kb10"):
        on_axes.stability_map(store, axes, case="kb3")
    bare = synthetic_store.make_store(tmp_path / "bare", 3, parts=("machine",))
    with pytest.raises(MissingDataError, match="it has none"):
        on_axes.branch(bare, axes)
