"""What the linear stages share: parameters, the equilibrium from speed to speed, flags of directions."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from pipelines.case.arrays import Array
from pipelines.case.models import Case
from pipelines.datasets.branch import BranchWriter
from pipelines.datasets.schema import KINDS
from pipelines.machine import film
from pipelines.machine.assembly import Machine, parameter_vector
from pipelines.orbits.equilibria.equilibrium import equilibrium_along
from pipelines.stages.linear import missing_speeds


def reference_parameters(case: Case, ring: Literal["mean", "undeformed"]) -> Array:
    """The case's parameters; with undeformed rings if the passive machine is to be linearised."""
    parameters = parameter_vector(case)
    if ring == "undeformed":
        parameters[film.DISPLACEMENT] = 0.0
    return parameters


def last_state(branch: BranchWriter) -> Array | None:
    """The equilibrium at the previous speed, from which the next one is searched."""
    newest = branch.resume_row()
    if newest is None or not np.all(np.isfinite(newest.row["state"])):
        return None
    return np.asarray(newest.row["state"])


def missing_entries(
    machine: Machine, parameters: Array, rows: Mapping[str, NDArray[Any]], known: Mapping[int, str]
) -> list[str]:
    """The report on speeds without equilibrium; reasons that are not ``known`` are recomputed."""
    speeds, states = rows["speed"], rows["state"]
    missing = []
    for index in np.flatnonzero(~np.isfinite(states).all(axis=1)):
        reason = known.get(int(index))
        if reason is None:
            guess = states[index - 1] if index > 0 and np.isfinite(states[index - 1]).all() else None
            reason = equilibrium_along(machine, parameters, speeds, int(index), guess).reason
        missing.append(missing_speeds.entry(float(speeds[index]), reason))
    return missing


def direction_flags(directions: NDArray[np.int8]) -> NDArray[np.int8]:
    """Stored flags of +1 forward, -1 backward, 0 planar."""
    flag = KINDS["criticals"].array("direction").flag
    table = {1: flag("forward"), -1: flag("backward"), 0: flag("mixed")}
    return np.vectorize(table.__getitem__, otypes=[np.int8])(directions)
