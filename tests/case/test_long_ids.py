"""Ids of cases of many swept keys stay short, so that every file named after them can be written."""

from __future__ import annotations

import pytest

from pipelines.case.reading import read_cases
from pipelines.case.sweeps import LONGEST_ID
from pipelines.datasets.durable import PARTIAL
from pipelines.datasets.locking import GroupLock
from pipelines.datasets.schema import KINDS

SWEEP = """[sweep]
"gas.viscosity" = [1.8512345678e-5, 1.9e-5]
"rotor.rayleigh_stiffness" = [2.431234567e-05]
"bearings.0.clearance" = [2.0412345678e-05]
"bearings.1.clearance" = [2.0512345678e-05]
"bearings.0.foil.stiffness" = [10.123456789]
"bearings.1.foil.stiffness" = [10.223456789]
"bearings.0.foil.loss_factor" = [0.42512345]
"bearings.1.foil.loss_factor" = [0.42612345]
"excitation.displacement" = [0.2123456]
"excitation.frequency" = [0.7123456]
"operation.speed" = [1.1, 1.2]
"""
LONGEST_NAME = 255


def test_many_swept_keys_give_ids_that_fit_and_tell_the_cases_apart(text: str) -> None:
    ids = [named.case_id for named in read_cases(text + SWEEP, "demo.toml")]
    assert len(set(ids)) == 4
    assert {len(each) for each in ids} == {LONGEST_ID}
    assert ids[0].startswith("viscosity=1.8512345678e-05_rayleigh_stiffness=2.431234567e-05_")
    assert ids == [named.case_id for named in read_cases(text + SWEEP, "demo.toml")]


def test_ids_that_fit_are_as_they_were(text: str) -> None:
    few = "[sweep]\noperation.speed = [1.1]\n'bearings.foil.stiffness' = [10.0]\n"
    assert read_cases(text + few, "demo.toml")[0].case_id == "speed=1.1_stiffness=10"


def test_every_file_of_a_case_fits(tmp_path) -> None:
    case = "x" * LONGEST_ID
    arrays = [spec for kind in KINDS.values() for spec in kind.arrays]
    dimensions = {dimension for spec in arrays for dimension in spec.dimensions}
    for container in KINDS:
        for dimension in dimensions:
            assert len(f"{case}-{container}-t000-{dimension}.csv{PARTIAL}") <= LONGEST_NAME
        assert len(GroupLock.file(tmp_path, f"cases/{case}/{container}/t000").name) <= LONGEST_NAME


@pytest.mark.parametrize("value", ["é" * 100, "a" * 199])
def test_long_values_of_one_key(text: str, value: str) -> None:
    (named,) = read_cases(text + f"[sweep]\nnote = ['{value}']\n", "demo.toml")
    assert len(named.case_id.encode()) <= LONGEST_ID
