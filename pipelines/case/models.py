"""The description of one case: frozen configuration tables in SI units.

A case is a gas, a flexible rotor, two gas foil bearings, the excitation of their active rings, an operating point, the
numerics and one table per stage.  The checks here are those of one key or of keys against each other; whether an
equilibrium exists is the solver's business.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import Annotated, Any, Literal

from pydantic import Field, ValidationInfo, field_validator

from pipelines.case.fields import Inconsistent, Table, choice, quantity, table
from pipelines.case.scales import Scales

PARAMETERS = ("speed", "excitation_frequency", "displacement", "foil_stiffness")
"""Names of the continuation parameters, in the order of every parameter vector (all dimensionless)."""

MAXIMUM_ELEMENTS = 500
MAXIMUM_UNKNOWNS = 20_000
FOIL_STIFFNESS_KEYS = ("stiffness", "areal_stiffness", "bump", "rigid")

Number = Annotated[float, Field(strict=True)]
NodeNumber = Annotated[int, Field(strict=True, ge=0)]


def _given(info: ValidationInfo, keys: tuple[str, ...]) -> list[str] | None:
    """Those of `keys` that are set; None if one of them is itself invalid (then that is reported instead)."""
    if any(key not in info.data for key in keys):
        return None
    return [key for key in keys if info.data[key] is not None and info.data[key] is not False]


def _require_one(info: ValidationInfo, value: Any, keys: tuple[str, ...], what: str) -> Any:
    """Refuse a group of alternative keys (the one being validated is the last) unless exactly one is given."""
    given = _given(info, keys[:-1])
    if given is not None:
        given += [keys[-1]] if value is not None and value is not False else []
        if len(given) != 1:
            raise Inconsistent(
                ((), f"give exactly one of {', '.join(keys)} for {what}; given: {', '.join(given) or 'none'}")
            )
    return value


def _require_rising(value: tuple[float, float] | None) -> tuple[float, float] | None:
    if value is not None and not value[0] < value[1]:
        raise Inconsistent(((), f"must be [low, high] with low < high, given [{value[0]:g}, {value[1]:g}]"))
    return value


class Gas(Table):
    """The lubricating gas."""

    viscosity: float = quantity(
        "dynamic viscosity of the gas (isothermal)",
        "Pa s",
        above=0,
        at_most=1,
        because="without viscosity no pressure is generated; air at 20 degC has 1.8e-5 Pa s",
    )
    ambient_pressure: float = quantity(
        "pressure around the bearings",
        "Pa",
        above=0,
        at_most=1e9,
        because="the film is a compressible gas at ambient pressure; the atmosphere has 101325 Pa",
    )


class Material(Table):
    """An isotropic linear elastic material; give exactly one of `poisson_ratio` and `shear_modulus`."""

    young_modulus: float = quantity(
        "Young's modulus", "Pa", at_least=1e6, because="SI units are Pa, not GPa; steel has 206e9 Pa"
    )
    density: float = quantity(
        "density", "kg/m3", above=0, at_most=1e5, because="SI units are kg/m3; steel has 7850 kg/m3"
    )
    poisson_ratio: float | None = quantity(
        "Poisson's ratio",
        "1",
        None,
        above=-1,
        at_most=0.5,
        because="an isotropic material is stable only for -1 < nu <= 1/2",
    )
    shear_modulus: float | None = quantity(
        "shear modulus; Poisson's ratio is then E/(2G) - 1",
        "Pa",
        None,
        above=0,
        because="a beam without shear stiffness carries no load",
    )

    @field_validator("shear_modulus")
    @classmethod
    def _one_second_constant(cls, value: float | None, info: ValidationInfo) -> float | None:
        _require_one(info, value, ("poisson_ratio", "shear_modulus"), "the second elastic constant")
        if value is not None and "young_modulus" in info.data:
            poisson = info.data["young_modulus"] / (2 * value) - 1
            if not -1 < poisson <= 0.5:
                raise Inconsistent(
                    (
                        (),
                        f"gives Poisson's ratio E/(2G) - 1 = {poisson:.3g}; an isotropic material is "
                        "stable only for -1 < nu <= 1/2",
                    )
                )
        return value

    @property
    def resolved_poisson_ratio(self) -> float:
        """Poisson's ratio, from the shear modulus if that was given."""
        if self.poisson_ratio is not None:
            return self.poisson_ratio
        assert self.shear_modulus is not None
        return self.young_modulus / (2 * self.shear_modulus) - 1


