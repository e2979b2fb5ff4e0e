"""Export stores to comma-separated tables, netCDF and MATLAB files, and bearings of ROSS.

Only committed rows are exported.  Arrays with more than `WIDEST` numbers a row (states, orbits, film
snapshots) are left out unless all are asked for.
"""

from __future__ import annotations

import csv
import io
import json
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from math import prod
from pathlib import Path
from typing import Any

import numpy as np

from pipelines.datasets import coefficient_tables, mode_tables
from pipelines.datasets.coefficient_tables import BearingTable, bearing_table, long_table, ross_bearing
from pipelines.datasets.dimensional import StoredScales
from pipelines.datasets.durable import replace_file
from pipelines.datasets.mode_tables import mode_table
from pipelines.datasets.reading import case_attributes, list_groups, read_group
from pipelines.datasets.records import Group
from pipelines.datasets.schema import KINDS, Array, ArraySpec
from pipelines.datasets.store import Store, case_group, local_name

WIDEST = 64
_OF_THE_STORE = ("dimensions", "arrays", "attributes_crc32c")  # and the first is a name in netCDF itself
_LONGEST_NAME = 63  # of a variable of MATLAB


@dataclass(frozen=True)
class PlannedFile:
    """A file of an export, and the function that reads its content."""

    path: Path
    content: Callable[[], bytes]


def planned_files(store: Store, case: str, folder: Path, kind: str, full: bool) -> list[PlannedFile]:
    """The files of a case: tables (``csv``), or one file for every group (``netcdf``) or case (``mat``).

    A table for every group and leading dimension, and one for the modes over the speed and for the
    coefficients of each bearing; of ``ross`` these alone, as bearings of ROSS. Reads metadata only; raises
    StoreError.
    """
    if kind == "mat":
        return [PlannedFile(folder / f"{case}.mat", partial(_mat, store, case, full))]
    files = _coefficient_files(store, case, folder, kind) if kind in ("csv", "ross") else []
    if kind == "ross":
        return files
    for name in list_groups(store, case):
        stem = f"{case}-{name.split('/', 2)[2].replace('/', '-')}"
        chosen = _chosen(store, name, full)
        if (
            kind == "csv"
            and local_name(name) in mode_tables.KINDS
            and mode_tables.NEEDED in {spec.name for spec in chosen}
        ):
            files.append(PlannedFile(folder / f"{stem}-modes.csv", partial(mode_table, store, name)))
        if kind == "netcdf":
            content = partial(_netcdf, store, name, [spec.name for spec in chosen])
            files.append(PlannedFile(folder / f"{stem}.nc", content))
            continue
        for dimension in dict.fromkeys(spec.dimensions[0] for spec in chosen):
            names = [spec.name for spec in chosen if spec.dimensions[0] == dimension]
            content = partial(_csv, store, name, names)
            files.append(PlannedFile(folder / f"{stem}-{dimension}.csv", content))
    return files


def _coefficient_files(store: Store, case: str, folder: Path, kind: str) -> list[PlannedFile]:
    """The stiffness and damping of each bearing, as long tables or as bearings of ROSS."""
    name = case_group(case, coefficient_tables.KIND)
    if not store.has_group(name):
        return []
    bearings = read_group(store, name, ()).attributes["dimensions"]["bearing"]
    write, ending = {"csv": (long_table, ".csv"), "ross": (ross_bearing, "-ross.toml")}[kind]
    return [
        PlannedFile(
            folder / f"{case}-{coefficient_tables.KIND}-bearing_{bearing + 1}{ending}",
            partial(_coefficients, write, store, name, bearing),
        )
        for bearing in range(bearings)
    ]


def _coefficients(write: Callable[[BearingTable], bytes], store: Store, name: str, bearing: int) -> bytes:
    return write(bearing_table(store, name, bearing))


def write_files(files: Sequence[PlannedFile]) -> list[Path]:
    """Write the files; each is complete or absent afterwards.

    Raises StoreError, OSError, and ImportError without xarray (netcdf).
    """
    for planned in files:
        planned.path.parent.mkdir(parents=True, exist_ok=True)
        replace_file(planned.path, planned.content(), durable=False)
    return [planned.path for planned in files]


def _chosen(store: Store, name: str, full: bool) -> tuple[ArraySpec, ...]:
    """The exported arrays of a group: those that serve only to resume are left out."""
    group = read_group(store, name, ())
    sizes: Mapping[str, int] = group.attributes["dimensions"]
    return tuple(
        spec
        for spec in KINDS[group.kind].arrays
        if spec.name in group.attributes["arrays"]
        and KINDS[group.kind].role(spec) != "slot"
        and (full or prod(sizes[dimension] for dimension in spec.dimensions[1:]) <= WIDEST)
    )


