from __future__ import annotations

from pathlib import Path

import pytest

from pipelines.datasets.store import Store
from tests.helpers.synthetic import FULL, compute, open_or_create


@pytest.fixture(scope="session")
def finished(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A finished store of 20 points (two chunks of orbits) and one group written at once. Tests must not
    change it.
    """
    path = tmp_path_factory.mktemp("finished") / "store.zarr"
    compute(path, 20, FULL, durable=False)
    return path


@pytest.fixture
def store(tmp_path: Path) -> Store:
    """An empty store, open for writing."""
    return open_or_create(tmp_path / "store.zarr", durable=False)
