"""The search of a plane for equations of one's own, against Mathieu's and Tondl's equations.

A damped Mathieu oscillator at rest has closed forms: two unstable multipliers at negative damping, one inside
the oval of its tongue, and both resonances R2 of its line of Neimark-Sacker points at characteristic values.
Tondl's system has a table of verified points.
"""

from __future__ import annotations

import csv
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

from pipelines.bifurcations.curve import CurveStop, SpecialKind
from pipelines.bifurcations.detection import EventKind
from pipelines.orbits.floquet import BasisOptions
from pipelines.orbits.period_map import Formulation, PeriodMap
from pipelines.orbits.shooting import CycleProblem, ShootingOptions
from pipelines.orbits.steppers import DOPRI8
from pipelines.stages.plane.problem import PlaneOptions, PlaneProblem
from pipelines.stages.plane.search import PlaneSet, certify_plane, search_plane
from pipelines.stages.plane.tracing import trace_curves
from tests.bifurcations.embedded_tondl import embedded_tondl
from tests.systems import damped_mathieu, hopf_pair, mathieu_tongue, tondl

REFERENCE = Path(__file__).parents[1] / "reference"
KINDS = {"NS": EventKind.NEIMARK_SACKER, "PD": EventKind.PERIOD_DOUBLING}
H = 0.2
TONGUE = PlaneProblem(
    CycleProblem(PeriodMap(damped_mathieu(), DOPRI8), np.array([2.0, 0.0, H]), "omega"),
    ("omega", "damping"),
    ((1.6, 2.4), (-1.5, 1.4)),
    np.zeros(2),
    scales=(0.2, 0.5),
)
COARSE = PlaneOptions(lines=(1, 1), line_step=0.1, curve_step=0.2, cells=(13, 9))
TONDL = PlaneProblem(
    CycleProblem(PeriodMap(tondl(), DOPRI8), np.zeros(2), "c1"),
    ("c1", "eta"),
    ((-0.03, 0.1), (0.5, 4.2)),
    np.zeros(4),
    scales=(0.05, 0.5),
)
FINE = PlaneOptions(lines=(3, 1), cells=(14, 38))
EMBEDDED = 28  # further states
ABOVE = 1.3  # frequency beyond which the large system is searched


def table(name: str) -> list[dict[str, str]]:
    return list(csv.DictReader((REFERENCE / f"tondl_{name}.csv").read_text().splitlines()))


def without(found: PlaneSet, kind: EventKind) -> list:  # type: ignore[type-arg]
    return [curve for curve in found.curves if curve.kind is not kind]


@pytest.fixture(scope="module")
def tongue() -> PlaneSet:
    return search_plane(TONGUE, COARSE)


def test_the_tongue_is_complete(tongue: PlaneSet) -> None:
    assert tongue.complete
    assert tongue.summary.disagreements == ()
    assert tongue.comparison.grid.found.max() == 2
    assert {curve.kind for curve in tongue.curves} == set(KINDS.values())
    assert tongue.summary.sentence().startswith("certified on cells of 0.0667 x 0.36")


def test_its_curves_are_those_of_the_closed_form(tongue: PlaneSet) -> None:
    """The line of zero damping, and both characteristic values, where the oval meets it."""
    found = [special for curve in tongue.curves for _, special in curve.special]
    ends = sorted(special.parameters[:2].tolist() for special in found if special.kind is SpecialKind.R2)
    assert np.allclose(ends, [(omega, 0.0) for omega in mathieu_tongue(1, H)], rtol=0, atol=1e-8)
    for curve in tongue.curves:
        if curve.kind is EventKind.NEIMARK_SACKER:
            assert np.max(np.abs(curve.parameters[:, 1])) < 1e-8


def test_a_start_that_fails_is_told() -> None:
    """A guess far from any period doubling gives a curve without points, and leaves the set incomplete."""
    event = SimpleNamespace(
        kind=EventKind.PERIOD_DOUBLING, parameters=np.array([2.35, 1.3, H]), state=np.zeros(2),
        period=2.0 * np.pi / 2.35, angle=np.pi,
    )  # fmt: skip
    (curve,) = trace_curves(TONGUE, COARSE, [event], [])  # type: ignore[list-item]
    assert (curve.stop, curve.is_finished) == (CurveStop.START_FAILED, False)
    assert curve.parameters.shape == (0, 2)
    assert curve.interpolated is None
    assert curve.name == "pd/c000"


