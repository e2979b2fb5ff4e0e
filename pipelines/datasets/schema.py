"""What a store holds: every array of every kind of group, as data.

A store is a tree of Zarr v3 groups. Each group has a *kind* (machine, linear, criticals, cycles, curve, ...)
and a kind is a table of arrays: name, dimensions, units, meaning. Writers, readers and the integrity check
all work from these tables.

Dimensions play four roles. Arrays whose first dimension is the kind's ``row`` dimension grow point by point;
those along ``event`` grow with the located bifurcations; those along ``slot`` have two slots written
alternately and hold what only the newest point needs; all others are written once, when the group is made.

Floating point arrays are filled with NaN, integers with -1, where nothing was written.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from pipelines.case.scales import PARAMETERS

SCHEMA_VERSION = 3
"""A new kind, or a new array that a group may lack, keeps the version.  Every other change of an array (name,
type, dimensions, flags, meaning) gets a new one: older stores are then refused with advice to read them with
the version of agfb that their attributes name, or to compute them again.  No command converts stores.
"""

EVENT = "event"
SLOT = "slot"

Dtype = Literal["float64", "complex128", "int32", "int8"]
Role = Literal["row", "event", "slot", "static"]
Array = NDArray[Any]


@dataclass(frozen=True)
class ArraySpec:
    """One array of a kind: its name, dimensions and meaning. Flag values count from 0; -1 is unset."""

    name: str
    dimensions: tuple[str, ...]
    long_name: str
    units: str = "1"
    dtype: Dtype = "float64"
    flags: tuple[str, ...] = ()
    padded: bool = False
    """Shorter data are accepted and filled up (multipliers of a basis narrower than the array)."""

    @property
    def fill(self) -> complex | float | int:
        """Value of elements that were never written."""
        return {"float64": np.nan, "complex128": complex(np.nan, np.nan), "int32": -1, "int8": -1}[self.dtype]

    def flag(self, meaning: str) -> int:
        """Stored value of a flag, from its meaning (ValueError when it is not one of this array's)."""
        return self.flags.index(meaning)


@dataclass(frozen=True)
class GroupSpec:
    """One kind of group.

    ``row`` names the dimension that grows point by point, ``event`` the dimension that grows with what
    is found on the way, ``coordinates`` the arrays that place a row.
    """

    kind: str
    title: str
    arrays: tuple[ArraySpec, ...]
    row: str | None = None
    coordinates: tuple[str, ...] = ()
    event: str = EVENT

    def role(self, spec: ArraySpec) -> Role:
        """The part of a commit that writes this array."""
        first = spec.dimensions[0]
        if first == self.event:
            return "event"
        if first == SLOT:
            return "slot"
        return "row" if self.row is not None and first == self.row else "static"

    def array(self, name: str) -> ArraySpec:
        """The array called ``name`` (KeyError when the kind has none)."""
        for spec in self.arrays:
            if spec.name == name:
                return spec
        raise KeyError(f"{self.kind} has no array {name!r}; it has {', '.join(s.name for s in self.arrays)}")


def _real(name: str, dimensions: str, long_name: str, units: str = "1", *, padded: bool = False) -> ArraySpec:
    return ArraySpec(name, tuple(dimensions.split()), long_name, units, padded=padded)


def _complex(name: str, dimensions: str, long_name: str, *, padded: bool = False) -> ArraySpec:
    return ArraySpec(name, tuple(dimensions.split()), long_name, "1", "complex128", padded=padded)


def _count(name: str, dimensions: str, long_name: str) -> ArraySpec:
    return ArraySpec(name, tuple(dimensions.split()), long_name, "1", "int32")


def _flag(name: str, dimensions: str, long_name: str, *meanings: str, padded: bool = False) -> ArraySpec:
    return ArraySpec(name, tuple(dimensions.split()), long_name, "1", "int8", meanings, padded)


# Films are measured by their own bearing; the rotor, and all times, by the first one.
OWN = "over the bearing's own clearance"
FIRST = "over the clearance c of the first bearing"
RING = f"{OWN} (where the excitation is a load: {FIRST})"
NONE = "; none (NaN) where the machine has none"
FOIL = f"k c / p0 of the first bearing that has a foil{NONE}"
ROTOR = f"{FIRST}, slopes over its c / L"

PARAMETERS_OF_A_POINT = (
    _real("speed", "point", "rotating speed, dimensionless"),
    _real("excitation_frequency", "point", f"excitation frequency of the ring, dimensionless{NONE}"),
    _real("displacement", "point", f"largest vertical displacement of the ring {RING}"),
    _real("foil_stiffness", "point", f"foil stiffness {FOIL}"),
)
PLACE_ON_A_CURVE = (
    _real("step", "point", "arclength step that the next point tries first"),
    _real("arclength", "point", "arclength from the first point"),
)
MASTER_COORDINATES = (
    _count("coordinate_node", "coordinate", "shaft node of the coordinate"),
    _flag(
        "coordinate_axis",
        "coordinate",
        "displacement along x or y, or slope: rotation alpha or beta of the section about x or y",
        "x",
        "y",
        "alpha",
        "beta",
    ),
)


def _extremes(over: str) -> tuple[ArraySpec, ...]:
    """Extremes of a motion over its period or torus."""
    return (
        _real("orbit_minimum", "point coordinate", f"smallest value over {over}, {ROTOR}"),
        _real("orbit_maximum", "point coordinate", f"largest value over {over}, {ROTOR}"),
        _real("minimum_pressure", "point bearing", f"smallest film pressure over {over}, over ambient"),
        _real("minimum_film", "point bearing", f"smallest film thickness over {over}, {OWN}"),
    )


def _damping_of(dimensions: str) -> tuple[ArraySpec, ...]:
    """How fast oscillations along some dimensions die out."""
    return (
        _real(
            "logarithmic_decrement",
            dimensions,
            "logarithmic decrement -2 pi Re lambda / Im lambda; negative: unstable",
            padded=True,
        ),
        _real("damping_ratio", dimensions, "damping ratio -Re lambda / |lambda|", padded=True),
    )


MACHINE = GroupSpec(
    "machine",
    "Geometry of the machine",
    (
        _real("node_position", "node", "axial position of the shaft nodes", "m"),
        _real("element_length", "element", "length of the shaft elements", "m"),
        _real("element_outer", "element", "outer diameter of the shaft elements", "m"),
        _real("element_inner", "element", "inner diameter of the shaft elements", "m"),
        _real(
            "element_outer_right",
            "element",
            "outer diameter at the right ends; the other is at the left",
            "m",
        ),
        _real(
            "element_inner_right",
            "element",
            "inner diameter at the right ends; the other is at the left",
            "m",
        ),
        _real(
            "element_axial_force", "element", "axial force in the shaft elements, positive for tension", "N"
        ),
        _count(
            "element_material",
            "element",
            "material of the shaft elements, index into the attribute material_names",
        ),
        _count("disc_node", "disc", "node of the discs"),
        _real("disc_mass", "disc", "mass of the discs", "kg"),
        _real("disc_diametral_inertia", "disc", "diametral moment of inertia of the discs", "kg m2"),
        _real("disc_polar_inertia", "disc", "polar moment of inertia of the discs", "kg m2"),
        _real(
            "disc_diameter_equivalent",
            "disc",
            "diameter of a thin disc of the same mass and polar inertia",
            "m",
        ),
        _real("disc_outer", "disc", "outer diameter of discs given by dimensions, NaN for others", "m"),
        _real("disc_inner", "disc", "inner diameter of discs given by dimensions, NaN for others", "m"),
        _real("disc_width", "disc", "width of discs given by dimensions, NaN for others", "m"),
        _count("support_node", "support", "node of the linear supports"),
        _count("bearing_node", "bearing", "node of the bearings"),
        _real("bearing_radius", "bearing", "bearing radius", "m"),
        _real("bearing_length", "bearing", "bearing length", "m"),
        _real("bearing_clearance", "bearing", "radial clearance", "m"),
        _count("master_node", "master", "nodes whose translations the condensation keeps"),
        _count("slope_node", "slope", "nodes whose slopes the condensation keeps too"),
    ),
)

LINEAR = GroupSpec(
    "linear",
    "Equilibria along the rotating speed and their linearisation",
    (
        _real("speed", "speed", "rotating speed, dimensionless"),
        _real(
            "state",
            "speed component",
            "equilibrium state: pressures and foil displacements of both bearings, rotor",
        ),
        _real("journal", "speed bearing axis", f"journal centre (x, y) {OWN}"),
        _real("minimum_film", "speed bearing", f"smallest film thickness {OWN}"),
        _complex(
            "eigenvalues", "speed eigenvalue", "leading eigenvalues of the linearised system", padded=True
        ),
        _real("eigenvalue_residual", "speed eigenvalue", "norm of J v - lambda v for unit v", padded=True),
        *_damping_of("speed eigenvalue"),
        _flag(
            "direction",
            "speed eigenvalue",
            "whirl direction of the eigenvector; unset where it does not oscillate",
            "backward",
            "forward",
            "mixed",
            padded=True,
        ),
        _real("whirl_ratio", "whirl_ratio", "whirl frequency over rotating speed"),
        _real(
            "bearing_stiffness",
            "speed whirl_ratio bearing row column",
            "bearing stiffness over p0 R L / c of the bearing itself",
        ),
        _real(
            "bearing_damping",
            "speed whirl_ratio bearing row column",
            "bearing damping over p0 R L t0 / c, R, L and c of the bearing itself, t0 of the first one",
        ),
        _count("newton_iterations", "speed", "Newton iterations of the equilibrium"),
        _real("newton_residual", "speed", "norm of the right-hand side at the equilibrium"),
    ),
    row="speed",
)

OPERATING_POINT = GroupSpec(
    "operating_point",
    "The machine at its operating speed: static deflection, bearings and modes",
    (
        _real(
            "deflection",
            "node axis",
            "static displacement (x, y) of the shaft nodes from the line of the bearings' centres",
            "m",
        ),
        _count("bearing_node", "bearing", "node of the bearing"),
        _real("reaction", "bearing axis", "force (x, y) of the film on the rotor", "N"),
        _real("journal", "bearing axis", f"journal centre (x, y) {OWN}"),
        _real("eccentricity", "bearing", f"distance of the journal centre from that of the bearing, {OWN}"),
        _real(
            "attitude_angle",
            "bearing",
            "angle from the load to the journal centre, positive in the direction of rotation",
            "rad",
        ),
        _real("minimum_film", "bearing", "smallest film thickness", "m"),
        _real("stiffness", "bearing row column", "stiffness of film and foil for synchronous whirl", "N/m"),
        _real("damping", "bearing row column", "damping of film and foil for synchronous whirl", "N s/m"),
        _complex("eigenvalue", "mode", "eigenvalue of the mode"),
        _real("frequency_hertz", "mode", "frequency Im lambda", "Hz"),
        _real("frequency_rpm", "mode", "frequency Im lambda", "rpm"),
        *_damping_of("mode"),
        _flag("direction", "mode", "whirl direction", "backward", "forward", "mixed"),
        _complex("mode_shape", "mode node axis", "mode shape (x, y) at all shaft nodes, largest component 1"),
    ),
)

COEFFICIENTS = GroupSpec(
    "coefficients",
    "Stiffness and damping of the bearings over rotating speed and whirl frequency",
    (
        _real("speed", "speed", "rotating speed, dimensionless"),
        _real("frequency", "frequency", "whirl frequency, dimensionless"),
        _real(
            "state",
            "speed component",
            "equilibrium state: pressures and foil displacements of both bearings, rotor",
        ),
        _real("journal", "speed bearing axis", f"journal centre (x, y) {OWN}"),
        _real(
            "stiffness",
            "speed frequency bearing row column",
            "stiffness K of film and foil over p0 R L / c of the bearing itself",
        ),
        _real(
            "damping",
            "speed frequency bearing row column",
            "damping C of film and foil over p0 R L t0 / c, R, L and c of the bearing itself, t0 of the "
            "first one",
        ),
        _count("bearing_node", "bearing", "node of the bearing"),
        _count("newton_iterations", "speed", "Newton iterations of the equilibrium"),
        _real("newton_residual", "speed", "norm of the right-hand side at the equilibrium"),
    ),
    row="speed",
)

CRITICALS = GroupSpec(
    "criticals",
    "Critical speeds, Campbell data, predicted resonances, and the full against the condensed rotor",
    (
        _real("speed", "speed", "rotating speed, dimensionless"),
        _real("frequency", "speed mode", "whirl frequency Im lambda", padded=True),
        *_damping_of("speed mode"),
        _flag("direction", "speed mode", "whirl direction", "backward", "forward", "mixed"),
        _real("critical_speed", "critical", "speed at which Im lambda equals the rotating speed"),
        _real("critical_damping_ratio", "critical", "damping ratio at the critical speed"),
        _flag(
            "critical_direction",
            "critical",
            "whirl direction at the critical speed",
            "backward",
            "forward",
            "mixed",
        ),
        _complex(
            "critical_mode_shape",
            "critical node axis",
            "mode shape (x, y) at all shaft nodes, largest component 1",
        ),
        _real("resonance_frequency", "resonance", "excitation frequency of a predicted parametric resonance"),
        _count("resonance_j", "resonance", "first critical speed of the combination, counted from 1"),
        _count("resonance_k", "resonance", "second critical speed of the combination, counted from 1"),
        _count("resonance_order", "resonance", "order n"),
        _flag(
            "resonance_kind",
            "resonance",
            "2 Omega_j / n, (Omega_j + Omega_k) / n or |Omega_j - Omega_k| / n",
            "principal",
            "sum",
            "difference",
        ),
        _real("full_frequency", "rotor_mode", "natural frequency of the full rotor on linear bearings"),
        _real(
            "condensed_frequency", "rotor_mode", "natural frequency of the condensed rotor on linear bearings"
        ),
        _real("full_decrement", "rotor_mode", "logarithmic decrement, full rotor"),
        _real("condensed_decrement", "rotor_mode", "logarithmic decrement, condensed rotor"),
        _real(
            "mac",
            "rotor_mode condensed_mode",
            "modal assurance criterion, full against condensed mode shapes",
        ),
        _real("checked_speed", "checked_mode", "rotating speed at which a mode of the rotor is checked"),
        _real(
            "checked_full_frequency",
            "checked_mode",
            "frequency of a mode of the full rotor up to the highest speed, on linear bearings",
        ),
        _real(
            "checked_condensed_frequency",
            "checked_mode",
            "frequency of this mode of the condensed rotor, not a number where it has no such mode",
        ),
        _real(
            "checked_error",
            "checked_mode",
            "relative error of the frequency of the condensed rotor, 1 where it has no such mode",
        ),
        _real("support_stiffness", "support", "stiffness of both bearings in the critical speed map", "N/m"),
        _real("map_forward", "support map_mode", "undamped critical speed of forward whirl", padded=True),
        _real("map_backward", "support map_mode", "undamped critical speed of backward whirl", padded=True),
        _real("unbalance_speed", "unbalance", "speeds of the unbalance response"),
        _real(
            "direct_stiffness",
            "unbalance bearing axis",
            "stiffness Kxx, Kyy of the bearings for synchronous whirl",
            "N/m",
        ),
        _count("response_node", "response", "node at which the unbalance response is taken"),
        _real("unbalance_full", "unbalance response", f"unbalance response amplitude {FIRST}, full rotor"),
        _real(
            "unbalance_condensed",
            "unbalance response",
            f"unbalance response amplitude {FIRST}, condensed rotor",
        ),
    ),
)

UNBALANCE_RESPONSE = GroupSpec(
    "unbalance_response",
    "Response of the linearised machine to its unbalance over the speed",
    (
        _real("speed", "speed", "rotating speed, dimensionless"),
        _count("plane_node", "plane", "node of the plane of unbalance"),
        _real("plane_moment", "plane", "unbalance of the plane", "kg m"),
        _real("plane_phase", "plane", "angle of the unbalance from the rotor's mark", "rad"),
        _count("probe_node", "probe", "node of the probe"),
        _complex(
            "response",
            "speed plane probe axis",
            f"motion under each plane alone: modulus is the amplitude {FIRST}, argument the phase ahead of "
            "the rotor's mark",
        ),
        _real(
            "journal_motion",
            "speed bearing",
            "largest radius of the journal's orbit under all planes, over the smallest film",
        ),
        _count("peak_probe", "peak", "probe of the resonance, index into probe_node"),
        _flag("peak_axis", "peak", "axis of the resonance", "x", "y"),
        _real("peak_speed", "peak", "speed of the largest amplitude under all planes"),
        _real("peak_amplitude", "peak", f"amplitude there, {FIRST}"),
        _real("peak_phase", "peak", "phase there, ahead of the rotor's mark", "rad"),
        _real("peak_low", "peak", "lower speed with 0.7071 of this amplitude; NaN where there is none"),
        _real("peak_high", "peak", "upper speed with 0.7071 of this amplitude; NaN where there is none"),
        _real("peak_amplification", "peak", "amplification factor peak_speed / (peak_high - peak_low)"),
    ),
)

CYCLES = GroupSpec(
    "cycles",
    "A branch of limit cycles with Floquet multipliers and located bifurcations",
    (
        *PARAMETERS_OF_A_POINT,
        _real("period", "point", "period, dimensionless"),
        _real("state", "point component", "state at the start of the period"),
        _real("tangent", "point extended", "unit tangent of the branch: state, [period], parameter"),
        *PLACE_ON_A_CURVE,
        _flag("direction", "point", "direction in which the continued parameter moves", "down", "up"),
        _complex("multipliers", "point multiplier", "slow Floquet multipliers, largest first", padded=True),
        _real("multiplier_residual", "point multiplier", "norm of M v - mu v for unit v", padded=True),
        _count("multiplier_count", "point", "number of multipliers stored"),
        _count("unstable_count", "point", "multipliers outside the unit circle, trivial ones left out"),
        _real("orbit", "point sample coordinate", f"orbit of the master nodes {ROTOR}"),
        *_extremes("the period"),
        _real(
            "minimum_film_trace", "point sample bearing", f"smallest film thickness along the period, {OWN}"
        ),
        _real(
            "film_pressure", "point snapshot bearing theta", "axial mean of the film pressure over ambient"
        ),
        _real("foil_displacement", "point snapshot bearing theta", f"foil displacement {OWN}, ring included"),
        _real("film_thickness", "point snapshot bearing theta", f"film thickness {OWN}"),
        _flag(
            "unexplained",
            "point",
            "stability changes in the step to this point that no event accounts for",
            "no",
            "yes",
        ),
        _count("newton_iterations", "point", "Newton-Picard iterations"),
        _real("newton_history", "point iteration", "residual norm before each iteration", padded=True),
        _count("steps_per_period", "point", "time steps of one period"),
        _real(
            "step_error",
            "point",
            "estimated error of the multipliers by the time steps; unknown where missing",
        ),
        _real("coarser_error", "point", "likely error with half as many time steps; unknown where missing"),
        _real(
            "basis",
            "slot component column",
            "orthonormal basis of the slow subspace at the newest point",
            padded=True,
        ),
        _count("basis_columns", "slot", "columns of the basis that are used"),
        _real("theta", "bearing theta", "circumferential angle", "rad"),
        _real("sample", "sample", "time of the samples over the period"),
        _real("snapshot", "snapshot", "time of the snapshots over the period"),
        *MASTER_COORDINATES,
        _flag(
            "event_kind",
            "event",
            "bifurcation",
            "fold",
            "period_doubling",
            "neimark_sacker",
            "branch_point",
            "neutral_saddle",
            "own_period_doubling",
        ),
        _count("event_after_point", "event", "index of the last point before the event"),
        _real("event_speed", "event", "rotating speed at the event"),
        _real("event_excitation_frequency", "event", f"excitation frequency at the event{NONE}"),
        _real("event_displacement", "event", "ring displacement at the event"),
        _real("event_foil_stiffness", "event", f"foil stiffness at the event, {FOIL}"),
        _real("event_period", "event", "period at the event"),
        _real("event_state", "event component", "state at the event"),
        _complex(
            "event_multipliers", "event multiplier", "slow Floquet multipliers at the event", padded=True
        ),
        _real("event_angle", "event", "argument of the critical multiplier", "rad"),
        _real("event_transversality", "event", "d|mu| / d(parameter) of the critical multiplier"),
        _flag("event_resonance", "event", "strong resonance nearby", "none", "R1", "R2", "R3", "R4"),
        _real("event_residual", "event", "test function at the located event"),
    ),
    row="point",
    coordinates=("speed", "excitation_frequency", "displacement", "foil_stiffness"),
)

TORI = GroupSpec(
    "tori",
    "A branch of quasi-periodic orbits, as invariant curves of the map over an excitation period",
    (
        *PARAMETERS_OF_A_POINT,
        _real("period", "point", "period of the map, dimensionless"),
        _real(
            "rotation",
            "point",
            "turn of the second angle in a period; its number of turns is this over 2 pi",
            "rad",
        ),
        _real(
            "whirl_frequency", "point", "mean whirl frequency: the strongest frequency of the second angle"
        ),
        _real(
            "section",
            "point angle component",
            "states of the invariant curve at the start of a period, at angle_count equally spaced angles",
            padded=True,
        ),
        _count("angle_count", "point", "number of angles of the section"),
        _real(
            "amplitudes",
            "point wave",
            "largest state component of every wave number of the curve",
            padded=True,
        ),
        _real("tail", "point", "what the Fourier series of the curve lacks, largest state component"),
        _real("residual", "point", "largest component by which an image misses the curve"),
        *PLACE_ON_A_CURVE,
        _flag("direction", "point", "direction in which the continued parameter moves", "down", "up"),
        _real(
            "moduli", "point multiplier", "moduli of the multipliers of the curve, largest first", padded=True
        ),
        _count(
            "unstable_count",
            "point",
            "multipliers outside the unit circle without the trivial one; -1 where growth leaves it open",
        ),
        _flag(
            "spectrum",
            "point",
            "whether all multipliers were found as eigenvalues; otherwise moduli are growth rates within 2 %",
            "incomplete",
            "complete",
        ),
        _real("section_curve", "point curve coordinate", f"invariant curve of the master nodes {ROTOR}"),
        *_extremes("the torus"),
        _count("newton_iterations", "point", "Newton-Picard iterations"),
        _count("steps_per_period", "point", "time steps of one period"),
        _real("step_error", "point", "estimated error of an image by the time steps (implicit stepper only)"),
        _flag(
            "event_kind",
            "event",
            "bifurcation of the torus: fold is a quasi-periodic saddle-node, hopf adds a frequency",
            "fold",
            "branch_point",
            "period_doubling",
            "hopf",
            "unknown",
        ),
        _count("event_after_point", "event", "index of the last point before the event"),
        _real("event_arclength", "event", "arclength from the first point"),
        _real("event_speed", "event", "rotating speed at the event"),
        _real("event_excitation_frequency", "event", f"excitation frequency at the event{NONE}"),
        _real("event_displacement", "event", "ring displacement at the event"),
        _real("event_foil_stiffness", "event", f"foil stiffness at the event, {FOIL}"),
        _real("event_rotation", "event", "turn of the second angle in a period at the event", "rad"),
        _real("event_section", "event angle component", "the section at the event", padded=True),
        _count("event_angle_count", "event", "number of angles of the section at the event"),
        _real("event_moduli", "event multiplier", "moduli of the multipliers at the event", padded=True),
        _flag(
            "event_stability",
            "event",
            "what the torus does along the branch; unset where the numbers of unstable multipliers on both "
            "sides are equal or one is undecided",
            "lost",
            "gained",
        ),
        _real("event_residual", "event", "test function at the located event"),
        _real("tangent", "slot angle component", "unit tangent of the branch: section", padded=True),
        _real("tangent_rotation", "slot", "the same: rotation"),
        _real("tangent_parameter", "slot", "the same: continued parameter"),
        _real(
            "basis",
            "slot angle component column",
            "orthonormal bases of the slow subspaces along the newest curve",
            padded=True,
        ),
        _count("basis_columns", "slot", "columns of the bases that are used"),
        _count("basis_leading", "slot", "columns of the bases that are smooth along the curve"),
        _real("curve", "curve", "second angle of the points of section_curve", "rad"),
        *MASTER_COORDINATES,
    ),
    row="point",
    coordinates=("speed", "excitation_frequency", "displacement", "foil_stiffness"),
)

CURVE = GroupSpec(
    "curve",
    "A curve of period doublings, Neimark-Sacker points or folds over two parameters",
    (
        *PARAMETERS_OF_A_POINT,
        _real("period", "point", "period of the cycle, dimensionless"),
        _real("state", "point component", "state at the start of the period"),
        _real("parameter_tangent", "point free", "d(free parameters) / d(arclength) along the curve"),
        *PLACE_ON_A_CURVE,
        _real("angle", "point", "argument of the critical multiplier", "rad"),
        _real("kappa", "point", "cosine of the argument of the critical multiplier"),
        _real("kappa_slope", "point", "d kappa / d(arclength)"),
        _real(
            "special_tests", "point special", "test functions of the special points, ordered as event_kind"
        ),
        _complex("multipliers", "point multiplier", "slow Floquet multipliers, largest first", padded=True),
        _real("multiplier_residual", "point multiplier", "norm of M v - mu v for unit v", padded=True),
        _count("multiplier_count", "point", "number of multipliers stored"),
        _count("unstable_count", "point", "multipliers outside the unit circle, critical ones left out"),
        _complex(
            "normal_form",
            "point",
            "critical coefficient of the stroboscopic map: a (fold), b (period doubling), d (Neimark-Sacker)",
        ),
        _real("normal_form_error", "point", "estimated error of the critical coefficient"),
        _flag(
            "criticality",
            "point",
            "type of the bifurcation by the sign of b or Re d, where that exceeds its error",
            "subcritical",
            "supercritical",
        ),
        *_extremes("the period"),
        _count("newton_iterations", "point", "iterations of the corrector"),
        _real("newton_history", "point iteration", "residual norm before each iteration", padded=True),
        _real("alignment", "point", "cosine of the angle between left and right critical vectors"),
        _count("steps_per_period", "point", "time steps of one period"),
        _real(
            "step_error",
            "point",
            "estimated error of the multipliers by the time steps; unknown where missing",
        ),
        _real("coarser_error", "point", "likely error with half as many time steps; unknown where missing"),
        _real(
            "clipping_width",
            "point",
            "half width over ambient pressure of the regularised clipping with which the point was computed; "
            "0: as the case says",
        ),
        _real(
            "width_effect",
            "point",
            "distance of the point from the curve without regularisation, measured or estimated, in the "
            "plane of the free parameters (a foil stiffness over that of the case); unknown where missing",
        ),
        _real(
            "grazing_gauge",
            "point",
            "stationary pressure, over angle and time, that is nearest to ambient: its excess over ambient; "
            "none (NaN) where no film has gumbel clipping",
        ),
        _count("grazing_bearing", "point", "bearing of grazing_gauge"),
        _real("grazing_angle", "point", "circumferential coordinate of grazing_gauge", "rad"),
        _real("grazing_phase", "point", "phase of the excitation of grazing_gauge", "rad"),
        _real(
            "directions",
            "slot direction extended",
            "tangent, normal, gradient of the test function and bend of the curve at the newest point: "
            "state, period, free parameters",
        ),
        _real(
            "critical_vectors",
            "slot side augmented",
            "right and left critical vector with period or phase part",
        ),
        _real(
            "basis",
            "slot component column",
            "orthonormal basis of the slow subspace at the newest point",
            padded=True,
        ),
        _count("basis_columns", "slot", "columns of the basis that are used"),
        *MASTER_COORDINATES,
        _flag(
            "event_kind",
            "event",
            "point of codimension two",
            "R1",
            "R2",
            "R3",
            "R4",
            "fold_flip",
            "fold_neimark_sacker",
            "flip_neimark_sacker",
            "double_neimark_sacker",
            "generalised_flip",
            "chenciner",
            "cusp",
        ),
        _count("event_after_point", "event", "index of the last point before the special point"),
        _real("event_speed", "event", "rotating speed at the special point"),
        _real("event_excitation_frequency", "event", f"excitation frequency at the special point{NONE}"),
        _real("event_displacement", "event", "ring displacement at the special point"),
        _real("event_foil_stiffness", "event", f"foil stiffness at the special point, {FOIL}"),
        _real("event_period", "event", "period at the special point"),
        _real("event_state", "event component", "state at the special point"),
        _complex(
            "event_multipliers",
            "event multiplier",
            "slow Floquet multipliers at the special point",
            padded=True,
        ),
        _real("event_angle", "event", "argument of the critical multiplier", "rad"),
        _real("event_residual", "event", "test function at the located special point"),
        _flag(
            "event_tongue",
            "event",
            "side of the tongue at R1 or R2 of a Neimark-Sacker curve: it ends at the near side and goes on "
            "from the far side, but across one that the error of the multipliers hides (unresolved)",
            "near_side",
            "far_side",
            "unresolved",
        ),
        _real(
            "event_width",
            "event",
            "width of that tongue in the plane: a bound if unresolved, a guess if it has no far side",
        ),
    ),
    row="point",
    coordinates=("speed", "excitation_frequency", "displacement", "foil_stiffness"),
)

BIFURCATION_SET = GroupSpec(
    "bifurcation_set",
    "How the plane of two parameters was searched for bifurcations",
    (
        _flag("line_parameter", "line", "parameter along the line", "speed", "excitation_frequency"),
        _real("line_fixed", "line", "value of the other parameter"),
        _real("line_low", "line", "lowest value of the parameter that was reached"),
        _real("line_high", "line", "highest value of the parameter that was reached"),
        _count("line_round", "line", "round of the search, counted from 0"),
        _count("line_events", "line", "bifurcations on the line"),
        _count("line_new_curves", "line", "curves that started from this line"),
        _flag("line_complete", "line", "whether the line reached both ends of the plane", "no", "yes"),
    ),
)

SURVEY = GroupSpec(
    "survey",
    "Stability of the cycles over a grid of two parameters, each cycle found alone",
    (
        _real(
            "along", "cell", "values of the parameter along the lines, the first of the attribute parameters"
        ),
        _real("across", "line", "value of the other parameter on the line"),
        _flag(
            "status",
            "line cell",
            "found: a cycle; thin_film, below_vacuum: one with a film below continue_cycles.minimum_film, or "
            "with a pressure that no gas has; otherwise why there is none",
            "found",
            "thin_film",
            "below_vacuum",
            "no_equilibrium",
            "no_cycle",
        ),
        _real("growth_rate", "line cell", "largest growth rate ln|mu| / T beside the cycle, dimensionless"),
        _complex("multiplier", "line cell", "Floquet multiplier mu of the largest modulus"),
        _complex(
            "nearest_multiplier", "line cell", "Floquet multiplier with the modulus nearest to 1, as ln|mu|"
        ),
        _flag(
            "bifurcation",
            "line cell",
            "bifurcation at which this multiplier passes the unit circle",
            "fold",
            "period_doubling",
            "neimark_sacker",
        ),
        _count("unstable_count", "line cell", "multipliers outside the unit circle"),
        _real("minimum_film", "line cell", f"smallest film thickness over the period in any bearing, {OWN}"),
        _flag("method", "line cell", "how the cycle was found", "harmonic_balance", "newton"),
        _real("miss", "line cell", "distance of the state after a period, relative to the largest state"),
        _count("steps_per_period", "line cell", "time steps of one period"),
        _real("step_error", "line cell", "likely error of the leading multipliers by the time steps"),
    ),
    row="line",
    coordinates=("across",),
)

VERDICTS = ("agrees", "disagrees", "not_decided")


def _verdict(name: str, dimensions: str, long_name: str) -> ArraySpec:
    return _flag(name, dimensions, long_name, *VERDICTS)


def _of_places(prefix: str, dimensions: str, places: str) -> tuple[ArraySpec, ...]:
    """What is found and expected at some places of a certificate."""
    return (
        _count(
            f"{prefix}found", dimensions, f"multipliers outside the unit circle at the {places}; -1: open"
        ),
        _count(
            f"{prefix}expected",
            dimensions,
            "the same as the curves tell it from the places beside; -1 where they do not",
        ),
        _verdict(f"{prefix}verdict", dimensions, f"whether the curves explain what is found at the {places}"),
        _complex(
            f"{prefix}nearest", dimensions, "Floquet multiplier with the modulus nearest to 1, as ln|mu|"
        ),
    )


CERTIFICATE = GroupSpec(
    "certificate",
    "Whether the bifurcation curves explain the stability that was found at points of their plane",
    (
        _real("along", "cell", "the first of the attribute parameters at the cells of the survey"),
        _real("across", "line", "the other parameter on the lines of the survey"),
        *_of_places("", "line cell", "cells"),
        _verdict("pair_along", "line gap_along", "the same for a cell and the next one on its line"),
        _verdict("pair_across", "gap_across cell", "the same for a cell and the one on the next line"),
        _real("point_along", "point", "the first parameter at random points"),
        _real("point_across", "point", "the other parameter at random points"),
        *_of_places("point_", "point", "random points"),
        _flag("asked_parameter", "asked", "parameter along a line that the search shall add", *PARAMETERS),
        _real("asked_fixed", "asked", "value of the other parameter on this line"),
    ),
)

REFINEMENT = GroupSpec(
    "refinement",
    "Bifurcation points recomputed on finer grids, and what they tell of the error of the stored ones",
    (
        _flag(
            "source",
            "refined",
            "groups of the case in which the stored point is: cycles/b, cycles/d, pd/c, ns/c, folds/c",
            "cycles",
            "doubled_cycles",
            "period_doublings",
            "neimark_sacker_points",
            "folds",
        ),
        _count("source_number", "refined", "number of the group in which the stored point is"),
        _count("source_index", "refined", "index of the event (of cycles) or of the row (of a curve)"),
        _flag("bifurcation", "refined", "bifurcation", "fold", "period_doubling", "neimark_sacker"),
        _count("turns", "refined", "excitation periods of the cycle"),
        _real("speed", "refined", "rotating speed of the stored point, dimensionless"),
        _real(
            "excitation_frequency",
            "refined",
            f"excitation frequency of the stored point, dimensionless{NONE}",
        ),
        _real("displacement", "refined", f"ring displacement of the stored point {RING}"),
        _real("foil_stiffness", "refined", f"foil stiffness of the stored point {FOIL}"),
        _flag("held", "refined", "parameter that all grids share", *PARAMETERS),
        _flag("free", "refined", "parameter whose value the grids tell", *PARAMETERS),
        _real("value", "refined", "stored value of the free parameter"),
        _real(
            "level_value", "refined level", "value of the free parameter on each grid, with finer time steps"
        ),
        _real("level_angle", "refined level", "argument of the critical multiplier on each grid", "rad"),
        _count("level_steps", "refined level", "time steps of one period on each grid"),
        _count("level_unknowns", "level", "unknowns of each grid"),
        _count("level_circumferential", "level", "circumferential intervals of each grid"),
        _count("level_axial", "level", "axial unknowns of each grid"),
        _real("observed_order", "refined", "order of convergence that the first three grids show"),
        _real("richardson", "refined", "extrapolated value of the free parameter"),
        _real("richardson_error", "refined", "uncertainty of the extrapolated value"),
        _real("error", "refined", "error of the stored value: |value - richardson|, or a bound (see status)"),
        _real("axial_error", "refined", "part of the error by the axial resolution"),
        _real("step_error", "refined", "part of the error by the time steps"),
        _flag(
            "status",
            "refined",
            "refined: the order is clean; bound: it is not, the error is the largest difference; "
            "otherwise why the point could not be recomputed",
            "refined",
            "bound",
            "not_converged",
            "other_bifurcation",
            "grid_too_large",
            "unsupported",
        ),
        _count("failed_level", "refined", "first grid without a value"),
    ),
    row="refined",
    coordinates=("speed", "excitation_frequency", "displacement", "foil_stiffness"),
)

CALIBRATION = GroupSpec(
    "calibration",
    "Machines that a calibration has computed, and how they meet the targets",
    (
        _real("position", "evaluation parameter", "place of each parameter within its range, from 0 to 1"),
        _real("value", "evaluation parameter", "value of each parameter, in the unit of its keys", ""),
        _real("reached", "evaluation target", "value of each target, in its own unit", ""),
        _real("onset", "evaluation target", "onset speed behind the target, dimensionless"),
        _flag(
            "status",
            "evaluation target",
            "how the search for the value ended",
            "found",
            "censored_below",
            "censored_above",
            "no_equilibrium",
            "no_cycle",
            "branch_lost",
            "film_limit",
            "invalid_machine",
            "undecided",
        ),
        _flag(
            "bifurcation",
            "evaluation target",
            "bifurcation at the onset",
            "fold",
            "period_doubling",
            "neimark_sacker",
            "branch_point",
            "hopf",
        ),
        _flag(
            "begin",
            "evaluation",
            "where branches began: at the lowest speed, or below the onset of a machine nearby",
            "lowest_speed",
            "near_onset",
        ),
        _real("wanted", "target", "wanted value, in the unit of the target", ""),
        _real("scatter", "target", "deviation that counts as one, in the unit of the target", ""),
        _real("low", "parameter", "lowest value of each parameter", ""),
        _real("high", "parameter", "highest value of each parameter", ""),
    ),
    row="evaluation",
)

TRANSIENT = GroupSpec(
    "transient",
    "A run in time: samples, and full states at checkpoints",
    (
        _real("time", "sample", "time since the start of the run, dimensionless"),
        _real("speed", "sample", "rotating speed, dimensionless"),
        _real("angle", "sample", "rotation angle", "rad"),
        _real("ring_displacement", "sample", f"largest vertical displacement of the ring {RING}"),
        _real("displacement", "sample coordinate", f"displacement of the master nodes {ROTOR}"),
        _real("journal", "sample bearing axis", f"journal centre (x, y) {OWN}"),
        _real("minimum_film", "sample bearing", f"smallest film thickness since the sample before, {OWN}"),
        _real(
            "minimum_pressure",
            "sample bearing",
            "smallest film pressure since the sample before, over ambient",
        ),
        _real(
            "maximum_pressure",
            "sample bearing",
            "largest film pressure since the sample before, over ambient",
        ),
        _real("minimum_foil", "sample bearing", f"smallest foil displacement since the sample before, {OWN}"),
        _real("maximum_foil", "sample bearing", f"largest foil displacement since the sample before, {OWN}"),
        _real("checkpoint_time", "checkpoint", "time of the checkpoint, dimensionless"),
        _real("checkpoint_step", "checkpoint", "time steps done at the checkpoint"),
        _count("checkpoint_samples", "checkpoint", "samples written at the checkpoint"),
        _real("checkpoint_speed", "checkpoint", "rotating speed at the checkpoint, dimensionless"),
        _real("checkpoint_angle", "checkpoint", "rotation angle at the checkpoint", "rad"),
        _real(
            "checkpoint_ring_phase",
            "checkpoint",
            "phase of the rings at the checkpoint, over one turn",
            "rad",
        ),
        _real("checkpoint_ring_displacement", "checkpoint", "displacement of the ring at the checkpoint"),
        _real(
            "checkpoint_state",
            "checkpoint component",
            "full state: pressures and foil displacements of both bearings, rotor",
        ),
        _real("checkpoint_extremes", "checkpoint extreme", "extremes since the last sample, for going on"),
        *MASTER_COORDINATES,
        _count("plane_node", "plane", "shaft node of the unbalance"),
        _real("plane_moment", "plane", "unbalance of the plane", "kg m"),
        _real("plane_phase", "plane", "angular position of the unbalance on the rotor", "rad"),
    ),
    row="sample",
    coordinates=("time",),
    event="checkpoint",
)

TRANSIENT_ANALYSIS = GroupSpec(
    "transient_analysis",
    "What a run in time tells: envelopes, sections, spectra, energies, kind of motion",
    (
        _real("window_time", "window", "time in the middle of the window, dimensionless"),
        _real("window_speed", "window", "rotating speed in the middle of the window, dimensionless"),
        _real("envelope_low", "window bearing axis", f"smallest journal coordinate in the window, {OWN}"),
        _real("envelope_high", "window bearing axis", f"largest journal coordinate in the window, {OWN}"),
        _real("mode_frequency", "mode", "frequency of the modes of the free condensed rotor at rest"),
        _count("mode_multiplicity", "mode", "shapes of this frequency, which count together"),
        _real(
            "kinetic_energy",
            "window mode",
            "mean kinetic energy in the window, over p0 R L c of the first bearing",
        ),
        _real(
            "strain_energy",
            "window mode",
            "mean strain energy in the window, over p0 R L c of the first bearing",
        ),
        _real("ring_section_time", "ring_section", "times at which the rings begin a period"),
        _real("ring_section_speed", "ring_section", "rotating speed there, dimensionless"),
        _real("ring_section_journal", "ring_section bearing axis", f"journal centre there {OWN}"),
        _real("rotation_section_time", "rotation_section", "times at which the rotor begins a turn"),
        _real("rotation_section_speed", "rotation_section", "rotating speed there, dimensionless"),
        _real("rotation_section_journal", "rotation_section bearing axis", f"journal centre there {OWN}"),
        _real("frequency", "frequency", "frequency of the spectrum, dimensionless"),
        _real(
            "spectrum",
            "frequency bearing axis",
            f"amplitude of the journal at the steady end of the run, {OWN}",
        ),
        _real("piece_time", "piece", "time in the middle of the piece, dimensionless"),
        _real("piece_speed", "piece", "rotating speed in the middle of the piece, dimensionless"),
        _real("piece_frequency", "piece_frequency", "frequency of the waterfall, dimensionless"),
        _real(
            "waterfall", "piece piece_frequency bearing axis", f"amplitude of the journal in the piece, {OWN}"
        ),
        _flag(
            "motion",
            "stretch",
            "motion at the steady end of the run; periods count those of the section",
            "equilibrium",
            "period_1",
            "period_2",
            "period_4",
            "period_8",
            "quasi_periodic",
            "chaotic",
            "unsettled",
        ),
        _flag(
            "section",
            "stretch",
            "what gives the points of the motion: rings, rotation, or the first journal rising through its "
            "mean height where nothing drives the machine",
            "ring",
            "rotation",
            "rising",
        ),
        _real("stretch_begin", "stretch", "time from which the motion is judged, dimensionless"),
        _count("section_points", "stretch", "points of the motion"),
        _real("section_period", "stretch", "mean time between two points, dimensionless"),
        _real("orbit_size", "stretch", "half of the largest extent of a journal coordinate"),
        _count("return_period", "return_period", "periods of the section after which points are compared"),
        _real(
            "return_distance",
            "stretch return_period",
            "root mean square distance of points so many periods apart, or any multiple, over the orbit size",
        ),
        _real("growth_rate", "stretch", "growth of the distance of successive points, per unit of time"),
        _real("chaos", "stretch", "outcome of the 0-1 test: 0 regular, 1 chaotic"),
    ),
)

OPERATING_RANGE = GroupSpec(
    "operating_range",
    "The bifurcation-free range of speeds over another parameter",
    (
        _real("abscissa", "abscissa", "the other parameter, named by the attribute parameter"),
        _real(
            "speed",
            "abscissa",
            "speed of the first bifurcation; highest speed where there is none, lowest speed where the cycle "
            "is unstable there",
        ),
        _flag("base", "abscissa", "cycle at the lowest speed; unset: taken as stable", "unstable", "stable"),
        _flag(
            "bifurcation",
            "abscissa",
            "the first bifurcation",
            "none",
            "fold",
            "period_doubling",
            "neimark_sacker",
        ),
        _flag("criticality", "abscissa", "type of the first bifurcation", "subcritical", "supercritical"),
        _real("angle", "abscissa", "argument of the critical multiplier", "rad"),
        _count("curve", "abscissa", "curve of the first bifurcation, index into the attribute curves"),
        _flag("caution", "abscissa", "whether an incomplete curve ends near the boundary", "no", "yes"),
    ),
)

KINDS: Mapping[str, GroupSpec] = {
    group.kind: group
    for group in (
        MACHINE,
        LINEAR,
        OPERATING_POINT,
        COEFFICIENTS,
        CRITICALS,
        UNBALANCE_RESPONSE,
        CYCLES,
        TORI,
        CURVE,
        BIFURCATION_SET,
        SURVEY,
        CERTIFICATE,
        REFINEMENT,
        CALIBRATION,
        TRANSIENT,
        TRANSIENT_ANALYSIS,
        OPERATING_RANGE,
    )
}
