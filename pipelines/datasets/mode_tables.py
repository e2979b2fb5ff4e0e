"""Modes over the speed as one long table: frequency in rpm and Hz, logarithmic decrement, whirl direction."""

from __future__ import annotations

import csv
import io
from collections.abc import Iterator

import numpy as np

from pipelines.datasets.reading import case_attributes, read_group
from pipelines.datasets.records import Group
from pipelines.datasets.schema import Array
from pipelines.datasets.store import Store, local_name

KINDS = ("linear", "criticals")
NEEDED = "logarithmic_decrement"
COLUMNS = (
    "speed",
    "speed_rpm",
    "mode",
    "frequency",
    "frequency_hz",
    "frequency_rpm",
    "logarithmic_decrement",
    "damping_ratio",
    "direction",
)
_MODES = {
    "linear": "# mode: counted by frequency at each speed, among the leading eigenvalues",
    "criticals": "# mode: followed over the speed",
}


def mode_table(store: Store, name: str) -> bytes:
    """A row for every speed and oscillating mode of a group ``cases/CASE/linear`` or ``.../criticals``."""
    own = {"linear": "eigenvalues", "criticals": "frequency"}[local_name(name)]
    group = read_group(store, name, ("speed", NEEDED, "damping_ratio", "direction", own))
    text = io.StringIO(newline="")
    scales = case_attributes(store, name.split("/")[1])["scales"]
    text.write(f"{_MODES[group.kind]}\n")
    text.write("# speed and frequency are dimensionless; a negative logarithmic decrement is unstable\n")
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow(COLUMNS)
    writer.writerows(_rows(group, float(scales["speed_rpm_per_unit"]), float(scales["hertz_per_unit"])))
    return text.getvalue().encode()


def _rows(group: Group, rpm: float, hertz: float) -> Iterator[list[float | int | str]]:
    frequency, direction = _frequencies(group), group.labels("direction")
    followed = group.kind == "criticals"
    for index, speed in enumerate(group["speed"].tolist()):
        modes = np.flatnonzero(np.isfinite(group[NEEDED][index]))
        if not followed:
            modes = modes[np.argsort(frequency[index, modes], kind="stable")]
        for number, mode in enumerate(modes.tolist(), start=1):
            own = float(frequency[index, mode])
            yield [
                speed,
                speed * rpm,
                mode + 1 if followed else number,
                own,
                own * hertz,
                own * rpm,
                float(group[NEEDED][index, mode]),
                float(group["damping_ratio"][index, mode]),
                str(direction[index, mode]),
            ]


def _frequencies(group: Group) -> Array:
    """Im lambda, (speeds, modes)."""
    return group["frequency"] if "frequency" in group else np.abs(group["eigenvalues"].imag)
