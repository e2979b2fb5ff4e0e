"""Figures of whole stores: which files there are, what is left out, and that their bytes do not change."""

from __future__ import annotations

import hashlib
import json
import os
import subprocess
import sys
from pathlib import Path

import matplotlib as mpl
import pytest

from pipelines.datasets.store import CorruptedError
from pipelines.figures.case_tables import RUNS
from pipelines.figures.drawing import FIGURE_KINDS, draw_figures
from pipelines.figures.style import new_figure, save_figure

ROOT = Path(__file__).parents[2]

DRAW = """
import json, sys
from pipelines.figures.drawing import draw_figures
store, output, formats, kinds = sys.argv[1], sys.argv[2], sys.argv[3].split(), sys.argv[4].split()
paths = draw_figures(store, output, formats=formats, kinds=kinds)
assert "matplotlib.pyplot" not in sys.modules
print(json.dumps([str(path) for path in paths]))
"""


def draw_elsewhere(store, output, formats, kinds):
    """Start drawing in another process, with another order of hashes than this one."""
    environment = os.environ | {"PYTHONPATH": str(ROOT), "PYTHONHASHSEED": "7"}
    command = [sys.executable, "-c", DRAW, str(store), str(output), formats, kinds]
    return subprocess.Popen(command, env=environment, stdout=subprocess.PIPE, text=True)


def digests(paths):
    return {Path(path).name: hashlib.sha256(Path(path).read_bytes()).hexdigest() for path in paths}


def finished(process):
    output, _ = process.communicate(timeout=120)
    assert process.returncode == 0
    return json.loads(output)


@pytest.mark.slow
def test_figures_of_all_kinds_have_the_same_bytes_in_another_process(synthetic, tmp_path):
    """Those of runs in time are in `test_runs`."""
    store, output = tmp_path / "store", tmp_path / "figures"
    synthetic.make_store(store, 3, parts=(*synthetic.PARTS, "survey", "certificate"))
    # hatches, colour bars, subfigures, markers, clipped lines: everything that gets an identifier in a file
    elsewhere = draw_elsewhere(store, tmp_path / "again", "svg", "machine campbell orbits film")
    said, before = [], dict(mpl.rcParams)
    wanted = [kind for kind, group in FIGURE_KINDS.items() if group != RUNS]
    written = draw_figures(store, output, formats=("svg",), kinds=wanted, notify=said.append)
    assert dict(mpl.rcParams) == before
    assert said == []
    kinds = [next(kind for kind in FIGURE_KINDS if path.stem.startswith(kind)) for path in written]
    assert list(dict.fromkeys(kinds)) == wanted
    assert all(path.parent == output / "kb10" for path in written)
    assert not list(output.rglob("*.partial"))
    again = digests(finished(elsewhere))
    assert {name.split(".")[0].split("-")[0] for name in again} == {"machine", "campbell", "orbits", "film"}
    assert again.items() <= digests(written).items()


@pytest.mark.slow
def test_every_format_has_the_same_bytes_whatever_was_drawn_before_it(synthetic, tmp_path):
    store = tmp_path / "store"
    synthetic.make_store(store, 3, parts=("machine", "cycles"))
    elsewhere = draw_elsewhere(store, tmp_path / "again", "pdf svg png", "multipliers")
    written = draw_figures(store, tmp_path / "figures", formats=("png", "svg", "pdf"), kinds=("multipliers",))
    assert len(written) == 3
    assert digests(written) == digests(finished(elsewhere))
    for path in written:
        for trace in (b"Date", b"matplotlib.org", b"Matplotlib v", b"Matplotlib pdf"):
            assert trace not in path.read_bytes(), (path.name, trace)


def test_a_growing_branch_is_drawn_from_its_first_point_on(synthetic, tmp_path):
    for points in (0, 1):
        store, output = tmp_path / str(points), tmp_path / "figures" / str(points)
        synthetic.make_store(store, points, parts=("machine", "cycles"))
        written = draw_figures(store, output, kinds=("bifurcation", "multipliers"))
        assert [path.name for path in written] == ["bifurcation-speed.png", "multipliers-b000.png"]
    empty, one = (tmp_path / "figures" / n / "kb10" / "bifurcation-speed.png" for n in "01")
    assert empty.stat().st_size < one.stat().st_size  # the first says only that there is nothing yet


def test_missing_groups_and_arrays_are_reported(synthetic, tmp_path):
    synthetic.make_store(tmp_path / "store", 3, parts=("machine",))
    said = []
    written = draw_figures(
        tmp_path / "store", tmp_path / "figures", kinds=tuple(FIGURE_KINDS), notify=said.append
    )
    assert [path.name for path in written] == ["machine.png"]
    assert len(said) == len(set(FIGURE_KINDS.values())) - 1  # one message for each kind of group
    cycles = [kind for kind, group in FIGURE_KINDS.items() if group == "cycles"]
    told = f"kb10: {', '.join(cycles)} are left out: the store has no group 'cycles' for this case"
    assert told in said
    assert "kb10: linearization is left out: the store has no group 'linear' for this case" in said
    said.clear()
    assert len(draw_figures(tmp_path / "store", tmp_path / "figures", notify=said.append)) == 1
    assert said == [], "nobody asked for the others"


def test_a_tree_without_doubled_branches_is_told(synthetic, tmp_path):
    synthetic.make_store(tmp_path / "store", 3, parts=("machine", "cycles"))
    said = []
    assert draw_figures(tmp_path / "store", tmp_path / "figures", kinds=["tree"], notify=said.append) == []
    assert said == ["kb10: tree is left out: it has no branch of doubled cycles (continue_cycles.doublings)"]


def test_a_damaged_group_costs_its_own_figures_only(synthetic, tmp_path):
    synthetic.make_store(tmp_path / "store", 3)
    damaged = next((tmp_path / "store").glob("cases/*/linear/eigenvalues/c*"))
    damaged.write_bytes(damaged.read_bytes()[:-1])
    told = []
    with pytest.raises(CorruptedError) as error:
        draw_figures(
            tmp_path / "store", tmp_path / "out", kinds=["machine", "linearization"], notify=told.append
        )
    assert error.value.path == damaged
    assert [path.name for path in (tmp_path / "out").rglob("*.png")] == ["machine.png"]
    assert any("linear is left out" in message for message in told)


def test_without_the_machine_its_figures_are_left_out_with_the_reason(synthetic, tmp_path):
    synthetic.make_store(tmp_path / "store", 3, parts=("cycles",))
    said = []
    kinds = ("machine", "bifurcation", "multipliers")
    written = draw_figures(tmp_path / "store", tmp_path / "figures", kinds=kinds, notify=said.append)
    assert [path.name for path in written] == ["multipliers-b000.png"]  # needs no geometry
    assert "bearing_node" in said[1]


def test_bad_requests_name_what_is_allowed(synthetic, tmp_path):
    synthetic.make_store(tmp_path / "store", 0, parts=("machine",))
    with pytest.raises(ValueError, match="unknown format gif; allowed are png, svg, pdf"):
        draw_figures(tmp_path / "store", tmp_path, formats=("gif",))
    with pytest.raises(ValueError, match="unknown figure trajectory; allowed are machine"):
        draw_figures(tmp_path / "store", tmp_path, kinds=("trajectory",))
    with pytest.raises(ValueError, match=r"no case matches 'kb2\*'; the store holds kb10"):
        draw_figures(tmp_path / "store", tmp_path, cases="kb2*")
    with pytest.raises(ValueError, match="must be one of png, svg, pdf"):
        save_figure(new_figure(1.0), tmp_path / "a.gif")
