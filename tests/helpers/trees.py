"""Comparing folders byte for byte."""

from __future__ import annotations

from pathlib import Path


def tree(folder: Path) -> dict[str, bytes | None]:
    """Every name below a folder with its content, None for a folder."""
    below = sorted(folder.rglob("*"))
    return {p.relative_to(folder).as_posix(): None if p.is_dir() else p.read_bytes() for p in below}


def compare_trees(first: Path, second: Path) -> list[str]:
    """One sentence for every difference in names or bytes of two folders; empty when they are identical."""
    left, right = tree(first), tree(second)
    found = [f"{name}: only in {first.name}" for name in left if name not in right]
    found += [f"{name}: only in {second.name}" for name in right if name not in left]
    found += [
        f"{name}: {_first_difference(left[name], right[name])}"
        for name in left
        if name in right and left[name] != right[name]
    ]
    return found


def _first_difference(first: bytes | None, second: bytes | None) -> str:
    if first is None or second is None:
        return "a file here, a folder there"
    same = next((i for i, (a, b) in enumerate(zip(first, second, strict=False)) if a != b), None)
    where = "one is longer" if same is None else f"first at byte {same}"
    return f"{len(first)} and {len(second)} bytes, {where}"
