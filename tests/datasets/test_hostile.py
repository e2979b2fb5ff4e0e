"""Stores made to do harm: every command refuses them with a store's error, before memory is asked for."""

from __future__ import annotations

import json
import os
import shutil
import tracemalloc
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
from typer.testing import CliRunner

from agfb_cli.errors import ExitCode
from agfb_cli.main import app
from pipelines.datasets.errors import StoreError
from pipelines.datasets.integrity import verify
from pipelines.datasets.metadata import encode_group
from pipelines.datasets.reading import case_attributes, list_cases, list_groups, read_group
from pipelines.datasets.schema import SCHEMA_VERSION
from pipelines.datasets.store import open_for_reading
from tests.helpers.synthetic import GROUP, LEAN, compute

CASE, CRITICALS = "cases/synthetic", "cases/synthetic/criticals"
MEMORY = (
    50e6  # bytes that reading may take: far more than the store has, far less than the hostile ones ask for
)
COMMANDS = (
    ("info", "{store}"),
    ("status", "{store}"),
    ("verify", "{store}"),
    ("compare", "{store}", "{whole}"),
    ("compare", "{whole}", "{store}"),
    ("export", "{store}", "-o", "{out}", "--full"),
)
# `verify` and `status` tell of what is damaged and go on; the others stop at it.
TELLS = {"info": (ExitCode.STORE,), "status": (ExitCode.STORE, ExitCode.DONE), "verify": (ExitCode.STORE,)}


