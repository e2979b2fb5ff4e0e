"""A group gets another name, or goes; nothing of it is left where it was."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from pipelines.datasets.branch import write_group
from pipelines.datasets.errors import LockedStoreError
from pipelines.datasets.integrity import verify
from pipelines.datasets.locking import GroupLock
from pipelines.datasets.moving import move_group, remove_container, remove_group
from pipelines.datasets.reading import list_groups, read_group
from pipelines.datasets.store import Store, create_store

AHEAD, PLACE = "cases/a/ahead/x", "cases/a/set/y"


@pytest.fixture
def store(tmp_path: Path) -> Store:
    made = create_store(tmp_path / "a.zarr", {"a": {}}, {"configuration": {"a": {}}})
    arrays = {"line_fixed": np.array([0.5]), "line_round": np.array([0])}
    write_group(made, AHEAD, "bifurcation_set", arrays, {"lowest": 0.25})
    return made


def test_a_group_moves_with_its_content(store: Store) -> None:
    before = read_group(store, AHEAD)
    move_group(store, AHEAD, PLACE)
    remove_container(store, "cases/a/ahead")
    assert list_groups(store, "a") == [PLACE]
    after = read_group(store, PLACE)
    assert (after.attributes, after["line_fixed"].tolist()) == (before.attributes, [0.5])
    assert not (store.path / "cases/a/ahead").exists()
    assert verify(store) == []


def test_no_group_takes_the_place_of_another(store: Store) -> None:
    write_group(store, PLACE, "bifurcation_set", {"line_fixed": np.array([0.75])})
    with pytest.raises(ValueError, match="exists"):
        move_group(store, AHEAD, PLACE)
    assert read_group(store, PLACE)["line_fixed"].tolist() == [0.75]


def test_a_removed_group_leaves_nothing(store: Store) -> None:
    with GroupLock(store.path, AHEAD), pytest.raises(LockedStoreError):
        remove_group(store, AHEAD)
    remove_group(store, AHEAD)
    remove_container(store, "cases/a/ahead")
    remove_container(store, "cases/a/ahead")
    assert list_groups(store, "a") == []
    assert [path.name for path in (store.path / "cases/a").iterdir()] == ["zarr.json"]
    assert verify(store) == []