STEEL = Material(young_modulus=206e9, density=7850.0, poisson_ratio=0.3)


class Element(Table):
    """`count` equal consecutive cylindrical beam elements; node numbers run from 0 along the rotor."""

    length: float = quantity(
        "length of one element",
        "m",
        above=0,
        at_most=100,
        because="an element without length has no stiffness",
    )
    outer_diameter: float = quantity(
        "outer diameter", "m", above=0, at_most=100, because="the section must have material"
    )
    inner_diameter: float = quantity(
        "inner diameter, 0 for a solid shaft", "m", 0.0, at_least=0, because="0 is a solid shaft"
    )
    material: str = quantity("name of a table of [rotor.materials]", "", "steel")
    count: int = quantity(
        "number of equal elements in a row",
        "",
        1,
        at_least=1,
        at_most=MAXIMUM_ELEMENTS,
        because=f"a rotor has 1 to {MAXIMUM_ELEMENTS} elements",
    )

    @field_validator("inner_diameter")
    @classmethod
    def _wall(cls, value: float, info: ValidationInfo) -> float:
        outer = info.data.get("outer_diameter")
        if outer is not None and value >= outer:
            raise Inconsistent(
                (
                    (),
                    f"must be smaller than outer_diameter = {outer:g} m: the wall has no thickness otherwise",
                )
            )
        return value


class Disc(Table):
    """A rigid disc at a node."""

    node: int = quantity("node of the disc", "", at_least=0, because="nodes are numbered from 0")
    mass: float = quantity("mass", "kg", at_least=0, because="mass cannot be negative")
    diametral_inertia: float = quantity(
        "moment of inertia about a diameter", "kg m2", at_least=0, because="inertia cannot be negative"
    )
    polar_inertia: float = quantity(
        "moment of inertia about the rotor axis", "kg m2", at_least=0, because="inertia cannot be negative"
    )

    @field_validator("polar_inertia")
    @classmethod
    def _rigid_body(cls, value: float, info: ValidationInfo) -> float:
        diametral = info.data.get("diametral_inertia")
        # I_d = I_p/2 + (integral of z^2 dm); the margin admits values rounded to six digits.
        if diametral is not None and value > 2 * diametral * (1 + 1e-5):
            raise Inconsistent(
                (
                    (),
                    f"must be at most 2 x diametral_inertia = {2 * diametral:g} kg m2: no rigid body "
                    "has more",
                )
            )
        return value


class Support(Table):
    """An extra linear support to ground at a node."""

    node: int = quantity("node of the support", "", at_least=0, because="nodes are numbered from 0")
    stiffness_xx: float = quantity("horizontal stiffness", "N/m", at_least=0, because="a support pulls back")
    stiffness_yy: float = quantity("vertical stiffness", "N/m", at_least=0, because="a support pulls back")
    stiffness_xy: float = quantity("cross-coupled stiffness, force in x by displacement in y", "N/m", 0.0)
    stiffness_yx: float = quantity("cross-coupled stiffness, force in y by displacement in x", "N/m", 0.0)
    damping_xx: float = quantity(
        "horizontal damping", "N s/m", 0.0, at_least=0, because="a passive support dissipates"
    )
    damping_yy: float = quantity(
        "vertical damping", "N s/m", 0.0, at_least=0, because="a passive support dissipates"
    )


