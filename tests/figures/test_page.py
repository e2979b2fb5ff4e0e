"""The report of a store as one page: its structure, its data, and what a click shows in a browser."""

from __future__ import annotations

import json
import re
import shutil
import subprocess
from base64 import b64decode
from html.parser import HTMLParser
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from matplotlib.figure import Figure

from pipelines.datasets.branch import write_group
from pipelines.datasets.failures import Failure, record_failure
from pipelines.datasets.reading import describe_case, list_cases, read_group
from pipelines.datasets.store import Store, create_store, open_for_reading
from pipelines.figures.case_tables import read_case
from pipelines.figures.page.case_section import Conclusions, ToldTable
from pipelines.figures.page.elements import embedded
from pipelines.figures.page.report_page import report_page
from pipelines.figures.page.stability_plane import POINTS_PER_INCH, axes_frame, draw_cycle_plane, placed
from pipelines.figures.page.stored_cycles import MULTIPLIERS, SAMPLES, StoredCycles, stored_cycles
from pipelines.figures.page.warnings import ADDED_BY, warnings
from pipelines.figures.stability_map import draw_stability_map, planes_of
from tests.figures.synthetic_store import SCALES, cycles, linear, machine, make_store, write_branch
from tests.helpers.curves import curve_rows, oval, write_curve
from tests.helpers.surveys import write_survey

VOID = {"meta", "img", "br", "hr", "input", "link"}
BROWSERS = ("chromium", "chromium-browser", "google-chrome", "chromium-headless-shell")
PLANE = ("excitation_frequency", "speed")


class Outline(HTMLParser):
    """Elements of a page with their attributes; raises AssertionError where they are not nested."""

    def __init__(self, page: str) -> None:
        super().__init__()
        self.open: list[str] = []
        self.elements: list[tuple[str, dict[str, str | None]]] = []
        self.texts: list[tuple[str, str]] = []
        self.feed(page)
        self.close()
        assert self.open == []

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.elements.append((tag, dict(attrs)))
        if tag not in VOID:
            self.open.append(tag)

    def handle_startendtag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        raise AssertionError(f"<{tag}/> is not HTML")

    def handle_endtag(self, tag: str) -> None:
        assert self.open.pop() == tag

    def handle_data(self, data: str) -> None:
        if self.open:
            self.texts.append((self.open[-1], data))

    def attribute(self, name: str) -> list[str]:
        return [found for _, attributes in self.elements if (found := attributes.get(name)) is not None]

    def text_of(self, tag: str) -> list[str]:
        return [text for inside, text in self.texts if inside == tag]

    def data(self) -> list[Any]:
        """Documents for the script, in order."""
        places = [attributes.get("type") for tag, attributes in self.elements if tag == "script"]
        return [
            json.loads(text)
            for kind, text in zip(places, self.text_of("script"), strict=True)
            if kind == "application/json"
        ]


def page_of(store: Store, told: dict[str, Conclusions] | None = None) -> str:
    opened = open_for_reading(store.path)
    return report_page(opened, list_cases(opened), told or {}, _quiet).decode()


def _quiet(message: str) -> None:
    """Tell nobody."""


@pytest.fixture(scope="module")
def whole(tmp_path_factory: pytest.TempPathFactory) -> Store:
    store = make_store(tmp_path_factory.mktemp("page") / "whole.zarr", 20)
    write_survey(store, "kb10")
    return store


@pytest.fixture(scope="module")
def page(whole: Store) -> str:
    return page_of(whole)


def test_it_is_well_formed_and_refers_to_nothing_outside(page: str) -> None:
    outline = Outline(page)
    identifiers = outline.attribute("id")
    assert len(identifiers) == len(set(identifiers)) > 1
    assert {tag for tag, _ in outline.elements} & {"link", "iframe", "object", "form", "base"} == set()
    links = outline.attribute("href")
    assert [link for link in links if not link.startswith("#")] == []
    assert {link.removeprefix("#") for link in links} <= set(identifiers)
    images = outline.attribute("src")
    assert len(images) == 7  # machine, operating point, Campbell diagram, Bode plot, map, branches, survey
    for image in images:
        drawing = b64decode(image.removeprefix("data:image/svg+xml;base64,")).decode()
        assert all(
            link.startswith(("#", "data:image/png")) for link in re.findall(r'href="([^"]*)"', drawing)
        )
        assert "<script" not in drawing
    (style,) = outline.text_of("style")
    assert not re.search(r"url\(|@import|@font-face", style)
    script = outline.text_of("script")[-1]
    assert not re.search(r"fetch|XMLHttpRequest|import\(|innerHTML|eval", script)
    assert re.findall(r"https?://[^\"]*", script) == ["http://www.w3.org/2000/svg"], "the name space of SVG"
    assert all(attributes.get("alt") for tag, attributes in outline.elements if tag == "img")
    levels = [int(tag[1]) for tag, _ in outline.elements if re.fullmatch("h[1-6]", tag)]
    assert levels[0] == 1
    assert max(np.diff(levels)) <= 1, "no level of headings is left out"


