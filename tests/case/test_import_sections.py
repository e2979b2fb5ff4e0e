"""CSV tables of shaft sections: columns, units, division into elements, and every mistake with its line."""

from __future__ import annotations

import pytest

from pipelines.case.imports.draft import draft_text
from pipelines.case.imports.sections import read_sections
from pipelines.case.reading import CaseError, read_cases

TABLE = """\
# a drawing in millimetres
length [mm],outer diameter [mm],outer_diameter_right [mm],inner_diameter (mm),material,count

40,20,,,Ti-6Al-4V,2
90,30,,10,steel,
25,30,15,10,Steel,
60,15,,,,
"""


def elements(text: str) -> list[tuple[object, ...]]:
    return [
        (
            part.table.count,
            round(part.table.length * part.table.count, 12),
            part.table.outer_diameter,
            part.table.inner_diameter,
            part.table.right_diameters,
            part.table.material,
        )
        for part in read_sections(text, "shaft.csv").elements
    ]


def test_sections_in_millimetres():
    assert elements(TABLE) == [
        (2, 0.04, 0.02, 0.0, (0.02, 0.0), "Ti-6Al-4V"),
        (3, 0.09, 0.03, 0.01, (0.03, 0.01), "steel"),
        (1, 0.025, 0.03, 0.01, (0.015, 0.01), "steel"),
        (4, 0.06, 0.015, 0.0, (0.015, 0.0), "steel"),
    ]


@pytest.mark.parametrize(
    "text",
    [
        "length,outer_diameter\n0.1,0.02\n",
        "length;outer_diameter\n0,1;0,02\n",
        "length\touter_diameter\n0.1\t0.02\n",
        "Outer Diameter [cm], Length [mm]\n2, 100\n",
        "length [in],outer_diameter_left [mm]\r\n3.937007874015748,20\r\n",
    ],
)
def test_separators_and_units(text):
    assert elements(text) == [(5, 0.1, 0.02, 0.0, (0.02, 0.0), "steel")]


def test_a_slender_shaft_has_no_more_elements_than_it_needs():
    (element,) = read_sections("length,outer_diameter\n1.0,0.001\n", "shaft.csv").elements
    assert element.table.count == 200


def test_materials_and_nodes_are_to_be_filled_in():
    rotor = read_sections(TABLE, "shaft.csv")
    text = draft_text(rotor, "mine")
    with pytest.raises(CaseError) as caught:
        read_cases(text, "mine.toml")
    material = "rotor.materials.Ti-6Al-4V"
    keys = ["node", "radius", "length", "clearance", "foil.rigid", "foil.loss_factor"]
    assert sorted(problem.key for problem in caught.value.problems) == sorted(
        [
            *(f"{material}.{key}" for key in ("young_modulus", "density", "shear_modulus")),
            *(f"bearings.0.{key}" for key in keys),
            "bearings.1.node",
            "operation.speed_rpm",
        ]
    )


@pytest.mark.parametrize(
    ("line", "replacement", "key", "message"),
    [
        (2, "length,outer_diameter,colour", "colour", "unknown column; allowed are length, outer_diameter"),
        (2, "length,outer_diameter,length", "length", "this column is there twice"),
        (2, "length [ft],outer_diameter", "length [ft]", "unknown unit; allowed here: m, cm, mm, in"),
        (2, "length,outer_diameter,count [mm]", "count [mm]", "unknown unit; allowed here: none"),
        (2, "length,inner_diameter", "outer_diameter", "this column is needed"),
        (4, "40,20,,,steel,2,3", "", "has 7 cells, but the header has 6"),
        (4, "40,x,,,steel,2", "outer_diameter", "must be a finite number"),
        (4, "40,nan,,,steel,2", "outer_diameter", "must be a finite number"),
        (4, "40,20,,,steel,2.5", "count", "must be a whole number"),
        (4, "40,20,,,steel,0", "section: count", "must be >= 1"),
        (4, ",20,,,steel,2", "section: length", "is missing"),
        (5, "90,,,10,steel,", "section: outer_diameter", "is missing"),
        (5, "90,30,,30,steel,", "section: inner_diameter", "the wall has no thickness otherwise"),
        (
            6,
            "25,30,9,10,Steel,",
            "section: inner_diameter_right",
            "smaller than outer_diameter_right = 0.009",
        ),
    ],
)
def test_mistakes_are_told_with_their_line(line, replacement, key, message):
    lines = TABLE.splitlines()
    lines[line - 1] = replacement
    with pytest.raises(CaseError) as caught:
        read_sections("\n".join(lines), "shaft.csv")
    found = caught.value.problems
    assert [(problem.file, problem.line) for problem in found] == [("shaft.csv", line)]
    assert found[0].key == key
    assert message in found[0].message


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("", "holds no table"),
        ("# nothing\n\n", "holds no table"),
        ("length,outer_diameter\n", "has a header, but no section"),
        ("length,outer_diameter\n40,20\n", "are lengths in m"),  # millimetres without saying so
    ],
)
def test_tables_that_hold_no_shaft(text, message):
    with pytest.raises(CaseError) as caught:
        read_sections(text, "shaft.csv")
    assert message in caught.value.problems[0].message
