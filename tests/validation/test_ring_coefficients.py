"""Ring coefficients against the table of tests/reference, and the printed formulas shown to be a misprint."""

from __future__ import annotations

import csv
import re
from pathlib import Path

import numpy as np
import pytest

from pipelines.case.models import Ring
from pipelines.case.ring_statics import THIN_RING, RingCoefficients, ring_coefficients

TABLE = Path(__file__).parents[1] / "reference" / "ring_coefficients.csv"
with TABLE.open(newline="") as _file:
    ROWS = {row["case"]: row for row in csv.DictReader(_file)}
WALLS = {
    name: (float(match[1]), float(match[2]))
    for name in ROWS
    if (match := re.match(r"rect\. wall Ri=(\d+) t=(\d+)", name))
}


def ring(inner_millimetre: float, wall_millimetre: float) -> Ring:
    return Ring(
        inner_radius=inner_millimetre * 1e-3,
        thickness=wall_millimetre * 1e-3,
        width=0.016,
        young_modulus=2.1e11,
        poisson_ratio=0.3,
    )


def test_thin_ring():
    row = ROWS["thin ring (alpha=beta=0)"]
    assert THIN_RING.horizontal == pytest.approx(float(row["DH_EI_over_WR3"]), abs=0.5e-7)
    assert THIN_RING.vertical == pytest.approx(float(row["DV_EI_over_WR3(abs)"]), abs=0.5e-7)
    assert THIN_RING.ratio == pytest.approx(float(row["DH_over_DV"]), abs=0.5e-6)


def test_the_table_has_four_walls():
    assert len(WALLS) == 4


@pytest.mark.parametrize("name", WALLS)
def test_rectangular_walls(name):
    coefficients = ring_coefficients(ring(*WALLS[name]))
    # printed to four decimals
    assert coefficients.k1 == pytest.approx(float(ROWS[name]["k1"]), abs=0.5e-4)
    assert coefficients.k2 == pytest.approx(float(ROWS[name]["k2"]), abs=0.5e-4)
    assert coefficients.ratio == pytest.approx(float(ROWS[name]["DH_over_DV"]), abs=0.5e-4)


def printed_coefficients(inner: float, outer: float, poisson_ratio: float) -> RingCoefficients:
    """Eq. 24 as printed, with radii in metres (the second correction is not even dimensionless)."""
    first = (outer**4 - inner**4) / (2 * inner**2 * (outer**2 - inner**2))
    second = 1.33 * (1 + 2 * poisson_ratio) * outer / (np.pi * (outer**2 - inner**2))
    return RingCoefficients(k1=1 - first + second, k2=1 - first)


def test_the_printed_formulas_are_far_from_any_ring():
    row = ROWS["paper eq as printed, Ri=20mm t=5mm SI"]
    printed = printed_coefficients(0.020, 0.025, 0.3)
    assert printed.k1 == pytest.approx(float(row["k1"]), abs=0.5e-3)
    assert printed.k2 == pytest.approx(float(row["k2"]), abs=1e-4)
    assert printed.vertical == pytest.approx(float(row["DV_EI_over_WR3(abs)"]), rel=1e-5)
    assert printed.horizontal == pytest.approx(float(row["DH_EI_over_WR3"]), rel=1e-5)
    corrected = ring_coefficients(ring(20, 5))
    # a ring 400 times softer than it is, and k2 of the wrong sign
    assert printed.vertical / corrected.vertical > 300
    assert printed.k2 < 0 < corrected.k2
    # their ratio tends to 2 / pi, whatever the ring
    assert printed.ratio == pytest.approx(float(row["DH_over_DV"]), abs=0.5e-4)
    limit = float(ROWS["limit k2->0 (what the printed kappas give)"]["DH_over_DV"])
    assert RingCoefficients(k1=1.0, k2=0.0).ratio == pytest.approx(limit, abs=0.5e-4)
