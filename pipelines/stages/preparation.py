"""The store that a run writes to: made by the driver alone, before any case is computed."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

from pipelines.case.reading import NamedCase
from pipelines.case.scales import Scales
from pipelines.datasets.branch import write_group
from pipelines.datasets.provenance import provenance
from pipelines.datasets.store import create_store, open_for_writing
from pipelines.machine.assembly import parameter_vector
from pipelines.stages.geometry import geometry
from pipelines.stages.parameter_columns import parameter_attributes


def prepare_store(store_path: Path, named_cases: Sequence[NamedCase], argv: Sequence[str]) -> None:
    """Make the store of a configuration, or check that the one which is there belongs to it.

    `named_cases` are all cases of the configuration, also those that will not be computed now; the geometry
    of each is written here. Raises StoreError (another configuration, something else at this path), OSError.
    """
    root = provenance(named_cases, argv)
    if store_path.exists():
        store = open_for_writing(store_path, root)
    else:
        store = create_store(
            store_path, {named.case_id: case_attributes(named) for named in named_cases}, root
        )
    for named in named_cases:
        group = f"cases/{named.case_id}/machine"
        if not store.has_group(group):
            write_group(store, group, "machine", *geometry(named.case))


def case_attributes(named: NamedCase) -> dict[str, Any]:
    """Name, origin, parameters at the start and scales, as JSON values; what the machine lacks is None."""
    scales = Scales.from_case(named.case)
    return {
        "name": named.case_id,
        "reconstruction": named.case.note,
        "parameters": parameter_attributes(named.case, parameter_vector(named.case)),
        "scales": {
            "time": scales.time,
            "displacement": scales.displacement,
            "force": scales.force,
            "pressure": scales.pressure,
            "speed_rpm_per_unit": scales.speed_rpm_per_unit,
            "hertz_per_unit": scales.hertz_per_unit,
        },
    }
