"""One row for each case of a store: what distinguishes its machine (inputs) and what came out (outputs)."""

from __future__ import annotations

import csv
import io
import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pipelines.case.fields import MEASURES, SI_UNITS, Path, extra_of, field_at
from pipelines.case.measuring import measured
from pipelines.case.models import Case
from pipelines.case.problems import value_at
from pipelines.case.sweeps import short_names
from pipelines.case.units import scale_of
from pipelines.datasets.dimensional import ENDINGS, scale_of_case
from pipelines.datasets.failures import read_failures
from pipelines.datasets.reading import case_attributes, list_groups, read_group
from pipelines.datasets.records import Group
from pipelines.datasets.store import Store, case_group, local_name

Value = float | str | None
_ROUNDING = 1e-12  # relative
DIMENSIONAL = {ENDINGS[SI_UNITS[quantity]]: SI_UNITS[quantity] for quantity in MEASURES.values()}
"""Endings of columns that show another column in this unit."""


@dataclass(frozen=True)
class Column:
    """One input or output of all cases: numbers with NaN where there is none, or words."""

    name: str
    unit: str
    meaning: str
    values: NDArray[Any]

    @property
    def is_number(self) -> bool:
        """Whether it holds numbers."""
        return bool(self.values.dtype.kind == "f")


@dataclass(frozen=True)
class CaseTable:
    """Cases in rows; ``inputs``: the configuration keys in which they differ; ``outputs``: stored results."""

    cases: tuple[str, ...]
    inputs: tuple[Column, ...]
    outputs: tuple[Column, ...]

    @property
    def columns(self) -> tuple[Column, ...]:
        """The case, then inputs, then outputs."""
        return (Column("case", "", "id of the case", np.array(self.cases)), *self.inputs, *self.outputs)


def case_table(store: Store, cases: Sequence[str]) -> CaseTable:
    """The table of some cases, from stored groups alone; raises StoreError for damaged groups."""
    configuration: Mapping[str, Any] = store.attributes.get("configuration", {})
    found = [dict(_outputs(store, case)) for case in cases]
    documents = [configuration.get(case, {}) for case in cases]
    known = {name for row in found for name, value in row.items() if value is not None}
    names = sorted(known, key=_place)
    outputs = [_column(name, *_unit_and_meaning(name), [row.get(name) for row in found]) for name in names]
    return CaseTable(tuple(cases), tuple(_inputs(documents)), tuple(outputs))


def _column(name: str, unit: str, meaning: str, values: Sequence[Any]) -> Column:
    """Numbers if all values are numbers or missing; else words."""
    numbers = all(value is None or (isinstance(value, int | float) and value is not True) for value in values)
    if numbers and not any(value is False for value in values):
        filled = [np.nan if value is None else float(value) for value in values]
        return Column(name, unit, meaning, np.array(filled))
    return Column(name, unit, meaning, np.array(["" if value is None else str(value) for value in values]))


# inputs


def _inputs(documents: Sequence[Mapping[str, Any]]) -> Iterator[Column]:
    """The keys whose values differ, with the unit and the meaning of their declaration."""
    flat = [dict(_flat(document, ())) for document in documents]
    paths = list(dict.fromkeys(path for values in flat for path in values))
    rows = {path: tuple(values.get(path) for values in flat) for path in paths}
    alike = _alike_in_si(documents)
    named = {
        _without_index(path, rows): path for path in paths if len(set(rows[path])) > 1 and path not in alike
    }
    for name, path in named.items():
        _, declared = field_at(Case, path)
        unit = extra_of(declared, "unit") if declared is not None else ""
        meaning = (declared.description or "") if declared is not None else ""
        yield _column(".".join(map(str, name)), unit, meaning, rows[path])


def _alike_in_si(documents: Sequence[Mapping[str, Any]]) -> set[Path]:
    """Keys that have one value in SI units, though its dimensionless numbers differ with the clearance."""
    rows = [dict(_in_si(document)) for document in documents]
    return {
        path
        for path in rows[0]
        if all(path in row and math.isclose(row[path], rows[0][path], rel_tol=_ROUNDING) for row in rows)
    }


def _in_si(document: Mapping[str, Any]) -> Iterator[tuple[Path, float]]:
    scale = scale_of(dict(document))
    tables = [name for name in document if name in Case.model_fields] if scale else []
    for table in tables:
        for each in measured(Case, document, table):
            factor = 1.0 if scale is None or each.in_si else scale[each.quantity]
            for path, number in _flat(value_at(document, each.path), each.path):
                yield path, factor * number


