"""Rotors saved by ROSS (`Rotor.save("rotor.toml")`, the layout of version 2.3).

Every part is a top-level table whose name begins with its class: `ShaftElement_TAG`, `DiskElement_TAG`, ...
Numbers are SI, speeds in rad/s. ROSS has six freedoms per node; agfb has the four of bending.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import Any, TypeGuard

from pipelines.case.imports.parts import Findings, Imported, Part, joined
from pipelines.case.locating import key_lines
from pipelines.case.reading import parse_toml
from pipelines.case.rotor import Disc, Element, Material, Support

SHAFT, COUPLING, DISC, GEAR, MASS = (
    "ShaftElement",
    "CouplingElement",
    "DiskElement",
    "GearElement",
    "PointMass",
)
BENDING_ONLY = "axial and torsional motion: agfb's rotor bends only"
UNCOUPLED = ("cxy", "cyx", "mxx", "myy", "mxy", "myx", "kzz", "czz", "mzz")
"""Coefficients of ROSS's bearings that a support does not have."""
COEFFICIENTS = {
    "stiffness_xx": "kxx",
    "stiffness_yy": "kyy",
    "stiffness_xy": "kxy",
    "stiffness_yx": "kyx",
    "damping_xx": "cxx",
    "damping_yy": "cyy",
}
OPTIONS = (
    ("shear_effects", True, "without shear: agfb's elements shear"),
    ("rotary_inertia", True, "without rotary inertia: agfb's elements have it"),
    ("gyroscopic", True, "without gyroscopic effect: agfb's elements have it"),
    ("shear_method_calc", "cowper", "with another shear coefficient than Cowper's, which agfb takes"),
)


@dataclass(frozen=True)
class _Part:
    """A part as ROSS wrote it; ``line`` is that of its table."""

    name: str
    values: Mapping[str, Any]
    line: int

    @property
    def kind(self) -> str:
        """Its class in ROSS."""
        return self.name.partition("_")[0]

    @property
    def tag(self) -> str:
        """The user's name for it."""
        return self.name.partition("_")[2]


def read_ross(text: str, file: str) -> Imported:
    """The rotor of a saved file; raises CaseError with the line of every problem."""
    findings = Findings(file)
    parts, parameters, version = _parts(text, findings)
    findings.close()
    shaft = _Shaft.of(parts, findings)
    findings.close()
    materials, elements = _elements(shaft, findings)
    findings.close()
    discs = tuple(_discs(parts, shaft, findings))
    supports = tuple(_supports(parts, shaft, parameters.get("rated_w"), findings))
    findings.close()
    for part in parts:
        if part.kind not in (SHAFT, COUPLING, DISC, GEAR, MASS) and "kxx" not in part.values:
            findings.lost.append(f"{part.name}: a part of a kind that agfb does not know")
    alpha, beta = _rayleigh(shaft, findings)
    findings.lost.append(BENDING_ONLY)
    found = Imported(
        f"{file}, saved by ROSS {version}",
        materials,
        joined(elements),
        discs,
        supports,
        _foil_nodes(supports, findings),
        alpha,
        beta,
        _rated_rpm(parameters.get("rated_w")),
        tuple(findings.changed),
        tuple(findings.lost),
    )
    return findings.check(found)


def _parts(text: str, findings: Findings) -> tuple[list[_Part], Mapping[str, Any], str]:
    """All parts in the order of the file, ROSS's parameters and version."""
    document, lines = parse_toml(text, findings.file), key_lines(text)
    tables = {name: value for name, value in document.items() if isinstance(value, dict)}
    parts = [
        _Part(name, values, lines.get((name,), 1)) for name, values in tables.items() if name != "parameters"
    ]
    version = document.get("ross_version")
    if not isinstance(version, str) or not any(part.kind == SHAFT for part in parts):
        what = "elements of a shaft" if isinstance(version, str) else "ross_version"
        message = f"no rotor saved by ROSS, it has no {what}; ROSS writes one with rotor.save('rotor.toml')"
        findings.refuse(1, "", message)
    elif not version.startswith("2."):
        findings.changed.append(f"saved by ROSS {version}: the layout of version 2.3 is assumed")
    return parts, tables.get("parameters", {}), str(version)


