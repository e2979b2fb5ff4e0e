"""What `--workers` and `--scheduler` mean together."""

from __future__ import annotations

import os

import pytest

from agfb_cli.errors import UsageError
from agfb_cli.pool import choose_pool
from pipelines.stages.scheduling.pool import Pool


@pytest.mark.parametrize(
    ("workers", "scheduler", "pool"),
    [
        (None, None, None),
        (1, None, None),
        (3, None, Pool(3)),
        (None, "sync", None),
        (1, "sync", None),
        (None, "local", Pool(os.cpu_count() or 1)),
        (1, "local", Pool(1)),
        (None, "tcp://node:8786", Pool(address="tcp://node:8786")),
    ],
)
def test_pool(workers: int | None, scheduler: str | None, pool: Pool | None) -> None:
    assert choose_pool(workers, scheduler) == pool


@pytest.mark.parametrize(
    ("workers", "scheduler", "message"),
    [
        (2, "sync", "--scheduler sync has one process, not 2"),
        (2, "tcp://node:8786", "--workers belongs to this machine"),
        (None, "node:8786", "--scheduler node:8786: not sync, local or an address"),
    ],
)
def test_contradictions(workers: int | None, scheduler: str, message: str) -> None:
    with pytest.raises(UsageError, match=message):
        choose_pool(workers, scheduler)
