"""The rotor of ``configs/models/ross_rotor.toml`` on two foil bearings, all of its freedoms kept.

``python -m tests.helpers.ross_foil_rotor`` writes the coefficients of the bearings, in the form that ROSS 3
reads, into ``tests/reference``; `tests/reference/make_ross_foil_bearing_fixture.py` goes on from there.
"""

from __future__ import annotations

from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np

from pipelines.case.imports.draft import draft_text
from pipelines.case.imports.ross import read_ross
from pipelines.case.reading import NamedCase, read_cases
from pipelines.datasets.exporting import planned_files, write_files
from pipelines.datasets.store import open_for_reading
from tests.helpers.configurations import MODELS
from tests.helpers.tiny import Watched

MODEL = MODELS / "ross_rotor.toml"
REFERENCE = Path(__file__).resolve().parents[1] / "reference"
SPEEDS = (2300.0, 2580.0)  # rad/s: near each one a whirl mode loses its stability
HIGHEST = 10_000.0  # rad/s: above the first bending modes
MASTERS = ", ".join(f"{{node = {node}, slopes = true}}" for node in range(10))
SETTINGS = (
    "bearings.radius=0.0125",
    "bearings.length=0.02",
    "bearings.clearance=2e-5",
    "bearings.foil.areal_stiffness=5e9",
    "bearings.foil.loss_factor=0.4",
    f"rotor.masters=[{MASTERS}]",
    "numerics.circumferential=24",
    "numerics.axial=2",
    "numerics.scheme=central",
)


def case() -> NamedCase:
    """The rotor with foil bearings in the place of the linear ones that ROSS saved."""
    text = draft_text(read_ross(MODEL.read_text(), MODEL.name), "ross")
    (plain,) = read_cases(text, MODEL.name, SETTINGS)
    time = plain.case.scales.time
    low, high = (speed * time for speed in SPEEDS)
    table = (
        f"coefficients.speed_range=[{low!r}, {high!r}]",
        "coefficients.points=2",
        f"coefficients.frequency_range=[0, {HIGHEST * time!r}]",
        "coefficients.frequencies=81",
    )
    (named,) = read_cases(text, MODEL.name, (*SETTINGS, *table))
    return named


def write_coefficients(folder: Path) -> list[Path]:
    """Compute the coefficients and export them for ROSS."""
    with TemporaryDirectory() as scratch:
        store = Path(scratch) / "ross.zarr"
        assert Watched("coefficients", case(), store).result.ok
        return write_files(planned_files(open_for_reading(store), "ross", folder, "ross", full=False))


def rounded(text: str) -> str:
    """The numbers of the tables to nine digits: enough for every test, and half as long."""
    lines = []
    for line in text.splitlines():
        if line.startswith(("  [", "frequency")):
            head, _, inner = line.partition("[")
            numbers = [f"{np.float64(value):.9g}" for value in inner.strip("[],").split(",")]
            line = f"{head}[{', '.join(n if '.' in n or 'e' in n else n + '.0' for n in numbers)}]" + (
                "," if line.endswith(",") else ""
            )
        lines.append(line)
    return "\n".join(lines) + "\n"


def main() -> None:
    """Write ``ross_foil_bearing_1.toml`` and ``ross_foil_bearing_2.toml``."""
    with TemporaryDirectory() as scratch:
        for number, path in enumerate(write_coefficients(Path(scratch)), start=1):
            (REFERENCE / f"ross_foil_bearing_{number}.toml").write_text(rounded(path.read_text()))


if __name__ == "__main__":
    main()
