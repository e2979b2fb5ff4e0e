"""The reference of the configuration, made from the models: Markdown for readers, JSON schema for editors."""

from __future__ import annotations

import json
from collections.abc import Iterator
from typing import Any, Literal, get_args, get_origin

from pydantic.fields import FieldInfo

from pipelines.case.fields import Table, bounds_of, extra_of, holds_values, inner_types, keys_of, model_of
from pipelines.case.models import Case
from pipelines.case.sampling import NAME, Sample, Sampled

_TYPE_NAMES = {float: "number", int: "integer", bool: "true/false", str: "string"}
_INTRODUCTION = """\
# Configuration

A case is a TOML file of the tables below. Every key can be set on the command line, as in
`--set bearings.foil.stiffness=3` (both bearings) or `--set bearings.1.clearance=2e-5` (the second one). A
table `[sweep]` with lists, such as `bearings.foil.stiffness = [3, 10]`, makes one case of every combination.
Keys that vary together share a line of lists:
`"bearings.foil.stiffness, excitation.frequency" = [[3, 0.63], [10, 0.70]]`. A table `[sample]`, at the end of
this page, draws machines from ranges of keys.

**Units.** The machine is described in SI units. A key with two units, such as `1 or rpm`, is dimensionless,
or in the second unit where `units = "si"` stands in its table, in a table around it or at the top of the
file: speeds in rpm, frequencies in Hz, times in s, displacements of the rings in um, stiffnesses of the foils
in N/m3. That holds in the tables, in `[sweep]`, in `[sample]` and for `--set`. The scales are those of the
first bearing. A step of a continuation is the change of its parameter alone (of the first of two). Keys that
name their unit, `speed_rpm`, `frequency_hz`, `rated_speed_rpm`, `value_rpm` and `areal_stiffness`, have it in
any case: `speed = 12000` in SI units and `speed_rpm = 12000` are one configuration. Prefer `units = "si"` at
the top of the file.
"""


def json_schema() -> dict[str, Any]:
    """JSON schema (draft 2020-12) of a configuration file, the tables [sweep] and [sample] included."""
    schema = Case.model_json_schema()
    schema["$schema"] = "https://json-schema.org/draft/2020-12/schema"
    # The second bearing inherits what it leaves out, which a schema cannot say.
    schema["$defs"]["Bearing"]["required"] = ["node"]
    schema["properties"]["sweep"] = {
        "type": "object",
        "description": "lists of values by dotted key, lists of lists by several keys with commas between "
        "them; every combination is a case",
    }
    schema["properties"][NAME] = Sample.model_json_schema()
    for table in (schema, *schema["$defs"].values()):
        for key in table.get("properties", {}).values():
            _in_any_unit(key)
    return schema


def _in_any_unit(key: dict[str, Any]) -> None:
    """State the unit of a key; one that has two is bounded by its sign alone, which both share."""
    unit = key.get("unit", "")
    if unit not in ("", "1"):
        key["description"] += f" [{unit}]"
    if not {"measures", "measured_by"}.isdisjoint(key):
        for form in (key, *key.get("anyOf", ())):
            for bound in ("minimum", "maximum", "exclusiveMinimum", "exclusiveMaximum"):
                if form.get(bound, 0) != 0:
                    del form[bound]


def reference_markdown() -> str:
    """The reference in Markdown: one section per table with key, type, meaning, unit, default and bounds."""
    sample = _section(Sample, f"[{NAME}]", f"{NAME}.")
    return "\n".join([_INTRODUCTION, *_section(Case, "", ""), *sample])


def settable_keys() -> dict[str, tuple[str, ...]]:
    """The dotted keys of all plain values, each with the words that it allows or its default as an example.

    Keys with a free name are left out.
    """
    declared = (*keys_of(Case), *keys_of(Sampled))
    keys = {name: field for name, field in declared if ".NAME" not in name}
    settable = {name: _examples(field) for name, field in keys.items() if holds_values(field.annotation)}
    # what may be a plain value has no keys of its own
    return {name: words for name, words in settable.items() if name.rpartition(".")[0] not in settable}


def _examples(field: FieldInfo) -> tuple[str, ...]:
    for kind in inner_types(field.annotation):
        if get_origin(kind) is Literal:
            return get_args(kind)
        if kind is bool:
            return ("true", "false")
    if field.is_required() or field.default is None:
        return ()
    default = field.default
    return (default if isinstance(default, str) else json.dumps(default, separators=(",", ":")),)


def _section(model: type[Table], header: str, prefix: str) -> Iterator[str]:
    """The table's keys, then the tables below it; `header` is as in TOML, `prefix` the dotted path."""
    yield f"## `{header}`\n" if header else "## Top level\n"
    yield f"{(model.__doc__ or '').strip()}\n"
    yield "| key | type | meaning | unit | default | allowed |"
    yield "|---|---|---|---|---|---|"
    for name, field in model.model_fields.items():
        yield _row(name, field)
    yield ""
    for name, field in model.model_fields.items():
        inner = model_of(field.annotation)
        if inner is not None:
            path = f"{prefix}{name}"
            yield from _section(inner, *_header(path, field))


def _header(path: str, field: FieldInfo) -> tuple[str, str]:
    """TOML header and prefix of the keys of a table at a path."""
    origins = {get_origin(kind) for kind in inner_types(field.annotation)}
    if tuple in origins:
        return f"[[{path}]]", f"{path}."
    if dict in origins:
        return f"[{path}.NAME]", f"{path}.NAME."
    return f"[{path}]", f"{path}."


def _row(name: str, field: FieldInfo) -> str:
    cells = (
        f"`{name}`",
        _type_name(field.annotation),
        field.description or "",
        extra_of(field, "unit"),
        "" if field.is_required() else _default(field.default),
        _allowed(field),
    )
    return "| " + " | ".join(cell.replace("|", "\\|") for cell in cells) + " |"


def _type_name(annotation: Any) -> str:
    names = []
    for kind in inner_types(annotation):
        origin = get_origin(kind)
        if origin is tuple:
            items = get_args(kind)
            number = "" if Ellipsis in items else f" of {len(items)}"
            what = " or ".join(f"{name}s" for name in _type_name(items[0]).split(" or "))
            names.append(f"{what} (array{number})")
        elif origin is dict:
            names.append("tables by name")
        elif origin is Literal:
            names.append("word")
        else:
            names.append(_TYPE_NAMES.get(kind, "table"))
    return " or ".join(names)


def _default(default: Any) -> str:
    if default is None:
        return "none"
    if isinstance(default, Table | dict):
        return "its defaults"
    return f"`{json.dumps(default)}`"


def _allowed(field: FieldInfo) -> str:
    for kind in inner_types(field.annotation):
        if get_origin(kind) is Literal:
            return ", ".join(f"`{word}`" for word in get_args(kind))
    parts = [part for part in (bounds_of(field), extra_of(field, "because")) if part]
    return ": ".join(parts)
