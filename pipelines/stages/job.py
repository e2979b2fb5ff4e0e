"""What every step of a stage on one case needs: case, machine, store, progress callback."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from pipelines.case.fields import MEASURES
from pipelines.case.models import Case
from pipelines.case.reading import NamedCase
from pipelines.case.units import in_both
from pipelines.datasets.errors import CorruptedError
from pipelines.datasets.reading import list_groups, metadata_stamp, read_group
from pipelines.datasets.records import Group
from pipelines.datasets.store import Store, case_group, local_name, open_for_writing
from pipelines.machine.assembly import Machine, build_machine
from pipelines.machine.condensation import master_freedoms
from pipelines.machine.shaft import NODE_FREEDOMS
from pipelines.stages.results import Progress, Report, ShouldStop


@dataclass(frozen=True)
class Job:
    """One stage on one case, or one `part` of it; `stage` is the command named in progress reports."""

    stage: str
    case_id: str
    case: Case
    machine: Machine
    store: Store
    report: Report
    should_stop: ShouldStop
    part: str = ""
    _read: dict[tuple[str, tuple[str, ...] | None], tuple[object, Group]] = field(
        default_factory=dict, repr=False, compare=False
    )

    @classmethod
    def of(
        cls, stage: str, named_case: NamedCase, store_path: Path, report: Report, should_stop: ShouldStop
    ) -> Job:
        """The job from the arguments of a stage."""
        store = open_for_writing(store_path)
        case = named_case.case
        return cls(stage, named_case.case_id, case, build_machine(case), store, report, should_stop)

    def report_progress(self, done: int, total: int | None, message: str) -> None:
        """Report how much is done."""
        self.report(Progress(self.stage, self.case_id, done, total, message, self.part))

    def place(self, parameter: str, value: float) -> str:
        """A value of a parameter in words, in both units: `speed 1.05 (16272 rpm)`."""
        shown = in_both(MEASURES[parameter], value, self.case.scales.si_per_unit, ".5g")
        return f"{parameter.replace('_', ' ')} {shown}"

    def path(self, group: str) -> str:
        """Full name of one of the case's groups: cycles/b000 -> cases/kb10/cycles/b000."""
        return case_group(self.case_id, group)

    def read(self, group: str, names: Sequence[str] | None = None) -> Group:
        """One of the case's groups, read again if something was committed to it since."""
        key = group, None if names is None else tuple(names)
        stamp = metadata_stamp(self.store, self.path(group))
        known = self._read.get(key)
        if known is None or known[0] != stamp:
            known = self._read[key] = stamp, read_group(self.store, self.path(group), names)
        return known[1]

    def groups(self, *containers: str) -> list[str]:
        """The case's groups within containers such as cycles, pd or ns, sorted by name."""
        try:
            found = list_groups(self.store, self.case_id)
        except (CorruptedError, FileNotFoundError):
            found = list_groups(self.store, self.case_id)  # another process has moved a group meanwhile
        known = map(local_name, found)
        return [name for name in known if name.split("/")[0] in containers]


@dataclass(frozen=True)
class Origin:
    """The bifurcation from which a branch or a curve starts: row `event` of a group such as cycles/b000."""

    group: str
    event: int

    def as_dict(self) -> dict[str, str | int]:
        """The origin as a group attribute."""
        return {"group": self.group, "event": self.event}

    @classmethod
    def of(cls, attributes: Mapping[str, object]) -> Origin | None:
        """The origin from the attributes of a group; None without one."""
        stored = attributes.get("origin")
        return cls(str(stored["group"]), int(stored["event"])) if isinstance(stored, dict) else None


def coordinates(case: Case) -> dict[str, Any]:
    """Node and axis of every coordinate of the masters."""
    freedoms = master_freedoms(case.rotor.master_nodes, case.rotor.slope_nodes)
    return {
        "coordinate_node": (freedoms // NODE_FREEDOMS).astype(np.int32),
        "coordinate_axis": (freedoms % NODE_FREEDOMS).astype(np.int8),
    }