def _spec(group: Group, name: str) -> ArraySpec:
    return KINDS[group.kind].array(name)


def _csv(store: Store, name: str, names: Sequence[str]) -> bytes:
    """A table with a comment line for every array; array entries and real and imaginary parts are columns.

    What is dimensionless follows in SI units: speed, speed_rpm.
    """
    group, text, scales = read_group(store, name, names), io.StringIO(newline=""), _scales(store, name)
    columns: dict[str, Array] = {}
    for array in names:
        spec = _spec(group, array)
        unit = "" if spec.flags else f" [{spec.units}]"
        text.write(f"# {array}: {spec.long_name}{unit}\n")
        columns |= _columns(array, group.labels(array))
        si = scales.si_unit(group, spec)
        if si is not None and group[array][:1].size <= WIDEST:
            text.write(f"# {array}_{si.ending}: the same [{si.unit}]\n")
            columns |= _columns(f"{array}_{si.ending}", group[array] * si.factor)
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow(columns)
    writer.writerows(zip(*(column.tolist() for column in columns.values()), strict=True))
    return text.getvalue().encode()


def _scales(store: Store, name: str) -> StoredScales:
    return StoredScales(store, name.split("/")[1])


def _columns(name: str, values: Array) -> dict[str, Array]:
    """An array as columns: name[0,1] for its entries, .re and .im for complex numbers."""
    flat = values.reshape(len(values), prod(values.shape[1:]))
    columns: dict[str, Array] = {}
    for number, index in enumerate(np.ndindex(values.shape[1:])):
        label = name + (f"[{','.join(map(str, index))}]" if index else "")
        if np.iscomplexobj(values):
            columns[f"{label}.re"], columns[f"{label}.im"] = flat[:, number].real, flat[:, number].imag
        else:
            columns[label] = flat[:, number]
    return columns


def _netcdf(store: Store, name: str, names: Sequence[str]) -> bytes:
    """netCDF 3, which has no complex numbers: NAME_real and NAME_imag.

    The attribute si_factor is what 1 is in si_units.
    """
    import xarray

    group, scales = read_group(store, name, names), _scales(store, name)
    dataset = xarray.Dataset(attrs=_plain(group.attributes))
    for array, values in group.arrays.items():
        spec = _spec(group, array)
        attributes: dict[str, Any] = {"long_name": spec.long_name, "units": spec.units}
        if spec.flags:
            del attributes["units"]
            attributes["flag_values"] = np.arange(-1, len(spec.flags), dtype=np.int8)
            attributes["flag_meanings"] = " ".join(("unset", *spec.flags))
        if (si := scales.si_unit(group, spec)) is not None:
            attributes |= si.attributes()
        if np.iscomplexobj(values):
            dataset[f"{array}_real"] = (spec.dimensions, values.real, attributes)
            dataset[f"{array}_imag"] = (spec.dimensions, values.imag, attributes)
        else:
            dataset[array] = (spec.dimensions, values, attributes)
    return bytes(dataset.to_netcdf(engine="scipy"))


def _plain(attributes: Mapping[str, Any]) -> dict[str, Any]:
    """Attributes that netCDF can hold: nested ones as JSON."""
    simple = (str, int, float)
    return {
        name: value if isinstance(value, simple) and not isinstance(value, bool) else json.dumps(value)
        for name, value in attributes.items()
        if value is not None and name not in _OF_THE_STORE
    }


def _mat(store: Store, case: str, full: bool) -> bytes:
    """One struct per group, named as the group, with its arrays, its attributes as JSON and its units.

    si_factor is what 1 is in si_units, for arrays that have both.
    """
    from scipy.io import savemat

    content: dict[str, Any] = {"case_attributes": json.dumps(case_attributes(store, case))}
    scales = StoredScales(store, case)
    for name in list_groups(store, case):
        group = read_group(store, name, [spec.name for spec in _chosen(store, name, full)])
        struct: dict[str, Any] = {
            array[:_LONGEST_NAME]: _for_matlab(group.labels(array)) for array in group.arrays
        }
        struct["units"] = {array[:_LONGEST_NAME]: _spec(group, array).units for array in group.arrays}
        units = {array: scales.si_unit(group, _spec(group, array)) for array in group.arrays}
        both = {array[:_LONGEST_NAME]: si.attributes() for array, si in units.items() if si is not None}
        for key in ("si_units", "si_factor"):
            struct[key] = {array: attributes[key] for array, attributes in both.items()}
        struct["attributes"] = json.dumps(dict(group.attributes))
        content[local_name(name).replace("/", "_")] = struct
    stream = io.BytesIO()
    savemat(stream, content, long_field_names=True, do_compression=True)
    return stream.getvalue()


def _for_matlab(values: Array) -> Array:
    return values.astype(object) if values.dtype.kind == "U" else values