def test_equal_stores_give_equal_bytes(whole: Store, page: str) -> None:
    assert page_of(whole) == page


def test_the_cycles_in_the_page_are_those_of_the_store(whole: Store, page: str) -> None:
    (data,) = Outline(page).data()
    held = read_case(whole, "kb10", ("machine",), _quiet, [])
    assert held is not None
    branches = {name: read_group(whole, f"cases/kb10/cycles/{name}") for name in ("b000", "d000", "s000")}
    assert {cycle["branch"] for cycle in data["cycles"]} == {f"cycles/{n}" for n in (*branches, "d001")}
    assert sum(cycle["branch"] == "cycles/b000" for cycle in data["cycles"]) == 20
    for cycle in data["cycles"]:
        branch = branches.get(cycle["branch"].removeprefix("cycles/"))
        if branch is None:
            continue
        row = cycle["row"]
        assert cycle["x"] == pytest.approx(branch["excitation_frequency"][row], rel=1e-6)
        assert cycle["y"] == pytest.approx(branch["speed"][row], rel=1e-6)
        assert cycle["unstable"] == branch["unstable_count"][row]
        assert cycle["turns"] == branch.attributes.get("turns", 1)
        stored = branch["multipliers"][row][np.isfinite(branch["multipliers"][row])]
        found = np.array(cycle["multipliers"]) @ [1.0, 1.0j]
        np.testing.assert_allclose(found, stored[:MULTIPLIERS], atol=1e-5)
        np.testing.assert_allclose(cycle["film"], branch["minimum_film"][row], atol=1e-5)
        for bearing, orbit in enumerate(cycle["orbits"]):
            journal = held.view.journal(branch["orbit"][row], bearing)
            points = np.reshape(orbit, (-1, 2))
            assert len(points) == SAMPLES
            apart = np.hypot(*(points[:, None, :] - journal[None, :, :]).T).min(axis=0)
            assert apart.max() < 2e-5, "every point is a stored sample"
            np.testing.assert_allclose(points[0], journal[0], atol=1e-5)
    assert 'class="point"' not in page, "the case of this store has no parameters of its own"
    text = " ".join(Outline(page).text_of("p"))
    assert f"{len(data['cycles'])} of {len(data['cycles'])} stored cycles" in text


def test_the_number_of_cycles_is_limited_and_told(whole: Store) -> None:
    held = read_case(whole, "kb10", ("machine",), _quiet, [])
    assert held is not None
    few = stored_cycles(whole, held.view, "kb10", PLANE, 7)
    assert len(few.cycles) == 7
    assert few.total > 40
    assert few.cycles[0]["branch"] == "cycles/b000"
    assert few.cycles[-1]["branch"] == "cycles/s000", "evenly from all branches"
    assert stored_cycles(whole, held.view, "kb10", ("displacement", "foil_stiffness"), 7).total == 0


@pytest.mark.parametrize("with_curves", [True, False])
def test_the_overlay_lies_where_the_figure_draws(whole: Store, with_curves: bool) -> None:
    """The formula, which the script repeats, against matplotlib's own transform."""
    held = read_case(whole, "kb10", ("machine", "curve"), _quiet, [])
    assert held is not None
    if with_curves:
        (plane,) = planes_of(held.curves, held.single)
        figure: Figure = draw_stability_map(held.view, plane)
    else:
        found = StoredCycles([{"x": 0.3, "y": 0.5}, {"x": 0.9, "y": 1.1}], 2)
        figure = draw_cycle_plane(held.view, PLANE, found)
    frame = axes_frame(figure, figure.axes[0])
    (x0, x1), (y0, y1) = frame["x"], frame["y"]
    for x, y in ((x0, y0), (x1, y1), (0.37 * x0 + 0.63 * x1, 0.8 * y0 + 0.2 * y1)):
        pixel = figure.axes[0].transData.transform((x, y)) * POINTS_PER_INCH / figure.dpi
        u, v = placed(frame, x, y)
        assert (u, frame["size"][1] - v) == pytest.approx(tuple(pixel), abs=2e-3)


