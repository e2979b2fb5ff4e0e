"""Figures of several cases together: which cases are in them, what tells these apart, and what is drawn."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from pipelines.datasets.branch import write_group
from pipelines.datasets.store import create_store
from pipelines.figures.case_tables import CaseTables, read_case
from pipelines.figures.drawing import draw_figures, draw_one_figure
from pipelines.figures.several_cases import JOINT_KINDS, joint_plans, told_apart
from tests.figures import synthetic_store
from tests.figures.synthetic_runs import write_runs
from tests.helpers.curves import curve_rows, oval, write_curve, write_set

DISPLACEMENTS = (0.2, 0.05, 0.1)
CASES = [f"stiffness=10_displacement={value:g}" for value in DISPLACEMENTS]
NEEDED = {group for groups in JOINT_KINDS.values() for group in groups}


def threshold(rise):
    return lambda f: np.column_stack([f, 1.05 + rise * np.exp(-(((f - 0.7) / 0.2) ** 2))])


@pytest.fixture(scope="module")
def store(tmp_path_factory):
    """Three displacements with a threshold each and runs; the largest with a closed tongue too."""
    attributes = {
        case: {
            "name": case,
            "parameters": {
                "speed": 0.3, "excitation_frequency": 0.7, "displacement": value, "foil_stiffness": 10.0
            },
            "scales": synthetic_store.SCALES,
            "reconstruction": synthetic_store.NOTE,
        }
        for case, value in zip(CASES, DISPLACEMENTS, strict=True)
    }  # fmt: skip
    path = tmp_path_factory.mktemp("several") / "store"
    store = create_store(path, attributes, {"configuration": {}, "configuration_hash": "0"}, durable=False)
    for case, value in zip(CASES, DISPLACEMENTS, strict=True):
        group = f"cases/{case}"
        rows = curve_rows(threshold(value), (0.2, 2.0), 20)
        rows["criticality"] = np.where(rows["excitation_frequency"] < 1.0, 0, 1).astype(np.int8)
        write_curve(store, f"{group}/ns/c000", "neimark_sacker", rows)
        write_set(store, case)
        write_group(
            store, f"{group}/machine", "machine", synthetic_store.machine(), {"material_names": ["steel"]}
        )
        if value > 0.05:
            write_runs(store, case)
        if value == 0.2:
            synthetic_store.write_branch(store, f"{group}/cycles/b000", synthetic_store.cycles(12))
    tongue = curve_rows(oval(1.25, 0.86, 0.13, 0.3), (0.0, 2 * np.pi), 40)
    write_curve(store, f"cases/{CASES[0]}/pd/c000", "period_doubling", tongue, "closed")
    return store


@pytest.fixture(scope="module")
def plans(store):
    read = [read_case(store, case, NEEDED | {"machine"}, pytest.fail, []) for case in sorted(CASES)]
    return {plan.kind: plan.draw() for plan in joint_plans(read, JOINT_KINDS, pytest.fail)}


def labels(figure):
    return [text.get_text() for legend in figure.legends for text in legend.get_texts()]


def test_sets_has_a_colour_for_each_case_by_increasing_displacement(plans):
    figure = plans["sets"]
    symbol = r"$\bar{\delta}$"
    assert labels(figure)[:3] == [f"{symbol} = 0.05", f"{symbol} = 0.1", f"{symbol} = 0.2"]
    assert figure.get_suptitle().splitlines()[0] == r"bifurcation sets at $\bar{k}_f$ = 10"
    colours = [handle.get_color() for handle in figure.legends[0].legend_handles[:3]]
    assert len(set(colours)) == 3
    lines = figure.axes[0].get_lines()
    for colour, rise in zip(colours, (0.05, 0.1, 0.2), strict=True):
        (drawn,) = (line for line in lines if line.get_color() == colour and line.get_linestyle() == "-")
        points = drawn.get_xydata()
        np.testing.assert_allclose(points, threshold(rise)(points[:, 0]), atol=2e-3)


def test_sets_tells_the_kinds_apart_by_their_lines(plans):
    figure = plans["sets"]
    dashed = [
        line
        for line in figure.axes[0].get_lines()
        if line.get_linestyle() == "--" and len(line.get_xdata()) > 2
    ]
    assert len(dashed) == 1, "the tongue of the largest displacement, in one piece"
    assert dashed[0].get_color() == figure.legends[0].legend_handles[2].get_color()
    assert {"Neimark–Sacker (NS)", "period doubling (PD)"} <= set(labels(figure))
    assert "fold (LPC)" not in labels(figure)


def test_the_passive_speed_is_one_line_where_the_cases_share_it(plans, store):
    assert r"instability at $\bar{\delta}=0$: 1.05" in labels(plans["sets"])
    read = [read_case(store, case, NEEDED, pytest.fail, []) for case in CASES[:2]]
    table = read[0].tables["bifurcation_set"]
    other = replace(table, attributes={**table.attributes, "passive_instability_speed": 1.1})
    changed = replace(read[0], tables={**read[0].tables, "bifurcation_set": other})
    (plan,) = joint_plans([changed, read[1]], ["sets"], pytest.fail)
    heights = {
        float(line.get_ydata()[0]) for line in plan.draw().axes[0].get_lines() if len(line.get_ydata()) == 2
    }
    assert heights == {1.05, 1.1}


def test_envelopes_has_the_runs_below_each_other_with_multipliers_below_their_cycles(plans, store):
    figure = plans["envelopes"]
    panels = figure.axes
    # only the last case has cycles, which are those of its run
    titles = [panel.get_title() for panel in panels]
    assert titles == [r"$\bar{\delta}$ = 0.1: bearing 1", r"$\bar{\delta}$ = 0.2: bearing 1", ""]
    assert panels[2].get_ylabel() == r"$|\mu|$"
    run = read_case(store, CASES[0], NEEDED, pytest.fail, []).runs[0]
    low = np.column_stack([run.analysis["window_speed"], run.analysis["envelope_low"][:, 0, 1]])
    assert any(np.array_equal(line.get_xydata(), low) for line in panels[1].get_lines())


def test_the_panels_keep_apart_from_heading_and_legend(plans):
    for figure in plans.values():
        renderer, whole = figure.canvas.get_renderer(), figure.bbox
        boxes = [figure._suptitle.get_window_extent()]
        boxes += [legend.get_window_extent(renderer) for legend in figure.legends]
        for box in boxes:
            assert whole.x0 <= box.x0 < box.x1 <= whole.x1
            for axes in figure.axes:
                assert not box.overlaps(axes.get_tightbbox(renderer))


def test_cases_are_told_apart_by_their_names_where_parameters_do_not(view):
    names = ("grade=1_stiffness=3", "grade=6.3_stiffness=3")
    cases = [replace(view, name=name, parameters={"speed": 0.3, "foil_stiffness": 3.0}) for name in names]
    assert told_apart(cases, ("speed",)) == (["grade=1", "grade=6.3"], r" at $\bar{k}_f$ = 3")


def test_reasons_why_a_figure_of_several_cases_is_left_out(view):
    said = []
    cases = [CaseTables(view, {}), CaseTables(view, {})]
    assert list(joint_plans(cases, JOINT_KINDS, said.append)) == []
    assert said == [
        "sets is left out: the chosen cases have no curves of bifurcations",
        "envelopes is left out: it needs two cases with a run over the speed that has ended; "
        "of the chosen ones none has",
    ]


def test_too_many_cases_are_not_crowded_into_one(store):
    case = read_case(store, CASES[0], NEEDED | {"machine"}, pytest.fail, [])
    said = []
    assert list(joint_plans([case] * 9, JOINT_KINDS, said.append)) == []
    assert ["choose at most 8" in said[0], "choose at most 4" in said[1]] == [True, True]


def test_their_files_lie_beside_the_folders_of_the_cases(store, tmp_path):
    written = draw_figures(store, tmp_path, kinds=("sets", "stability"), cases="*=0.?")
    assert [str(path.relative_to(tmp_path)) for path in written] == [
        "stiffness=10_displacement=0.1/stability-map.png",
        "stiffness=10_displacement=0.2/stability-map.png",
        "sets.png",
    ]
    unasked = draw_figures(store, tmp_path, cases="*=0.05")
    assert not any(path.name == "sets.png" for path in unasked)


def test_one_figure_into_a_file_of_ones_own(store, tmp_path):
    path = draw_one_figure(store, tmp_path / "fig3b.svg", kinds=("sets",))
    assert path == tmp_path / "fig3b.svg"
    assert path.read_bytes().startswith(b"<?xml")
    with pytest.raises(
        ValueError, match=r"a.png can hold one figure, .* make 3 figures \(stiffness=10_displacement"
    ):
        draw_one_figure(store, tmp_path / "a.png", kinds=("stability",))
    with pytest.raises(ValueError, match="make no figure"):
        draw_one_figure(store, tmp_path / "a.png", cases=CASES[1], kinds=("envelope",))
    assert not (tmp_path / "a.png").exists()