class Rotor(Table):
    """A flexible rotor of beam elements, condensed onto its master nodes."""

    materials: dict[str, Material] = table(
        "materials by name; `steel` (E 206e9 Pa, nu 0.3, 7850 kg/m3) if the table is left out",
        {"steel": STEEL},
        min_length=1,
        max_length=100,
    )
    elements: tuple[Element, ...] = table(
        "beam elements from left to right", min_length=1, max_length=MAXIMUM_ELEMENTS
    )
    discs: tuple[Disc, ...] = table("rigid discs", (), max_length=MAXIMUM_ELEMENTS)
    supports: tuple[Support, ...] = table("extra linear supports to ground", (), max_length=MAXIMUM_ELEMENTS)
    masters: tuple[NodeNumber, ...] = table(
        "master nodes, rising; their translations are kept by the Guyan condensation",
        max_length=MAXIMUM_ELEMENTS + 1,
    )
    rayleigh_mass: float = quantity(
        "alpha of the damping alpha M + beta K", "1/s", 0.0, at_least=0, because="damping dissipates"
    )
    rayleigh_stiffness: float = quantity(
        "beta of the damping alpha M + beta K", "s", 0.0, at_least=0, because="damping dissipates"
    )
    gravity: float = quantity(
        "acceleration of gravity, along -y",
        "m/s2",
        9.81,
        at_least=0,
        at_most=1000,
        because="gravity points along -y; 0 is a weightless or vertical rotor",
    )

    @field_validator("elements")
    @classmethod
    def _elements(cls, elements: tuple[Element, ...], info: ValidationInfo) -> tuple[Element, ...]:
        problems: list[tuple[tuple[str | int, ...], str]] = []
        total = sum(element.count for element in elements)
        if total > MAXIMUM_ELEMENTS:
            problems.append(((), f"make {total} elements; at most {MAXIMUM_ELEMENTS} are allowed"))
        materials = info.data.get("materials")
        for index, element in enumerate(elements):
            if materials is not None and element.material not in materials:
                problems.append(
                    ((index, "material"), f"no such material; defined: {', '.join(sorted(materials))}")
                )
        if problems:
            raise Inconsistent(*problems)
        return elements

    @field_validator("discs", "supports")
    @classmethod
    def _on_the_shaft(cls, attached: tuple[Any, ...], info: ValidationInfo) -> tuple[Any, ...]:
        last = _last_node(info)
        off = [
            ((index, "node"), _off_shaft(item.node, last))
            for index, item in enumerate(attached)
            if last is not None and item.node > last
        ]
        if off:
            raise Inconsistent(*off)
        return attached

    @field_validator("masters")
    @classmethod
    def _masters(cls, masters: tuple[int, ...], info: ValidationInfo) -> tuple[int, ...]:
        last = _last_node(info)
        problems: list[tuple[tuple[str | int, ...], str]] = [
            ((index,), _off_shaft(node, last))
            for index, node in enumerate(masters)
            if last is not None and node > last
        ]
        if len(masters) < 2:
            problems.append(((), "must name at least two nodes: the rotor stands on two bearings"))
        if any(a >= b for a, b in zip(masters, masters[1:], strict=False)):
            problems.append(((), "must rise strictly, each node once"))
        if problems:
            raise Inconsistent(*problems)
        return masters

    @field_validator("gravity")
    @classmethod
    def _mass_is_sane(cls, gravity: float, info: ValidationInfo) -> float:
        if all(key in info.data for key in ("materials", "elements", "discs")):
            mass = _mass(info.data["materials"], info.data["elements"], info.data["discs"])
            if not 0 < mass <= 1e5:
                raise Inconsistent(
                    (
                        ("..",),
                        f"the rotor weighs {mass:.3g} kg; 0 to 1e5 kg are allowed: check that "
                        "lengths are in m and densities in kg/m3",
                    )
                )
        return gravity

    def single_elements(self) -> tuple[Element, ...]:
        """One `Element` with count 1 per finite element, from left to right."""
        return tuple(
            element.model_copy(update={"count": 1}) for element in self.elements for _ in range(element.count)
        )

    def node_positions(self) -> tuple[float, ...]:
        """Axial position of every node [m]; node 0 lies at 0."""
        positions = [0.0]
        for element in self.single_elements():
            positions.append(positions[-1] + element.length)
        return tuple(positions)

    @property
    def node_count(self) -> int:
        """Number of nodes, one more than elements."""
        return 1 + sum(element.count for element in self.elements)

    @property
    def mass(self) -> float:
        """Mass of shaft and discs [kg]."""
        return _mass(self.materials, self.elements, self.discs)


def _last_node(info: ValidationInfo) -> int | None:
    elements = info.data.get("elements")
    return None if elements is None else sum(element.count for element in elements)


def _off_shaft(node: int, last: int | None) -> str:
    return f"node {node} is not on the shaft, whose nodes are 0 to {last}"


def _mass(materials: dict[str, Material], elements: tuple[Element, ...], discs: tuple[Disc, ...]) -> float:
    """m = sum rho pi/4 (d_o^2 - d_i^2) l + discs."""
    shaft = sum(
        element.count
        * element.length
        * materials[element.material].density
        * math.pi
        / 4
        * (element.outer_diameter**2 - element.inner_diameter**2)
        for element in elements
    )
    return shaft + sum(disc.mass for disc in discs)


