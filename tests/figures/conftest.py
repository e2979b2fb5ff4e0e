from __future__ import annotations

import importlib.util
import sys
from pathlib import Path
from types import ModuleType

import numpy as np
import pytest

from pipelines.datasets.schema import KINDS
from pipelines.figures.axes import AxisScales
from pipelines.figures.contents import CaseView, Table

HELPER = Path(__file__).with_name("synthetic_store.py")


def load_helper() -> ModuleType:
    """The module that invents stores; tests are no package, so it is loaded by its path."""
    if "synthetic_store" not in sys.modules:
        spec = importlib.util.spec_from_file_location("synthetic_store", HELPER)
        assert spec is not None
        assert spec.loader is not None
        module = importlib.util.module_from_spec(spec)
        sys.modules["synthetic_store"] = module
        spec.loader.exec_module(module)
    return sys.modules["synthetic_store"]


@pytest.fixture(scope="session")
def synthetic():
    return load_helper()


def labelled(kind, arrays):
    """Flags as their meanings, as a store is read."""
    flags = {spec.name: np.array(["unset", *spec.flags]) for spec in KINDS[kind].arrays if spec.flags}
    return {name: flags[name][values + 1] if name in flags else values for name, values in arrays.items()}


@pytest.fixture(scope="session")
def view(synthetic):
    """A machine of two materials, one hollow part and a support in the middle."""
    scales = AxisScales(rpm=18000.0, hertz=300.0, micrometres=20.0, stiffness=5.0)
    machine = Table(synthetic.machine(hollow=True), {"material_names": ["steel", "titanium"]})
    return CaseView("kb10", "Invented numbers.", scales, machine)


@pytest.fixture(scope="session")
def branch(synthetic):
    """A branch over the speed, unstable between two period doublings and beyond a Neimark-Sacker point."""
    rows, events = synthetic.cycles()
    arrays = rows | {name: np.array([event[name] for event in events]) for name in events[0]}
    return Table(labelled("cycles", arrays), {"parameter": "speed", "status": "ended"})


@pytest.fixture(scope="session")
def criticals(synthetic):
    return Table(labelled("criticals", synthetic.criticals()))


@pytest.fixture(scope="session")
def linear(synthetic):
    return Table(synthetic.linear(), synthetic.ATTRIBUTES["linear"])
