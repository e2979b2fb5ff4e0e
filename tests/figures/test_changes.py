"""The figure of single changes: which cases are compared, and what is drawn of them."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from pipelines.case.reading import NamedCase, read_cases
from pipelines.datasets.branch import open_branch
from pipelines.datasets.case_table import CaseTable, case_table
from pipelines.datasets.schema import KINDS
from pipelines.datasets.store import Store, open_for_writing
from pipelines.figures.bifurcation_diagram import EVENT_MARKS
from pipelines.figures.changes import BASE, change_panels, draw_changes
from pipelines.figures.drawing import draw_figures
from pipelines.stages.scheduling.preparation import prepare_store
from tests.helpers.tiny import CONFIG

SWEEP = """
[sweep]
"excitation.frequency" = [0.2, 0.7]
"bearings.foil.pressure, excitation.ratio" = [["absolute", 0.9], ["gauge", 0.9], ["absolute", 0.6]]
"""


def swept() -> tuple[NamedCase, ...]:
    return read_cases(CONFIG.read_text() + SWEEP, "smoke.toml", (), ())


def speed_of(frequency: float, pressure: str, ratio: float) -> float:
    """A first bifurcation that is known: another pressure lowers it, another ratio raises it."""
    return 1.0 + 0.1 * frequency - 0.2 * (pressure == "gauge") + 0.5 * (0.9 - ratio)


@pytest.fixture(scope="module")
def store(tmp_path_factory: pytest.TempPathFactory) -> Store:
    """Six cases with a branch each; at the lower frequency nothing bifurcates with the smaller ratio."""
    cases = swept()
    path = tmp_path_factory.mktemp("changes") / "a.zarr"
    prepare_store(path, cases, ["agfb", "test"])
    opened = open_for_writing(path, durable=False)
    kinds = KINDS["cycles"].array("event_kind")
    for named in cases:
        frequency, ratio = named.case.excitation.frequency, named.case.excitation.ratio
        pressure = named.case.bearings[0].foil.pressure
        group = f"cases/{named.case_id}/cycles/b000"
        with open_branch(opened, group, "cycles", {"point": 1}, {}, {"parameter": "speed"}) as writer:
            zeros = {name: 0 for name, array in writer.arrays.items() if array.role == "row"}
            slots = {name: 0 for name, array in writer.arrays.items() if array.role == "slot"}
            events = []
            if (frequency, ratio) != (0.2, 0.6):
                kind = kinds.flag("period_doubling" if pressure == "gauge" else "neimark_sacker")
                place = {"event_kind": kind, "event_speed": speed_of(frequency, pressure, ratio)}
                own = {name: 0 for name, array in writer.arrays.items() if array.role == "event"}
                events = [own | place]
            writer.commit(zeros, slots, events)
            writer.finish("range")
    return opened


@pytest.fixture(scope="module")
def table(store: Store) -> CaseTable:
    cases = [named.case_id for named in swept()]
    return case_table(store, cases)


def test_every_change_stands_beside_the_base_of_its_own_panel(table: CaseTable) -> None:
    panels = change_panels(table)
    assert [panel.title for panel in panels] == ["frequency = 0.2", "frequency = 0.7"]
    for frequency, panel in zip((0.2, 0.7), panels, strict=True):
        assert [each.label for each in panel.changes] == [BASE, "pressure = gauge", "ratio = 0.6"]
        assert panel.base == pytest.approx(speed_of(frequency, "absolute", 0.9))
        assert panel.changes[1].speed == pytest.approx(speed_of(frequency, "gauge", 0.9))
        assert panel.changes[1].kind == "period_doubling"
    assert np.isnan(panels[0].changes[2].speed)
    assert panels[1].changes[2].speed == pytest.approx(speed_of(0.7, "absolute", 0.6))


def test_the_base_has_the_values_of_most_cases_wherever_it_stands(store: Store, table: CaseTable) -> None:
    backwards = change_panels(case_table(store, table.cases[::-1]))
    assert [panel.changes[0].label for panel in backwards] == [BASE, BASE]
    assert backwards[0].base == pytest.approx(speed_of(0.2, "absolute", 0.9))


def test_the_figure_shows_every_speed_and_the_base(table: CaseTable) -> None:
    panels = change_panels(table)
    figure = draw_changes(panels, "a note")
    for panel, axes in zip(panels, figure.axes, strict=False):
        assert axes.get_title() == panel.title
        drawn = {
            float(line.get_xdata()[0])  # type: ignore[index]
            for line in axes.lines
            if line.get_marker() in [mark.marker for mark in EVENT_MARKS.values()]
        }
        assert drawn == {each.speed for each in panel.changes if np.isfinite(each.speed)}
        assert ("none" in {text.get_text() for text in axes.texts}) == (panel is panels[0])
    labels = [text.get_text() for text in figure.axes[0].get_yticklabels()]
    assert labels == [BASE, "pressure = gauge", "ratio = 0.6"]


def test_it_is_drawn_on_request_only(store: Store, tmp_path: Path) -> None:
    told: list[str] = []
    written = draw_figures(store, tmp_path / "asked", kinds=("changes",), notify=told.append)
    assert [path.name for path in written] == ["changes.png"]
    assert not told
    usual = draw_figures(store, tmp_path / "usual", kinds=None, notify=told.append)
    assert "changes.png" not in {path.name for path in usual}
    alone = draw_figures(
        store, tmp_path / "one", cases="*0.2*absolute*0.9*", kinds=("changes",), notify=told.append
    )
    assert alone == []
    assert any("changes is left out" in message for message in told)