class Bump(Table):
    """Geometry of the bump foil, from which its stiffness follows (Eq. 6, 7)."""

    pitch: float = quantity(
        "distance from bump to bump, S", "m", above=0, because="bumps repeat along the foil"
    )
    half_length: float = quantity("half length of a bump, l", "m", above=0, because="a bump has a length")
    thickness: float = quantity(
        "thickness of the bump foil, t", "m", above=0, because="a foil has a thickness"
    )
    young_modulus: float = quantity(
        "Young's modulus of the bump foil", "Pa", at_least=1e6, because="SI units are Pa, not GPa"
    )
    poisson_ratio: float = quantity(
        "Poisson's ratio of the bump foil",
        "1",
        above=-1,
        at_most=0.5,
        because="an isotropic material is stable only for -1 < nu <= 1/2",
    )

    @field_validator("half_length")
    @classmethod
    def _within_pitch(cls, value: float, info: ValidationInfo) -> float:
        pitch = info.data.get("pitch")
        if pitch is not None and 2 * value > pitch:
            raise Inconsistent(
                ((), f"must be at most half of pitch = {pitch:g} m: bumps would overlap otherwise")
            )
        return value


class Foil(Table):
    """The compliant foil: an elastic foundation with damping (Eq. 5-8); exactly one way to give its stiffness."""

    stiffness: float | None = quantity(
        "dimensionless foil stiffness k_f = k c/p0",
        "1",
        None,
        above=0,
        because="a foil without stiffness does not hold the film; use rigid = true for a plain bearing",
    )
    areal_stiffness: float | None = quantity(
        "foil stiffness per area, k",
        "N/m3",
        None,
        above=0,
        because="a foil without stiffness does not hold the film; use rigid = true for a plain bearing",
    )
    bump: Bump | None = table("bump geometry", None)
    rigid: bool = quantity("a plain bearing without foil", "", False)
    loss_factor: float | None = quantity(
        "loss factor eta; not needed for a rigid bearing",
        "1",
        None,
        above=0,
        at_most=1e3,
        because="the foil's rate is (p - k q)/c and c = eta k cannot be zero",
    )
    damping: Literal["proportional", "loss_factor"] = choice(
        "reading of eta: `proportional` c = eta k (the paper's), `loss_factor` c = eta k/Omega",
        "proportional",
    )
    pressure: Literal["gauge", "absolute"] = choice(
        "pressure that loads the foil: `gauge` p - p0, `absolute` p (adds the constant 1/k_f)", "gauge"
    )

    @field_validator("rigid")
    @classmethod
    def _one_stiffness(cls, value: bool, info: ValidationInfo) -> bool:
        _require_one(info, value, FOIL_STIFFNESS_KEYS, "the stiffness of the foil")
        return value

    @field_validator("loss_factor")
    @classmethod
    def _damped(cls, value: float | None, info: ValidationInfo) -> float | None:
        if value is None and info.data.get("rigid") is False:
            raise Inconsistent(
                ((), "is missing: the foil's rate is (p - k q)/c and c = eta k cannot be zero")
            )
        return value


class Bearing(Table):
    """One gas foil bearing."""

    node: int = quantity(
        "node of the journal; must be a master node", "", at_least=0, because="nodes are numbered from 0"
    )
    radius: float = quantity("radius R", "m", above=0, at_most=10, because="the journal has a radius")
    length: float = quantity(
        "axial length L", "m", above=0, at_most=10, because="a bearing without length carries nothing"
    )
    clearance: float = quantity(
        "radial clearance c", "m", above=0, because="the film has no thickness otherwise"
    )
    film: Literal["edge", "periodic"] = choice(
        "`edge`: ambient pressure along the foil's edge line at edge_angle; `periodic`: uninterrupted film",
        "edge",
    )
    edge_angle: float = quantity(
        "angle theta_0 of the foil's edge line, from +x towards +y; gravity points to 3 pi/2",
        "rad",
        0.0,
        at_least=-2 * math.pi,
        at_most=2 * math.pi,
        because="an angle in rad, not in degrees",
    )
    clipping: Literal["gumbel", "smooth", "full"] = choice(
        "sub-ambient pressure in the gas force: `gumbel` counts as ambient, `smooth` the same regularised, "
        "`full` counts as it is",
        "gumbel",
    )
    smoothing: float = quantity(
        "width of the regularisation of `smooth`, as a part of ambient pressure",
        "1",
        0.01,
        above=0,
        at_most=1,
        because="a positive width makes the clipping smooth",
    )
    foil: Foil = table("the compliant foil")

    @field_validator("clearance")
    @classmethod
    def _thin(cls, value: float, info: ValidationInfo) -> float:
        radius = info.data.get("radius")
        if radius is not None and value > 0.05 * radius:
            raise Inconsistent(
                (
                    (),
                    f"must be at most 0.05 x radius = {0.05 * radius:g} m: Reynolds' equation holds "
                    "for thin films only",
                )
            )
        return value


