"""The configuration of an imported rotor, with what is still to be filled in as comments."""

from __future__ import annotations

import json
import math
import re
from collections.abc import Iterator, Mapping
from typing import Any

from pipelines.case.imports.parts import Imported
from pipelines.case.rotor import Element, Material, Support

LONGEST_GAP = 1 / 5
"""Masters are inserted until no gap between them is longer than this part of the rotor."""
GAS = """\
[gas]
viscosity = 1.85e-5          # Pa s; air at 25 degC
ambient_pressure = 101325.0  # Pa
"""
EXCITATION = """\
[excitation]
displacement = 0.0           # passive bearings; active rings: displacement or load, frequency, ring

[operation]
"""


def masters_of(rotor: Imported) -> tuple[int, ...]:
    """Master nodes: bearings, supports, discs, both ends, and nodes between them where a gap is long."""
    positions = rotor.node_positions
    masters = {0, rotor.last_node, *rotor.foil_nodes}
    masters.update(disc.table.node for disc in rotor.discs)
    masters.update(support.table.node for support in rotor.supports)
    longest = LONGEST_GAP * positions[-1]
    pending = sorted(masters)
    while len(pending) > 1:
        left, right = pending[0], pending[1]
        if positions[right] - positions[left] > longest and right - left > 1:
            middle = 0.5 * (positions[left] + positions[right])
            between = min(range(left + 1, right), key=lambda node: abs(positions[node] - middle))
            masters.add(between)
            pending.insert(1, between)
        else:
            del pending[0]
    return tuple(sorted(masters))


def draft_text(rotor: Imported, name: str) -> str:
    """TOML of a case of that name; `agfb validate` names the keys that are commented out and needed."""
    words = (*_head(rotor, name), GAS, *_rotor(rotor), *_bearings(rotor), EXCITATION + _speed(rotor))
    return "\n".join(words)


def case_name(stem: str) -> str:
    """A name of a case from the name of a file."""
    return re.sub(r"[^A-Za-z0-9._-]+", "_", stem).strip("._-")[:64] or "rotor"


def _head(rotor: Imported, name: str) -> Iterator[str]:
    lines = [f"Rotor of {rotor.source}. Fill in the keys that are commented out; `agfb validate` names them."]
    lines += [f"Changed: {told}" for told in rotor.changed]
    lines += [f"Not carried over: {told}" for told in rotor.lost]
    yield "\n".join(f"# {_comment(line)}" for line in lines)
    yield f"name = {_string(name)}\n"


def _rotor(rotor: Imported) -> Iterator[str]:
    yield "[rotor]"
    yield f"masters = {list(masters_of(rotor))} # nodes that the condensation keeps"
    yield f"rayleigh_mass = {rotor.rayleigh_mass!r}  # 1/s"
    yield f"rayleigh_stiffness = {rotor.rayleigh_stiffness!r}  # s"
    yield "gravity = 9.81  # m/s2 along -y; 0 for a vertical rotor\n"
    for name, material in rotor.materials.items():
        yield from _material(name, material)
    node, positions = 0, rotor.node_positions
    for part in rotor.elements:
        last = node + part.table.count
        place = f"nodes {node} to {last}, {1e3 * positions[node]:.5g} to {1e3 * positions[last]:.5g} mm"
        yield _table(
            "rotor.elements", _values(part.table), f"{place}; {part.remark}" if part.remark else place
        )
        node = last
    for disc in rotor.discs:
        yield _table("rotor.discs", _values(disc.table), disc.remark)
    for support in rotor.supports:
        if support.table.node not in rotor.foil_nodes:
            yield _table("rotor.supports", _values(support.table), support.remark)


def _material(name: str, material: Material | None) -> Iterator[str]:
    key = name if re.fullmatch(r"[A-Za-z0-9_-]+", name) else _string(name)
    yield f"[rotor.materials.{key}]"
    if material is None:
        yield "# young_modulus =            # Pa: fill in"
        yield "# density =                  # kg/m3: fill in"
        yield "# poisson_ratio =            # or shear_modulus in Pa: fill in\n"
    else:
        yield "\n".join(_lines(_values(material))) + "\n"


def _bearings(rotor: Imported) -> Iterator[str]:
    nodes = rotor.foil_nodes or (None, None)
    for bearing, node in enumerate(nodes):
        for support in rotor.supports:
            if support.table.node == node:
                yield _replaced(support.table, support.remark)
        yield "[[bearings]]" + " # keys that it omits are those of the first one" * bearing
        if node is None:
            yield "# node =                     # one of rotor.masters: fill in"
        else:
            yield f"node = {node}"
        if bearing == 0:
            shaft = f"; the shaft is {_diameter(rotor, node):.6g} m thick there" if node is not None else ""
            yield f"# radius =                   # m: fill in{shaft}"
            yield "# length =                   # m: fill in"
            yield "# clearance =                # m, radial: fill in\n"
            yield "[bearings.foil]"
            yield "# areal_stiffness =          # N/m3, or stiffness, bump, rigid = true: fill in"
            yield "# loss_factor =              # fill in"
        yield ""


def _replaced(support: Support, remark: str) -> str:
    """A linear support where a foil bearing takes its place, as a comment."""
    told = "a foil bearing takes its place; as a support both would act together:"
    lines = (_comment(remark), told, "[[rotor.supports]]", *_lines(_values(support)))
    return "\n".join(f"# {line}" for line in lines)


def _speed(rotor: Imported) -> str:
    if rotor.speed_rpm is None:
        return "# speed_rpm =                # rpm: fill in\n"
    return f"speed_rpm = {rotor.speed_rpm!r}  # rpm, the rated speed\n"


def _diameter(rotor: Imported, node: int) -> float:
    """The larger outer diameter of the elements at a node."""
    singles: list[Element] = [single for part in rotor.elements for single in part.table.divided()]
    left = [singles[node - 1].right_diameters[0]] if node > 0 else []
    right = [singles[node].outer_diameter] if node < len(singles) else []
    return max(left + right)


def _values(table: Any) -> dict[str, Any]:
    """The values of a table that differ from their defaults."""
    fields = type(table).model_fields
    return {
        key: value
        for key, value in table.model_dump().items()
        if value is not None and value != fields[key].default
    }


def _table(header: str, values: Mapping[str, Any], remark: str = "") -> str:
    told = f" # {_comment(remark)}" if remark else ""
    return "\n".join([f"[[{header}]]{told}", *_lines(values)]) + "\n"


def _lines(values: Mapping[str, Any]) -> list[str]:
    return [
        f"{key} = {_string(value) if isinstance(value, str) else _number(value)}"
        for key, value in values.items()
    ]


def _number(value: float) -> str:
    assert math.isfinite(value)
    return repr(value)


def _string(text: str) -> str:
    """A TOML string: JSON's, but for one character that TOML forbids."""
    return json.dumps(text, ensure_ascii=False).replace("\x7f", "\\u007f")


def _comment(text: str) -> str:
    """One line of text: what a tag may hold does not end the comment."""
    return "".join(letter if letter.isprintable() else " " for letter in text)