@pytest.mark.parametrize(
    ("parts", "shown", "lacking"),
    [
        ((), set(), set(ADDED_BY)),
        (("machine", "linear"), {"Machine", "Linear behaviour"}, set(ADDED_BY) - {"linear"}),
        (("machine", "criticals"), {"Machine", "Linear behaviour"}, set(ADDED_BY) - {"criticals"}),
        (
            ("machine", "cycles"),
            {"Machine", "Branches of cycles", "Stability map", "Estimated errors"},
            set(ADDED_BY) - {"cycles"},
        ),
        (("machine", "curves"), {"Machine", "Stability map", "Estimated errors"}, set(ADDED_BY) - {"curve"}),
    ],
)
def test_it_holds_what_the_store_holds_and_says_what_is_missing(
    tmp_path: Path, parts: tuple[str, ...], shown: set[str], lacking: set[str]
) -> None:
    outline = Outline(page_of(make_store(tmp_path / "a.zarr", 5, parts=parts)))
    always = {"Warnings", "Operating point and units", "Not in this store", "Configuration"}
    assert set(outline.text_of("h3")) == shown | always
    commands = {text.removesuffix(" CONFIG -o STORE") for text in outline.text_of("td") if "CONFIG" in text}
    assert commands == {ADDED_BY[kind][1] for kind in lacking}


def test_a_branch_without_points_and_a_branch_along_the_frequency(tmp_path: Path) -> None:
    store = make_store(tmp_path / "a.zarr", 0, parts=("machine", "cycles"))
    assert "Stability map" not in Outline(page_of(store)).text_of("h3")
    write_branch(store, "cases/kb10/cycles/b001", cycles(4), "range", parameter="excitation_frequency")
    (data,) = Outline(page_of(store)).data()
    assert [parameter["unit"] for parameter in data["parameters"]] == ["Hz", "rpm"]
    assert len(data["cycles"]) == 4


def test_a_machine_without_excitation_has_a_map_of_its_other_parameters(tmp_path: Path) -> None:
    """And an operating point beside the map is not drawn."""
    own = {"parameters": {"speed": 0.5, "foil_stiffness": 70.0, "excitation_frequency": None}}
    case = {"name": "a", "reconstruction": "", "scales": SCALES, **own}
    provenance = {"configuration": {}, "configuration_hash": "0"}
    store = create_store(tmp_path / "a.zarr", {"a": case}, provenance, durable=False)
    write_group(store, "cases/a/machine", "machine", machine(), {"material_names": ["steel"]})
    rows, _ = cycles(4)
    absent = {name: np.full(4, np.nan) for name in ("excitation_frequency", "displacement")}
    write_branch(store, "cases/a/cycles/b000", (rows | absent, []), "range")
    page = page_of(store)
    (data,) = Outline(page).data()
    assert [parameter["title"] for parameter in data["parameters"]] == ["foil stiffness", "rotating speed"]
    assert [cycle["x"] for cycle in data["cycles"]] == [10.0] * 4
    assert data["operating_point"] is None
    assert "The operating point lies outside this map." in page


def test_texts_of_the_user_stay_texts(tmp_path: Path) -> None:
    hostile = "</script></pre><img src=x onerror=alert(1)>&amp;\u2028 $title"
    attributes = {"name": hostile, "parameters": {}, "scales": SCALES, "reconstruction": hostile}
    provenance = {"configuration": {"a": {"name": hostile}}, "configuration_hash": "0", "argv": [hostile]}
    store = create_store(tmp_path / "a.zarr", {"a": attributes}, provenance, durable=False)
    write_group(store, "cases/a/machine", "machine", machine(), {"material_names": ["steel", hostile]})
    record_failure(store, Failure("a", "linearize", hostile, hostile))
    told = Conclusions(
        (hostile,), (ToldTable(hostile, [hostile], [(hostile,)]),), (hostile,), ((hostile, "1"),)
    )
    page = page_of(store, {"a": told})
    outline = Outline(page)
    assert all(source.startswith("data:") for source in outline.attribute("src"))
    assert not [attributes for _, attributes in outline.elements if "onerror" in attributes]
    assert len(outline.text_of("script")) == 1
    assert page.count("<img src=x") == 0
    assert hostile in outline.text_of("h2")
    assert json.loads(outline.text_of("pre")[0])["name"] == hostile


def test_data_cannot_end_their_element() -> None:
    hostile = {"branch": "</script><!--<script>\u2028&"}
    text = embedded(hostile)
    assert text.count("<") == 2
    assert Outline(text).data() == [hostile]


