"""Two very different bearings: every axis, column and circle of a bearing is measured by its own clearance,
radius and length.
"""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from matplotlib.patches import Circle

from pipelines.case.reading import NamedCase, read_cases
from pipelines.datasets.reading import read_group
from pipelines.datasets.store import open_for_reading
from pipelines.figures import style
from pipelines.figures.axes import PARAMETER_AXES, add_parameter_axis
from pipelines.figures.bifurcation_diagram import draw_bifurcation_diagram
from pipelines.figures.bifurcation_tree import draw_bifurcation_tree
from pipelines.figures.case_tables import CaseTables, read_case
from pipelines.figures.condensation import draw_condensation
from pipelines.figures.contents import Table
from pipelines.figures.linearization import draw_linearization
from pipelines.figures.machine_drawing import draw_machine
from pipelines.figures.orbits import draw_film, draw_orbits, last_stable_point, representative_points
from pipelines.figures.response_envelope import Chart, draw_envelope, draw_envelopes, draw_unbalance
from pipelines.figures.run_motion import draw_modal_energy, draw_poincare, draw_spectrum, draw_waterfall
from pipelines.figures.runs import RUN_ARRAYS, RunView
from pipelines.figures.tori import draw_section, draw_tori
from tests.figures import synthetic_store
from tests.helpers.tiny import CONFIG, TINY, Watched

CLEARANCE = np.array([20e-6, 50e-6])
RADIUS, LENGTH = np.array([0.014, 0.022]), np.array([0.016, 0.009])
RATIO = CLEARANCE / CLEARANCE[0]
PRESSURE = 1e5
TIME = 5e-4
SCALES = {
    "rpm": 30.0 / (np.pi * TIME),
    "hertz": 1.0 / (2.0 * np.pi * TIME),
    "micrometres": 20.0,
    "stiffness": 1e-9 * PRESSURE / CLEARANCE[0],
}


@pytest.fixture(scope="module")
def different(view):
    """The synthetic case with another second bearing."""
    arrays = view.machine.arrays | {
        "bearing_clearance": CLEARANCE, "bearing_radius": RADIUS, "bearing_length": LENGTH
    }  # fmt: skip
    scales = replace(view.scales, **SCALES, bearings_differ=True)
    return replace(view, machine=Table(arrays, view.machine.attributes), scales=scales)


@pytest.fixture(scope="module")
def tori(synthetic):
    return Table(synthetic.tori(), {"parameter": "speed", "origin": {"group": "cycles/b000", "event": 2}})


@pytest.fixture(scope="module")
def runs(tmp_path_factory):
    store = synthetic_store.make_store(tmp_path_factory.mktemp("runs") / "s", 3, parts=("machine", "runs"))
    found = []
    for name in ("t000", "t001", "t002"):
        groups = (f"cases/kb10/transient_analysis/{name}", None), (f"cases/kb10/transient/{name}", RUN_ARRAYS)
        read = [read_group(store, group, names) for group, names in groups]
        found.append(RunView(name, *(Table(each.labelled(), each.attributes) for each in read)))
    return found


def twins(axes, word=""):
    """Factor of every second y axis whose label holds the word, by label."""
    return {
        twin.get_ylabel(): twin.get_ylim()[1] / axes.get_ylim()[1]
        for twin in axes.child_axes
        if twin.get_ylabel() and word in twin.get_ylabel()
    }


def of_bearing(axes, bearing):
    """The lines drawn in the look of a bearing."""
    colour = style.bearing_look(bearing)["color"]
    return [line.get_xydata() for line in axes.get_lines() if line.get_color() == colour]


def values(lines):
    return np.unique(np.concatenate([line[:, 1] for line in lines]))


def circles(axes):
    return [patch.get_radius() for patch in axes.patches if isinstance(patch, Circle)]


def both(label=""):
    return {f"{label}, bearing {n + 1} [µm]".removeprefix(", "): 1e6 * c for n, c in enumerate(CLEARANCE)}


def test_the_linearization(different, linear):
    figure = draw_linearization(different, linear)
    _, _, locus, film, *coefficients = figure.axes[:8]
    assert circles(locus) == [1.0]
    for bearing in range(2):
        np.testing.assert_array_equal(of_bearing(locus, bearing)[0], linear["journal"][:, bearing])
        np.testing.assert_array_equal(of_bearing(film, bearing)[0][:, 1], linear["minimum_film"][:, bearing])
        force = PRESSURE * RADIUS[bearing] * LENGTH[bearing] / CLEARANCE[bearing]
        stiffness, damping = coefficients[2 * bearing : 2 * bearing + 2]
        assert twins(stiffness) == pytest.approx({"[MN/m]": 1e-6 * force})
        assert twins(damping) == pytest.approx({"[kN s/m]": 1e-3 * force * TIME})
        assert {f"bearing {bearing + 1}"} == {axes.get_title()[-9:] for axes in (stiffness, damping)}
        expected = linear["bearing_stiffness"][:, 0, bearing, 1, 1]
        assert any(np.array_equal(line.get_ydata(), expected) for line in stiffness.get_lines())
    assert twins(film) == pytest.approx(both())


