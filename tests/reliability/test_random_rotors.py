"""Random rotors: the same critical speeds from every number of speeds, as many as the count of modes says.

Twenty of them; `make torture` tries three hundred.
"""

from __future__ import annotations

import numpy as np
import pytest

from pipelines.machine.assembly import build_machine, parameter_vector
from pipelines.orbits.equilibria.campbell import campbell_diagram
from pipelines.orbits.equilibria.critical_speeds import CriticalSpeeds, critical_speeds
from tests.helpers.rotors import TwoDiscRotor, random_rotor

GRID, RANGE, MAX_DAMPING_RATIO = (16, 2), (0.15, 1.5), 0.5
FEW = 8


def criticals(rotor: TwoDiscRotor, points: int) -> CriticalSpeeds:
    description = rotor.case(GRID)
    machine, parameters = build_machine(description), parameter_vector(description)
    diagram = campbell_diagram(machine, parameters, np.linspace(*RANGE, points), None, MAX_DAMPING_RATIO)
    return critical_speeds(machine, parameters, diagram, MAX_DAMPING_RATIO)


def pytest_generate_tests(metafunc: pytest.Metafunc) -> None:
    metafunc.parametrize("seed", range(metafunc.config.getoption("rotors")))


def test_every_number_of_speeds_finds_the_same(seed: int) -> None:
    many = int(np.random.default_rng(seed).integers(FEW + 1, 61))
    results = [criticals(random_rotor(seed), points) for points in (FEW, many)]
    few, more = ([one.speed for one in result.found] for result in results)
    np.testing.assert_allclose(few, more, rtol=0.0, atol=1e-8, err_msg=f"{FEW} and {many} speeds")
    for result in results:
        assert (np.diff([one.speed for one in result.found]) > 1e-9).all(), "told twice"
        known = result.counts[result.counts >= 0]
        change = sum(one.change for one in result.found) + result.passages
        if -1 in result.counts:  # what happens where there is no equilibrium is told as such
            change += sum(one.after - one.before for one in result.undecided)
        else:
            assert result.undecided == []
        assert known[-1] - known[0] == change