def test_several_cases_have_contents_an_overview_and_their_own_identifiers(tmp_path: Path) -> None:
    names = ("a=1", "a=2")
    own = {"parameters": {"speed": 0.5, "excitation_frequency": 0.7}, "scales": SCALES}
    cases = {name: {"name": name, "reconstruction": "", **own} for name in names}
    provenance = {"configuration": {n: {"a": float(n[-1])} for n in names}, "configuration_hash": "0"}
    store = create_store(tmp_path / "a.zarr", cases, provenance, durable=False)
    for name in names:
        write_group(store, f"cases/{name}/machine", "machine", machine(), {"material_names": ["steel"]})
        write_branch(store, f"cases/{name}/cycles/b000", cycles(4), "range")
    outline = Outline(page_of(store))
    identifiers = outline.attribute("id")
    assert len(identifiers) == len(set(identifiers))
    assert set(outline.attribute("href")) == {"#case-1", "#case-2"} <= {f"#{name}" for name in identifiers}
    assert outline.text_of("h2")[0] == "All cases"
    assert outline.attribute("class").count("point") == 2, "both operating points"
    assert len(outline.data()) == 2


def warnings_of(store: Store) -> list[str]:
    opened = open_for_reading(store.path)
    return warnings(opened, "kb10", describe_case(opened, "kb10"))


def test_warnings_name_reason_and_advice_and_groups_alike_once(tmp_path: Path) -> None:
    store = make_store(tmp_path / "a.zarr", 5, parts=("machine", "curves"))
    record_failure(store, Failure("kb10", "bifurcation_set", "maximum rounds", "raise max_rounds"))
    rows = curve_rows(oval(0.4, 0.4, 0.05, 0.05), (0.0, 3.0), 5)
    write_curve(store, "cases/kb10/pd/c002", "period_doubling", rows, "minimum_step")
    found = warnings_of(store)
    assert "bifurcation-set failed: maximum rounds; raise max_rounds" in found
    assert "folds/c001, ns/c002, pd/c002: ended (minimum step)" in found
    assert not [warning for warning in found if "pd/c000" in warning], "it closed"
    write_branch(store, "cases/kb10/cycles/b000", cycles(3))
    assert [each for each in warnings_of(store) if "cycles/b000: not complete" in each]


@pytest.mark.parametrize(
    ("attributes", "told"),
    [
        ({"instability_speed": 0.9}, "loses its stability at the speed 0.9000"),
        ({"instability_speed": 0.9, "unstable_from_start": True}, "unstable at the lowest speed too"),
        ({"unstable_from_start": True}, "unstable from the lowest speed on"),
        ({"instability_between": [0.4, 0.5]}, "between the speeds 0.4 and 0.5, where some speeds have no"),
        ({}, "nowhere between the speeds 0.2 and 0.8"),
    ],
)
def test_the_page_says_what_is_known_of_the_instability(
    tmp_path: Path, attributes: dict[str, Any], told: str
) -> None:
    """A speed without equilibrium at the end does not count as stable."""
    store = make_store(tmp_path / "a.zarr", parts=("machine",))
    arrays = linear(4)
    arrays["speed"] = np.array([0.2, 0.5, 0.8, 1.1])
    arrays["minimum_film"][-1] = np.nan
    write_group(store, "cases/kb10/linear", "linear", arrays, attributes)
    assert told in " ".join(Outline(page_of(store)).text_of("p"))


def test_the_modes_of_the_page_are_those_of_the_stored_operating_point(tmp_path: Path) -> None:
    store = make_store(tmp_path / "a.zarr", parts=("machine", "operating_point"))
    point = read_group(store, "cases/kb10/operating_point")
    cells = Outline(page_of(store)).text_of("td")
    for value in (*point["frequency_hertz"], *point["logarithmic_decrement"]):
        assert f"{value:.5g}" in cells


# in a browser


@pytest.fixture(scope="module")
def browser() -> str:
    found = next((path for name in BROWSERS if (path := shutil.which(name))), None)
    if found is None:
        pytest.skip("no browser on the path")
    return found


def rendered(browser: str, address: str, *options: str) -> str:
    """The document of a page after its scripts have run."""
    command = [browser, "--headless", "--disable-gpu", "--no-sandbox", *options, "--dump-dom", address]
    return subprocess.run(command, capture_output=True, text=True, timeout=120, check=True).stdout


def shown_cycle(document: str) -> str:
    found = re.search(r'<div class="cycle" role="status">.*?<h4>(.*?)</h4>', document, re.DOTALL)
    return found[1] if found else ""


