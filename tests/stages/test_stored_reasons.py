"""Why a group ended, in the words that stores of earlier versions have: later runs compare them."""

from __future__ import annotations

from enum import Enum

import pytest

from pipelines.bifurcations.branch import BranchStop
from pipelines.bifurcations.curve import CurveStop
from pipelines.bifurcations.tori.torus import TorusStop
from pipelines.stages.calibration import calibrate
from pipelines.stages.cycles.branch import NO_START
from pipelines.stages.ending import stop_reasons
from pipelines.stages.linear import criticals
from pipelines.stages.refinement import refine
from pipelines.stages.transients import transient

CONTINUED = {"range", "maximum_points", "minimum_step", "limit", "interrupted", "start_failed"}


def test_reasons_of_sweeps_and_searches() -> None:
    assert calibrate.OUT_OF_EVALUATIONS == "the allowed number of machines is computed"
    assert (calibrate.CONVERGED, NO_START) == ("converged", "no_start")
    assert refine.ALL_RECOMPUTED == "all points are recomputed"
    assert sorted(transient.SUCCESSFUL) == ["finished", "touch", "vacuum"]
    assert sorted(criticals.SUCCESSFUL) == [
        "all speeds are computed",
        "no critical speed lies inside the range",
        "some speeds have no equilibrium",
    ]


@pytest.mark.parametrize(
    ("stops", "own"),
    [
        (BranchStop, {"closed"}),
        (CurveStop, {"closed", "leaves_boundary", "resonance_1", "resonance_2", "traced"}),
        (TorusStop, {"rough", "collapsed"}),
    ],
)
def test_reasons_of_continuations(stops: type[Enum], own: set[str]) -> None:
    assert stop_reasons(stops) == CONTINUED | own
