"""One flipped bit or one lost file anywhere in a store is found and named."""

from __future__ import annotations

import random
import shutil
from pathlib import Path

import numpy as np
import pytest
from typer.testing import CliRunner

from agfb_cli.errors import ExitCode
from agfb_cli.main import app
from pipelines.datasets import branch
from pipelines.datasets.branch import open_branch, write_group
from pipelines.datasets.errors import CorruptedError, StoreError
from pipelines.datasets.integrity import verify
from pipelines.datasets.reading import describe, list_groups, read_branch
from pipelines.datasets.store import open_for_reading, open_for_writing
from tests.helpers.synthetic import CRITICALS, FULL, GROUP, compute, static
from tests.helpers.trees import compare_trees


@pytest.fixture
def copy(finished: Path, tmp_path: Path) -> Path:
    return shutil.copytree(finished, tmp_path / "copy")


def flip(path: Path, bit: int) -> None:
    content = bytearray(path.read_bytes())
    content[bit // 8] ^= 1 << (bit % 8)
    path.write_bytes(content)


def is_older_slot(path: Path) -> bool:
    """Of the two slots only the newest row's counts: of 20 rows slot 1."""
    return path.parent.name.startswith("basis") and path.name.startswith("c.0")


def test_a_whole_store_has_no_findings(finished: Path) -> None:
    assert verify(finished) == []


def test_any_flipped_bit_is_reported_with_its_file(copy: Path) -> None:
    moments = random.Random(7)
    files = sorted(p for p in (copy / "cases").rglob("*") if p.is_file() and not is_older_slot(p))
    assert len(files) > 80
    for path in files:
        before = path.read_bytes()
        flip(path, moments.randrange(8 * len(before)))
        found = verify(copy) if path.name == "zarr.json" else _of_group(copy, path)
        named = [finding for finding in found if finding.path in (path, path.parent)]
        assert named, path
        assert all(finding.advice for finding in named)
        path.write_bytes(before)


def _of_group(store: Path, path: Path) -> list[CorruptedError]:
    name = path.parent.name
    with pytest.raises(CorruptedError) as error:
        read_branch(open_for_reading(store), path.parent.parent.relative_to(store).as_posix(), [name])
    return [error.value]


def test_a_damaged_chunk_is_reported_by_every_way_in(copy: Path) -> None:
    path = copy / GROUP / "orbit" / "c.1.0.0"
    flip(path, 8 * 100)
    expected = f"damaged chunk .*folder {copy / GROUP} and run the same command again"
    assert [finding.path for finding in verify(copy)] == [path]
    with pytest.raises(CorruptedError, match=expected) as error:
        read_branch(open_for_reading(copy), GROUP)
    assert error.value.path == path
    with pytest.raises(CorruptedError, match=expected):
        open_branch(open_for_writing(copy, durable=False), GROUP, "cycles", FULL)


def test_every_lost_chunk_is_reported(copy: Path) -> None:
    chunks = sorted((copy / GROUP).rglob("c.*"))
    for path in chunks:
        path.unlink()
    found = {finding.path: finding for finding in verify(copy)}
    assert set(found) == {path for path in chunks if not is_older_slot(path)}
    assert {finding.problem for finding in found.values()} == {"a chunk is missing"}


def test_the_advice_restores_the_store(finished: Path, copy: Path) -> None:
    flip(copy / GROUP / "state" / "c.0.0", 999)
    [finding] = verify(copy)
    shutil.rmtree(copy / GROUP)
    assert str(copy / GROUP) in finding.advice
    compute(copy, 20, FULL, durable=False)
    assert compare_trees(finished, copy) == []


@pytest.mark.parametrize(
    "name", ["zarr.json", "cases/zarr.json", "cases/synthetic/zarr.json", f"{GROUP}/../zarr.json"]
)
def test_lost_metadata_are_reported(copy: Path, name: str) -> None:
    (copy / name).unlink()
    try:
        problems = verify(copy)
    except StoreError as error:
        problems = [error]
    assert problems


def test_every_lost_metadata_file_is_damage_and_nothing_is_left_out(copy: Path) -> None:
    """Also to those who list groups: a branch that is not told is a lost result."""
    for path in sorted((copy / "cases").rglob("zarr.json")):
        content = path.read_bytes()
        path.unlink()
        errors = {finding.path for finding in verify(copy) if finding.severity == "error"}
        assert errors == {path}
        with pytest.raises(CorruptedError) as error:
            describe(copy)
        assert error.value.path == path
        path.write_bytes(content)
    assert verify(copy) == []


def test_a_branch_without_its_metadata_is_not_made_anew(copy: Path) -> None:
    (copy / GROUP / "zarr.json").unlink()
    chunks = sorted((copy / GROUP).rglob("c.*"))
    with pytest.raises(CorruptedError, match="Remove the folder"):
        open_branch(open_for_writing(copy, durable=False), GROUP, "cycles", FULL)
    assert sorted((copy / GROUP).rglob("c.*")) == chunks


def test_a_store_that_lost_its_own_description_is_damaged(copy: Path) -> None:
    (copy / "zarr.json").unlink()
    done = CliRunner().invoke(app, ["verify", str(copy)], prog_name="agfb")
    assert done.exit_code == ExitCode.STORE
    assert "zarr.json: the file is missing" in done.stderr


def test_a_group_whose_making_was_interrupted_is_no_damage(copy: Path, monkeypatch) -> None:
    class Killed(BaseException):
        pass

    def kill(*_: object) -> None:
        raise Killed

    store = open_for_writing(copy, durable=False)
    other = GROUP.replace("b000", "b001")
    with monkeypatch.context() as patched:
        patched.setattr(branch, "_publish", kill)
        with pytest.raises(Killed):
            open_branch(store, other, "cycles", FULL, static(FULL))
        with pytest.raises(Killed):
            write_group(store, CRITICALS, "criticals", {"critical_speed": np.array([0.5])})
    assert {finding.severity for finding in verify(copy)} == {"note"}
    assert other not in list_groups(store, "synthetic")
    open_branch(store, other, "cycles", FULL, static(FULL)).close()
    write_group(store, CRITICALS, "criticals", {"critical_speed": np.array([0.5])})
    assert verify(copy) == []


def test_a_lost_case_and_strangers_with_metadata(copy: Path) -> None:
    shutil.copytree(copy / GROUP / "state", copy / GROUP / "extra")
    found = verify(copy)
    assert {finding.severity for finding in found} == {"note"}
    assert {finding.path.parent for finding in found} == {copy / GROUP / "extra"}
    shutil.rmtree(copy / "cases" / "synthetic")
    assert [(each.path.name, each.problem) for each in verify(copy)] == [("synthetic", "the case is missing")]


def test_origins_and_starts_must_be_there(copy: Path) -> None:
    store = open_for_writing(copy, durable=False)
    doubled = GROUP.replace("b000", "d000")
    events = read_branch(store, GROUP).n_events
    assert events > 0
    origin = {"group": "cycles/b000", "event": events - 1}
    for event, problems in ((events - 1, 0), (events, 1)):
        told = {"origin": origin | {"event": event}}
        open_branch(store, doubled, "cycles", FULL, static(FULL), told).close()
        found = verify(copy)
        assert [finding.path for finding in found] == [copy / doubled] * problems
    assert "its origin is not in the store: cycles/b000, event" in found[0].problem
    told = {"request": {"transient": {"start": "cycles/b007", "start_row": None}}}
    open_branch(store, doubled, "cycles", FULL, static(FULL), told).close()
    assert "its start is not in the store: cycles/b007" in verify(copy)[0].problem


def test_strangers_and_leftovers_are_noted(copy: Path) -> None:
    (copy / "notes.txt").write_text("text")
    (copy / GROUP / "state" / "c.0.0.partial").write_text("half")
    found = {finding.path.name: finding.severity for finding in verify(copy)}
    assert found == {"notes.txt": "note", "c.0.0.partial": "note"}
    (copy / "link").symlink_to(copy)
    assert "error" in {finding.severity for finding in verify(copy)}