def test_orbits_and_film(different, branch):
    orbits, film = (
        draw_orbits(different, "speed", branch, "b000"),
        draw_film(different, "speed", branch, "b000"),
    )
    point, snapshots = last_stable_point(branch), (0, 2, 4, 6)
    for bearing in range(2):
        columns = list(different.journal_coordinates(bearing))
        whole, close, trace = orbits.axes[3 * bearing : 3 * bearing + 3]
        assert circles(whole) == [1.0]
        expected = branch["orbit"][representative_points(branch)[1]][:, columns] / RATIO[bearing]
        for axes in (whole, close):
            assert any(np.allclose(line.get_xydata()[:-1], expected) for line in axes.get_lines()
                       if len(line.get_xdata()) == len(expected) + 1)  # fmt: skip
        assert twins(trace) == pytest.approx({"[µm]": 1e6 * CLEARANCE[bearing]})
        _, foil, thickness = (film.axes[2 * row + bearing] for row in range(3))
        assert twins(foil) == pytest.approx({"foil [µm]": 1e6 * CLEARANCE[bearing]})
        assert twins(thickness) == pytest.approx({"film thickness [µm]": 1e6 * CLEARANCE[bearing]})
        drawn = [line.get_ydata() for line in thickness.get_lines()]
        for snapshot, line in zip(snapshots, drawn, strict=True):
            np.testing.assert_array_equal(line, branch["film_thickness"][point, snapshot, bearing])


def test_the_bifurcation_diagram_and_the_tree(different, branch):
    for axes, word in zip(
        draw_bifurcation_diagram(different, "speed", [branch]).axes,
        ("vertical", "horizontal", "eccentricity"), strict=True,
    ):  # fmt: skip
        assert twins(axes) == pytest.approx(both(word))
        for bearing in range(2):
            x, y = (branch["orbit"][..., c] / RATIO[bearing] for c in different.journal_coordinates(bearing))
            quantity = {"vertical": y, "horizontal": x, "eccentricity": np.hypot(x, y)}[word]
            assert np.isin(quantity.max(axis=1), values(of_bearing(axes, bearing))).all()
    tree = draw_bifurcation_tree(different, "speed", {"b000": branch}).axes[0]
    assert twins(tree) == pytest.approx({"[µm]": 1e6 * CLEARANCE[0]})
    column = different.journal_coordinates(0)[1]
    drawn = np.concatenate([line.get_ydata() for line in tree.get_lines()])
    assert np.isin(branch["orbit"][:, 0, column], drawn).all()


def test_tori_with_their_cycles_and_sections(different, branch, tori):
    figure = draw_tori(different, "speed", [tori], [branch])
    for axes, axis in zip(figure.axes[:2], (1, 0), strict=True):
        assert twins(axes) == pytest.approx(both())
        for bearing in range(2):
            column = different.journal_coordinates(bearing)[axis]
            for extreme in ("orbit_minimum", "orbit_maximum"):
                expected = tori[extreme][:, column] / RATIO[bearing]
                assert np.isin(expected, values(of_bearing(axes, bearing))).all()
                cycles = values(
                    [line.get_xydata() for line in axes.get_lines() if line.get_color() == style.GREY]
                )
                assert np.isin(branch[extreme][:, column] / RATIO[bearing], cycles).all()
    section = draw_section(different, "speed", tori, "q000")
    for bearing, axes in enumerate(section.axes[:2]):
        columns = list(different.journal_coordinates(bearing))
        np.testing.assert_allclose(
            axes.get_lines()[-1].get_xydata()[:-1], tori["section_curve"][-1][:, columns] / RATIO[bearing]
        )


def test_envelopes_of_runs_over_cycles(different, branch, runs):
    same = {"excitation_frequency": 0.7, "displacement": 0.2, "foil_stiffness": 10.0}
    moving = Table(
        branch.arrays | {n: np.full(len(branch["speed"]), v) for n, v in same.items()}, branch.attributes
    )
    run = runs[0]
    figures = (
        draw_envelope(different, run, [moving]).axes[:2],
        draw_unbalance(different, runs[:2]).axes[:2],
        draw_envelopes([Chart("one", different, run, [moving])] * 2, "").axes[:1],
    )
    for number, panels in enumerate(figures):
        for bearing, axes in enumerate(panels):
            assert twins(axes) == pytest.approx({"vertical [µm]": 1e6 * CLEARANCE[bearing]})
            lines = [line.get_xydata() for line in axes.get_lines()]
            high = run.analysis["envelope_high"][
                :, bearing, 1
            ]  # over the bearing's own clearance in the store
            assert np.isin(high, values(lines)).all()
            if number != 1:
                column = different.journal_coordinates(bearing)[1]
                assert np.isin(moving["orbit_maximum"][:, column] / RATIO[bearing], values(lines)).all()


