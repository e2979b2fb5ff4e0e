"""The stages by name, and the location of their functions.

Imports no stage, so that the command line can ask for names cheaply.  A new stage is a function with the
signature `Stage` and a line here, and a plan if it consists of parts (`pipelines.stages.parts`);
`pipelines.stages.scheduling.plan` says what a dry run foresees of it.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from importlib import import_module
from pathlib import Path
from types import MappingProxyType
from typing import TYPE_CHECKING, Any, Protocol

from pipelines.case.reading import NamedCase
from pipelines.stages.results import Report, ShouldStop, StageResult

if TYPE_CHECKING:
    from pipelines.stages.parts import Plan

STAGES: Mapping[str, str] = MappingProxyType(
    {
        "linearize": "linear.linearize",
        "coefficients": "linear.coefficients",
        "criticals": "linear.criticals",
        "unbalance_response": "linear.unbalance_response",
        "continue_cycles": "cycles.continue_cycles",
        "track_pd": "curves.track_curves",
        "track_ns": "curves.track_curves",
        "track_folds": "curves.track_curves",
        "bifurcation_set": "curves.bifurcation_set",
        "survey": "survey.survey",
        "refine": "refinement.refine",
        "transient": "transients.transient",
        "continue_tori": "tori.continue_tori",
        "calibrate": "calibration.calibrate",
    }
)
"""Module below `pipelines.stages` that has the function of each stage, under the stage's name."""

DIVIDED = frozenset(
    {"continue_cycles", "track_pd", "track_ns", "track_folds", "bifurcation_set", "survey", "refine"}
)
"""Stages that consist of parts; the module of each has the function ``plan_<stage>`` beside its own."""

AWAITED: Mapping[str, frozenset[str]] = MappingProxyType(
    {
        "linearize": frozenset(),
        "criticals": frozenset(),
        "continue_cycles": frozenset(),
        "bifurcation_set": frozenset({"criticals"}),  # for the resonances at which it has lines
    }
)
"""The stages that must have ended before a stage begins; all earlier ones for those that are not named."""

MOTIONS = frozenset(
    {
        "continue_cycles",
        "track_pd",
        "track_ns",
        "track_folds",
        "bifurcation_set",
        "survey",
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
    function: Stage = _from_module(stage, stage)
    return function


def modules(stages: Iterable[str]) -> list[str]:
    """The modules that workers need for some stages, in the order in which they are imported."""
    return [
        *dict.fromkeys(f"pipelines.stages.{STAGES[stage]}" for stage in stages if stage in STAGES),
        "pipelines.stages.scheduling.campaign",
    ]


def plan_function(stage: str) -> Callable[[NamedCase, Path, Report, ShouldStop], Plan]:
    """The function that makes the plan of one of the stages `DIVIDED`; its arguments are those of a stage."""
    function: Callable[[NamedCase, Path, Report, ShouldStop], Plan] = _from_module(stage, f"plan_{stage}")
    return function


def _from_module(stage: str, name: str) -> Any:
    if stage not in STAGES:
        raise ValueError(f"stage {stage!r} is not one of {', '.join(STAGES)}")
    return getattr(import_module(f"pipelines.stages.{STAGES[stage]}"), name)