class Ring(Table):
    """The active outer ring, loaded by two opposite forces (Appendix)."""

    inner_radius: float = quantity("inner radius", "m", above=0, because="the ring surrounds the bearing")
    thickness: float = quantity(
        "radial thickness", "m", above=0, because="a ring without thickness has no stiffness"
    )
    width: float = quantity("axial width", "m", above=0, because="a ring without width has no stiffness")
    young_modulus: float = quantity("Young's modulus", "Pa", at_least=1e6, because="SI units are Pa, not GPa")
    poisson_ratio: float = quantity(
        "Poisson's ratio",
        "1",
        above=-1,
        at_most=0.5,
        because="an isotropic material is stable only for -1 < nu <= 1/2",
    )

    @field_validator("thickness")
    @classmethod
    def _curved_beam(cls, value: float, info: ValidationInfo) -> float:
        radius = info.data.get("inner_radius")
        if radius is not None and value > radius:
            raise Inconsistent(
                (
                    (),
                    f"must be at most inner_radius = {radius:g} m: the ring formulas are those of a "
                    "curved beam",
                )
            )
        return value


class Excitation(Table):
    """The harmonic deformation of the rings; the same frequency in both bearings."""

    displacement: float | None = quantity(
        "largest vertical displacement delta of the ring, as a part of the clearance; 0 is the passive bearing",
        "1",
        None,
        at_least=0,
        below=1,
        because="a displacement of a whole clearance closes the film",
    )
    load: float | None = quantity(
        "peak load F0 on the ring instead of displacement; needs [excitation.ring]",
        "N",
        None,
        at_least=0,
        because="the load presses the ring together",
    )
    frequency: float | None = quantity(
        "dimensionless excitation frequency Omega_ex; may be left out without excitation (displacement 0)",
        "1",
        None,
        above=0,
        at_most=1e4,
        because="the period is 2 pi/Omega_ex",
    )
    frequency_hz: float | None = quantity(
        "excitation frequency instead of frequency", "Hz", None, above=0, because="the period is 1/frequency"
    )
    ratio: float | None = quantity(
        "ratio rho = |d_h/d_v| of horizontal to vertical displacement; default: from the ring, a thin ring without one",
        "1",
        None,
        at_least=0,
        at_most=10,
        because="the ring widens sideways when it is pressed together",
    )
    ring: Ring | None = table("geometry of the ring", None)
    amplitudes: tuple[Number, Number] = table(
        "factor on the displacement of each bearing", (1.0, 1.0), unit="1"
    )
    phases: tuple[Number, Number] = table("phase of each bearing's ring", (0.0, 0.0), unit="rad")

    @field_validator("load")
    @classmethod
    def _one_amplitude(cls, value: float | None, info: ValidationInfo) -> float | None:
        _require_one(info, value, ("displacement", "load"), "the amplitude of the ring")
        return value

    @field_validator("frequency_hz")
    @classmethod
    def _one_frequency(cls, value: float | None, info: ValidationInfo) -> float | None:
        passive = info.data.get("displacement") == 0
        if not (passive and value is None and _given(info, ("frequency",)) == []):
            _require_one(info, value, ("frequency", "frequency_hz"), "the excitation frequency")
        return value

    @field_validator("ring")
    @classmethod
    def _ring(cls, value: Ring | None, info: ValidationInfo) -> Ring | None:
        if value is None and info.data.get("load") is not None:
            raise Inconsistent(
                ((), "is missing: the load F0 needs the ring's geometry to become a displacement")
            )
        if value is not None and info.data.get("ratio") is not None:
            raise Inconsistent(((), "gives the ratio |d_h/d_v| already: give either ratio or ring"))
        return value

    @field_validator("amplitudes")
    @classmethod
    def _open_film(cls, value: tuple[float, float], info: ValidationInfo) -> tuple[float, float]:
        if min(value) < 0:
            raise Inconsistent(((), "must not be negative: give the phase pi for opposite motion"))
        displacement = info.data.get("displacement") or 0.0
        if max(value) * displacement >= 1:
            raise Inconsistent(
                (
                    (),
                    f"times displacement = {displacement:g} must stay below 1: the ring closes the "
                    "film otherwise",
                )
            )
        return value

    @field_validator("phases")
    @classmethod
    def _radians(cls, value: tuple[float, float]) -> tuple[float, float]:
        if max(abs(value[0]), abs(value[1])) > 2 * math.pi:
            raise Inconsistent(((), "must lie within -2 pi and 2 pi: an angle in rad, not in degrees"))
        return value


