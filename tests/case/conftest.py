"""A configuration whose line numbers the tests know."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import pytest

from pipelines.case.reading import CaseError, Problem, read_cases

TEXT = """\
name = "demo"
[gas]
viscosity = 1.85e-5
ambient_pressure = 101325.0
[rotor]
masters = [0, 2, 4]
[[rotor.elements]]
count = 4
length = 0.05
outer_diameter = 0.0176
[[rotor.discs]]
node = 0
mass = 0.08
diametral_inertia = 2.85e-5
polar_inertia = 5.70e-5
[[bearings]]
node = 0
radius = 0.014
length = 0.0161
clearance = 20.4e-6
[bearings.foil]
stiffness = 10.0
loss_factor = 0.425
[[bearings]]
node = 4
[excitation]
displacement = 0.2
frequency = 0.7
[operation]
speed = 1.0
[numerics]
circumferential = 24
axial = 2
"""


@pytest.fixture(scope="session")
def text() -> str:
    return TEXT


@pytest.fixture
def problems() -> Callable[..., tuple[Problem, ...]]:
    """All problems of a text; `changes` are pairs (line, replacement); other lines stay in place."""

    def read(
        *changes: tuple[int, str], overrides: tuple[str, ...] = (), end: str = ""
    ) -> tuple[Problem, ...]:
        lines = TEXT.splitlines()
        for line, replacement in changes:
            lines[line - 1] = replacement
        with pytest.raises(CaseError) as caught:
            read_cases("\n".join(lines) + "\n" + end, "demo.toml", overrides)
        return caught.value.problems

    return read


@pytest.fixture
def table() -> dict[str, Any]:
    """The same configuration as a resolved dictionary."""
    return read_cases(TEXT, "demo.toml")[0].resolved