@dataclass(frozen=True)
class _Shaft:
    """The elements of the shaft from left to right, and the couplings at its ends.

    ``first`` is ROSS's number of the left node.
    """

    elements: tuple[_Part, ...]
    couplings: tuple[_Part, ...]
    first: int

    @classmethod
    def of(cls, parts: Sequence[_Part], findings: Findings) -> _Shaft:
        """Put the elements in order; a gap between them is a problem, a second layer is told."""
        by_node: dict[int, _Part] = {}
        for part in parts:
            if part.kind != SHAFT:
                continue
            node = _node(part, findings)
            if node is not None and (other := by_node.setdefault(node, part)) is not part:
                findings.lost.append(f"{part.name}: lies on {other.name}; agfb's shaft has one layer")
        nodes = sorted(by_node)
        for left, right in pairwise(nodes):
            if right != left + 1:
                message = f"is missing: the shaft has no element between nodes {left + 1} and {right}"
                findings.refuse(by_node[right].line, f"{SHAFT} {left + 1}", message)
        couplings = tuple(part for part in parts if part.kind == COUPLING)
        return cls(tuple(by_node[node] for node in nodes), couplings, nodes[0] if nodes else 0)

    @property
    def last(self) -> int:
        """The number of the right node, counted from 0."""
        return len(self.elements)

    def node(self, part: _Part, findings: Findings) -> int | None:
        """The node of a part, counted from 0; None where it is not on the shaft, which is told."""
        number = _node(part, findings)
        if number is None or 0 <= number - self.first <= self.last:
            return None if number is None else number - self.first
        findings.lost.append(f"{part.name}: stands on node {number}, which is not on the shaft")
        return None


def _node(part: _Part, findings: Findings) -> int | None:
    number = part.values.get("n")
    if isinstance(number, int) and not isinstance(number, bool) and number >= 0:
        return number
    findings.refuse(part.line, f"{part.name}: n", "must be the number of a node", str(number)[:40])
    return None


def _elements(shaft: _Shaft, findings: Findings) -> tuple[dict[str, Material | None], list[Part[Element]]]:
    """Materials by name, and the elements."""
    materials: dict[str, Material | None] = {}
    elements = []
    for part in shaft.elements:
        name = _material(part, materials, findings)
        left_outer, left_inner = (
            findings.number(part.values, key, part.line, part.name) for key in ("odl", "idl")
        )
        values: dict[str, Any] = {
            "length": findings.number(part.values, "L", part.line, part.name),
            "outer_diameter": left_outer,
            "inner_diameter": left_inner,
            "material": name,
            "axial_force": findings.number(part.values, "axial_force", part.line, part.name),
        }
        for key, ours, left in (
            ("odr", "outer_diameter_right", left_outer),
            ("idr", "inner_diameter_right", left_inner),
        ):
            if key in part.values and part.values[key] != left:
                values[ours] = findings.number(part.values, key, part.line, part.name)
        element = findings.table(Element, values, part.line, part.name)
        if element is not None:
            named = "" if part.tag.startswith("Shaft Element ") else part.tag
            elements.append(Part(element, named))
        if findings.number(part.values, "torque", part.line, part.name):
            findings.lost.append(f"{part.name}: its torque")
    for key, usual, told in OPTIONS:
        if count := sum(part.values.get(key, usual) != usual for part in shaft.elements):
            findings.changed.append(f"shaft elements {told} ({count} of {len(shaft.elements)})")
    return materials, elements


