"""The tables are consistent, and Zarr reads the metadata made from them as its own."""

from __future__ import annotations

import json

import numpy as np
import pytest
import zarr
from zarr.codecs import BloscCodec, Crc32cCodec
from zarr.storage import MemoryStore

from pipelines.datasets.layout import CHUNK_BYTES, ArrayLayout, array_metadata, layout
from pipelines.datasets.schema import KINDS, GroupSpec

SIZES = {dimension: 3 for kind in KINDS.values() for spec in kind.arrays for dimension in spec.dimensions}
LAYOUTS = [a for k in KINDS.values() for a in layout(k.kind, {**SIZES, "slot": 2}).values()]


@pytest.mark.parametrize("kind", KINDS.values(), ids=KINDS)
def test_tables_are_consistent(kind: GroupSpec) -> None:
    names = [spec.name for spec in kind.arrays]
    assert len(set(names)) == len(names)
    for spec in kind.arrays:
        assert spec.long_name
        assert len(set(spec.dimensions)) == len(spec.dimensions), "xarray cannot have a dimension twice"
        assert (spec.dtype == "int8") == bool(spec.flags)
    assert set(kind.coordinates) <= set(names)


@pytest.mark.parametrize("array", LAYOUTS, ids=lambda a: a.spec.name)
def test_metadata_are_those_that_zarr_writes(array: ArrayLayout) -> None:
    spec = array.spec
    files = MemoryStore()
    made = zarr.create_array(
        files,
        shape=array.shape,
        chunks=array.chunks,
        dtype=spec.dtype,
        fill_value=spec.fill,
        compressors=[BloscCodec(cname="zstd", clevel=5, shuffle="shuffle"), Crc32cCodec()],
        chunk_key_encoding={"name": "default", "separator": "."},
        dimension_names=spec.dimensions,
        attributes=array_metadata(array)["attributes"],
    )
    assert json.loads(files._store_dict["zarr.json"].to_bytes()) == array_metadata(array)
    np.testing.assert_array_equal(made[...], np.full(array.shape, spec.fill, spec.dtype))


def test_chunks_hold_many_small_rows_and_at_least_one_large_row() -> None:
    arrays = layout(
        "cycles", {"point": 2000, "component": 886, "extended": 30_000, "sample": 64, "coordinate": 14}
    )
    assert arrays["speed"].chunks == (512,)
    for name in ("state", "orbit"):
        chunk = arrays[name].chunks
        assert CHUNK_BYTES / 2 < 8 * np.prod(chunk) <= CHUNK_BYTES
    assert arrays["tangent"].chunks == (1, 30_000)


def test_chunks_do_not_depend_on_the_capacity() -> None:
    small, large = (layout("cycles", {"point": n, "component": 40}) for n in (10, 10_000))
    assert all(small[name].chunks == large[name].chunks for name in small)


@pytest.mark.parametrize(
    ("sizes", "complaint"),
    [
        ({"point": 10**9, "component": 10}, "'point' of cycles has size 1000000000"),
        ({"point": -1, "component": 10}, "size -1"),
        ({"point": 10, "slot": 2, "component": 100_000, "column": 100_000}, "larger than a store may hold"),
    ],
)
def test_sizes_beyond_reason_are_refused(sizes: dict[str, int], complaint: str) -> None:
    with pytest.raises(ValueError, match=complaint):
        layout("cycles", sizes)
