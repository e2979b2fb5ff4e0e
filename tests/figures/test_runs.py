"""Figures of runs in time: what is drawn is what the analysis says."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from matplotlib.collections import QuadMesh

from pipelines.datasets.reading import read_group
from pipelines.figures.case_tables import RUNS
from pipelines.figures.contents import MissingDataError, Table
from pipelines.figures.drawing import FIGURE_KINDS, draw_figures
from pipelines.figures.response_envelope import comparable, draw_envelope, draw_unbalance
from pipelines.figures.run_motion import draw_modal_energy, draw_poincare, draw_spectrum, draw_waterfall
from pipelines.figures.runs import RUN_ARRAYS, RunView
from tests.figures import synthetic_store


@pytest.fixture(scope="module")
def runs(tmp_path_factory):
    parts = ("machine", "runs")
    store = synthetic_store.make_store(tmp_path_factory.mktemp("runs") / "store", 3, parts=parts)
    found = []
    for name in ("t000", "t001", "t002"):
        group = read_group(store, f"cases/kb10/transient_analysis/{name}")
        samples = read_group(store, f"cases/kb10/transient/{name}", RUN_ARRAYS)
        tables = [Table(part.labelled(), part.attributes) for part in (group, samples)]
        found.append(RunView(name, *tables))
    return found


def changed(run, **arrays):
    return replace(run, analysis=Table({**run.analysis.arrays, **arrays}, run.analysis.attributes))


def skipping(run, part, reason, *prefixes):
    kept = {n: v for n, v in run.analysis.arrays.items() if not n.startswith(prefixes)}
    return replace(run, analysis=Table(kept, {**run.analysis.attributes, "skipped": {part: reason}}))


@pytest.fixture(scope="module")
def moving(branch):
    """The branch of cycles with the parameters of the runs."""
    same = {"excitation_frequency": 0.7, "displacement": 0.2, "foil_stiffness": 10.0}
    points = len(branch["speed"])
    arrays = branch.arrays | {name: np.full(points, value) for name, value in same.items()}
    return Table(arrays, branch.attributes)


def lines(axes):
    return [line.get_xydata() for line in axes.get_lines()]


def test_the_envelope_lies_over_the_cycles_and_their_multipliers(view, runs, moving):
    run = runs[0]
    figure = draw_envelope(view, run, [moving])
    assert len(figure.axes) == 3
    for bearing in range(2):
        drawn = lines(figure.axes[bearing])
        low = np.column_stack([run.analysis["window_speed"], run.analysis["envelope_low"][:, bearing, 1]])
        assert any(line.shape == low.shape and np.array_equal(line, low) for line in drawn)
        column = view.journal_coordinates(bearing)[1]
        heights = np.concatenate([line[:, 1] for line in drawn])
        assert np.isin(moving["orbit_maximum"][:, column], heights).all()
    moduli = np.concatenate([line[:, 1] for line in lines(figure.axes[2])])
    largest = np.nanmax(np.abs(moving["multipliers"]), axis=1)
    assert np.isin(largest, moduli).all()
    assert figure.axes[0].get_xlim() == figure.axes[2].get_xlim()


def test_only_cycles_with_the_parameters_of_the_run_are_compared(runs, moving):
    other = Table(moving.arrays | {"displacement": np.full(len(moving["speed"]), 0.1)}, moving.attributes)
    doubled = Table(moving.arrays, {**moving.attributes, "turns": 2})
    along = Table(moving.arrays, {**moving.attributes, "parameter": "displacement"})
    assert comparable(runs[0], [moving, other, doubled, along]) == [moving, doubled]


def test_a_run_at_constant_speed_is_drawn_over_time(view, runs, moving):
    run = runs[2]
    figure = draw_envelope(view, run, [moving])
    assert len(figure.axes) == 2
    assert "time" in figure.axes[-1].get_xlabel()
    np.testing.assert_array_equal(lines(figure.axes[0])[0][:, 0], run.analysis["window_time"])


def test_a_speed_that_goes_up_and_down_is_drawn_over_time(runs):
    speed = runs[0].run["speed"].copy()
    speed[-1] = speed[-3]
    table = Table({**runs[0].run.arrays, "speed": speed}, runs[0].run.attributes)
    assert not replace(runs[0], run=table).over_speed
    assert runs[0].over_speed


def test_a_run_that_stays_at_one_speed_most_of_the_time_is_drawn_over_time(runs):
    speed = runs[0].run["speed"].copy()
    speed[len(speed) // 2 - 2 :] = speed.max()
    table = Table({**runs[0].run.arrays, "speed": speed}, runs[0].run.attributes)
    assert not replace(runs[0], run=table).over_speed


def test_unbalances_are_labelled_and_drawn_over_each_other(view, runs):
    figure = draw_unbalance(view, runs)
    (legend,) = figure.legends
    assert {text.get_text() for text in legend.get_texts()} == {"balanced", "G 2.5"}
    assert len(figure.axes[0].get_lines()) == 4
    with pytest.raises(MissingDataError, match="two runs"):
        draw_unbalance(view, runs[1:])


def test_labels_of_unbalance():
    def label(unbalance):
        attributes = {"request": {"unbalance": unbalance}}
        return RunView("t000", Table({}), Table({}, attributes)).unbalance

    assert label(None) == "balanced"
    assert label({"grade": 6.3, "planes": []}) == "G 6.3"
    planes = [{"moment": 2.5}, {"moment": 3.0}]
    assert label({"grade": None, "planes": planes}) == "U = 5.5 g mm"


def test_the_waterfall_shows_the_vertical_amplitudes(view, runs):
    run = runs[0]
    figure = draw_waterfall(view, run)
    for bearing in range(2):
        axes = figure.axes[bearing]
        (mesh,) = [c for c in axes.collections if isinstance(c, QuadMesh)]
        expected = np.maximum(run.analysis["waterfall"][:, :, bearing, 1], mesh.norm.vmin)
        np.testing.assert_array_equal(np.ravel(mesh.get_array()), expected.ravel())
        rotation, rings = lines(axes)
        np.testing.assert_array_equal(rotation[:, 0], rotation[:, 1])  # over the speed
        np.testing.assert_array_equal(rings[:, 0], 0.7)
        assert 2.1 < axes.get_xlim()[1] < 4.0  # the fourth peak is at 2.8, 1e-3 of the first


def test_the_spectrum_shows_both_directions(view, runs):
    run = runs[2]
    figure = draw_spectrum(view, run)
    assert figure.get_suptitle().rstrip().endswith(": quasi-periodic")
    for bearing in range(2):
        horizontal, vertical, rotation, rings = lines(figure.axes[bearing])
        np.testing.assert_array_equal(horizontal[:, 1], run.analysis["spectrum"][:, bearing, 0])
        np.testing.assert_array_equal(vertical[:, 1], run.analysis["spectrum"][:, bearing, 1])
        assert rotation[0, 0] == 1.25
        assert rings[0, 0] == 0.7


def test_poincare_points_are_those_of_the_judged_stretch(view, runs):
    run = runs[2]
    figure = draw_poincare(view, run)
    assert "quasi-periodic, 0–1 test 0.02" in figure.get_suptitle()
    chosen = run.analysis["ring_section_time"] >= run.analysis["stretch_begin"][0]
    points = lines(figure.axes[1])[-1]
    np.testing.assert_array_equal(points, run.analysis["ring_section_journal"][chosen, 1])
    assert f"{np.count_nonzero(chosen)} points" in figure.axes[1].get_title()


def test_a_motion_that_is_not_known_says_why(view, runs):
    run = skipping(runs[0], "motion", "the speed changes", "motion", "stretch_begin")
    assert "not judged: the speed changes" in draw_poincare(view, run).get_suptitle()
    resting = skipping(run, "ring_section", "the rings rest", "ring_section")
    assert len(draw_poincare(view, resting).axes) == 2
    with pytest.raises(MissingDataError, match="no steady end"):
        draw_spectrum(view, skipping(runs[0], "spectrum", "no steady end", "frequency", "spectrum"))


def test_energies_of_the_modes_that_take_part(view, runs):
    run = runs[0]
    figure = draw_modal_energy(view, run)
    kinetic, strain = figure.axes
    drawn = np.array([line[:, 1] for line in lines(kinetic)])
    np.testing.assert_array_equal(drawn, run.analysis["kinetic_energy"][:, [0, 1, 3]].T)
    drawn = np.array([line[:, 1] for line in lines(strain)])
    np.testing.assert_array_equal(drawn, run.analysis["strain_energy"][:, [1, 3]].T)
    (legend,) = figure.legends
    assert [text.get_text().split(",")[0] for text in legend.get_texts()] == [
        "rigid body",
        "bending",
        "bending",
    ]


@pytest.mark.slow
def test_heading_and_panels_keep_apart(view, runs, moving):
    for figure in (
        draw_envelope(view, runs[1], [moving]),
        draw_unbalance(view, runs),
        draw_waterfall(view, runs[0]),
        draw_spectrum(view, runs[2]),
        draw_poincare(view, runs[2]),
        draw_modal_energy(view, runs[0]),
    ):
        renderer, whole = figure.canvas.get_renderer(), figure.bbox
        boxes = [figure._suptitle.get_window_extent()]
        boxes += [legend.get_window_extent(renderer) for legend in figure.legends]
        for box in boxes:
            assert whole.x0 <= box.x0 < box.x1 <= whole.x1
            for axes in figure.axes:
                assert not box.overlaps(axes.get_tightbbox(renderer))


@pytest.mark.slow
def test_files_of_every_run(tmp_path):
    synthetic_store.make_store(tmp_path / "store", 3, parts=("machine", "runs"))
    said = []
    kinds = [kind for kind, group in FIGURE_KINDS.items() if group == RUNS]
    written = draw_figures(tmp_path / "store", tmp_path / "figures", kinds=kinds, notify=said.append)
    each = [f"{kind}-t00{n}.png" for kind in kinds if kind != "unbalance" for n in range(3)]
    assert {path.name for path in written} == {*each, "unbalance.png"}
    assert said == []
