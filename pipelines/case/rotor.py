"""Tables of the rotor: materials, beam elements, discs, supports, master nodes."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import Annotated, Any, ClassVar

from pydantic import Field, PlainSerializer, PlainValidator, TypeAdapter, ValidationInfo, field_validator

from pipelines.case.fields import (
    SECOND_ELASTIC_CONSTANT,
    GrownTable,
    Inconsistency,
    InconsistentError,
    Table,
    quantity,
    require_one,
    table,
)

MAXIMUM_ELEMENTS = 500
MAXIMUM_MASS = 1e5

NodeNumber = Annotated[int, Field(strict=True, ge=0)]


class Material(Table):
    """An isotropic linear elastic material; give exactly one of `poisson_ratio` and `shear_modulus`."""

    young_modulus: float = quantity(
        "Young's modulus", "Pa", at_least=1e6, because="SI units are Pa, not GPa; steel has 206e9 Pa"
    )
    density: float = quantity(
        "density", "kg/m3", at_least=1e-6, at_most=1e5, because="SI units are kg/m3; steel has 7850 kg/m3"
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
        require_one(info, value, SECOND_ELASTIC_CONSTANT, "the second elastic constant")
        if value is not None and "young_modulus" in info.data:
            poisson = info.data["young_modulus"] / (2 * value) - 1
            if not -1 < poisson <= 0.5:
                raise InconsistentError(
                    f"gives Poisson's ratio E/(2G) - 1 = {poisson:.3g}; an isotropic material is "
                    "stable only for -1 < nu <= 1/2"
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


class Element(GrownTable):
    """`count` consecutive beam elements of equal length: a cylinder, or a cone divided into them."""

    later_keys: ClassVar[frozenset[str]] = frozenset(
        {"outer_diameter_right", "inner_diameter_right", "axial_force"}
    )

    length: float = quantity(
        "length of one element",
        "m",
        at_least=1e-6,
        at_most=100,
        because="an element without length has no stiffness",
    )
    outer_diameter: float = quantity(
        "outer diameter; of a cone at its left end",
        "m",
        at_least=1e-6,
        at_most=100,
        because="the section must have material",
    )
    outer_diameter_right: float | None = quantity(
        "outer diameter at the right end of the last of the `count` elements, which makes them one cone; "
        "default: outer_diameter",
        "m",
        None,
        at_least=1e-6,
        at_most=100,
        because="the section must have material",
    )
    inner_diameter: float = quantity(
        "inner diameter, 0 for a solid shaft; of a conical bore at its left end",
        "m",
        0.0,
        at_least=0,
        because="0 is a solid shaft",
    )
    inner_diameter_right: float | None = quantity(
        "inner diameter at the right end of the last of the `count` elements; default: inner_diameter",
        "m",
        None,
        at_least=0,
        because="0 is a solid shaft",
    )
    material: str = quantity("name of a table of [rotor.materials]", "", "steel")
    count: int = quantity(
        "number of elements in a row",
        "",
        1,
        at_least=1,
        at_most=MAXIMUM_ELEMENTS,
        because=f"a rotor has 1 to {MAXIMUM_ELEMENTS} elements",
    )
    axial_force: float = quantity(
        "constant axial force in these elements, positive for tension, which stiffens them",
        "N",
        0.0,
        at_least=-1e9,
        at_most=1e9,
        because="a force in N",
    )

    @field_validator("inner_diameter")
    @classmethod
    def _wall(cls, value: float, info: ValidationInfo) -> float:
        _require_wall(value, "outer_diameter", info.data.get("outer_diameter"))
        return value

    @field_validator("inner_diameter_right")
    @classmethod
    def _right_wall(cls, value: float | None, info: ValidationInfo) -> float | None:
        data = info.data
        if {"outer_diameter", "outer_diameter_right", "inner_diameter"} <= data.keys():
            name = "outer_diameter" if data["outer_diameter_right"] is None else "outer_diameter_right"
            _require_wall(data["inner_diameter"] if value is None else value, name, data[name])
        return value

    @property
    def right_diameters(self) -> tuple[float, float]:
        """Outer and inner diameter at the right end [m]."""
        outer, inner = self.outer_diameter_right, self.inner_diameter_right
        return (
            self.outer_diameter if outer is None else outer,
            self.inner_diameter if inner is None else inner,
        )

    @property
    def is_cone(self) -> bool:
        """Whether a diameter changes along the elements."""
        return self.right_diameters != (self.outer_diameter, self.inner_diameter)

    @property
    def volume(self) -> float:
        """Volume of all `count` elements [m3]."""
        outer, inner = self.right_diameters
        square = self.outer_diameter**2 + self.outer_diameter * outer + outer**2
        square -= self.inner_diameter**2 + self.inner_diameter * inner + inner**2
        return math.pi / 12 * square * self.length * self.count

    def divided(self) -> tuple[Element, ...]:
        """The `count` elements one by one, from left to right."""
        if not self.is_cone:
            return (self.model_copy(update={"count": 1}),) * self.count
        ends = zip((self.outer_diameter, self.inner_diameter), self.right_diameters, strict=True)
        outer, inner = (
            [left + (right - left) * place / self.count for place in range(self.count)] + [right]
            for left, right in ends
        )
        return tuple(
            self.model_copy(
                update={
                    "count": 1,
                    "outer_diameter": outer[place],
                    "outer_diameter_right": outer[place + 1],
                    "inner_diameter": inner[place],
                    "inner_diameter_right": inner[place + 1],
                }
            )
            for place in range(self.count)
        )


def _require_wall(inner: float, name: str, outer: float | None) -> None:
    """Refuse an inner diameter that leaves no wall below the outer diameter of that name."""
    if outer is not None and inner >= outer:
        raise InconsistentError(
            f"must be smaller than {name} = {outer:g} m: the wall has no thickness otherwise"
        )


@dataclass(frozen=True)
class DiscInertia:
    """Mass [kg] of a rigid disc, and its moments of inertia about a diameter and the rotor axis [kg m2]."""

    mass: float
    diametral: float
    polar: float


class Disc(GrownTable):
    """A rigid disc at a node (wheel, collar, coupling): mass and inertias, or dimensions and material."""

    later_keys: ClassVar[frozenset[str]] = frozenset(
        {"outer_diameter", "inner_diameter", "width", "material"}
    )

    node: int = quantity("node of the disc", "", at_least=0, because="nodes are numbered from 0")
    outer_diameter: float | None = quantity(
        "outer diameter, with width instead of mass and inertias",
        "m",
        None,
        at_least=1e-6,
        at_most=100,
        because="a disc has a diameter",
    )
    inner_diameter: float = quantity(
        "diameter of the bore, where the shaft goes through", "m", 0.0, at_least=0, because="0 is no bore"
    )
    width: float | None = quantity(
        "width along the rotor axis",
        "m",
        None,
        at_least=1e-6,
        at_most=100,
        because="a disc without width has no mass",
    )
    material: str = quantity("name of a table of [rotor.materials]; with the dimensions", "", "steel")
    mass: float | None = quantity(
        "mass", "kg", None, at_least=0, at_most=MAXIMUM_MASS, because="mass cannot be negative and is in kg"
    )
    diametral_inertia: float | None = quantity(
        "moment of inertia about a diameter",
        "kg m2",
        None,
        at_least=0,
        at_most=1e9,
        because="inertia cannot be negative and is in kg m2",
    )
    polar_inertia: float | None = quantity(
        "moment of inertia about the rotor axis",
        "kg m2",
        None,
        at_least=0,
        because="inertia cannot be negative",
    )

    @field_validator("inner_diameter")
    @classmethod
    def _ring(cls, value: float, info: ValidationInfo) -> float:
        _require_wall(value, "outer_diameter", info.data.get("outer_diameter"))
        return value

    @field_validator("width")
    @classmethod
    def _both_dimensions(cls, value: float | None, info: ValidationInfo) -> float | None:
        if "outer_diameter" in info.data and (value is None) != (info.data["outer_diameter"] is None):
            raise InconsistentError("belongs to outer_diameter: give both of them, or mass and inertias")
        return value

    @field_validator("mass", "diametral_inertia", "polar_inertia")
    @classmethod
    def _one_way(cls, value: float | None, info: ValidationInfo) -> float | None:
        dimensions = [info.data.get(key) for key in ("outer_diameter", "width")]
        if not {"outer_diameter", "width", "inner_diameter"} <= info.data.keys():
            return value
        if dimensions == [None, None] and value is None:
            unit = "kg" if info.field_name == "mass" else "kg m2"
            name = str(info.field_name).replace("_", " ")
            raise InconsistentError(f"is missing: {name} [{unit}]; or give outer_diameter and width instead")
        if value is not None and dimensions != [None, None]:
            raise InconsistentError("follows from outer_diameter, width and material: give one or the other")
        if value is not None and info.data["inner_diameter"] > 0:
            raise InconsistentError("is given: inner_diameter belongs to outer_diameter and width")
        return value

    @field_validator("polar_inertia")
    @classmethod
    def _rigid_body(cls, value: float | None, info: ValidationInfo) -> float | None:
        diametral = info.data.get("diametral_inertia")
        # I_d = I_p/2 + (integral of z^2 dm); the margin admits values rounded to six digits.
        if diametral is not None and value is not None and value > 2 * diametral * (1 + 1e-5):
            raise InconsistentError(
                f"must be at most 2 x diametral_inertia = {2 * diametral:g} kg m2: no rigid body has more"
            )
        return value

    @property
    def has_dimensions(self) -> bool:
        """Whether it is given by dimensions and material."""
        return self.outer_diameter is not None

    def inertia(self, materials: Mapping[str, Material]) -> DiscInertia:
        """Mass and moments of inertia, given or those of a ring of the material.

        m = rho pi/4 (d_o^2 - d_i^2) w, I_p = m (d_o^2 + d_i^2)/8, I_d = I_p/2 + m w^2/12
        """
        if self.outer_diameter is None or self.width is None:
            assert self.mass is not None
            assert self.diametral_inertia is not None
            assert self.polar_inertia is not None
            return DiscInertia(self.mass, self.diametral_inertia, self.polar_inertia)
        outer, inner = self.outer_diameter**2, self.inner_diameter**2
        mass = materials[self.material].density * math.pi / 4 * (outer - inner) * self.width
        polar = mass * (outer + inner) / 8
        return DiscInertia(mass, 0.5 * polar + mass * self.width**2 / 12, polar)


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


class Master(Table):
    """A master node that keeps its slopes beside its translations; a number alone keeps the translations."""

    node: int = quantity("node of the shaft", "", at_least=0, because="nodes are numbered from 0")
    slopes: bool = quantity(
        "also keep the slopes: where a wheel overhangs, its tilt is a motion of its own", "", False
    )


_NODE_NUMBER = TypeAdapter(NodeNumber)


def _master(value: Any) -> int | Master:
    """A master as written in the file; without slopes its node number, so that a rotor has one form."""
    if isinstance(value, dict | Master):
        master = Master.model_validate(value)
        return master if master.slopes else master.node
    return _NODE_NUMBER.validate_python(value)


def _written(master: int | Master) -> int | dict[str, Any]:
    return master if isinstance(master, int) else master.model_dump()


MasterNode = Annotated[
    NodeNumber | Master,
    PlainValidator(_master, json_schema_input_type=NodeNumber | Master),
    PlainSerializer(_written),
]


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
    masters: tuple[MasterNode, ...] = table(
        "master nodes, rising; the Guyan condensation keeps their translations, and of `{ node = 0, slopes = "
        "true }` the slopes too",
        max_length=MAXIMUM_ELEMENTS + 1,
    )
    rayleigh_mass: float = quantity(
        "alpha of the damping alpha M + beta K", "1/s", 0.0, at_least=0, because="damping dissipates"
    )
    rayleigh_stiffness: float = quantity(
        "beta of the damping alpha M + beta K",
        "s",
        0.0,
        at_least=0,
        at_most=1e3,
        because="damping dissipates and beta is in s",
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
        problems: list[str | Inconsistency] = []
        total = sum(element.count for element in elements)
        if total > MAXIMUM_ELEMENTS:
            problems.append(f"make {total} elements; at most {MAXIMUM_ELEMENTS} are allowed")
        materials = info.data.get("materials")
        problems += _unknown_materials(elements, materials) or _buckled(elements, materials)
        if problems:
            raise InconsistentError(*problems)
        if materials is not None and not 0 < (mass := _mass(materials, elements, ())) <= MAXIMUM_MASS:
            raise InconsistentError(
                f"weigh {mass:.3g} kg; at most {MAXIMUM_MASS:g} kg are allowed: are lengths in m and "
                "densities in kg/m3?"
            )
        return elements

    @field_validator("discs")
    @classmethod
    def _discs(cls, discs: tuple[Disc, ...], info: ValidationInfo) -> tuple[Disc, ...]:
        materials = info.data.get("materials")
        if problems := _unknown_materials(discs, materials):
            raise InconsistentError(*problems)
        for index, disc in enumerate(discs):
            if materials is not None and (mass := disc.inertia(materials).mass) > MAXIMUM_MASS:
                raise InconsistentError(
                    ((index, "width"), f"makes {mass:.3g} kg; at most {MAXIMUM_MASS:g} kg are allowed")
                )
        return discs

    @field_validator("discs", "supports")
    @classmethod
    def _on_the_shaft(cls, attached: tuple[Any, ...], info: ValidationInfo) -> tuple[Any, ...]:
        last = _last_node(info)
        off = [
            ((index, "node"), off_shaft(item.node, last))
            for index, item in enumerate(attached)
            if last is not None and item.node > last
        ]
        if off:
            raise InconsistentError(*off)
        return attached

    @field_validator("masters")
    @classmethod
    def _masters(cls, masters: tuple[int | Master, ...], info: ValidationInfo) -> tuple[int | Master, ...]:
        last, nodes = _last_node(info), [node_of(master) for master in masters]
        problems: list[str | Inconsistency] = [
            ((index,) if isinstance(masters[index], int) else (index, "node"), off_shaft(node, last))
            for index, node in enumerate(nodes)
            if last is not None and node > last
        ]
        if len(nodes) < 2:
            problems.append("must name at least two nodes: the rotor stands on two bearings")
        if any(a >= b for a, b in pairwise(nodes)):
            problems.append("must rise strictly, each node once")
        if problems:
            raise InconsistentError(*problems)
        return masters

    def single_elements(self) -> tuple[Element, ...]:
        """One `Element` with count 1 per finite element, from left to right."""
        return tuple(single for element in self.elements for single in element.divided())

    def node_positions(self) -> tuple[float, ...]:
        """Axial position of every node [m]; node 0 lies at 0."""
        positions = [0.0]
        for element in self.single_elements():
            positions.append(positions[-1] + element.length)
        return tuple(positions)

    @property
    def master_nodes(self) -> tuple[int, ...]:
        """Nodes whose translations are kept, rising."""
        return tuple(node_of(master) for master in self.masters)

    @property
    def slope_nodes(self) -> tuple[int, ...]:
        """Master nodes whose slopes are kept as well, rising."""
        return tuple(master.node for master in self.masters if isinstance(master, Master))

    @property
    def condensed_freedoms(self) -> int:
        """Degrees of freedom of the condensed rotor: x, y of every master, and two slopes where kept."""
        return 2 * (len(self.masters) + len(self.slope_nodes))

    @property
    def node_count(self) -> int:
        """Number of nodes, one more than elements."""
        return 1 + sum(element.count for element in self.elements)

    @property
    def disc_inertias(self) -> tuple[DiscInertia, ...]:
        """Mass and moments of inertia of every disc."""
        return tuple(disc.inertia(self.materials) for disc in self.discs)

    @property
    def mass(self) -> float:
        """Mass of shaft and discs [kg]."""
        return _mass(self.materials, self.elements, self.discs)


def _last_node(info: ValidationInfo) -> int | None:
    elements = info.data.get("elements")
    return None if elements is None else sum(element.count for element in elements)


def node_of(master: int | Master) -> int:
    """Node of a master in either notation."""
    return master if isinstance(master, int) else master.node


def off_shaft(node: int, last: int | None) -> str:
    """Message for a node beyond the last one."""
    return f"node {node} is not on the shaft, whose nodes are 0 to {last}"


def _unknown_materials(
    parts: Sequence[Element | Disc], materials: Mapping[str, Material] | None
) -> list[Inconsistency]:
    """The parts whose material is not defined; none where the materials are themselves wrong."""
    if materials is None:
        return []
    message = f"no such material; defined: {', '.join(sorted(materials))}"
    return [
        ((index, "material"), message)
        for index, part in enumerate(parts)
        if part.material not in materials and not (isinstance(part, Disc) and not part.has_dimensions)
    ]


def _buckled(elements: Sequence[Element], materials: Mapping[str, Material] | None) -> list[Inconsistency]:
    """Elements that would buckle between their own nodes: P > pi^2 E I/l^2 of their thick end."""
    if materials is None:
        return []
    problems: list[Inconsistency] = []
    for index, element in enumerate(elements):
        ends = ((element.outer_diameter, element.inner_diameter), element.right_diameters)
        second_moment = max(math.pi / 64 * (outer**4 - inner**4) for outer, inner in ends)
        modulus = materials[element.material].young_modulus
        most = math.pi**2 * modulus * second_moment / element.length**2
        if -element.axial_force > most:
            problems.append(
                ((index, "axial_force"), f"buckles the element itself: {most:.4g} N of compression at most")
            )
    return problems


def _mass(materials: Mapping[str, Material], elements: tuple[Element, ...], discs: tuple[Disc, ...]) -> float:
    """m = sum rho V of the elements + discs."""
    shaft = sum(materials[element.material].density * element.volume for element in elements)
    return shaft + sum(disc.inertia(materials).mass for disc in discs)
