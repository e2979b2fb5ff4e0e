"""Bookkeeping of special points on spectra written down by hand."""

from __future__ import annotations

import math

import numpy as np
import pytest

from pipelines.bifurcations.curve import SpecialKind
from pipelines.bifurcations.curves.codimension_two import crossed, genuine, other_multipliers, resonant_end
from tests.bifurcations.curve_runs import FLIP, FOLD, NS


def values_of(**values: float) -> np.ndarray:
    tests = np.full(len(SpecialKind), math.nan)
    for name, value in values.items():
        tests[SpecialKind[name] - 1] = value
    return tests


def test_sign_changes_and_starts_on_special_points() -> None:
    before, after = values_of(R3=0.1, R4=-0.2, R2=0.3), values_of(R3=-0.1, R4=-0.1, R2=0.1)
    assert crossed(before, after) == (SpecialKind.R3,)
    # the step that arrives on a special point has it, the one that leaves does not
    on = values_of(R3=1e-13, R4=-0.2, R2=0.3)
    assert crossed(before, on) == (SpecialKind.R3,)
    assert crossed(on, after) == ()
    assert crossed(values_of(CUSP=1.0), values_of(R1=-1.0)) == ()


def test_other_multipliers() -> None:
    angle = 1.1
    pair = np.exp(1j * np.array([angle, -angle]))
    spectrum = np.concatenate([pair, [0.9999, -0.98, 0.3]]).astype(complex)
    assert np.allclose(
        np.sort(other_multipliers(NS, spectrum, math.cos(angle), False).real), [-0.98, 0.3, 0.9999]
    )
    assert len(other_multipliers(NS, spectrum, math.cos(angle), True)) == 2
    assert -0.98 not in other_multipliers(FLIP, spectrum, -1.0, False)
    assert 0.9999 not in other_multipliers(FOLD, spectrum, 1.0, False)


def test_neutral_saddles_are_told_apart() -> None:
    complex_pair = np.exp(1j * np.array([1.0, -1.0]))
    real_pair = np.array([1.25, 0.8], dtype=complex)
    for curve, special in (
        (FLIP, SpecialKind.FLIP_NEIMARK_SACKER),
        (FOLD, SpecialKind.FOLD_NEIMARK_SACKER),
        (NS, SpecialKind.DOUBLE_NEIMARK_SACKER),
    ):
        assert genuine(special, curve, complex_pair, 0.3)
        assert not genuine(special, curve, real_pair, 0.3)
        assert not genuine(special, curve, real_pair[:1], 0.3)
    assert genuine(SpecialKind.FLIP_NEIMARK_SACKER, NS, real_pair, 0.3)
    assert not genuine(SpecialKind.R4, NS, complex_pair, 1.1)


@pytest.mark.parametrize(
    ("cos_theta", "expected"), [(1.0, SpecialKind.R1), (-1.0, SpecialKind.R2), (-0.99, None), (0.3, None)]
)
def test_ends_of_a_neimark_sacker_curve(cos_theta: float, expected: SpecialKind | None) -> None:
    assert resonant_end(NS, cos_theta) is expected
    assert resonant_end(FLIP, cos_theta) is None