@pytest.fixture(scope="module")
def whole(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("whole") / "store.zarr"
    compute(path, 3, LEAN, durable=False)
    return path


@pytest.fixture
def store(whole: Path, tmp_path: Path) -> Path:
    return shutil.copytree(whole, tmp_path / "store.zarr")


def read_everything(path: Path) -> None:
    opened = open_for_reading(path)
    for case in list_cases(opened):
        case_attributes(opened, case)
        for group in list_groups(opened, case):
            read_group(opened, group)


def refused(path: Path, whole: Path, out: Path, *, chunk: bool = False) -> None:
    """Reading raises a store's error and asks for little memory; every command says so, except those that do
    not read chunks where only a ``chunk`` is hostile.
    """
    tracemalloc.start()
    try:
        with pytest.raises(StoreError) as error:
            read_everything(path)
        assert error.value.advice
        assert tracemalloc.get_traced_memory()[1] < MEMORY
    finally:
        tracemalloc.stop()
    for command in COMMANDS[2:] if chunk else COMMANDS:
        words = [word.format(store=path, whole=whole, out=out) for word in command]
        done = CliRunner().invoke(app, words, prog_name="agfb")
        assert done.exit_code in TELLS.get(command[0], (ExitCode.STORE,)), (words, done.output)
        assert "bug" not in done.stderr
        if done.exit_code == ExitCode.DONE:
            assert "damaged" in done.stdout
    assert chunk or not out.exists(), "groups before the chunk are exported"


def change_group(path: Path, group: str, change: Callable[[dict[str, Any]], object]) -> None:
    """Change the attributes of a group, checksum and all."""
    file = path / group / "zarr.json"
    attributes = json.loads(file.read_bytes())["attributes"]
    change(attributes)
    file.write_bytes(encode_group(attributes["kind"], attributes))


def change_array(path: Path, change: Callable[[dict[str, Any]], object]) -> None:
    file = path / GROUP / "state" / "zarr.json"
    content = json.loads(file.read_bytes())
    change(content)
    file.write_text(json.dumps(content))


STRUCTURED = {"name": "structured", "configuration": {"fields": [["a", "float64"]]}}
ARRAYS: dict[str, Callable[[dict[str, Any]], object]] = {
    "wrong shape": lambda m: m.update(shape=[40, 7]),
    "fewer rows than committed": lambda m: m.update(shape=[2, 6]),
    "wrong rank": lambda m: m.update(shape=[40]),
    "shape of fractions": lambda m: m.update(shape=[40.0, 6.0]),
    "shape of booleans": lambda m: m.update(shape=[True, 6]),
    "no shape": lambda m: m.pop("shape"),
    "huge rows": lambda m: m.update(shape=[10**15, 6]),
    "huge columns": lambda m: m.update(shape=[40, 10**15]),
    "huge chunk": lambda m: m["chunk_grid"]["configuration"].update(chunk_shape=[10**9, 6]),
    "chunk of fractions": lambda m: m["chunk_grid"]["configuration"].update(chunk_shape=[512.0, 6.0]),
    "object dtype": lambda m: m.update(data_type="object"),
    "numpy object dtype": lambda m: m.update(data_type="|O"),
    "structured dtype": lambda m: m.update(data_type=STRUCTURED),
    "variable text": lambda m: m.update(data_type="variable_length_utf8"),
    "variable bytes": lambda m: m.update(data_type="variable_length_bytes"),
    "pickle codec": lambda m: m["codecs"].insert(0, {"name": "numcodecs.pickle"}),
    "json codec": lambda m: m["codecs"].insert(0, {"name": "numcodecs.json2"}),
    "only pickle": lambda m: m.update(codecs=[{"name": "numcodecs.pickle", "configuration": {}}]),
    "another compressor": lambda m: m["codecs"].__setitem__(
        1, {"name": "gzip", "configuration": {"level": 5}}
    ),
    "a group": lambda m: m.update(node_type="group"),
    "chunks elsewhere": lambda m: m.update(
        chunk_key_encoding={"name": "default", "configuration": {"separator": "/../../"}}
    ),
}


@pytest.mark.parametrize("change", ARRAYS.values(), ids=ARRAYS)
def test_arrays(store: Path, whole: Path, tmp_path: Path, change: Callable[[dict[str, Any]], object]) -> None:
    change_array(store, change)
    refused(store, whole, tmp_path / "out")


GROUPS: dict[str, tuple[str, Callable[[dict[str, Any]], object]]] = {
    "huge rows": (GROUP, lambda a: a["dimensions"].update(point=10**15)),
    "huge columns": (GROUP, lambda a: a["dimensions"].update(component=10**15)),
    "rows as a boolean": (GROUP, lambda a: a["dimensions"].update(point=True)),
    "more rows than fit": (GROUP, lambda a: a.update(n_points=10**9)),
    "arrays outside": (GROUP, lambda a: a["arrays"].append("../../../outside")),
    "arrays of numbers": (GROUP, lambda a: a.update(arrays=[1])),
    "an unknown kind": (CRITICALS, lambda a: a.update(kind="evil")),
    "a store in a store": (CRITICALS, lambda a: a.update(kind="store")),
    "a case in a case": (CRITICALS, lambda a: a.update(kind="case")),
    "a container for a branch": (GROUP, lambda a: a.update(kind="container")),
    "results for a case": (CASE, lambda a: a.update(kind="linear", dimensions={}, arrays=[])),
    "a status that is none": (GROUP, lambda a: a.update(status=["running"])),
    "a reason that is none": (GROUP, lambda a: a.update(stop_reason={"a": 1})),
    "an advice that is none": (GROUP, lambda a: a.update(stop_advice=3)),
    "a name that is none": (CASE, lambda a: a.update(name=["a"])),
    "scales that are none": (CASE, lambda a: a.update(scales=[1.0])),
    "a configuration that is none": ("", lambda a: a.update(configuration=["synthetic"])),
    "versions that are none": ("", lambda a: a.update(versions="1.0")),
    "words that are none": ("", lambda a: a.update(argv=[["agfb"]])),
    "a version of the schema as a fraction": ("", lambda a: a.update(schema_version=float(SCHEMA_VERSION))),
}


@pytest.mark.parametrize(("group", "change"), GROUPS.values(), ids=GROUPS)
def test_groups(
    store: Path, whole: Path, tmp_path: Path, group: str, change: Callable[[dict[str, Any]], object]
) -> None:
    file = store / group / "zarr.json"
    attributes = json.loads(file.read_bytes())["attributes"]
    change(attributes)
    version = attributes["schema_version"]
    content = encode_group(attributes["kind"], attributes)
    if type(version) is float:  # which the writer would mend
        written = f'"schema_version": {SCHEMA_VERSION}'.encode()
        content = content.replace(written, written + b".0")
    file.write_bytes(content)
    refused(store, whole, tmp_path / "out")


NUMBERS = {
    "infinity": "1e999",
    "not a number": "NaN",
    "infinity by name": "-Infinity",
    "long number": "1" * 10_000,
    "deep": "[" * 600 + "]" * 600,
    "less deep": '{"a":' * 60 + "1" + "}" * 60,
}


@pytest.mark.parametrize("group", ["", CASE, GROUP])
@pytest.mark.parametrize("text", NUMBERS.values(), ids=NUMBERS)
def test_metadata_that_no_writer_makes(
    store: Path, whole: Path, tmp_path: Path, group: str, text: str
) -> None:
    file = store / group / "zarr.json"
    content = file.read_text()
    file.write_text(content.replace('"attributes": {', f'"attributes": {{"x": {text},', 1))
    with pytest.raises(StoreError, match=r"JSON|nested") as error:
        read_everything(store)
    assert error.value.path == file
    refused(store, whole, tmp_path / "out")


PLACES = {
    "all cases": "cases",
    "a case": CASE,
    "its metadata": f"{CASE}/zarr.json",
    "a container": f"{CASE}/cycles",
    "a group": GROUP,
    "metadata of a group": f"{GROUP}/zarr.json",
    "an array": f"{GROUP}/state",
    "metadata of an array": f"{GROUP}/state/zarr.json",
    "a chunk": f"{GROUP}/state/c.0.0",
}


@pytest.mark.parametrize("place", PLACES.values(), ids=PLACES)
def test_links_out_of_the_store(store: Path, whole: Path, tmp_path: Path, place: str) -> None:
    outside = tmp_path / "outside"
    (store / place).rename(outside)
    (store / place).symlink_to(outside)
    links = {finding.path for finding in verify(store) if finding.problem == "a link inside a store"}
    assert links == {store / place}
    done = CliRunner().invoke(app, ["verify", str(store), "--sample", "0"], prog_name="agfb")
    assert done.exit_code == ExitCode.STORE
    assert str(store / place) in done.stdout
    refused(store, whole, tmp_path / "out", chunk="c.0" in place)


@pytest.mark.parametrize("place", [f"{GROUP}/state/zarr.json", f"{GROUP}/state/c.0.0"])
def test_a_pipe_in_the_place_of_a_file_does_not_hang(
    store: Path, whole: Path, tmp_path: Path, place: str
) -> None:
    (store / place).unlink()
    os.mkfifo(store / place)
    refused(store, whole, tmp_path / "out", chunk="c.0" in place)


def test_a_pipe_in_the_place_of_a_group_is_told(store: Path) -> None:
    (store / GROUP / "zarr.json").unlink()
    os.mkfifo(store / GROUP / "zarr.json")
    assert [(finding.path, finding.problem) for finding in verify(store)] == [
        (store / GROUP / "zarr.json", "not a plain file")
    ]