class Operation(Table):
    """The operating point; exactly one of `speed` and `speed_rpm`."""

    speed: float | None = quantity(
        "dimensionless rotating speed Omega (the bearing number of the first bearing)",
        "1",
        None,
        above=0,
        at_most=1e3,
        because="the film carries by rotation",
    )
    speed_rpm: float | None = quantity(
        "rotating speed", "rpm", None, above=0, because="the film carries by rotation"
    )

    @field_validator("speed_rpm")
    @classmethod
    def _one_speed(cls, value: float | None, info: ValidationInfo) -> float | None:
        _require_one(info, value, ("speed", "speed_rpm"), "the rotating speed")
        return value


class Numerics(Table):
    """Grid, schemes and tolerances."""

    circumferential: int = quantity(
        "circumferential intervals of the film grid",
        "",
        40,
        at_least=8,
        at_most=1024,
        because="fewer do not resolve the pressure wave, more do not fit in memory",
    )
    axial: int = quantity(
        "axial unknowns on the half film",
        "",
        3,
        at_least=1,
        at_most=32,
        because="Chebyshev collocation converges with 2 to 4; stiffness grows like its fourth power",
    )
    scheme: Literal["central", "backward"] = choice(
        "circumferential convection: `central` second order, `backward` the paper's first order", "central"
    )
    axial_scheme: Literal["chebyshev", "uniform"] = choice(
        "`chebyshev` collocation or the paper's `uniform` differences", "chebyshev"
    )
    stepper: Literal["rk4"] = choice("time stepper of the period map", "rk4")
    steps_per_period: int | None = quantity(
        "time steps per excitation period; default: from the measured spectral radius",
        "",
        None,
        at_least=8,
        at_most=10_000_000,
        because="a period needs steps to be resolved",
    )
    newton_tolerance: float = quantity(
        "tolerance of Newton's method on the dimensionless residual",
        "1",
        1e-10,
        above=0,
        at_most=1e-3,
        because="events are located far below it otherwise",
    )
    newton_iterations: int = quantity(
        "most Newton iterations per point",
        "",
        12,
        at_least=1,
        at_most=1000,
        because="one iteration is the least",
    )
    multiplier_cut: float = quantity(
        "Floquet multipliers above this modulus are kept in the slow subspace",
        "1",
        1e-3,
        above=0,
        below=1,
        because="multipliers near the unit circle must be inside, decayed ones outside",
    )
    event_tolerance: float = quantity(
        "tolerance of located bifurcations in the parameter",
        "1",
        1e-8,
        above=0,
        at_most=1e-2,
        because="a bracket is halved until it is this narrow",
    )
    max_columns: int = quantity(
        "most columns of the slow subspace",
        "",
        64,
        at_least=2,
        at_most=4096,
        because="a pair of multipliers needs two columns",
    )


class Linearize(Table):
    """Equilibria and eigenvalues along the speed."""

    speed_range: tuple[Number, Number] = table("dimensionless speeds from, to", (0.2, 1.6), unit="1")
    points: int = quantity(
        "number of speeds", "", 41, at_least=2, at_most=100_000, because="a range has two ends"
    )
    whirl_ratios: tuple[Number, ...] = table(
        "whirl frequency / rotating speed at which bearing stiffness and damping are given",
        (0.5, 1.0),
        unit="1",
        min_length=1,
        max_length=1000,
    )
    eigenvalues: int = quantity(
        "number of leading eigenvalues", "", 12, at_least=1, at_most=500, because="one is the least"
    )

    @field_validator("speed_range")
    @classmethod
    def _range(cls, value: tuple[float, float]) -> tuple[float, float] | None:
        return _positive_range(value, "the film carries by rotation")

    @field_validator("whirl_ratios")
    @classmethod
    def _positive(cls, value: tuple[float, ...]) -> tuple[float, ...]:
        if min(value) <= 0:
            raise Inconsistent(
                ((), "must be positive: damping is the quadrature part over the whirl frequency")
            )
        return value


