"""Sizes that no machine has are refused with their key, before a formula divides by them."""

from __future__ import annotations

import pytest

from pipelines.case.reading import CaseError, read_cases

BUMP = "bearings.foil={loss_factor=0.4, bump={pitch=4.572e-3, half_length=1.778e-3, thickness=1e-4, "
BUMP += "young_modulus=214e9, poisson_ratio=0.29}}"


@pytest.mark.parametrize("value", ["1e-320", "1e-160", "1e-30"])
@pytest.mark.parametrize(
    "key",
    [
        "gas.ambient_pressure",
        "bearings.clearance",
        "bearings.radius",
        "bearings.length",
        "rotor.elements.length",
        "rotor.elements.outer_diameter",
        "bearings.foil.areal_stiffness",
        "bearings.foil.bump.pitch",
        "bearings.foil.bump.half_length",
        "bearings.foil.bump.thickness",
    ],
)
def test_nothing_is_so_small(text: str, key: str, value: str) -> None:
    words = [BUMP] if ".bump." in key else []
    with pytest.raises(CaseError) as caught:
        read_cases(text, "demo.toml", (*words, f"{key}={value}"))
    assert any(problem.key.endswith(key.rsplit(".", 1)[1]) for problem in caught.value.problems)


@pytest.mark.parametrize("key", ["rotor.discs.diametral_inertia", "rotor.rayleigh_stiffness"])
def test_nothing_is_so_large(text: str, key: str) -> None:
    with pytest.raises(CaseError, match="must be >= 0 and <= "):
        read_cases(text, "demo.toml", (f"{key}=1e300",))