@pytest.mark.parametrize(
    "kind", [EventKind.PERIOD_DOUBLING, pytest.param(EventKind.NEIMARK_SACKER, marks=pytest.mark.slow)]
)
def test_a_curve_that_lacks_is_missed_and_found(tongue: PlaneSet, kind: EventKind) -> None:
    rest = without(tongue, kind)
    lacking = certify_plane(TONGUE, COARSE, rest, tongue.survey)
    assert not lacking.certified
    again = search_plane(TONGUE, replace(COARSE, lines=(0, 0)), rest, tongue.survey)
    assert again.complete
    assert len(again.lines) > 0
    assert len({curve.name for curve in again.curves}) == len(again.curves)
    for curve in tongue.curves:
        middle = curve.points[len(curve.points) // 2]
        assert any(
            np.min(np.linalg.norm((other.parameters - middle.parameters) / TONGUE.scales, axis=1)) < 0.1
            for other in again.curves
            if other.kind is curve.kind
        )


def test_no_line_and_no_round_is_a_certificate_alone(tongue: PlaneSet) -> None:
    rest = without(tongue, EventKind.PERIOD_DOUBLING)
    told = search_plane(TONGUE, replace(COARSE, lines=(0, 0), rounds=0), rest, tongue.survey)
    assert (told.curves, told.lines, told.complete) == (tuple(rest), (), False)
    assert len(told.summary.disagreements) > 0
    assert all(abs(each.across) < 1.2 for each in told.summary.disagreements), "in the oval or beside it"


def test_a_curve_that_ended_early_is_not_complete(tongue: PlaneSet) -> None:
    short = [replace(curve, stop=CurveStop.MINIMUM_STEP) for curve in tongue.curves]
    assert not replace(tongue, curves=tuple(short)).complete


@pytest.mark.parametrize(
    ("change", "told"),
    [
        ({"names": ("omega", "omega")}, "two different"),
        ({"names": ("omega", "speed")}, "unknown parameter"),
        ({"ranges": ((2.4, 1.6), (0.0, 1.0))}, "must rise"),
        (
            {
                "cycles": CycleProblem(
                    PeriodMap(hopf_pair(), DOPRI8, Formulation.AUTONOMOUS), np.ones(2), "mu"
                )
            },
            "period of their forcing",
        ),
    ],
)
def test_planes_that_make_no_sense(change: dict[str, object], told: str) -> None:
    with pytest.raises(ValueError, match=told):
        replace(TONGUE, **change)  # type: ignore[arg-type]


@pytest.mark.parametrize("change", [{"lines": (-1, 2)}, {"rounds": -1}, {"cells": (1, 5)}])
def test_options_that_make_no_sense(change: dict[str, object]) -> None:
    with pytest.raises(ValueError, match=r"must not be negative|at least two"):
        PlaneOptions(**change)  # type: ignore[arg-type]


def assert_verified(found: PlaneSet, above: float) -> None:
    """Every verified point beyond a frequency lies on a curve of its kind, between two of its points."""
    assert found.complete
    for row in table("verified_points"):
        kind, c1, eta = KINDS[row["kind"]], float(row["c1"]), float(row["eta"])
        curves = [curve.interpolated for curve in found.curves if curve.kind is kind]
        there = [
            float(curve.at(place)[0])
            for curve in curves
            if curve is not None
            for place in curve.where(1, eta)
        ]
        assert eta < above or any(abs(other - c1) < 5e-5 for other in there), row


@pytest.fixture(scope="module")
def tondls() -> PlaneSet:
    return search_plane(TONDL, FINE)


@pytest.mark.slow
def test_tondls_plane_is_complete(tondls: PlaneSet) -> None:
    """With an oval of period doublings that is 0.0004 high, far less than a cell: R2 leads to it."""
    assert_verified(tondls, 0.0)
    found = [(special.kind, special.parameters) for curve in tondls.curves for _, special in curve.special]
    for row in table("codim2"):
        place = float(row["c1"]), float(row["eta"])
        assert any(
            kind.name == row["kind"] and np.allclose(parameters, place, rtol=0, atol=1e-7)
            for kind, parameters in found
        ), row


@pytest.mark.slow
@pytest.mark.parametrize("kind", list(KINDS.values()))
def test_a_curve_of_tondls_plane_is_missed_and_found(tondls: PlaneSet, kind: EventKind) -> None:
    rest = without(tondls, kind)
    assert not certify_plane(TONDL, FINE, rest, tondls.survey).certified
    again = search_plane(TONDL, replace(FINE, lines=(0, 0)), rest, tondls.survey)
    assert_verified(again, 0.0)


@pytest.mark.slow
def test_tondls_plane_is_complete_in_a_large_system() -> None:
    """The same curves where a slow subspace of 32 states carries them."""
    options = ShootingOptions(basis=BasisOptions(initial_columns=12))
    period_map = PeriodMap(embedded_tondl(EMBEDDED), DOPRI8, samples=32, minimum_steps=32)
    plane = replace(
        TONDL,
        cycles=CycleProblem(period_map, np.zeros(3), "c1", options),
        ranges=((-0.03, 0.08), (ABOVE, 4.0)),
        rest=np.zeros(4 + EMBEDDED),
    )
    assert_verified(search_plane(plane, replace(FINE, cells=(7, 28))), ABOVE)