class Criticals(Table):
    """Critical speeds, Campbell diagram and the table of parametric resonances."""

    speed_range: tuple[Number, Number] = table("dimensionless speeds from, to", (0.1, 2.0), unit="1")
    points: int = quantity(
        "number of speeds", "", 41, at_least=2, at_most=100_000, because="a range has two ends"
    )
    max_damping_ratio: float = quantity(
        "modes damped more than this are no critical speeds",
        "1",
        0.5,
        above=0,
        at_most=1,
        because="a damping ratio of 1 no longer oscillates",
    )
    orders: int = quantity(
        "largest order n of the resonances 2 Omega_j/n and |Omega_j +- Omega_k|/n",
        "",
        3,
        at_least=1,
        at_most=20,
        because="order 1 is the principal resonance",
    )
    unbalance_points: int = quantity(
        "speeds of the unbalance response that compares full and condensed rotor",
        "",
        200,
        at_least=2,
        at_most=100_000,
        because="a range has two ends",
    )

    @field_validator("speed_range")
    @classmethod
    def _range(cls, value: tuple[float, float]) -> tuple[float, float] | None:
        return _positive_range(value, "the film carries by rotation")


def _positive_range(value: tuple[float, float], because: str) -> tuple[float, float] | None:
    if value[0] <= 0:
        raise Inconsistent(((0,), f"must be > 0: {because}"))
    return _require_rising(value)


class ContinueCycles(Table):
    """Continuation of limit cycles in one parameter."""

    parameter: Literal["speed", "excitation_frequency", "displacement", "foil_stiffness"] = choice(
        "dimensionless parameter that is continued; `foil_stiffness` scales both foils together", "speed"
    )
    range: tuple[Number, Number] = table(
        "values of the parameter between which the branch is followed", (0.2, 1.6), unit="1"
    )
    start: float | None = quantity(
        "value of the parameter where the branch starts; default: the case's own value", "1", None
    )
    formulation: Literal["stroboscopic", "autonomous"] = choice(
        "`stroboscopic`: period map of the forced system; `autonomous`: unknown period with an integral phase "
        "condition (needed for self-excited whirl, displacement 0)",
        "stroboscopic",
    )
    step: float = quantity(
        "first arclength step", "1", 0.02, above=0, because="a branch is followed in steps"
    )
    minimum_step: float = quantity(
        "the branch ends when a step would be shorter",
        "1",
        1e-5,
        above=0,
        because="a branch is followed in steps",
    )
    maximum_step: float = quantity(
        "longest arclength step", "1", 0.05, above=0, because="a branch is followed in steps"
    )
    max_points: int = quantity(
        "the branch ends after this many points",
        "",
        200,
        at_least=1,
        at_most=100_000,
        because="the store is laid out for them",
    )
    direction: Literal["up", "down", "both"] = choice("direction of the parameter at the start", "up")

    @field_validator("range")
    @classmethod
    def _range(cls, value: tuple[float, float], info: ValidationInfo) -> tuple[float, float] | None:
        parameter = info.data.get("parameter")
        if parameter == "displacement":
            if value[0] < 0 or value[1] >= 1:
                raise Inconsistent(
                    ((), "must lie within 0 <= displacement < 1: the ring closes the film otherwise")
                )
            return _require_rising(value)
        return _positive_range(value, "this parameter is positive")

    @field_validator("start")
    @classmethod
    def _start(cls, value: float | None, info: ValidationInfo) -> float | None:
        low, high = info.data.get("range", (-math.inf, math.inf))
        if value is not None and not low <= value <= high:
            raise Inconsistent(((), f"must lie inside range = [{low:g}, {high:g}]"))
        return value

    @field_validator("maximum_step")
    @classmethod
    def _steps(cls, value: float, info: ValidationInfo) -> float:
        minimum, step = info.data.get("minimum_step", 0.0), info.data.get("step", value)
        if not minimum <= step <= value:
            raise Inconsistent(
                (
                    (),
                    f"minimum_step <= step <= maximum_step must hold, given {minimum:g}, {step:g}, {value:g}",
                )
            )
        return value


