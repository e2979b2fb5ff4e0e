"""Stored arrays in rpm, Hz, s, um, N/m3, N/m and N s/m: which unit an array has, and the factor to it.

Stores are dimensionless. Times, speeds and the rotor are scaled by the first bearing, films by their own one
(`pipelines.datasets.schema` says in the meaning of each array which).
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from pipelines.case.fields import MEASURES, SI_UNITS
from pipelines.case.scales import si_per_unit
from pipelines.datasets.reading import case_attributes, read_group
from pipelines.datasets.records import Group
from pipelines.datasets.schema import FIRST, OWN, ROTOR, Array, ArraySpec
from pipelines.datasets.store import Store, case_group

_OF_BEARINGS = {
    "bearing_stiffness": "N/m",
    "stiffness": "N/m",
    "bearing_damping": "N s/m",
    "damping": "N s/m",
}
"""Arrays over p0 R L/c or p0 R L t0/c of the bearing itself."""
_BY_LAST_WORD = {"speed": "speed", "frequency": "frequency", "time": "time", "period": "time"}
_BY_NAME = {
    "peak_low": "speed",
    "peak_high": "speed",
    "stretch_begin": "time",
    "event_displacement": "displacement",
    "ring_displacement": "displacement",
    "checkpoint_ring_displacement": "displacement",
    "foil_stiffness": "foil_stiffness",
    "event_foil_stiffness": "foil_stiffness",
}
_BY_ATTRIBUTE = {
    "abscissa": ("parameter", 0),
    "along": ("parameters", 0),
    "point_along": ("parameters", 0),
    "across": ("parameters", 1),
    "point_across": ("parameters", 1),
}
"""Arrays of a parameter that an attribute of their group names, the first or the second of two."""
ENDINGS = {
    "rpm": "rpm",
    "Hz": "hz",
    "s": "s",
    "um": "um",
    "N/m3": "n_per_m3",
    "N/m": "n_per_m",
    "N s/m": "ns_per_m",
}
"""What a column's name ends with that shows another column in this unit."""


@dataclass(frozen=True)
class SiUnit:
    """The unit of an array, and what its number 1 is in it."""

    unit: str
    factor: Array
    """One number, or an array that fits all dimensions; NaN for entries with another unit."""

    @property
    def ending(self) -> str:
        """The ending of the names of its columns."""
        return ENDINGS[self.unit]

    def attributes(self) -> dict[str, object]:
        """The unit as attributes of a netCDF variable."""
        factor = self.factor.ravel()
        return {"si_units": self.unit, "si_factor": float(factor[0]) if factor.size == 1 else factor}


@dataclass(frozen=True)
class StoredScales:
    """The scales of a stored case."""

    store: Store
    case: str

    @cached_property
    def _scales(self) -> Mapping[str, float] | None:
        """The ``scales`` of the case; None where they are not stored."""
        return case_attributes(self.store, self.case).get("scales")

    @cached_property
    def scale(self) -> dict[str, float]:
        """What a dimensionless 1 is in the units of `SI_UNITS`; nothing where the scales are not stored."""
        return {} if self._scales is None else scale_of_case(self._scales)

    @cached_property
    def of_bearings(self) -> dict[str, Array]:
        """What a dimensionless 1 of each bearing is: c in um, p0 R L/c in N/m, p0 R L t0/c in N s/m.

        Nothing where the geometry or the scales are not stored.
        """
        name, scales = case_group(self.case, "machine"), self._scales
        if scales is None or not self.store.has_group(name):
            return {}
        machine = read_group(self.store, name, ("bearing_radius", "bearing_length", "bearing_clearance"))
        radius, length, clearance = machine.arrays.values()
        stiffness = scales["pressure"] * radius * length / clearance
        return {"um": 1e6 * clearance, "N/m": stiffness, "N s/m": stiffness * scales["time"]}

    def si_unit(self, group: Group, spec: ArraySpec) -> SiUnit | None:
        """The unit of an array of a group; None for what has none, or has its unit already."""
        if spec.units != "1" or spec.dtype not in ("float64", "complex128") or not self.scale:
            return None
        if (measures := _OF_BEARINGS.get(spec.name)) is not None:
            return self._of_own_bearing(spec.dimensions, measures)
        if ROTOR in spec.long_name:
            return self._of_coordinates(group, spec.dimensions)
        if (quantity := quantity_of(spec, group.attributes)) is not None:
            return SiUnit(SI_UNITS[quantity], np.array(self.scale[quantity]))
        return self._of_own_bearing(spec.dimensions, "um") if OWN in spec.long_name else None

    def _of_own_bearing(self, dimensions: tuple[str, ...], unit: str) -> SiUnit | None:
        if "bearing" not in dimensions or not self.of_bearings:
            return None
        shape = [-1 if name == "bearing" else 1 for name in dimensions]
        return SiUnit(unit, self.of_bearings[unit].reshape(shape))

    def _of_coordinates(self, group: Group, dimensions: tuple[str, ...]) -> SiUnit | None:
        """Displacements of the rotor's coordinates; its slopes have another unit."""
        if "coordinate" not in dimensions or "coordinate_axis" not in group.attributes["arrays"]:
            return None
        axes = read_group(self.store, group.name, ("coordinate_axis",)).labels("coordinate_axis")
        factor = np.where(np.isin(axes, ("x", "y")), self.scale["displacement"], np.nan)
        return SiUnit("um", factor.reshape([-1 if name == "coordinate" else 1 for name in dimensions]))


def scale_of_case(scales: Mapping[str, float]) -> dict[str, float]:
    """What a dimensionless 1 is in the units of `SI_UNITS`, from the ``scales`` of a stored case."""
    return si_per_unit(scales["time"], scales["displacement"], scales["pressure"])


def quantity_of(spec: ArraySpec, attributes: Mapping[str, object]) -> str | None:
    """What an array measures in the scales of the first bearing, one of `SI_UNITS`; None for other arrays."""
    if spec.name in _BY_ATTRIBUTE:
        attribute, place = _BY_ATTRIBUTE[spec.name]
        named = attributes.get(attribute)
        name = named[place] if isinstance(named, list) else named
        return MEASURES.get(str(name))
    if spec.name in _BY_NAME:
        return _BY_NAME[spec.name]
    if spec.name == "displacement" or FIRST in spec.long_name.partition("(")[0]:
        return "displacement"
    return _BY_LAST_WORD.get(spec.name.rpartition("_")[2])
