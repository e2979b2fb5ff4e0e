"""The store that a run writes to: made by the driver alone, before any case is computed."""

from __future__ import annotations

import math
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from pipelines.case.models import PARAMETERS
from pipelines.case.reading import NamedCase
from pipelines.case.scales import Scales
from pipelines.datasets.provenance import provenance
from pipelines.datasets.store import create_store, open_for_writing
from pipelines.machine.assembly import parameter_vector


def prepare_store(store_path: Path, named_cases: Sequence[NamedCase], argv: Sequence[str]) -> None:
    """Make the store of a configuration, or check that the store which is there belongs to it.

    `named_cases` are all cases of the configuration, also those that will not be computed now. Raises
    StoreError (another configuration, something else at this path) and OSError.
    """
    root = provenance(named_cases, argv)
    if store_path.exists():
        open_for_writing(store_path, root)
    else:
        create_store(store_path, {named.case_id: case_attributes(named) for named in named_cases}, root)


def case_attributes(named: NamedCase) -> dict[str, Any]:
    """Name, origin, parameters at the start and scales, as JSON values; an infinite one is None."""
    scales = Scales.from_case(named.case)
    values = dict(zip(PARAMETERS, (float(value) for value in parameter_vector(named.case)), strict=True))
    return {
        "name": named.case_id,
        "reconstruction": named.resolved.get("note", ""),
        "parameters": {name: value if math.isfinite(value) else None for name, value in values.items()},
        "scales": {
            "time": scales.time,
            "displacement": scales.displacement,
            "force": scales.force,
            "pressure": scales.pressure,
            "speed_rpm_per_unit": scales.speed_rpm_per_unit,
            "hertz_per_unit": scales.hertz_per_unit,
        },
    }
