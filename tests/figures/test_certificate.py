"""The map of a certificate: the colours of its cells, and marks where the curves do not explain them."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from matplotlib.collections import QuadMesh
from matplotlib.figure import Figure

from pipelines.figures.case_tables import read_case
from pipelines.figures.certificate import COUNTS, MARKS, draw_certificate
from tests.figures.synthetic_store import make_store
from tests.helpers.curves import PLANE
from tests.helpers.surveys import write_certificate


def drawn(path: Path, disagreeing: tuple[int, int] | None) -> Figure:
    store = make_store(path, parts=("machine", "curves"))
    write_certificate(store, "kb10", disagreeing)
    held = read_case(store, "kb10", ("certificate", "curve"), print, [])
    assert held is not None
    return draw_certificate(held.view, held.of_kind("certificate")["r000"], held.curves)


def marked(figure: Figure, verdict: str) -> list[tuple[float, float]]:
    marker = MARKS[verdict][1]["marker"]
    lines = [line for line in figure.axes[0].lines if line.get_marker() == marker]
    return [(float(x), float(y)) for line in lines for x, y in zip(*line.get_data(), strict=True)]


def test_cells_have_the_colour_of_their_number_and_disagreements_a_cross(tmp_path: Path) -> None:
    figure = drawn(tmp_path / "a.zarr", (4, 7))
    (mesh,) = [each for each in figure.axes[0].collections if isinstance(each, QuadMesh)]
    across = np.linspace(*PLANE[1], 7)
    np.testing.assert_array_equal(mesh.get_array(), np.where(across[:, None] > 0.9, 2, 0) + np.zeros((7, 10)))
    assert marked(figure, "disagrees") == [pytest.approx((np.linspace(*PLANE[0], 10)[7], across[4]))]
    assert marked(figure, "agrees") == [pytest.approx((0.5, 1.0)), pytest.approx((1.0, 1.0 / 1.5))]
    assert marked(figure, "not_decided") == [pytest.approx((1.5, 0.5 / 1.5))]
    labels = [text.get_text() for text in figure.legends[0].get_texts()]
    assert labels[:2] == [COUNTS[0], COUNTS[2]]
    assert MARKS["disagrees"][0] in labels
    assert "Neimark–Sacker (NS)" in labels, "the curves are drawn"
    assert "not certified on cells of 0.2 × 0.2" in figure.get_suptitle()


def test_a_certified_plane_has_no_cross(tmp_path: Path) -> None:
    figure = drawn(tmp_path / "a.zarr", None)
    assert marked(figure, "disagrees") == []
    assert ": bifurcation set, certified" in figure.get_suptitle()
