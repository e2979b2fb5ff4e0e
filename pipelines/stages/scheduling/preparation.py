"""The store of a run: prepared by the driver alone, before any case is computed."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Any

import numpy as np

from pipelines.case.models import Case, Rotor
from pipelines.case.reading import NamedCase
from pipelines.datasets.branch import write_group
from pipelines.datasets.provenance import provenance
from pipelines.datasets.store import case_group, create_store, open_for_writing
from pipelines.machine.assembly import parameter_vector
from pipelines.machine.rotor_properties import rotor_properties
from pipelines.machine.shaft import assemble_rotor
from pipelines.stages.parameter_columns import parameter_attributes


def prepare_store(store_path: Path, named_cases: Sequence[NamedCase], argv: Sequence[str]) -> None:
    """Create the store of a configuration, or check that an existing one belongs to it.

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
        group = case_group(named.case_id, "machine")
        if not store.has_group(group):
            write_group(store, group, "machine", *geometry(named.case))


def case_attributes(named: NamedCase) -> dict[str, Any]:
    """Name, origin, initial parameters and scales as JSON values; None for what the machine lacks."""
    scales = named.case.scales
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


def geometry(case: Case) -> tuple[dict[str, Any], dict[str, Any]]:
    """Arrays and attributes of a case's group ``machine``"""
    rotor, bearings = case.rotor, case.bearings
    elements, discs = rotor.single_elements(), rotor.disc_inertias
    materials = list(rotor.materials)
    arrays = {
        "node_position": np.array(rotor.node_positions()),
        "element_length": np.array([element.length for element in elements]),
        "element_outer": np.array([element.outer_diameter for element in elements]),
        "element_inner": np.array([element.inner_diameter for element in elements]),
        "element_material": np.array(
            [materials.index(element.material) for element in elements], dtype=np.int32
        ),
        "disc_node": np.array([disc.node for disc in rotor.discs], dtype=np.int32),
        "disc_mass": np.array([disc.mass for disc in discs], dtype=float),
        "disc_diametral_inertia": np.array([disc.diametral for disc in discs], dtype=float),
        "disc_polar_inertia": np.array([disc.polar for disc in discs], dtype=float),
        # I_p = m d^2 / 8 of a thin disc
        "disc_diameter_equivalent": np.array(
            [np.sqrt(8.0 * disc.polar / disc.mass) if disc.mass > 0.0 else 0.0 for disc in discs]
        ),
        "support_node": np.array([support.node for support in rotor.supports], dtype=np.int32),
        "bearing_node": np.array([bearing.node for bearing in bearings], dtype=np.int32),
        "bearing_radius": np.array([bearing.radius for bearing in bearings]),
        "bearing_length": np.array([bearing.length for bearing in bearings]),
        "bearing_clearance": np.array([bearing.clearance for bearing in bearings]),
        "master_node": np.array(rotor.master_nodes, dtype=np.int32),
    }
    return arrays | _rare_arrays(rotor), {"material_names": materials, "rotor": _properties(case)}


def _properties(case: Case) -> dict[str, Any]:
    """Mass [kg], centre of gravity [m], moments of inertia [kg m2] and static loads of the bearings [N]."""
    nodes = [bearing.node for bearing in case.bearings]
    return asdict(rotor_properties(assemble_rotor(case.rotor), nodes))


def _rare_arrays(rotor: Rotor) -> dict[str, Any]:
    """Arrays of cones, axial forces, discs by dimensions and kept slopes, where the rotor has them."""
    arrays: dict[str, Any] = {}
    elements = rotor.single_elements()
    if any(element.is_cone for element in elements):
        outer, inner = zip(*(element.right_diameters for element in elements), strict=True)
        arrays |= {"element_outer_right": np.array(outer), "element_inner_right": np.array(inner)}
    if any(element.axial_force for element in elements):
        arrays["element_axial_force"] = np.array([element.axial_force for element in elements])
    if any(disc.has_dimensions for disc in rotor.discs):
        unknown = (np.nan, np.nan, np.nan)
        sizes = [
            (disc.outer_diameter, disc.inner_diameter, disc.width) if disc.has_dimensions else unknown
            for disc in rotor.discs
        ]
        names = ("disc_outer", "disc_inner", "disc_width")
        arrays |= dict(zip(names, np.array(sizes, dtype=float).T.copy(), strict=True))
    if rotor.slope_nodes:
        arrays["slope_node"] = np.array(rotor.slope_nodes, dtype=np.int32)
    return arrays
