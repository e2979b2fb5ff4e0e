"""The stages by name, and the location of their functions.

Imports no stage, so that the command line can ask for names cheaply.  A new stage is a function with the
signature `Stage` and a line here; `pipelines.stages.scheduling.plan` says what a dry run foresees of it.
"""

from __future__ import annotations

from collections.abc import Mapping
from importlib import import_module
from pathlib import Path
from types import MappingProxyType
from typing import Protocol

from pipelines.case.reading import NamedCase
from pipelines.stages.results import Report, ShouldStop, StageResult

STAGES: Mapping[str, str] = MappingProxyType(
    {
        "linearize": "linear.linearize",
        "criticals": "linear.criticals",
        "unbalance_response": "linear.unbalance_response",
        "continue_cycles": "cycles.continue_cycles",
        "track_pd": "curves.track_curves",
        "track_ns": "curves.track_curves",
        "track_folds": "curves.track_curves",
        "bifurcation_set": "curves.bifurcation_set",
        "refine": "refinement.refine",
        "transient": "transients.transient",
        "continue_tori": "tori.continue_tori",
        "calibrate": "calibration.calibrate",
    }
)
"""Module below `pipelines.stages` that has the function of each stage, under the stage's name."""

MOTIONS = frozenset(
    {
        "continue_cycles",
        "track_pd",
        "track_ns",
        "track_folds",
        "bifurcation_set",
        "transient",
        "continue_tori",
    }
)
"""Stages that compute motions of the condensed rotor; their results say how far it is off."""


class Stage(Protocol):
    """The signature of every stage function."""

    def __call__(
        self, named: NamedCase, store_path: Path, report: Report, should_stop: ShouldStop
    ) -> StageResult:
        """Compute one case into its groups of the store."""


def stage_function(stage: str) -> Stage:
    """The function of a stage, imported when first needed: the import compiles or loads the kernels.

    Raises ValueError for a name that is none of `STAGES`.
    """
    if stage not in STAGES:
        raise ValueError(f"stage {stage!r} is not one of {', '.join(STAGES)}")
    function: Stage = getattr(import_module(f"pipelines.stages.{STAGES[stage]}"), stage)
    return function
