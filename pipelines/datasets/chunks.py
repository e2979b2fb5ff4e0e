"""Chunks of one array: each is one file, encoded here and read through Zarr.

Zarr writes the same bytes, through its event loop and in four times the time; a commit has some forty small
files. They are looked at before Zarr reads them, so that every failure names a file.
"""

from __future__ import annotations

import os
import struct
from math import prod
from pathlib import Path
from typing import Any

import google_crc32c
import numcodecs.blosc
import numpy as np
import zarr

from pipelines.datasets.durable import replace_file
from pipelines.datasets.errors import CorruptedError
from pipelines.datasets.layout import BLOSC_LEVEL, ArrayLayout
from pipelines.datasets.metadata import RECOMPUTE, regular_file_size
from pipelines.datasets.schema import Array
from pipelines.datasets.store import Store

numcodecs.blosc.use_threads = (
    False  # they would order the blocks of a chunk as they finish; Zarr has none either
)

_CHECKSUM_BYTES = 4
_BLOSC_HEADER = struct.Struct(
    "<4BIII"
)  # version, version of the compressor, flags, itemsize, bytes, block, compressed


def write_chunk(store: Store, group: str, array: ArrayLayout, index: int, rows: Array) -> None:
    """Replace chunk ``index`` (along the rows) by at most ``array.chunks[0]`` rows and fill values behind.
    Raises OSError.
    """
    content = np.full(array.chunks, array.spec.fill, dtype=np.dtype(array.spec.dtype).newbyteorder("<"))
    content[: len(rows)] = rows
    path = store.path / group / array.spec.name / array.chunk_files()[index]
    replace_file(path, _encode(content), durable=store.durable)


def write_array(store: Store, group: str, array: ArrayLayout, content: Array) -> None:
    """Write all rows of an array. Chunks of fill values are written too: a missing file means a lost one.
    Raises OSError.
    """
    step = array.chunks[0]
    for index in range(len(array.chunk_files())):
        write_chunk(store, group, array, index, content[index * step : (index + 1) * step])


def _encode(content: Array) -> bytes:
    """The bytes that the codecs of `pipelines.datasets.layout.array_metadata` make of a chunk."""
    codec = numcodecs.blosc.Blosc("zstd", BLOSC_LEVEL, numcodecs.blosc.SHUFFLE)
    compressed = bytes(codec.encode(content))
    return compressed + google_crc32c.value(compressed).to_bytes(_CHECKSUM_BYTES, "little")


def read_array(
    store: Store, group: str, array: ArrayLayout, start: int = 0, stop: int | None = None
) -> Array:
    """Rows ``start`` to ``stop`` (all when None). Raises CorruptedError naming the chunk that is missing or
    damaged.
    """
    rows = slice(start, array.shape[0] if stop is None else stop)
    folder = store.path / group / array.spec.name
    files = array.chunk_files(rows.stop)[rows.start // array.chunks[0] :]
    for name in files:
        check_chunk_file(folder / name, array)
    target = zarr.open_array(store.path, path=f"{group}/{array.spec.name}", mode="r", zarr_format=3)
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
        found = f"announces {announced} bytes in {compressed}"
        raise damaged_chunk(path, f"{found}, expected {expected} in {size - _CHECKSUM_BYTES}")


def _advice(path: Path) -> str:
    return RECOMPUTE.replace("this folder", f"the folder {path.parent.parent}")
