"""Figures of the linear machine: operating point, bearing coefficients, critical speed map, polar plot."""

from __future__ import annotations

import numpy as np
import pytest

from pipelines.datasets.store import open_for_reading
from pipelines.figures.case_tables import CaseTables, read_case
from pipelines.figures.coefficients import draw_coefficients
from pipelines.figures.contents import MissingDataError, Table
from pipelines.figures.critical_map import draw_critical_map
from pipelines.figures.operating_point import draw_operating_point
from pipelines.figures.polar import draw_polar
from tests.figures.synthetic_store import SCALES, make_store

PARTS = ("machine", "operating_point", "coefficients", "criticals", "unbalance_response")


@pytest.fixture(scope="module")
def case(tmp_path_factory: pytest.TempPathFactory) -> CaseTables:
    path = tmp_path_factory.mktemp("linear") / "a.zarr"
    make_store(path, parts=PARTS)
    found = read_case(open_for_reading(path), "kb10", set(PARTS), print, [])
    assert found is not None
    return found


def test_the_operating_point_names_unstable_modes_and_loads(case: CaseTables) -> None:
    point = case.single["operating_point"]
    figure = draw_operating_point(case.view, point)
    axes = figure.subfigs[0].axes[0]
    for line, axis in zip(axes.get_lines(), (0, 1), strict=False):
        np.testing.assert_allclose(line.get_ydata(), 1e6 * point["deflection"][:, axis])
    assert any("bearing 2: 3.5 N" in text.get_text() for text in axes.texts)
    shapes = [each for each in figure.subfigs[1].axes if each.axison]
    assert len(shapes) == 5
    unstable = [any(text.get_text() == "unstable" for text in each.texts) for each in shapes]
    assert unstable == (point["logarithmic_decrement"] < 0.0).tolist()


def test_an_operating_point_without_equilibrium_is_left_out(case: CaseTables) -> None:
    nothing = Table({}, {"equilibrium": False, "reason": "the films carry only half", "speed_rpm": 1.0})
    with pytest.raises(MissingDataError, match="the films carry only half"):
        draw_operating_point(case.view, nothing)


def test_coefficients_of_both_bearings_with_their_synchronous_values(case: CaseTables) -> None:
    table = case.single["coefficients"]
    figure = draw_coefficients(case.view, table)
    panels = figure.axes[:16]
    assert panels[4].get_title() == r"$\bar{C}_{xx}$, bearing 1"
    lines = panels[8 + 3].get_lines()  # Kyy of bearing 2
    np.testing.assert_array_equal(lines[0].get_ydata(), table["stiffness"][0, :, 1, 1, 1])
    # the second speed has no equilibrium
    np.testing.assert_array_equal(lines[1].get_ydata(), table["stiffness"][2, :, 1, 1, 1])
    dotted = next(line for line in lines if line.get_linestyle() == ":")
    speeds = np.delete(table["speed"], 1)
    np.testing.assert_array_equal(dotted.get_xdata(), speeds)
    last = np.interp(speeds[-1], table["frequency"], table["stiffness"][-1, :, 1, 1, 1])
    assert dotted.get_ydata()[-1] == pytest.approx(last)
    (right,) = panels[8 + 3].child_axes
    assert right.get_ylabel() == "[MN/m]"
    machine, pressure = case.view.machine, SCALES["pressure"]
    radius, length, clearance = (machine[f"bearing_{key}"][1] for key in ("radius", "length", "clearance"))
    figure.canvas.draw()
    top, dimensional = panels[8 + 3].get_ylim()[1], right.get_ylim()[1]
    assert dimensional == pytest.approx(top * 1e-6 * pressure * radius * length / clearance)


def test_the_critical_speed_map_has_the_stiffness_of_the_bearings(case: CaseTables) -> None:
    criticals = case.single["criticals"]
    axes = draw_critical_map(case.view, criticals).axes[0]
    drawn = {tuple(line.get_xdata()) for line in axes.get_lines()}
    for bearing in (0, 1):
        for axis in (0, 1):
            assert tuple(criticals["direct_stiffness"][:, bearing, axis]) in drawn
    assert tuple(criticals["support_stiffness"]) in drawn


def test_the_polar_plot_has_amplitude_and_phase(case: CaseTables) -> None:
    response = case.single["unbalance_response"]
    axes = draw_polar(case.view, response).axes[1]
    motion = response["response"].sum(axis=1)[:, 1, 0] * case.view.scales.micrometres
    line = axes.get_lines()[0]
    np.testing.assert_allclose(line.get_ydata() * np.exp(1j * line.get_xdata()), motion, rtol=1e-12)


def test_the_machine_tells_mass_and_loads(case: CaseTables) -> None:
    from pipelines.figures.machine_drawing import draw_machine

    figure = draw_machine(case.view)
    assert "0.76 kg, centre of gravity at 180 mm" in figure.get_suptitle()
    labels = [text.get_text() for text in figure.axes[0].texts]
    assert "B1, 4 N" in labels
