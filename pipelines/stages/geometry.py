"""The machine's geometry as the figures draw it: plain arrays in SI units."""

from __future__ import annotations

from typing import Any

import numpy as np

from pipelines.case.models import Case


def geometry(case: Case) -> tuple[dict[str, Any], dict[str, Any]]:
    """Arrays and attributes of a case's group ``machine``."""
    rotor, bearings = case.rotor, case.bearings
    elements = rotor.single_elements()
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
        "disc_mass": np.array([disc.mass for disc in rotor.discs], dtype=float),
        "disc_diametral_inertia": np.array([disc.diametral_inertia for disc in rotor.discs], dtype=float),
        "disc_polar_inertia": np.array([disc.polar_inertia for disc in rotor.discs], dtype=float),
        # I_p = m d^2 / 8 of a thin disc
        "disc_diameter_equivalent": np.array(
            [
                np.sqrt(8.0 * disc.polar_inertia / disc.mass) if disc.mass > 0.0 else 0.0
                for disc in rotor.discs
            ]
        ),
        "support_node": np.array([support.node for support in rotor.supports], dtype=np.int32),
        "bearing_node": np.array([bearing.node for bearing in bearings], dtype=np.int32),
        "bearing_radius": np.array([bearing.radius for bearing in bearings]),
        "bearing_length": np.array([bearing.length for bearing in bearings]),
        "bearing_clearance": np.array([bearing.clearance for bearing in bearings]),
        "master_node": np.array(rotor.master_nodes, dtype=np.int32),
    }
    if rotor.slope_nodes:
        arrays["slope_node"] = np.array(rotor.slope_nodes, dtype=np.int32)
    return arrays, {"material_names": materials}
