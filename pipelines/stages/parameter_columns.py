"""Parameters of a solution as columns of a store, and columns as parameters.

A machine need not have all four: two rigid bearings have no foil stiffness, a passive machine may have no
excitation frequency.  A store holds none (NaN, in attributes None) there; the equations take a stand-in.
"""

from __future__ import annotations

import math
from collections.abc import Mapping

from pipelines.case.arrays import Array
from pipelines.case.models import Case
from pipelines.case.scales import PARAMETERS
from pipelines.machine.assembly import with_stand_ins


def parameter_columns(case: Case, parameters: Array, prefix: str = "") -> dict[str, float]:
    """The four ``parameters`` of a solution by name, NaN for those that the case's machine lacks."""
    own = case.parameters
    return {
        prefix + name: math.nan if math.isnan(known) else float(value)
        for name, known, value in zip(PARAMETERS, own, parameters, strict=True)
    }


def stored_parameters(arrays: Mapping[str, Array], row: int, prefix: str = "") -> Array:
    """The four parameters of a row in the form of the equations."""
    return with_stand_ins([arrays[prefix + name][row] for name in PARAMETERS])


def parameter_attributes(case: Case, parameters: Array) -> dict[str, float | None]:
    """The four ``parameters`` of a solution as JSON values."""
    columns = parameter_columns(case, parameters)
    return {name: None if math.isnan(value) else value for name, value in columns.items()}
