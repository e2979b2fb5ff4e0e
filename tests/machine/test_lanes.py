"""Sums over lanes in vector registers and in plain loops: both give the same, and either can be taken."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path
from types import ModuleType
from typing import Any

import numpy as np
import pytest
from numba import njit
from numpy.typing import NDArray

from pipelines import machine
from pipelines.machine import kernels, lanes, plain_lanes, vector_lanes
from pipelines.machine.assembly import build_machine, parameter_vector
from pipelines.machine.lanes import LANES
from pipelines.machine.rates import UNSIGNED
from pipelines.orbits.equilibria.equilibrium import machine_equilibrium
from pipelines.orbits.floquet import deterministic_block
from pipelines.orbits.machine_cycles import machine_system
from pipelines.orbits.period_map import PeriodMap
from pipelines.orbits.steppers import ESDIRK5
from tests.machines import case

ROOT = Path(__file__).parents[2]
ROWS = 16


def sums(module: ModuleType) -> Any:
    """A compiled function that takes all three sums of a module."""
    set_lanes, add_lanes, accumulate_lanes = module.set_lanes, module.add_lanes, module.accumulate_lanes

    @njit
    def take(out, base, values, factors, count):  # type: ignore[no-untyped-def]
        w, zero, two = UNSIGNED(LANES), UNSIGNED(0), UNSIGNED(2)
        set_lanes(out, w, (factors[0], factors[1], factors[2]), values, (zero, w + two * w, two * w))
        add_lanes(out, w, factors[3], values, w)
        accumulate_lanes(out, zero, base, two * w, factors, two, values, w, two * w, UNSIGNED(count))
        set_lanes(out, two * w, (factors[4], factors[5]), out, (two * w, w))  # from itself

    return take


def test_both_give_the_same_sums() -> None:
    """To the rounding of a fused multiply-add; the numbers of terms around those that are unrolled."""
    random = np.random.default_rng(7)
    plain, vector = sums(plain_lanes), sums(vector_lanes)
    for count in range(7):
        base, values = random.standard_normal(ROWS * LANES), random.standard_normal(ROWS * LANES)
        factors = random.standard_normal(ROWS)
        start = random.standard_normal(3 * LANES)
        one, other, rows = start.copy(), start.copy(), values.reshape(ROWS, LANES)
        plain(one, base, values, factors, count)
        vector(other, base, values, factors, count)
        np.testing.assert_allclose(one, other, rtol=0.0, atol=1e-14)
        expected = base.reshape(ROWS, LANES)[2] + factors[2 : 2 + count] @ rows[1 : 1 + 2 * count : 2]
        np.testing.assert_allclose(other[:LANES], expected, rtol=0.0, atol=1e-14)


@pytest.mark.parametrize("module", [plain_lanes, vector_lanes])
@pytest.mark.parametrize("quads", [1, 2])
@pytest.mark.parametrize("add", [False, True])
def test_product_of_small_matrices(module: ModuleType, quads: int, add: bool) -> None:
    """Parts of larger arrays; what lies beside the product stays as it was."""
    multiply_quads, known = module.multiply_quads, (0,) * quads

    @njit
    def multiply(rows, a, b, out):  # type: ignore[no-untyped-def]
        u = UNSIGNED
        multiply_quads(known, u(rows), a.ravel(), u(7), u(6), b.ravel(), u(13), u(12), add, out, u(11), u(10))

    random = np.random.default_rng(3)
    a, b, before = random.standard_normal((7, 6)), random.standard_normal((6, 12)), random.standard_normal(90)
    width, out = quads * lanes.QUAD, before.copy()
    multiply(5, a, b, out)
    product = a[1:6, 1 : 1 + lanes.QUAD] @ b[1 : 1 + lanes.QUAD, 1 : 1 + width]
    expected = before.copy().reshape(9, 10)
    expected[1:6, 1 : 1 + width] = expected[1:6, 1 : 1 + width] + product if add else -product
    np.testing.assert_allclose(out.reshape(9, 10), expected, rtol=0.0, atol=1e-14)
    untouched = np.ones((9, 10), dtype=bool)
    untouched[1:6, 1 : 1 + width] = False
    np.testing.assert_array_equal(out.reshape(9, 10)[untouched], before.reshape(9, 10)[untouched])


@pytest.mark.parametrize("module", [plain_lanes, vector_lanes])
def test_borrowed_arrays_are_the_same_memory(module: ModuleType) -> None:
    """What is written through a view is in the array, and nothing is freed that the caller holds."""
    borrowed = module.borrowed

    @njit
    def write(values):  # type: ignore[no-untyped-def]
        view = borrowed(values)[2:].reshape(2, 3)
        view[1] = 7.0
        return view[0].sum()

    values = np.arange(8.0)
    references = sys.getrefcount(values)
    for _ in range(3):
        assert write(values) == 2.0 + 3.0 + 4.0
    np.testing.assert_array_equal(values, [0, 1, 2, 3, 4, 7, 7, 7])
    assert sys.getrefcount(values) == references


def test_plain_ones_are_taken_where_the_others_fail(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delenv("AGFB_PLAIN_LANES", raising=False)
    assert lanes.chosen() is vector_lanes
    monkeypatch.setitem(sys.modules, "pipelines.machine.vector_lanes", None)
    monkeypatch.delattr(machine, "vector_lanes")
    assert lanes.chosen() is plain_lanes


@pytest.mark.parametrize(("value", "module"), [("0", vector_lanes), ("1", plain_lanes)])
def test_the_environment_chooses(value: str, module: ModuleType, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("AGFB_PLAIN_LANES", value)
    assert lanes.chosen() is module


def test_kernels_on_the_disk_belong_to_a_choice(monkeypatch: pytest.MonkeyPatch) -> None:
    digest = kernels.source_digest.__wrapped__
    known = digest()
    monkeypatch.setattr(kernels, "PLAIN", not kernels.PLAIN)
    assert digest() != known


def image() -> NDArray[np.float64]:
    """Ten columns and the state after one period of the machine."""
    description = case((8, 2), displacement=0.1)
    built, parameters = build_machine(description), parameter_vector(description)
    system, state = machine_system(built), machine_equilibrium(built, parameters).state
    found = PeriodMap(system, stepper=ESDIRK5).evaluate(
        state, parameters, 2.0 * np.pi / parameters[1], 6, deterministic_block(system.size, 10)
    )
    assert found.finite
    return np.column_stack([found.columns, found.state])


@pytest.mark.slow
def test_both_give_the_same_pass(tmp_path: Path) -> None:
    """The plain loops are interpreted here: to compile all kernels with them takes a minute."""
    out = tmp_path / "plain.npy"
    script = (
        "import sys; import numpy as np; from pipelines.machine import lanes;"
        "from tests.machine.test_lanes import image; assert lanes.PLAIN; np.save(sys.argv[1], image())"
    )
    environment = os.environ | {"AGFB_PLAIN_LANES": "1", "NUMBA_DISABLE_JIT": "1"}
    subprocess.run([sys.executable, "-c", script, str(out)], cwd=ROOT, env=environment, check=True)
    plain = np.load(out)
    np.testing.assert_allclose(plain, image(), rtol=0.0, atol=1e-10 * np.abs(plain).max())