def test_spectra_waterfalls_sections_and_energies_of_runs(different, runs):
    run = runs[2]
    for bearing, axes in enumerate(draw_spectrum(different, run).axes[:2]):
        assert twins(axes) == pytest.approx({"amplitude [µm]": 1e6 * CLEARANCE[bearing]})
        np.testing.assert_array_equal(
            axes.get_lines()[1].get_ydata(), run.analysis["spectrum"][:, bearing, 1]
        )
    for bearing, axes in enumerate(draw_waterfall(different, run).axes[:2]):
        (mesh,) = axes.collections
        largest = run.analysis["waterfall"][:, :, bearing, 1].max()
        assert mesh.get_array().max() == largest
    for number, axes in enumerate(draw_poincare(different, run).axes[:4]):
        drawn = axes.get_lines()[-1].get_xydata()
        points = run.analysis[("ring", "rotation")[number // 2] + "_section_journal"][:, number % 2]
        np.testing.assert_array_equal(drawn, points[-len(drawn) :])
    title = draw_modal_energy(different, run).axes[0].get_title()
    assert "bearing 1" in title


def test_axes_that_belong_to_the_first_bearing_say_so(different, criticals):
    axes = style.new_figure(2.0).subplots()
    for parameter, factor in (("displacement", 20.0), ("foil_stiffness", 5.0)):
        found, label = PARAMETER_AXES[parameter].dimensional(different.scales)
        assert "bearing 1" in label
        assert found == pytest.approx(factor)
    add_parameter_axis(axes, "displacement", different.scales)
    response = draw_condensation(different, criticals).axes[-1]
    assert twins(response) == pytest.approx({"unbalance response [µm]": 20.0})


SMALL = {"radius": 0.014, "length": 0.0161, "clearance": 20.4e-6, "stiffness": 10.0}
LARGE = {"radius": 0.017, "length": 0.012, "clearance": 31e-6, "stiffness": 4.0}
RPM = 20000.0


def machine_of(*bearings: dict[str, float]) -> NamedCase:
    """The symmetric rotor of the smoke configuration at a speed in rpm; everything asked for in SI units."""
    keys = []
    for place, bearing in enumerate(bearings):
        own = {name: value for name, value in bearing.items() if name != "stiffness"}
        keys += [f"bearings.{place}.{name}={value!r}" for name, value in own.items()]
        keys.append(f"bearings.{place}.foil={{stiffness={bearing['stiffness']}, loss_factor=0.3}}")
    keys += ["excitation={displacement=0.04, frequency_hz=150.0}", f"operation={{speed_rpm={RPM}}}"]
    document = CONFIG.read_text()
    named, *_ = read_cases(document, CONFIG.name, (*TINY, *keys), stages=())
    scales = named.case.scales
    speed = scales.speed_from_rpm(RPM)
    second = 1.0 / scales.time
    keys += [
        f"linearize.speed_range=[{0.9 * speed!r}, {speed!r}]",
        "linearize.points=2",
        f"continue_cycles.start={speed!r}",
        f"continue_cycles.range=[{speed!r}, {1.1 * speed!r}]",
        "continue_cycles.max_points=1",
        "numerics.multiplier_tolerance=1e-6",
        f"transient.duration={0.24 * second!r}",
        "transient.steps_per_period=64",
    ]
    named, *_ = read_cases(document, CONFIG.name, (*TINY, *keys), stages=())
    return named


@pytest.fixture(scope="module")
def exchanged(tmp_path_factory) -> tuple[CaseTables, CaseTables]:
    """Two bearings on a symmetric rotor, and the same machine turned end for end."""
    folder, found = tmp_path_factory.mktemp("exchanged"), []
    for name, bearings in (("one", (SMALL, LARGE)), ("other", (LARGE, SMALL))):
        store: Path = folder / f"{name}.zarr"
        case = machine_of(*bearings)
        for stage in ("linearize", "continue_cycles", "transient"):
            result = Watched(stage, case, store).result
            assert result.ok, (stage, result)
        kinds = ("linear", "cycles", "transient", "transient_analysis")
        tables = read_case(open_for_reading(store), case.case_id, kinds, print, [])
        assert tables is not None
        found.append(tables)
    return found[0], found[1]


def in_units(axes):
    """The values of every line over a bearing, in the unit of the second axis."""
    ((label, factor),) = twins(axes).items()
    return label, [np.asarray(line.get_ydata()) * factor for line in axes.get_lines()]


def assert_alike(axes, other, tolerance):
    (label, mine), (other_label, yours) = in_units(axes), in_units(other)
    assert label == other_label
    assert len(mine) == len(yours) > 0
    for first, second in zip(mine, yours, strict=True):
        np.testing.assert_allclose(first, second, rtol=0.0, atol=tolerance * np.abs(first).max())


@pytest.mark.slow
def test_turned_end_for_end_a_machine_has_the_same_numbers_in_units(exchanged):
    """All scales are those of the first bearing, which is another one then."""
    linear = [draw_linearization(each.view, each.single["linear"]).axes for each in exchanged]
    branches = [each.of_kind("cycles")["b000"] for each in exchanged]
    orbits = [draw_orbits(e.view, "speed", b, "b000").axes for e, b in zip(exchanged, branches, strict=True)]
    films = [draw_film(e.view, "speed", b, "b000").axes for e, b in zip(exchanged, branches, strict=True)]
    spectra = [draw_spectrum(each.view, each.runs[0]).axes for each in exchanged]
    envelopes = [draw_envelope(each.view, each.runs[0], []).axes for each in exchanged]
    for bearing in range(2):
        there = 1 - bearing
        for kind in range(2):  # stiffness, damping
            assert_alike(linear[0][4 + 2 * bearing + kind], linear[1][4 + 2 * there + kind], 1e-7)
        locus = [of_bearing(axes[2], place)[0] for axes, place in zip(linear, (bearing, there), strict=True)]
        np.testing.assert_allclose(*locus, rtol=0.0, atol=1e-8)
        micrometres = [
            of_bearing(axes[3], place)[0][:, 1]
            * twins(axes[3], f"bearing {place + 1}")[f"bearing {place + 1} [µm]"]
            for axes, place in zip(linear, (bearing, there), strict=True)
        ]
        np.testing.assert_allclose(*micrometres, rtol=1e-8)
        assert_alike(orbits[0][3 * bearing + 2], orbits[1][3 * there + 2], 1e-5)
        whole = [axes[3 * place].get_lines()[-1].get_xydata()
                 for axes, place in zip(orbits, (bearing, there), strict=True)]  # fmt: skip
        np.testing.assert_allclose(*whole, rtol=0.0, atol=1e-5)
        for row in (1, 2):  # foil, film thickness
            assert_alike(films[0][2 * row + bearing], films[1][2 * row + there], 1e-5)
        assert_alike(spectra[0][bearing], spectra[1][there], 1e-4)
        assert_alike(envelopes[0][bearing], envelopes[1][there], 1e-4)
    for axes in zip(*linear, strict=True):
        labels = [
            {t.get_xlabel(): t.get_xlim()[1] for t in each.child_axes if t.get_xlabel()} for each in axes
        ]
        assert labels[0] == pytest.approx(labels[1])


def test_the_film_is_what_journal_and_foil_leave_of_the_own_clearance(exchanged):
    """h = c - x cos(theta) - y sin(theta) + q in µm, each read off its own figure."""
    case = exchanged[0]
    branch = case.of_kind("cycles")["b000"]
    orbits, films = (draw(case.view, "speed", branch, "b000").axes for draw in (draw_orbits, draw_film))
    for bearing, clearance in enumerate((20.4, 31.0)):
        orbit = orbits[3 * bearing].get_lines()[-1].get_xydata() * clearance
        _, foil = in_units(films[2 + bearing])
        _, film = in_units(films[4 + bearing])
        theta = np.radians(films[4 + bearing].get_lines()[0].get_xdata())
        for number, (q, h) in enumerate(zip(foil[1:], film, strict=True)):  # behind the line at zero
            x, y = orbit[number * (len(orbit) // 4)]
            expected = clearance - x * np.cos(theta) - y * np.sin(theta) + q
            np.testing.assert_allclose(h, expected, rtol=0.0, atol=1e-9 * clearance)


def test_the_machine_is_drawn_with_each_bearing_of_its_own_size(different):
    axes = draw_machine(different).axes[0]
    for bearing in range(2):
        width, radius = 1e3 * LENGTH[bearing], 1e3 * RADIUS[bearing]
        boxes = [p.get_bbox() for p in axes.patches if hasattr(p, "get_width") and p.get_hatch()]
        assert any(box.width == pytest.approx(width) and box.y0 == pytest.approx(radius) for box in boxes)
