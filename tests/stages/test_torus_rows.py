"""Bifurcations of tori as rows of a store."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest

from pipelines.bifurcations.tori.events import TorusEvent, TorusEventKind
from pipelines.bifurcations.tori.problem import TorusUnknowns
from pipelines.datasets.records import Group
from pipelines.stages.tori.rows import event_row
from tests.helpers.tiny import tiny_case


@pytest.mark.parametrize(("destabilises", "expected"), [(True, "lost"), (False, "gained"), (None, "unset")])
def test_the_change_of_stability_at_a_bifurcation(destabilises: bool | None, expected: str) -> None:
    at = TorusUnknowns(np.zeros((3, 2)), 1.0, 0.9)
    event = TorusEvent(TorusEventKind.FOLD, at, np.array([1.0]), 0.1, destabilises, 0.0)
    circle = SimpleNamespace(parameters_at=lambda _: np.ones(4))
    row = event_row(tiny_case().case, circle, event, SimpleNamespace(index=1))  # type: ignore[arg-type]
    stored = Group("q000", "tori", {}, {"event_stability": np.array([row["event_stability"]])})
    assert stored.labels("event_stability").tolist() == [expected]
