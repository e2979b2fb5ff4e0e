"""Write ross_foil_bearing_eigenvalues.csv: a rotor of ROSS on the foil bearings that agfb exports.

ROSS (https://github.com/petrobras/ross, Apache-2.0) is never a dependency here: see make_ross_fixture.py for
an environment of its own, in which this script is run after `python -m tests.helpers.ross_foil_rotor`,

    /tmp/ross/bin/python tests/reference/make_ross_foil_bearing_fixture.py

The rotor of ``configs/models/ross_rotor.toml`` gets the bearings of ``ross_foil_bearing_1.toml`` and ``_2``,
files of `agfb export --format ross`.  Each eigenvalue is that of coefficients at its own whirl frequency,
found by fixed-point iteration.  The files are in the form of ROSS 3, which has this iteration itself:

    bearing = ross.BearingElement.load("ross_foil_bearing_1.toml")
    rotor.run_modal(speed, matched_whirl=True)

The script needs version 2.3 only: it interpolates the tables as ROSS 3 does, by a piecewise cubic that keeps
their shape, and hands the bearings over as constant coefficients.
"""

from __future__ import annotations

import tomllib
from collections.abc import Iterator

import numpy as np
import ross
from make_ross_rotor_fixture import FOLDER, MODEL, lateral_eigenvalues
from scipy.interpolate import PchipInterpolator

NAMES = ("kxx", "kxy", "kyx", "kyy", "cxx", "cxy", "cyx", "cyy")
TOLERANCE, ITERATIONS = 1e-12, 200


def table(number: int) -> dict[str, object]:
    (found,) = tomllib.loads((FOLDER / f"ross_foil_bearing_{number}.toml").read_text()).values()
    return found


def rotor(tables: list[dict[str, object]], speed: int, whirl: float) -> ross.Rotor:
    """The rotor with the coefficients of one speed of the tables at a whirl frequency."""
    saved = ross.Rotor.load(MODEL)
    bearings = [
        ross.BearingElement(
            n=each["n"],
            tag=each["tag"],
            **{name: float(PchipInterpolator(each["frequency"], each[name][speed])(whirl)) for name in NAMES},
        )
        for each in tables
    ]
    return ross.Rotor(
        saved.shaft_elements, saved.disk_elements, bearings, saved.point_mass_elements, rated_w=saved.rated_w
    )


def matched(tables: list[dict[str, object]], speed: int, value: float) -> Iterator[complex]:
    """Eigenvalues below the highest frequency of the tables, each at its own whirl frequency."""
    for first in lateral_eigenvalues(rotor(tables, speed, value), value):
        found = complex(first)
        for _ in range(ITERATIONS):
            if found.imag > tables[0]["frequency"][-1]:
                break
            every = lateral_eigenvalues(rotor(tables, speed, found.imag), value)
            before, found = found, complex(every[np.argmin(np.abs(every - found))])
            if abs(found - before) <= TOLERANCE * abs(found):
                yield found
                break


def main() -> None:
    tables = [table(1), table(2)]
    rows = [
        "# ROSS " + ross.__version__ + ", make_ross_foil_bearing_fixture.py; all numbers in rad/s",
        "speed,real,imaginary",
    ]
    for index, speed in enumerate(tables[0]["speed"]):
        distinct: list[complex] = []
        for found in matched(tables, index, speed):
            if all(abs(found - other) > 1e-6 * abs(found) for other in distinct):
                distinct.append(found)
        rows += [f"{speed!r},{z.real!r},{z.imag!r}" for z in sorted(distinct, key=lambda z: z.imag)]
    (FOLDER / "ross_foil_bearing_eigenvalues.csv").write_text("\n".join(rows) + "\n")


if __name__ == "__main__":
    main()