class Case(Table):
    """One case: everything that a computation needs to know."""

    name: str = quantity(
        "name of the case; letters, digits, `.`, `_`, `-`",
        "",
        pattern=r"^[A-Za-z0-9][A-Za-z0-9._-]*$",
        max_length=64,
        because="it names a group of the store",
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
    criticals: Criticals = table("stage `agfb criticals`", Criticals())
    continue_cycles: ContinueCycles = table("stage `agfb continue-cycles`", ContinueCycles())

    @field_validator("bearings")
    @classmethod
    def _bearings(cls, bearings: tuple[Bearing, Bearing], info: ValidationInfo) -> tuple[Bearing, Bearing]:
        problems: list[tuple[tuple[str | int, ...], str]] = []
        rotor: Rotor | None = info.data.get("rotor")
        for index, bearing in enumerate(bearings):
            path = (index, "node")
            if rotor is None:
                continue
            if bearing.node >= rotor.node_count:
                problems.append((path, _off_shaft(bearing.node, rotor.node_count - 1)))
            elif bearing.node not in rotor.masters:
                problems.append(
                    (
                        path,
                        f"node {bearing.node} must be one of rotor.masters = {list(rotor.masters)}: the "
                        "film acts on nodes that the condensation keeps",
                    )
                )
        if bearings[0].node == bearings[1].node:
            problems.append(
                ((1, "node"), "both bearings stand on the same node: the rotor could tilt freely")
            )
        if problems:
            raise Inconsistent(*problems)
        return bearings

    @field_validator("excitation")
    @classmethod
    def _ring_fits(cls, excitation: Excitation, info: ValidationInfo) -> Excitation:
        bearings: tuple[Bearing, ...] = info.data.get("bearings", ())
        radius = max((bearing.radius + bearing.clearance for bearing in bearings), default=0.0)
        if excitation.ring is not None and excitation.ring.inner_radius < radius:
            raise Inconsistent(
                (
                    ("ring", "inner_radius"),
                    f"must be at least {radius:g} m: the ring surrounds journal and film",
                )
            )
        return excitation

    @field_validator("numerics")
    @classmethod
    def _fits_in_memory(cls, numerics: Numerics, info: ValidationInfo) -> Numerics:
        rotor: Rotor | None = info.data.get("rotor")
        masters = len(rotor.masters) if rotor is not None else 2
        # N = 2 (N_theta - 1)(N_z + 1) + 4 n_master
        unknowns = 2 * (numerics.circumferential - 1) * (numerics.axial + 1) + 4 * masters
        if unknowns > MAXIMUM_UNKNOWNS:
            raise Inconsistent(
                (
                    (),
                    f"the grid {numerics.circumferential} x {numerics.axial} makes {unknowns} unknowns; "
                    f"at most {MAXIMUM_UNKNOWNS} are allowed",
                )
            )
        return numerics

    @field_validator("continue_cycles")
    @classmethod
    def _continuation(cls, stage: ContinueCycles, info: ValidationInfo) -> ContinueCycles:
        needed = ("gas", "bearings", "excitation", "operation")
        # A stage that the file does not mention must not stop another one.
        if stage.model_fields_set and all(key in info.data for key in needed):
            problems = list(_continuation_problems(stage, *(info.data[key] for key in needed)))
            if problems:
                raise Inconsistent(*problems)
        return stage


def _continuation_problems(
    stage: ContinueCycles,
    gas: Gas,
    bearings: tuple[Bearing, Bearing],
    excitation: Excitation,
    operation: Operation,
) -> Iterator[tuple[tuple[str | int, ...], str]]:
    """What makes the continuation impossible for this machine."""
    name = stage.parameter
    unforced = excitation.frequency is None and excitation.frequency_hz is None
    if name == "foil_stiffness" and any(bearing.foil.rigid for bearing in bearings):
        yield ("parameter",), "a rigid bearing has no foil stiffness to continue"
    if name == "excitation_frequency" and excitation.displacement == 0:
        yield ("parameter",), "has no effect at displacement 0: nothing depends on the excitation frequency"
    if unforced and (stage.formulation == "stroboscopic" or name == "displacement"):
        yield (
            ("formulation",),
            (
                "the stroboscopic period is 2 pi/Omega_ex: give excitation.frequency, or "
                'formulation = "autonomous" for self-excited cycles'
            ),
        )
    if name == "displacement" and max(excitation.amplitudes) * stage.range[1] >= 1:
        yield (
            ("range",),
            "times the largest of excitation.amplitudes must stay below 1: the ring closes the film",
        )
    if stage.start is None and not (name == "displacement" and excitation.load is not None):
        value = dict(
            zip(PARAMETERS, Scales.of(gas, bearings).parameter_values(excitation, operation), strict=True)
        )[name]
        if not stage.range[0] <= value <= stage.range[1]:
            yield (
                ("range",),
                (
                    f"[{stage.range[0]:g}, {stage.range[1]:g}] does not contain the case's own {name} = "
                    f"{value:.6g}, where the branch starts: give start, or another range"
                ),
            )