def _flat(value: Any, path: Path) -> Iterator[tuple[Path, Any]]:
    if isinstance(value, Mapping):
        for name, inner in value.items():
            yield from _flat(inner, (*path, name))
    elif isinstance(value, list | tuple):
        for index, inner in enumerate(value):
            yield from _flat(inner, (*path, index))
    else:
        yield path, value


def _without_index(path: Path, rows: Mapping[Path, tuple[Any, ...]]) -> Path:
    """The path without an index whose entries agree in every case: bearings.clearance for both bearings."""
    for place, part in enumerate(path):
        if isinstance(part, int):
            alike = [
                other
                for other in rows
                if len(other) == len(path)
                and isinstance(other[place], int)
                and (*other[:place], *other[place + 1 :]) == (*path[:place], *path[place + 1 :])
            ]
            if len(alike) > 1 and all(rows[other] == rows[path] for other in alike):
                return (*path[:place], *path[place + 1 :])
    return path


def short_titles(columns: Sequence[Column]) -> list[str]:
    """The shortest ends of the names that distinguish them, as words and without a unit."""
    names = short_names([column.name for column in columns])
    return [_without_unit(name)[0].replace("_", " ") for name in names]


# outputs

_MEANINGS = {
    "instability_speed": "speed at which the equilibrium loses its stability",
    "critical_speed": "critical speed, by number",
    "first_bifurcation": "kind of the first bifurcation on the branch cycles/b000",
    "first_bifurcation_speed": "speed of the first bifurcation on the branch cycles/b000",
    "first_bifurcation_excitation_frequency": "excitation frequency of that bifurcation",
    "first_bifurcation_displacement": "ring displacement of that bifurcation",
    "first_bifurcation_foil_stiffness": "foil stiffness of that bifurcation",
    "best_excitation_frequency": "excitation frequency with the largest bifurcation-free speed range",
    "best_speed": "end of that range",
    "best_bound": "what ends that range; none: nothing up to the highest speed of the plane",
    "passive_gain": "gain of best_speed over the instability speed without displacement of the rings",
    "reference_gain": "gain of best_speed over the range at excitation frequency 0.2",
    "operating_point": "stability of the cycle at the case's own speed and excitation frequency",
    "margin_speed": "distance in speed from there to the nearest boundary of stable cycles; negative where "
    "the cycle is unstable there",
    "margin_excitation_frequency": "distance in excitation frequency, likewise",
    "margin_displacement": "distance in ring displacement, likewise",
    "margin_foil_stiffness": "distance in foil stiffness, likewise",
    "margin_relative": "relative distance to the nearest boundary of all, in shares of both parameters",
    "margin_bifurcation": "kind of this boundary",
    "failed": "stages that failed, with the reason",
}
_ORDER = tuple(_MEANINGS)


def _outputs(store: Store, case: str) -> Iterator[tuple[str, Value]]:
    groups = {local_name(name) for name in list_groups(store, case)}
    scales = case_attributes(store, case)["scales"]

    def read(name: str, arrays: Sequence[str] = ()) -> Group | None:
        return read_group(store, case_group(case, name), arrays) if name in groups else None

    if (linear := read("linear")) is not None:
        yield from _speed("instability_speed", linear.attributes.get("instability_speed"), scales)
    if (criticals := read("criticals", ("critical_speed",))) is not None:
        for number, speed in enumerate(criticals.arrays["critical_speed"].tolist(), start=1):
            yield from _speed(f"critical_speed_{number}", speed, scales)
    if "cycles/b000" in groups:
        yield from _first_bifurcation(read_group(store, case_group(case, "cycles/b000")), scales)
    if (ranges := read("operating_range")) is not None:
        yield from _operating_range(ranges.attributes, scales)
    if failures := read_failures(store, case):
        yield "failed", "; ".join(f"{failure.stage}: {failure.reason}" for failure in failures)


def _both(
    name: str, parameter: str, value: float | None, scales: Mapping[str, float]
) -> Iterator[tuple[str, Value]]:
    """A value of a parameter, dimensionless and in its SI unit."""
    quantity = MEASURES[parameter]
    yield name, value
    dimensional = None if value is None else value * scale_of_case(scales)[quantity]
    yield f"{name}_{ENDINGS[SI_UNITS[quantity]]}", dimensional


def _speed(name: str, speed: float | None, scales: Mapping[str, float]) -> Iterator[tuple[str, Value]]:
    yield from _both(name, "speed", speed, scales)