def _material(part: _Part, materials: dict[str, Material | None], findings: Findings) -> str:
    """Name of the element's material, which is added to the materials."""
    written = part.values.get("material")
    if not isinstance(written, dict) or not isinstance(written.get("name"), str):
        findings.refuse(part.line, f"{part.name}: material", "is missing: a table with name, rho, E and G_s")
        return ""
    values = {
        ours: findings.number(written, key, part.line, f"{part.name}: material")
        for ours, key in (("young_modulus", "E"), ("density", "rho"), ("shear_modulus", "G_s"))
    }
    material = findings.table(Material, values, part.line, f"{part.name}: material {written['name']}")
    name, number = written["name"], 1
    while materials.get(name, material) != material:  # two materials of one name
        number += 1
        name = f"{written['name']}_{number}"
    if material is not None:
        materials[name] = material
    return name


def _discs(parts: Sequence[_Part], shaft: _Shaft, findings: Findings) -> Iterator[Part[Disc]]:
    """Discs; also from gears, point masses and the halves of couplings at the ends of the shaft."""
    for part in parts:
        if part.kind in (DISC, GEAR):
            if part.kind == GEAR:
                findings.lost.append(f"{part.name}: its mesh; the gear is a disc")
            yield from _disc(part, shaft.node(part, findings), ("m", "Id", "Ip"), part.tag, findings)
        elif part.kind == MASS:
            yield from _point_mass(part, shaft, findings)
        elif part.kind == COUPLING:
            yield from _coupling(part, shaft, findings)


def _disc(
    part: _Part, node: int | None, keys: Sequence[str | None], remark: str, findings: Findings
) -> Iterator[Part[Disc]]:
    if node is None:
        return
    mass, diametral, polar = (
        0.0 if key is None else findings.number(part.values, key, part.line, part.name) for key in keys
    )
    values = {"node": node, "mass": mass, "diametral_inertia": diametral, "polar_inertia": polar}
    disc = findings.table(Disc, values, part.line, part.name)
    if disc is not None:
        yield Part(disc, remark)


def _point_mass(part: _Part, shaft: _Shaft, findings: Findings) -> Iterator[Part[Disc]]:
    node = shaft.node(part, findings)
    in_x, in_y = (findings.number(part.values, key, part.line, part.name) for key in ("mx", "my"))
    if node is not None and in_x != in_y:
        findings.lost.append(f"{part.name}: its mass differs in x and y ({in_x:g} and {in_y:g} kg)")
    elif node is not None:
        findings.changed.append(f"{part.name}: a disc without moments of inertia")
        yield from _disc(part, node, ("mx", None, None), part.tag, findings)


def _coupling(part: _Part, shaft: _Shaft, findings: Findings) -> Iterator[Part[Disc]]:
    """The half at the shaft as a disc; the other half with the coupling's flexibility is lost."""
    number = _node(part, findings)
    if number is None:
        return
    if number == shaft.first + shaft.last:
        node, side = shaft.last, "l"
    elif number == shaft.first - 1:
        node, side = 0, "r"
    else:
        findings.refuse(part.line, part.name, "joins two shafts: agfb has one; save one of them alone")
        return
    findings.lost.append(f"{part.name}: its flexibility and its other half; the half on the shaft is a disc")
    yield from _disc(part, node, (f"m_{side}", f"Id_{side}", f"Ip_{side}"), part.tag, findings)