def nearest_cycle(data: dict[str, Any], x: float, y: float) -> str:
    """The cycle nearest on the drawing, whose axes stretch both parameters."""
    (_, _, width, height), across, up = (data["frame"][name] for name in ("axes", "x", "y"))
    distance = [
        np.hypot((cycle["x"] - x) * width / np.ptp(across), (cycle["y"] - y) * height / np.ptp(up))
        for cycle in data["cycles"]
    ]
    nearest = data["cycles"][int(np.argmin(distance))]
    return f"Cycle {nearest['row']} of {nearest['branch']}"


@pytest.fixture
def page_file(tmp_path: Path, page: str) -> Path:
    path = tmp_path / "report.html"
    path.write_text(page, encoding="utf-8")
    return path


@pytest.mark.slow
def test_an_address_shows_the_nearest_cycle(browser: str, page_file: Path, page: str) -> None:
    (data,) = Outline(page).data()
    for x, y in ((0.6, 0.41), (1.5, 1.12)):
        document = rendered(browser, f"{page_file.as_uri()}#cycle=map-1-1,{x},{y}")
        assert shown_cycle(document) == nearest_cycle(data, x, y)
    assert document.count('class="orbit"') == 4, "both journals, in their clearance and enlarged"
    assert len(re.findall('class="(inside|outside)"', document)) == len(data["cycles"][0]["multipliers"])
    assert shown_cycle(rendered(browser, f"{page_file.as_uri()}#cycle=map-7-1,0.6,0.4")) == ""


@pytest.mark.slow
def test_at_first_the_cycle_nearest_to_the_operating_point_is_shown(browser: str, tmp_path: Path) -> None:
    own = {"parameters": {"speed": 0.81, "excitation_frequency": 0.7}, "scales": SCALES}
    case = {"name": "a", "reconstruction": "", **own}
    provenance = {"configuration": {}, "configuration_hash": "0"}
    store = create_store(tmp_path / "a.zarr", {"a": case}, provenance, durable=False)
    write_group(store, "cases/a/machine", "machine", machine(), {"material_names": ["steel"]})
    write_branch(store, "cases/a/cycles/b000", cycles(11), "range")  # speeds 0.3, 0.4, ..., 1.3
    (tmp_path / "a.html").write_text(page_of(store), encoding="utf-8")
    assert shown_cycle(rendered(browser, (tmp_path / "a.html").as_uri())) == "Cycle 5 of cycles/b000"


CLICK = """
<script>
const chart = document.querySelector(".map svg"), box = chart.getBoundingClientRect();
const size = chart.viewBox.baseVal;
const clientX = box.left + U * box.width / size.width, clientY = box.top + V * box.height / size.height;
chart.parentElement.dispatchEvent(new MouseEvent("click", { clientX, clientY, bubbles: true }));
for (let count = 0; count < KEYS; count += 1) {
  chart.parentElement.dispatchEvent(new KeyboardEvent("keydown", { key: "ArrowUp", bubbles: true }));
}
</script></body>"""


@pytest.mark.slow
@pytest.mark.parametrize(("window", "keys"), [("1200,900", 0), ("360,640", 0), ("1200,900", 12)])
def test_a_click_and_the_arrow_keys_show_the_nearest_cycle(
    browser: str, page_file: Path, page: str, window: str, keys: int
) -> None:
    (data,) = Outline(page).data()
    (y0, y1), (x, y) = data["frame"]["y"], (0.62, 0.45)
    u, v = placed(data["frame"], x, y)
    click = CLICK.replace("U *", f"{u} *").replace("V *", f"{v} *").replace("KEYS", str(keys))
    page_file.write_text(page.replace("</body>", click), encoding="utf-8")
    document = rendered(browser, page_file.as_uri(), f"--window-size={window}")
    assert shown_cycle(document) == nearest_cycle(data, x, y + keys * 0.02 * (y1 - y0))
    if keys:
        assert nearest_cycle(data, x, y) != shown_cycle(document), "the keys have moved the place"


@pytest.mark.slow
def test_no_page_is_wider_than_a_phone(browser: str, page_file: Path, page: str) -> None:
    measure = (
        "<script>document.title = `${document.documentElement.scrollWidth} ${innerWidth}`</script></body>"
    )
    page_file.write_text(page.replace("</body>", measure), encoding="utf-8")
    document = rendered(browser, page_file.as_uri(), "--window-size=500,800")
    found = re.search(r"<title>(\d+) (\d+)</title>", document)
    assert found is not None
    assert int(found[1]) <= int(found[2])
