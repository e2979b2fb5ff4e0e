"""The description of one case: frozen configuration tables in SI units.

A case is a gas, a flexible rotor, two gas foil bearings, the excitation of their active rings, an operating
point, the numerics and one table per stage.  The checks here are those of one key, of keys of one table and
of the machine's tables against each other; what a stage asks of them is in `pipelines.case.stage_checks`,
and whether an equilibrium exists is the solver's business.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any, Self

from pydantic import Field, ValidationError, ValidationInfo, field_validator, model_validator

from pipelines.case.bearings import Bearing, Bump, Excitation, Foil, Gas, Ring
from pipelines.case.calibrate_settings import Calibrate, CalibrationParameter, CalibrationTarget
from pipelines.case.curve_settings import BifurcationSet, TrackCurves
from pipelines.case.fields import Inconsistency, InconsistentError, Units, UnitsTable, quantity, table
from pipelines.case.problems import CaseError, Places, problems_of
from pipelines.case.refine_settings import Refine
from pipelines.case.rotor import Disc, Element, Master, Material, Rotor, Support, off_shaft
from pipelines.case.scales import Scales
from pipelines.case.settings import (
    Coefficients,
    ContinueCycles,
    Criticals,
    Linearize,
    Numerics,
    Operation,
    UnbalanceResponse,
)
from pipelines.case.survey_settings import Survey
from pipelines.case.sweeps import assign
from pipelines.case.torus_settings import ContinueTori
from pipelines.case.transient_settings import Transient, Unbalance, unbalance_on_shaft
from pipelines.case.units import dimensionless

__all__ = [
    "Bearing",
    "BifurcationSet",
    "Bump",
    "Calibrate",
    "CalibrationParameter",
    "CalibrationTarget",
    "Case",
    "Coefficients",
    "ContinueCycles",
    "ContinueTori",
    "Criticals",
    "Disc",
    "Element",
    "Excitation",
    "Foil",
    "Gas",
    "Linearize",
    "Master",
    "Material",
    "Numerics",
    "Operation",
    "Refine",
    "Ring",
    "Rotor",
    "Support",
    "Survey",
    "TrackCurves",
    "Transient",
    "Unbalance",
    "UnbalanceResponse",
]

MAXIMUM_UNKNOWNS = 20_000


class Case(UnitsTable):
    """One case: everything that a computation needs."""

    units: Units | None = Field(
        default=None,
        description='`si`: keys with two units, as in "1 or rpm", are in the second one, but for tables with '
        "`units` of their own; `dimensionless`, the default: in the first one",
    )
    name: str = quantity(
        "name of the case; letters, digits, `.`, `_`, `-`",
        "",
        pattern=r"^[A-Za-z0-9][A-Za-z0-9._-]*$",
        max_length=64,
        because="it names a group of the store",
    )
    note: str = quantity(
        "a remark that every figure of the case carries, for instance where the machine's data come from",
        "",
        "",
        max_length=200,
        because="it must fit below a figure",
    )
    gas: Gas = table("the lubricating gas")
    rotor: Rotor = table("the flexible rotor")
    bearings: tuple[Bearing, Bearing] = table(
        "the two bearings; keys left out of the second table are taken from the first (but for node)"
    )
    excitation: Excitation = table("the active rings")
    operation: Operation = table("the operating point")
    numerics: Numerics = table("grid, schemes, tolerances", Numerics())
    linearize: Linearize = table("stage `agfb linearize`", Linearize())
    coefficients: Coefficients = table("stage `agfb coefficients`", Coefficients())
    criticals: Criticals = table("stage `agfb criticals`", Criticals())
    unbalance_response: UnbalanceResponse = table("stage `agfb unbalance-response`", UnbalanceResponse())
    continue_cycles: ContinueCycles = table("stage `agfb continue-cycles`", ContinueCycles())
    track_curves: TrackCurves = table("stages `agfb track-pd`, `track-ns`, `track-folds`", TrackCurves())
    bifurcation_set: BifurcationSet = table("search of `agfb run` for the whole set", BifurcationSet())
    survey: Survey = table("stage `agfb survey`", Survey())
    refine: Refine = table("stage of the option `--refine`", Refine())
    unbalance: Unbalance | None = table(
        "the rotor's unbalance, for `agfb unbalance-response`, `transient` and `continue-tori`", None
    )
    transient: Transient = table("stage `agfb transient`", Transient())
    continue_tori: ContinueTori = table("stage `agfb continue-tori`", ContinueTori())
    calibrate: Calibrate | None = table("stage `agfb calibrate`", None)

    @model_validator(mode="before")
    @classmethod
    def _dimensionless(cls, document: Any) -> Any:
        return dimensionless(cls, document).document if isinstance(document, dict) else document

    _unbalance = field_validator("unbalance")(unbalance_on_shaft)

    @field_validator("bearings")
    @classmethod
    def _bearings(cls, bearings: tuple[Bearing, Bearing], info: ValidationInfo) -> tuple[Bearing, Bearing]:
        rotor: Rotor | None = info.data.get("rotor")
        problems = (
            misplaced_journals(rotor, [bearing.node for bearing in bearings]) if rotor is not None else []
        )
        if problems:
            raise InconsistentError(*problems)
        return bearings

    @field_validator("excitation")
    @classmethod
    def _ring_fits(cls, excitation: Excitation, info: ValidationInfo) -> Excitation:
        bearings: tuple[Bearing, ...] = info.data.get("bearings", ())
        radius = max((bearing.radius + bearing.clearance for bearing in bearings), default=0.0)
        if excitation.ring is not None and excitation.ring.inner_radius < radius:
            raise InconsistentError(
                (
                    ("ring", "inner_radius"),
                    f"must be at least {radius:g} m: the ring surrounds journal and film",
                )
            )
        if excitation.load is not None and "gas" in info.data and bearings:
            _require_open_films(excitation, Scales.of(info.data["gas"], bearings))
        return excitation

    @field_validator("numerics")
    @classmethod
    def _fits_in_memory(cls, numerics: Numerics, info: ValidationInfo) -> Numerics:
        rotor: Rotor | None = info.data.get("rotor")
        freedoms = rotor.condensed_freedoms if rotor is not None else 4
        # N = 2 (N_theta - 1)(N_z + 1) + 4 n_master (+ 4 where a master keeps its slopes)
        unknowns = 2 * (numerics.circumferential - 1) * (numerics.axial + 1) + 2 * freedoms
        if unknowns > MAXIMUM_UNKNOWNS:
            raise InconsistentError(
                f"the grid {numerics.circumferential} x {numerics.axial} makes {unknowns} unknowns; "
                f"at most {MAXIMUM_UNKNOWNS} are allowed"
            )
        return numerics

    @property
    def scales(self) -> Scales:
        """Scales of the machine."""
        return Scales.of(self.gas, self.bearings)

    @property
    def parameters(self) -> tuple[float, float, float, float]:
        """The parameter vector of the case in the order of `PARAMETERS`."""
        return self.scales.parameter_values(self.excitation, self.operation)

    def with_values(self, assignments: Mapping[str, Any]) -> Self:
        """The case with other values at some dotted keys (as in `--set`) and without its calibration.

        Raises MisplacedError for a key that leads nowhere, CaseError for a case that cannot be.
        """
        document = self.model_dump(mode="json", exclude={"calibrate"})
        for key, value in assignments.items():
            assign(document, key, value)
        try:
            return type(self).model_validate(document)
        except ValidationError as error:
            raise CaseError(problems_of(error, type(self), Places("", {}))) from None


def misplaced_journals(rotor: Rotor, nodes: Sequence[Any]) -> list[Inconsistency]:
    """What is wrong with the nodes of the bearings; an invalid node number is reported elsewhere."""
    problems: list[Inconsistency] = []
    for index, node in enumerate(nodes):
        if not isinstance(node, int) or node < 0:
            continue
        if node >= rotor.node_count:
            problems.append(((index, "node"), off_shaft(node, rotor.node_count - 1)))
        elif node not in rotor.master_nodes:
            masters = ", ".join(map(str, rotor.master_nodes))
            message = f"must be one of rotor.masters ({masters}): the film acts on nodes that are kept"
            problems.append(((index, "node"), message))
        if node in nodes[:index]:
            problems.append(
                ((index, "node"), "both bearings stand on this node: the rotor could tilt freely")
            )
    return problems


def _require_open_films(excitation: Excitation, scales: Scales) -> None:
    """Refuse a ring load that presses the ring onto its journal: a displacement of a whole clearance."""
    factors = scales.ring_factors(excitation)
    moved = scales.ring_displacement(excitation) * max(factors)
    if moved < 1.0:
        return
    assert excitation.load is not None  # the caller's own check
    bearing = factors.index(max(factors))
    length = moved * scales.displacement * scales.bearings[bearing].clearance_ratio
    amplitude = excitation.amplitudes[bearing]
    raise InconsistentError(
        (
            ("load",) if amplitude <= 1.0 else ("amplitudes",),
            f"{excitation.load:g} N times {amplitude:g} move the ring of bearing {bearing + 1} by "
            f"{length:.3g} m, {moved:.3g} of its clearance: must stay below 1, the ring closes the film "
            f"otherwise; at most {excitation.load / moved:.3g} N",
        )
    )