def _supports(
    parts: Sequence[_Part], shaft: _Shaft, rated: Any, findings: Findings
) -> Iterator[Part[Support]]:
    """Linear supports from bearings of any kind; seals are left out."""
    for part in parts:
        if "kxx" not in part.values or (node := shaft.node(part, findings)) is None:
            continue
        if "Seal" in part.kind:
            findings.lost.append(f"{part.name}: a seal, at node {node}")
            continue
        values, told = _coefficients(part, rated, findings)
        kept = {ours: values.get(key, 0.0) for ours, key in COEFFICIENTS.items()}
        if min(kept["stiffness_xx"], kept["stiffness_yy"], kept["damping_xx"], kept["damping_yy"]) < 0:
            findings.lost.append(
                f"{part.name}: a support cannot have negative stiffness or damping in x or y"
            )
            continue
        if left_out := [key for key in UNCOUPLED if values.get(key)]:
            findings.lost.append(f"{part.name}: {', '.join(left_out)}")
        if part.values.get("n_link") is not None:
            findings.changed.append(
                f"{part.name}: stands on the ground instead of node {part.values['n_link']}"
            )
        support = findings.table(Support, {"node": node} | kept, part.line, part.name)
        if support is not None:
            yield Part(support, f"{part.name}, linear, {told}")


def _coefficients(part: _Part, rated: Any, findings: Findings) -> tuple[dict[str, float], str]:
    """The coefficients of a bearing at one speed, and what to say about it."""
    listed = part.values.get("frequency")
    speeds = [float(speed) for speed in listed] if _numbers(listed) else []
    lists: dict[str, list[float]] = {}
    for key in (*COEFFICIENTS.values(), *UNCOUPLED):
        written = part.values.get(key, 0.0)
        written = written if isinstance(written, list) else [written]
        if not _numbers(written) or len(written) not in {1, len(speeds)}:
            findings.refuse(
                part.line, f"{part.name}: {key}", "must be a list with a number for each frequency"
            )
        else:
            lists[key] = [float(number) for number in written]
    if all(len(set(numbers)) == 1 for numbers in lists.values()):
        return {key: numbers[0] for key, numbers in lists.items()}, "constant coefficients"
    is_rated = isinstance(rated, int | float) and math.isfinite(rated)
    wanted = float(rated) if is_rated else speeds[len(speeds) // 2]
    chosen = min(range(len(speeds)), key=lambda place: abs(speeds[place] - wanted))
    told = f"coefficients at {speeds[chosen]:g} rad/s"
    why = f"the nearest to the rated speed of {wanted:g}" if is_rated else "the middle of its list"
    findings.changed.append(f"{part.name}: depends on speed; the support has its {told}, {why}")
    return {key: numbers[chosen if len(numbers) > 1 else 0] for key, numbers in lists.items()}, told


def _numbers(written: Any) -> TypeGuard[list[float]]:
    """Whether this is a list of finite numbers."""
    return (
        isinstance(written, list)
        and len(written) > 0
        and all(isinstance(number, int | float) and math.isfinite(number) for number in written)
    )


def _rayleigh(shaft: _Shaft, findings: Findings) -> tuple[float, float]:
    """alpha and beta of all elements, which must be equal to be those of the rotor."""
    pairs = {
        tuple(findings.number(part.values, key, part.line, part.name) for key in ("alpha", "beta"))
        for part in shaft.elements
    }
    if len(pairs) > 1:
        findings.lost.append("alpha and beta of the shaft elements: they differ, and the rotor has one pair")
        return 0.0, 0.0
    ((alpha, beta),) = pairs
    if alpha:
        findings.changed.append("alpha: it damps the discs too")
    if beta and any(part.values.get("axial_force") for part in shaft.elements):
        findings.changed.append("beta: it does not damp the stiffness by axial forces")
    return alpha, beta


def _foil_nodes(supports: Sequence[Part[Support]], findings: Findings) -> tuple[int, ...]:
    """The nodes of the bearings, of the outermost ones where there are more than two."""
    nodes = sorted({part.table.node for part in supports})
    if len(nodes) > 2:
        findings.changed.append(
            f"bearings at nodes {nodes}: foil bearings take the places of the outermost two"
        )
    return (nodes[0], nodes[-1]) if len(nodes) > 1 else ()


def _rated_rpm(rated: Any) -> float | None:
    if isinstance(rated, int | float) and not isinstance(rated, bool) and 0 < rated < math.inf:
        return float(rated) * 30.0 / math.pi
    return None
