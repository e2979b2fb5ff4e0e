"""Chunks of one array: read only after their files were looked at, so that every failure names a file."""

from __future__ import annotations

import os
import struct
from math import prod
from pathlib import Path
from typing import Any

import numpy as np
import zarr

from pipelines.datasets.errors import CorruptedError
from pipelines.datasets.layout import ArrayLayout
from pipelines.datasets.metadata import RECOMPUTE, regular_file_size
from pipelines.datasets.schema import Array
from pipelines.datasets.store import Store

_CHECKSUM_BYTES = 4
_BLOSC_HEADER = struct.Struct(
    "<4BIII"
)  # version, version of the compressor, flags, itemsize, bytes, block, compressed


def open_array(store: Store, group: str, array: ArrayLayout) -> zarr.Array[Any]:
    """The Zarr array. Call it for arrays whose metadata were checked."""
    mode = "r" if store.read_only else "r+"
    opened = zarr.open_array(store.files, path=f"{group}/{array.spec.name}", mode=mode, zarr_format=3)
    # chunks of fill values are written too, so that a missing file always means a lost one (open_array itself
    # ignores a configuration for an array that exists)
    return opened.with_config({"write_empty_chunks": True})


def read_array(
    store: Store,
    group: str,
    array: ArrayLayout,
    start: int = 0,
    stop: int | None = None,
    opened: zarr.Array[Any] | None = None,
) -> Array:
    """Rows ``start`` to ``stop`` (all when None). Raises CorruptedError naming the chunk that is missing or
    damaged.
    """
    rows = slice(start, array.shape[0] if stop is None else stop)
    folder = store.path / group / array.spec.name
    files = array.chunk_files(rows.stop)[rows.start // array.chunks[0] :]
    for name in files:
        check_chunk_file(folder / name, array)
    target = open_array(store, group, array) if opened is None else opened
    try:
        return np.asarray(target[rows])
    except (ValueError, RuntimeError) as error:
        raise _damaged(store, target, array, folder, rows, error) from error


def _damaged(
    store: Store, target: zarr.Array[Any], array: ArrayLayout, folder: Path, rows: slice, error: Exception
) -> CorruptedError:
    step = array.chunks[0]
    for index in range(rows.start // step, -(-rows.stop // step)):
        try:
            target[index * step : min((index + 1) * step, array.shape[0])]
        except (ValueError, RuntimeError) as found:
            return damaged_chunk(folder / array.chunk_files()[index], str(found))
    return damaged_chunk(folder, str(error))


def damaged_chunk(path: Path, why: str) -> CorruptedError:
    """The error for a chunk whose content is not what was written."""
    return CorruptedError(f"damaged chunk ({why[:150]})", f"{_advice(path)}", path)


def check_chunk_file(path: Path, array: ArrayLayout) -> None:
    """Raise CorruptedError when a chunk file is missing or announces another size than the schema gives it.

    The announced size is what Blosc allocates, before any checksum is computed.
    """
    if regular_file_size(path) is None:
        raise CorruptedError("a chunk is missing", _advice(path), path)
    with path.open("rb") as file:
        header = file.read(_BLOSC_HEADER.size)
        # of the file that was read: a writer may have put the next one in its place
        size = os.fstat(file.fileno()).st_size
    expected = prod(array.chunks) * np.dtype(array.spec.dtype).itemsize
    if len(header) < _BLOSC_HEADER.size:
        raise damaged_chunk(path, "too short")
    *_, announced, _, compressed = _BLOSC_HEADER.unpack(header)
    if announced != expected or compressed + _CHECKSUM_BYTES != size:
        raise damaged_chunk(
            path, f"announces {announced} bytes in {compressed}, expected {expected} in {size - _CHECKSUM_BYTES}"
        )


def _advice(path: Path) -> str:
    return RECOMPUTE.replace("this folder", f"the folder {path.parent.parent}")
