"""Stiffness and damping of a bearing for other programs: one long table, or a bearing of ROSS 3.

Speeds without equilibrium are left out.
"""

from __future__ import annotations

import csv
import io
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from pipelines.datasets.dimensional import StoredScales
from pipelines.datasets.reading import read_group
from pipelines.datasets.schema import Array
from pipelines.datasets.store import Store

KIND = "coefficients"
ARRAYS = ("speed", "frequency", "stiffness", "damping", "bearing_node")
ENTRIES = (("xx", 0, 0), ("xy", 0, 1), ("yx", 1, 0), ("yy", 1, 1))
_MEANING = (
    "# film and foil in series about the equilibrium of each speed, for whirl at each frequency: "
    "force = -(K x + C dx/dt); x horizontal, y upwards, the rotor turns from x to y"
)


@dataclass(frozen=True)
class BearingTable:
    """The coefficients of one bearing, ``number`` counted from 1.

    Axes dimensionless and in rpm and Hz; ``stiffness`` and ``damping`` (speeds, frequencies, 2, 2)
    dimensionless, with their units in N/m and N s/m.
    """

    case: str
    number: int
    node: int
    speed: Array
    speed_rpm: Array
    frequency: Array
    frequency_hertz: Array
    stiffness: Array
    damping: Array
    stiffness_unit: float
    damping_unit: float


def bearing_table(store: Store, name: str, bearing: int) -> BearingTable:
    """The coefficients of a bearing, counted from 0, from a group ``cases/CASE/coefficients``."""
    case = name.split("/")[1]
    group, scales = read_group(store, name, ARRAYS), StoredScales(store, case)
    found = np.isfinite(group["stiffness"]).all(axis=(1, 2, 3, 4))
    speed, frequency = group["speed"][found], group["frequency"]
    return BearingTable(
        case,
        bearing + 1,
        int(group["bearing_node"][bearing]),
        speed,
        speed * scales.scale["speed"],
        frequency,
        frequency * scales.scale["frequency"],
        group["stiffness"][found, :, bearing],
        group["damping"][found, :, bearing],
        float(scales.of_bearings["N/m"][bearing]),
        float(scales.of_bearings["N s/m"][bearing]),
    )


def long_table(table: BearingTable) -> bytes:
    """A row for every speed and frequency, with named columns: dimensionless numbers, and SI beside them."""
    text = io.StringIO(newline="")
    text.write(f"{_MEANING}\n")
    text.write(f"# bearing {table.number} of case {table.case}, node {table.node}\n")
    text.write(f"# k..: over {table.stiffness_unit!r} N/m; c..: over {table.damping_unit!r} N s/m\n")
    writer = csv.writer(text, lineterminator="\n")
    names = [f"{letter}{entry}" for letter in "kc" for entry, _, _ in ENTRIES]
    units = ["n_per_m"] * len(ENTRIES) + ["ns_per_m"] * len(ENTRIES)
    in_units = [f"{name}_{unit}" for name, unit in zip(names, units, strict=True)]
    writer.writerow(["speed", "speed_rpm", "frequency", "frequency_hz", *names, *in_units])
    writer.writerows(_rows(table))
    return text.getvalue().encode()


def _rows(table: BearingTable) -> Iterator[list[float]]:
    flat = (len(table.speed), len(table.frequency), 4)
    stiffness, damping = table.stiffness.reshape(flat), table.damping.reshape(flat)
    for index, (speed, rpm) in enumerate(zip(table.speed, table.speed_rpm, strict=True)):
        for place, (frequency, hertz) in enumerate(zip(table.frequency, table.frequency_hertz, strict=True)):
            k, c = stiffness[index, place], damping[index, place]
            values = np.concatenate([k, c, k * table.stiffness_unit, c * table.damping_unit])
            yield [float(speed), float(rpm), float(frequency), float(hertz), *values.tolist()]


def ross_bearing(table: BearingTable) -> bytes:
    """A file that `ross.BearingElement.load` of ROSS 3 reads: tables (len(speed), len(frequency)) in SI.

    Both axes in rad/s.
    """
    lines = [
        _MEANING,
        f"# bearing {table.number} of case {table.case}; for ROSS 3 (ross.BearingElement.load): "
        "kxx[i][j] [N/m] and cxx[i][j] [N s/m] at speed[i] and frequency[j] [rad/s]",
        f'["BearingElement_bearing {table.number}"]',
        f"n = {table.node}",
        f'tag = "bearing {table.number}"',
        f"speed = {_list(table.speed_rpm * (np.pi / 30.0))}",
        f"frequency = {_list(table.frequency_hertz * (2.0 * np.pi))}",
    ]
    for letter, values, unit in (
        ("k", table.stiffness, table.stiffness_unit),
        ("c", table.damping, table.damping_unit),
    ):
        for entry, row, column in ENTRIES:
            inner = ",\n  ".join(_list(each) for each in values[:, :, row, column] * unit)
            lines.append(f"{letter}{entry} = [\n  {inner},\n]")
    return ("\n".join(lines) + "\n").encode()


def _list(values: Sequence[float] | Array) -> str:
    return "[" + ", ".join(repr(float(value)) for value in values) + "]"
