"""Chunks of one array: each chunk is one file, encoded and decoded here.

Zarr writes and reads the same bytes, through its event loop and in three times the time; a commit has some
forty small files. What its environment and its files of settings say about that does not matter here, and
every failure names a file.
"""

from __future__ import annotations

import struct
from collections.abc import Iterator
from math import prod
from pathlib import Path

import google_crc32c
import numcodecs.blosc
import numpy as np

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


def chunk_file(store: Store, group: str, array: ArrayLayout, index: int, rows: Array) -> tuple[Path, bytes]:
    """The file of chunk ``index`` (along the rows) with at most ``array.chunks[0]`` rows, and its content.

    Fill values stand in place of missing rows.
    """
    content = np.full(array.chunks, array.spec.fill, dtype=np.dtype(array.spec.dtype).newbyteorder("<"))
    content[: len(rows)] = rows
    return store.path / group / array.spec.name / array.chunk_file(index), _encode(content)


def array_files(store: Store, group: str, array: ArrayLayout, content: Array) -> Iterator[tuple[Path, bytes]]:
    """The files of all chunks of an array.

    Chunks of fill values are among them: a missing file means lost data.
    """
    step = array.chunks[0]
    for index in range(len(array.chunk_files())):
        yield chunk_file(store, group, array, index, content[index * step : (index + 1) * step])


def _encode(content: Array) -> bytes:
    """The bytes of a chunk after the codecs of `pipelines.datasets.layout.array_metadata`."""
    codec = numcodecs.blosc.Blosc("zstd", BLOSC_LEVEL, numcodecs.blosc.SHUFFLE)
    compressed = bytes(codec.encode(content))
    return compressed + google_crc32c.value(compressed).to_bytes(_CHECKSUM_BYTES, "little")


def read_array(
    store: Store, group: str, array: ArrayLayout, start: int = 0, stop: int | None = None
) -> Array:
    """Rows ``start`` to ``stop`` (all when None).

    Raises CorruptedError naming the chunk that is missing or damaged.
    """
    stop = array.shape[0] if stop is None else stop
    step, folder = array.chunks[0], store.path / group / array.spec.name
    files = array.chunk_files(stop)[start // step :]
    if not files:
        return np.empty((max(0, stop - start), *array.row_shape), array.spec.dtype)
    rows = np.concatenate([_read_chunk(folder / name, array) for name in files])
    return rows[start % step : start % step + stop - start]


def _read_chunk(path: Path, array: ArrayLayout) -> Array:
    """The rows of a chunk file, including those after the last row of the array."""
    if (size := regular_file_size(path)) is None:
        raise CorruptedError("a chunk is missing", _advice(path), path)
    expected = prod(array.chunks) * np.dtype(array.spec.dtype).itemsize
    if size > expected + _BLOSC_HEADER.size + _CHECKSUM_BYTES:  # Blosc never needs more
        raise damaged_chunk(path, f"{size} bytes for the {expected} that it holds")
    try:
        content = _decode(path.read_bytes(), expected)
    except (ValueError, RuntimeError) as error:
        raise damaged_chunk(path, str(error)) from error
    return content.view(np.dtype(array.spec.dtype).newbyteorder("<")).reshape(array.chunks)


def _decode(stored: bytes, expected: int) -> Array:
    """The inverse of `_encode`, as ``expected`` bytes. Raises ValueError and RuntimeError for damaged data.

    The size that the header announces is what Blosc allocates: it is looked at before anything else.
    """
    if len(stored) < _BLOSC_HEADER.size:
        raise ValueError("too short")
    compressed, checksum = stored[:-_CHECKSUM_BYTES], stored[-_CHECKSUM_BYTES:]
    *_, announced, _, size = _BLOSC_HEADER.unpack_from(stored)
    if announced != expected or size != len(compressed):
        raise ValueError(f"announces {announced} bytes in {size}, expected {expected} in {len(compressed)}")
    if google_crc32c.value(compressed).to_bytes(_CHECKSUM_BYTES, "little") != checksum:
        raise ValueError("the checksum is another one")
    return np.frombuffer(numcodecs.blosc.Blosc().decode(compressed), np.uint8)


def damaged_chunk(path: Path, why: str) -> CorruptedError:
    """The error for a chunk whose content differs from what was written."""
    return CorruptedError(f"damaged chunk ({why[:150]})", f"{_advice(path)}", path)


def _advice(path: Path) -> str:
    return RECOMPUTE.replace("this folder", f"the folder {path.parent.parent}")
