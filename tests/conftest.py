"""The surroundings that the command makes for itself, and how hard the tests of reliability try.

The first must precede the import of numpy. A site may set variables that choose the processor's instructions:
they would change the last bits of what a test computes in its own process and compares with the command's.
Spinning BLAS threads slow small matrices. `make torture` asks for more killed processes and more examples.
"""

from __future__ import annotations

import os

import pytest
from hypothesis import HealthCheck, settings

from agfb_cli.surroundings import settle

settle()
for name in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"):
    os.environ.setdefault(name, "1")

# the same examples in every run; `make torture` draws new ones
settings.register_profile("steady", derandomize=True, deadline=None, database=None)
settings.register_profile(
    "torture", max_examples=10_000, deadline=None, suppress_health_check=list(HealthCheck)
)
settings.load_profile("steady")


def pytest_addoption(parser: pytest.Parser) -> None:
    parser.addoption("--kills", type=int, default=20, help="processes that each of the killing tests kills")
    parser.addoption("--rotors", type=int, default=20, help="random rotors whose critical speeds are sought")


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """The longest files first: at the end of a run, one process waits the less for the other."""
    items.sort(key=lambda item: "validation" not in item.path.parts)


@pytest.fixture(scope="session")
def kills(pytestconfig: pytest.Config) -> int:
    """How many processes a test kills at random moments."""
    return int(pytestconfig.getoption("kills"))
