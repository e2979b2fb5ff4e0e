"""Arrays of a kind on disk: sizes, chunks and the content of their ``zarr.json``."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from math import prod
from typing import Any

import numpy as np

from pipelines.datasets.schema import KINDS, ArraySpec, GroupSpec, Role

CONVENTIONS = "CF-1.11"

# A commit rewrites the newest chunk of every array: small enough to rewrite for each point, large enough to
# read quickly.
CHUNK_BYTES = 128 * 1024
CHUNK_ROWS = 512
BLOSC_LEVEL = 5

# Largest sizes a store may declare. They exist because a few hundred bytes of JSON can ask for any amount of
# memory.
LARGEST_ROWS = 1_000_000
LARGEST_DIMENSION = 100_000
LARGEST_CHUNK_BYTES = 256 * 1024**2
LARGEST_ARRAY_BYTES = 64 * 1024**3


@dataclass(frozen=True)
class ArrayLayout:
    """An array with its sizes: the content of its ``zarr.json``."""

    spec: ArraySpec
    role: Role
    shape: tuple[int, ...]
    chunks: tuple[int, ...]
    coordinates: tuple[str, ...] = ()

    @property
    def row_shape(self) -> tuple[int, ...]:
        """Shape of one row (of one slot, of one event)."""
        return self.shape[1:]

    def with_rows(self, rows: int) -> ArrayLayout:
        """The array with another capacity. Chunks do not depend on it, so written bytes stay valid."""
        return replace(self, shape=(rows, *self.shape[1:]))

    def chunk_files(self, rows: int | None = None) -> list[str]:
        """Names of the chunk files that hold the first ``rows`` rows (all when None)."""
        if 0 in self.shape:
            return []
        count = self.shape[0] if rows is None else rows
        return [self.chunk_file(index) for index in range(-(-count // self.chunks[0]))]

    def chunk_file(self, index: int) -> str:
        """Name of the file of a chunk, by its number along the rows."""
        return f"c.{index}" + ".0" * (len(self.shape) - 1)


def layout(
    kind: str, sizes: Mapping[str, int], names: tuple[str, ...] | None = None
) -> dict[str, ArrayLayout]:
    """Arrays of a group from the sizes of its dimensions.

    Arrays with a dimension that has no size are left out, so a group without pressure snapshots simply gives
    no size for them. ``names`` restricts the arrays further. Raises ValueError for sizes outside the limits
    of this module.
    """
    group = KINDS[kind]
    for dimension, size in sizes.items():
        limit = LARGEST_ROWS if dimension in (group.row, group.event) else LARGEST_DIMENSION
        if not 0 <= size <= limit:
            raise ValueError(f"dimension {dimension!r} of {kind} has size {size}; allowed are 0 to {limit}")
    chosen = [
        s
        for s in group.arrays
        if all(d in sizes for d in s.dimensions) and (names is None or s.name in names)
    ]
    return {
        spec.name: _array_layout(group, spec, tuple(sizes[d] for d in spec.dimensions)) for spec in chosen
    }


def _array_layout(group: GroupSpec, spec: ArraySpec, shape: tuple[int, ...]) -> ArrayLayout:
    role = group.role(spec)
    itemsize = np.dtype(spec.dtype).itemsize
    row_bytes = itemsize * prod(shape[1:])
    rows = {
        "row": _rows_per_chunk(row_bytes),
        "event": _rows_per_chunk(row_bytes),
        "slot": 1,
        "static": shape[0],
    }[role]
    if max(1, rows) * row_bytes > LARGEST_CHUNK_BYTES or row_bytes * shape[0] > LARGEST_ARRAY_BYTES:
        raise ValueError(
            f"array {spec.name!r} of {group.kind} with shape {shape} is larger than a store may hold"
        )
    chunks = (max(1, rows), *(max(1, n) for n in shape[1:]))
    placed = group.coordinates if role == "row" and spec.name not in group.coordinates else ()
    return ArrayLayout(spec, role, shape, chunks, placed)


def _rows_per_chunk(row_bytes: int) -> int:
    return int(min(CHUNK_ROWS, max(1, CHUNK_BYTES // max(1, row_bytes))))


def array_metadata(array: ArrayLayout) -> dict[str, Any]:
    """The ``zarr.json`` of an array: Zarr v3 core metadata with CF attributes.

    Blosc (zstd 5, byte shuffle) with a CRC-32C behind it: without a checksum one flipped bit reads as another
    number.
    """
    spec = array.spec
    itemsize = np.dtype(spec.dtype).itemsize
    blosc: dict[str, Any] = {"typesize": itemsize, "cname": "zstd", "clevel": BLOSC_LEVEL}
    blosc |= {"shuffle": "shuffle", "blocksize": 0}
    serializer: dict[str, Any] = {"name": "bytes"}
    if itemsize > 1:
        serializer["configuration"] = {"endian": "little"}
    fill: Any = {"float64": "NaN", "complex128": ["NaN", "NaN"], "int32": -1, "int8": -1}[spec.dtype]
    return {
        "zarr_format": 3,
        "node_type": "array",
        "shape": list(array.shape),
        "data_type": spec.dtype,
        "chunk_grid": {"name": "regular", "configuration": {"chunk_shape": list(array.chunks)}},
        "chunk_key_encoding": {"name": "default", "configuration": {"separator": "."}},
        "fill_value": fill,
        "codecs": [serializer, {"name": "blosc", "configuration": blosc}, {"name": "crc32c"}],
        "attributes": _cf_attributes(array),
        "dimension_names": list(spec.dimensions),
        "storage_transformers": [],
    }


def _cf_attributes(array: ArrayLayout) -> dict[str, Any]:
    spec = array.spec
    attributes: dict[str, Any] = {"long_name": spec.long_name, "units": spec.units}
    if spec.flags:
        attributes["flag_values"] = list(range(-1, len(spec.flags)))
        attributes["flag_meanings"] = " ".join(("unset", *spec.flags))
        del attributes["units"]
    if array.coordinates:
        attributes["coordinates"] = " ".join(array.coordinates)
    return attributes
