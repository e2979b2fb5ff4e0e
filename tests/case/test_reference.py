"""The generated reference covers every key, and the schema is one."""

from __future__ import annotations

import json

from pipelines.case.fields import extra_of, keys_of
from pipelines.case.models import Case
from pipelines.case.reference import json_schema, reference_markdown


def test_every_key_is_described_and_stands_in_the_reference():
    markdown = reference_markdown()
    for path, field in keys_of(Case):
        assert field.description, path
        assert f"| `{path.rsplit('.', 1)[-1]}` |" in markdown, path


def test_every_number_states_its_unit():
    """Numbers that count something (whole numbers) have none; "1" means dimensionless."""
    for path, field in keys_of(Case):
        if "float" in str(field.annotation) or "Number" in str(field.annotation):
            assert extra_of(field, "unit"), path


def test_rows_state_unit_default_and_bounds():
    markdown = reference_markdown()
    assert (
        "| `clearance` | number | radial clearance c | m |  | >= 1e-07: thinner is no gas film |"
    ) in markdown
    assert (
        "| `gravity` | number | acceleration of gravity, along -y | m/s2 | `9.81` | >= 0 and <= 1000: "
        in markdown
    )
    assert '`"gumbel"` | `gumbel`, `smooth`, `full` |' in markdown
    assert "## `[[rotor.elements]]`" in markdown
    assert "## `[rotor.materials.NAME]`" in markdown
    assert "## `[bearings.foil.bump]`" in markdown
    table_rows = [line for line in markdown.splitlines() if line.startswith("| `")]
    assert {line.replace("\\|", "").count("|") for line in table_rows} == {7}


def test_the_schema_is_json_and_names_bounds():
    schema = json.loads(json.dumps(json_schema(), allow_nan=False))
    assert schema["$defs"]["Bearing"]["properties"]["clearance"]["minimum"] == 1e-7
    assert schema["$defs"]["Bearing"]["properties"]["clearance"]["unit"] == "m"
    assert schema["additionalProperties"] is False
    assert "sweep" in schema["properties"]
