"""Masters with slopes through the stages: stored coordinates, cycles, runs in time."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from pipelines.datasets.reading import read_group
from pipelines.datasets.records import Group
from pipelines.datasets.schema import KINDS
from pipelines.datasets.store import open_for_reading
from pipelines.machine.assembly import build_machine
from tests.helpers.tiny import SHARP, Watched, tiny_case

# wheels at both ends, heavy enough to tilt on their own
WHEELS = ("rotor.discs.diametral_inertia=4e-4", "rotor.discs.polar_inertia=7e-4", SHARP)
PLAIN = "rotor.masters=[0, 2, 4, 7, 10, 12, 14]"
SLOPES = (
    "rotor.masters=[{ node = 0, slopes = true }, 2, 4, 7, 10, { node = 12, slopes = false }, "
    "{ node = 14, slopes = true }]"
)
FULL = f"rotor.masters=[{', '.join(f'{{ node = {node}, slopes = true }}' for node in range(15))}]"
TWO = ("continue_cycles.max_points=2",)


def branch_of(store: Path, masters: str) -> Group:
    assert Watched("continue_cycles", tiny_case(*WHEELS, *TWO, masters), store).result.ok
    return read_group(open_for_reading(store), "cases/smoke/cycles/b000")


def journals(branch: Group) -> np.ndarray:
    """Orbits of both journals (point, sample, 4)."""
    axis, node = branch.labels("coordinate_axis"), branch["coordinate_node"]
    wanted = [(place, way) for place in (2, 12) for way in ("x", "y")]
    columns = [int(np.flatnonzero((node == place) & (axis == way))[0]) for place, way in wanted]
    return branch["orbit"][:, :, columns]


@pytest.fixture(scope="module")
def branches(tmp_path_factory):
    folder = tmp_path_factory.mktemp("slopes")
    names = {"plain": PLAIN, "slopes": SLOPES, "full": FULL}
    return {
        name: (folder / f"{name}.zarr", branch_of(folder / f"{name}.zarr", m)) for name, m in names.items()
    }


def test_cycles_come_to_those_of_the_full_rotor(branches):
    full = branches["full"][1]
    error, shift = {}, {}
    for name in ("plain", "slopes"):
        found = branches[name][1]
        error[name] = np.abs(journals(found)[0] - journals(full)[0]).max()
        leading = [np.sort_complex(each["multipliers"][0][:6]) for each in (found, full)]
        shift[name] = np.abs(leading[0] - leading[1]).max()
    assert error["slopes"] < 1e-4 < 2e-4 < error["plain"]
    assert shift["slopes"] < 5e-3 < 0.1 < shift["plain"]


def test_every_coordinate_says_what_it_is(branches):
    branch = branches["slopes"][1]
    np.testing.assert_array_equal(
        branch["coordinate_node"], [0, 0, 0, 0, 2, 2, 4, 4, 7, 7, 10, 10, 12, 12, 14, 14, 14, 14]
    )
    axes = ["x", "y", "alpha", "beta", *["x", "y"] * 5, "x", "y", "alpha", "beta"]
    np.testing.assert_array_equal(branch.labels("coordinate_axis"), axes)
    plain = branches["plain"][1]
    np.testing.assert_array_equal(plain["coordinate_node"], np.repeat([0, 2, 4, 7, 10, 12, 14], 2))
    np.testing.assert_array_equal(plain.labels("coordinate_axis"), ["x", "y"] * 7)


def test_the_stored_orbit_bends_the_shaft_as_the_full_rotor(branches):
    """Other nodes follow from the stored coordinates; slopes are in units of c/L."""
    machine = build_machine(tiny_case(*WHEELS, *TWO, SLOPES).case)
    orbit, full = (branches[name][1]["orbit"][0] for name in ("slopes", "full"))
    everywhere = (orbit @ machine.scaled.transformation.T).reshape(len(orbit), 15, 4)[:, :, :2]
    expected = full.reshape(len(full), 15, 4)
    # about its mean: between two masters the shaft also sags under its own weight
    motion, wanted = (each - each.mean(axis=0) for each in (everywhere, expected[:, :, :2]))
    np.testing.assert_allclose(motion, wanted, rtol=0.0, atol=1e-4)
    # between two masters the slope is that of the translations: dx/dZ = beta, dy/dZ = -alpha
    length = 0.360 / 14
    rise = (expected[:, 8, :2] - expected[:, 6, :2]) / (2.0 * length / 0.0161)
    np.testing.assert_allclose(rise[:, 0], expected[:, 7, 3], rtol=0.0, atol=1e-5)
    np.testing.assert_allclose(rise[:, 1], -expected[:, 7, 2], rtol=0.0, atol=1e-5)


def test_a_run_in_time_goes_on_along_a_cycle_with_slopes(branches):
    store, branch = branches["slopes"]
    table = (
        "transient.start=cycles/b000",
        "transient.start_row=0",
        "transient.tolerance=1e-8",
        f"transient.duration={2 * branch['period'][0]}",
        "transient.samples_per_period=64",
    )
    result = Watched("transient", tiny_case(*WHEELS, *TWO, SLOPES, *table), store).result
    assert result.stop_reason == "finished"
    run = read_group(open_for_reading(store), "cases/smoke/transient/t000")
    assert run["displacement"].shape[1] == 18
    np.testing.assert_array_equal(run["coordinate_axis"], branch["coordinate_axis"])
    np.testing.assert_allclose(run["displacement"][64:128], branch["orbit"][0], rtol=0.0, atol=1e-5)
    np.testing.assert_allclose(
        run["journal"][64:128].reshape(64, 4), journals(branch)[0], rtol=0.0, atol=1e-5
    )


def test_slopes_have_names_in_every_kind_that_stores_coordinates():
    kinds = [kind for kind in KINDS.values() if any(s.name == "coordinate_axis" for s in kind.arrays)]
    assert {kind.kind for kind in kinds} == {"cycles", "tori", "curve", "transient"}
    for kind in kinds:
        assert kind.array("coordinate_axis").flags == ("x", "y", "alpha", "beta")