def _first_bifurcation(branch: Group, scales: Mapping[str, float]) -> Iterator[tuple[str, Value]]:
    """The first bifurcation on the branch and the value of the branch's parameter there."""
    parameter = str(branch.attributes["parameter"])
    name = f"first_bifurcation_{parameter}"
    kinds = branch.labels("event_kind")
    places = np.flatnonzero(kinds != "neutral_saddle")  # which is no bifurcation
    first = float(branch.arrays[f"event_{parameter}"][places[0]]) if len(places) else None
    yield "first_bifurcation", str(kinds[places[0]]) if len(places) else "none"
    yield from _both(name, parameter, first, scales)


def _operating_range(
    attributes: Mapping[str, Any], scales: Mapping[str, float]
) -> Iterator[tuple[str, Value]]:
    """What `agfb report` concluded."""
    best, parameter = attributes.get("best"), attributes["parameter"]
    if best is not None:
        yield from _both(f"best_{parameter}", parameter, best[parameter], scales)
        yield from _speed("best_speed", best["speed"], scales)
        yield "best_bound", "none" if best["open"] else str(best["bifurcation"])
    yield "passive_gain", attributes.get("passive_gain")
    yield "reference_gain", attributes.get("reference_gain")
    if (margin := attributes.get("margin")) is not None:
        yield from _margin(margin, parameter, scales)


def _margin(
    margin: Mapping[str, Any], parameter: str, scales: Mapping[str, float]
) -> Iterator[tuple[str, Value]]:
    """Distances of the operating point from the boundaries of stable cycles, negative if it is unstable."""
    yield "operating_point", "not known" if margin["base"] == "unset" else str(margin["base"])
    sign = -1.0 if margin["base"] == "unstable" else 1.0
    in_speed, along, relative = (
        None if (distance := margin[f"{name}_distance"]) is None else sign * distance
        for name in ("speed", parameter, "relative")
    )
    yield from _speed("margin_speed", in_speed, scales)
    yield from _both(f"margin_{parameter}", parameter, along, scales)
    yield "margin_relative", relative
    nearest = margin["nearest"]
    yield "margin_bifurcation", "none" if nearest is None else str(nearest["bifurcation"])


def _root(name: str) -> tuple[str, str]:
    """An output's name without number and dimensional ending, and that ending."""
    stem, ending = _without_unit(name)
    root, _, number = stem.rpartition("_")
    return (root if number.isdecimal() else stem), ending


def _without_unit(name: str) -> tuple[str, str]:
    """A name without its dimensional ending, and that ending."""
    ending = next((each for each in DIMENSIONAL if name.endswith(f"_{each}")), "")
    return (name.removesuffix(f"_{ending}"), ending) if ending else (name, "")


def _place(name: str) -> tuple[int, int, str]:
    """Sort key: order of `_MEANINGS`, then the number, then the dimensionless before the dimensional."""
    root, _ = _root(name)
    number = name.removeprefix(root).strip("_").split("_")[0]
    return _ORDER.index(root), int(number) if number.isdecimal() else 0, name


def _unit_and_meaning(name: str) -> tuple[str, str]:
    root, ending = _root(name)
    words = root in ("first_bifurcation", "best_bound", "operating_point", "margin_bifurcation", "failed")
    return DIMENSIONAL[ending] if ending else "" if words else "1", _MEANINGS[root]


# files


def csv_of(table: CaseTable) -> bytes:
    """Comma-separated text: a comment line for every column, the names, a row for every case."""
    text = io.StringIO(newline="")
    for column in table.columns:
        unit = f" [{column.unit}]" if column.unit else ""
        text.write(f"# {column.name}: {column.meaning}{unit}\n")
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow([column.name for column in table.columns])
    writer.writerows(zip(*(column.values.tolist() for column in table.columns), strict=True))
    return text.getvalue().encode()


def netcdf_of(table: CaseTable) -> bytes:
    """NetCDF 3 with the dimension ``case``; raises ImportError without xarray."""
    import xarray

    dataset = xarray.Dataset(attrs={"title": "One row for each case"})
    for columns, role in ((table.columns[:1], "id"), (table.inputs, "input"), (table.outputs, "output")):
        for column in columns:
            unit = {"units": column.unit} if column.is_number else {}
            attributes = {"long_name": column.meaning, "role": role, **unit}
            dataset[column.name] = ("case", column.values, attributes)
    return bytes(dataset.to_netcdf(engine="scipy"))
