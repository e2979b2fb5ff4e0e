"""The smoke case gives the numbers it gave: a change here is a change of results, to be explained.

They are regressions on a coarse grid, not truths: tests/validation compares with independent data.
"""

from __future__ import annotations

import json

import numpy as np
import pytest

from tests.golden.regenerate import GOLDEN
from tests.golden.values import golden_values

# Newton stops at 1e-10 and events are located to 1e-8 in the parameter; other processors round differently.
TOLERANCE = 1e-7
# A difference quotient of moduli over a twentieth of a step magnifies those errors by as much.
DIFFERENCED = {"neimark_sacker_transversality": 1e-4}


@pytest.fixture(scope="module")
def computed(tmp_path_factory: pytest.TempPathFactory) -> dict[str, object]:
    return golden_values(tmp_path_factory.mktemp("golden"))


@pytest.mark.parametrize("name", sorted(json.loads(GOLDEN.read_text())))
def test_value_is_the_frozen_one(computed: dict[str, object], name: str) -> None:
    frozen = json.loads(GOLDEN.read_text())[name]
    np.testing.assert_allclose(computed[name], frozen, rtol=DIFFERENCED.get(name, TOLERANCE), atol=0.0)


def test_all_values_are_frozen(computed: dict[str, object]) -> None:
    assert set(computed) == set(json.loads(GOLDEN.read_text()))
