"""Compiled functions on the disk are used again only while the sources of all kernels are the same."""

from __future__ import annotations

import importlib.util
import sys
from pathlib import Path
from types import ModuleType

import numba
import numpy as np
import pytest

from pipelines.machine import kernels, rates

SOURCE = """
from numba import types

from pipelines.machine.kernels import kernel


@kernel()
def half(x):
    return 0.5 * x


@kernel(types.float64(types.float64))
def quarter(x):
    return half(half(x))
"""


WITH_A_TUPLE = """
from typing import NamedTuple

from numba import types

from pipelines.machine.kernels import kernel


class Pair(NamedTuple):
    first: float
    second: float


@kernel()
def sum_of(pair):
    return pair.first + pair.second


@kernel(types.float64(types.float64, types.float64))
def total(first, second):
    return sum_of(Pair(first, second))
"""


@pytest.fixture(autouse=True)
def _no_module_is_left(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "some_kernels", ModuleType("some_kernels"))


def loaded(path: Path) -> ModuleType:
    spec = importlib.util.spec_from_file_location("some_kernels", path)
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    sys.modules["some_kernels"] = module  # where pickled types are looked for
    spec.loader.exec_module(module)
    return module


def hits(module: ModuleType) -> tuple[int, int]:
    """Loaded and compiled signatures of the eager function."""
    stats = module.quarter.stats
    return sum(stats.cache_hits.values()), sum(stats.cache_misses.values())


def test_a_change_of_any_source_compiles_again(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path = tmp_path / "some_kernels.py"
    path.write_text(SOURCE)
    first = loaded(path)
    assert (first.quarter(8.0), hits(first)) == (2.0, (0, 1))
    assert hits(loaded(path)) == (1, 0)
    monkeypatch.setattr(kernels, "source_digest", lambda: "another version")
    assert hits(loaded(path)) == (0, 1), "the function's own file is the same, that of a callee may not be"
    assert hits(loaded(path)) == (1, 0)


def test_the_digest_is_that_of_every_file_with_kernels(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(kernels, "_PACKAGES", (tmp_path,))
    digest = kernels.source_digest.__wrapped__
    (tmp_path / "room").mkdir()
    (tmp_path / "room" / "a.py").write_text("@kernel()")
    (tmp_path / "b.py").write_text("PLAIN = 1")
    known = digest()
    (tmp_path / "b.py").write_text("PLAIN = 2")
    assert digest() == known
    (tmp_path / "room" / "a.py").write_text("@kernel(inline='always')")
    assert digest() != known


def test_numba_still_has_what_the_decorator_changes() -> None:
    """Where it has not, its own rule holds, and `kernel` needs the new names."""
    cached = rates.machine_rates._cache._cache_file
    assert cached._source_stamp == kernels.source_digest()
    assert cached._version == f"{numba.__version__} {kernels.source_digest()}"


def test_a_type_that_is_gone_does_no_harm(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """The cache holds the types of arguments by name."""
    path = tmp_path / "some_kernels.py"
    for digest, name in (("a version", "Pair"), ("another version", "Two")):
        monkeypatch.setattr(kernels, "source_digest", lambda digest=digest: digest)
        path.write_text(WITH_A_TUPLE.replace("Pair", name))
        assert loaded(path).total(1.0, 2.0) == 3.0


def doubled(phase, state, parameters, constants, layout, work, out):  # type: ignore[no-untyped-def]
    """A right-hand side of its own, 2 s."""
    for i in range(out.size):
        out[i] = 2.0 * state[i]


@numba.njit(numba.float64(kernels.ENTRY, numba.float64[::1]))
def second_rate(rates, state):  # type: ignore[no-untyped-def]
    """The second entry of f(s), of the function at an entry point."""
    rates, out, some = kernels.as_rates(rates), np.zeros(2), np.zeros(1)
    rates(0.0, state, some, some, np.zeros(1, np.int64), some, out)
    return out[1]


def test_a_loop_calls_what_it_is_handed() -> None:
    first, second = numba.njit(kernels.RATES)(doubled), numba.njit(kernels.RATES)(doubled)
    entries = [kernels.entry_point(rates, kernels.RATES) for rates in (first, second, first)]
    assert entries[0] == entries[2] != entries[1]
    assert [second_rate(entry, np.array([1.0, 3.0])) for entry in entries] == [6.0] * 3


def test_an_error_in_a_called_function_reaches_the_caller() -> None:
    @numba.njit(kernels.RATES)
    def refusing(phase, state, parameters, constants, layout, work, out):  # type: ignore[no-untyped-def]
        raise ValueError("no rates here")

    with pytest.raises(ValueError, match="no rates here"):
        second_rate(kernels.entry_point(refusing, kernels.RATES), np.zeros(2))


def test_a_function_of_another_type_has_no_entry_point() -> None:
    with pytest.raises(numba.TypingError):
        kernels.entry_point(rates.machine_rates, kernels.TANGENT)


def test_a_python_function_stands_for_itself() -> None:
    assert kernels.entry_point(doubled, kernels.RATES) is doubled
    assert kernels.as_rates(doubled) is doubled
