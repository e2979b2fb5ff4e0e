"""Other tools read the stores, also while they are being written."""

from __future__ import annotations

import threading
import warnings
from pathlib import Path

import numpy as np
import xarray

from pipelines.datasets.branch import open_branch, write_group
from pipelines.datasets.integrity import verify
from pipelines.datasets.reading import read_branch
from pipelines.datasets.store import Store, open_for_reading
from tests.helpers.synthetic import GROUP, LEAN, extend, static


def open_quietly(path: Path) -> xarray.DataTree:
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        return xarray.open_datatree(path, engine="zarr", consolidated=False)


def test_xarray_opens_a_finished_store(finished: Path) -> None:
    tree = open_quietly(finished)
    branch = tree[GROUP].to_dataset()
    assert branch.attrs["Conventions"] == "CF-1.11"
    assert branch["multipliers"].dtype == complex
    assert branch["orbit"].dims == ("point", "sample", "coordinate")
    assert branch["orbit"].attrs["units"] == "1"
    assert set(branch["orbit"].coords) >= {"speed", "displacement", "sample"}
    assert branch["direction"].attrs["flag_meanings"] == "unset down up"
    ours = read_branch(open_for_reading(finished), GROUP)
    for name, values in ours.arrays.items():
        np.testing.assert_array_equal(branch[name].values[: len(values)], values, err_msg=name)
    assert tree["cases/synthetic/criticals"]["critical_speed"].values.tolist() == [0.5, 1.25]


def test_xarray_opens_speeds_that_are_not_all_written_and_empty_arrays(store: Store) -> None:
    sizes = {"speed": 5, "component": 3, "eigenvalue": 2}
    with open_branch(store, "cases/synthetic/linear", "linear", sizes) as writer:
        for speed in (0.5, 0.75):
            row = {name: np.full(a.row_shape, 1) for name, a in writer.arrays.items()}
            writer.commit(row | {"speed": speed})
    nothing = {"critical_speed": [], "critical_mode_shape": np.zeros((0, 7, 2), complex)}
    write_group(store, "cases/synthetic/criticals", "criticals", nothing)
    tree = open_quietly(store.path)
    linear = tree["cases/synthetic/linear"].to_dataset()
    assert linear["state"].sel(speed=0.75).values.tolist() == [1.0, 1.0, 1.0]
    assert np.isnan(linear["speed"].values[2:]).all()
    assert tree["cases/synthetic/criticals"]["critical_mode_shape"].shape == (0, 7, 2)
    assert verify(store) == []


def test_xarray_opens_without_arguments(finished: Path) -> None:
    with warnings.catch_warnings():
        # xarray recommends consolidated metadata; a store that several processes extend cannot have them
        warnings.filterwarnings("ignore", "Failed to open Zarr store with consolidated metadata")
        tree = xarray.open_datatree(finished, engine="zarr")
    assert tree[GROUP].attrs["n_points"] == 20


def test_opening_without_consolidated_metadata_is_silent(finished: Path) -> None:
    """As the page on notebooks does."""
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        tree = xarray.open_datatree(finished, engine="zarr", consolidated=False)
    assert tree[GROUP].attrs["n_points"] == 20


def test_xarray_and_our_reader_open_a_store_mid_run(store: Store) -> None:
    failures: list[BaseException] = []

    def write() -> None:
        try:
            with open_branch(store, GROUP, "cycles", LEAN, static(LEAN), {"parameter": "speed"}) as writer:
                ready.set()
                extend(writer, 15)
        except BaseException as error:
            failures.append(error)
            raise

    ready = threading.Event()
    thread = threading.Thread(target=write)
    thread.start()
    assert ready.wait(30)
    seen = []
    while thread.is_alive():
        tree = open_quietly(store.path)
        committed = tree[GROUP].attrs["n_points"]
        state = tree[GROUP]["state"].values
        assert np.isfinite(state[:committed]).all()
        ours = read_branch(open_for_reading(store.path), GROUP)
        assert ours.n_points >= committed
        assert np.isfinite(ours["tangent"]).all()
        assert len(ours["event_kind"]) == ours.n_events
        seen.append(committed)
    thread.join()
    assert not failures
    assert any(0 < n < 15 for n in seen), "the store was opened while it was being written"
