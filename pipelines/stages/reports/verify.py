"""`agfb verify`: is a store intact, and do its numbers solve the equations?

Beside the files, a sample of the stored solutions is put into the equations of the stored case again:

    equilibrium   0 = F(s),              cycle   phi_T(s) - s = 0

A cycle is integrated with the time steps and the clipping of its row, so that its residual is what Newton's
method left. A line of a survey, which holds no states, is computed again; its residual is the change of a
multiplier.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from pipelines.bifurcations.switching import with_multiplied_period
from pipelines.case.models import Case
from pipelines.case.reading import NamedCase
from pipelines.case.scales import PARAMETERS
from pipelines.datasets.errors import CorruptedError, StoreError
from pipelines.datasets.integrity import Finding
from pipelines.datasets.integrity import verify as verify_files
from pipelines.datasets.reading import list_cases, list_groups, read_group
from pipelines.datasets.store import Store, open_for_reading
from pipelines.machine import film
from pipelines.machine.assembly import Machine, build_machine, parameter_vector
from pipelines.orbits.equilibria.equilibrium import MEAN_PHASE, at_rest
from pipelines.stages.cycles.problem import cycle_problem, smooth_maps
from pipelines.stages.parameter_columns import stored_parameters
from pipelines.stages.survey.line import compute_line, survey_problem

_SLACK = 10.0  # times the tolerance: another processor rounds differently along a period
_ADVICE = "Its arrays do not belong together: remove the folder {path} and run the same command again"
CYCLES = ("cycles", "curve")

__all__ = ["Checked", "Finding", "stored_case", "verify"]


@dataclass(frozen=True)
class Checked:
    """A stored solution inserted into the equations: its residual and the allowed one."""

    group: str
    row: int
    residual: float
    tolerance: float

    @property
    def holds(self) -> bool:
        return self.residual <= self.tolerance


def verify(store_path: Path, sample: int) -> tuple[list[Finding], list[Checked]]:
    """Everything wrong with a store, and the residuals of up to ``sample`` rows of each group of solutions.

    A group whose files are damaged is not evaluated. Raises StoreError when the root is unusable.
    """
    store = open_for_reading(store_path)
    findings = verify_files(store)
    checked: list[Checked] = []
    if sample > 0:
        damaged = [finding.path for finding in findings if finding.severity == "error"]
        for case, groups in _groups(store, reported=bool(damaged)):
            named = stored_case(store, case)
            machine = build_machine(named.case)
            for group in groups:
                if not any((store.path / group) in (path, *path.parents) for path in damaged):
                    checked += _residuals(store, group, named.case, machine, sample)
    findings += [_finding(store, each) for each in checked if not each.holds]
    return findings, checked


def _groups(store: Store, reported: bool) -> Iterator[tuple[str, list[str]]]:
    """Cases with their groups; none of a case that cannot be listed and whose damage is ``reported``."""
    try:
        for case in list_cases(store):
            yield case, list_groups(store, case)
    except StoreError:
        if not reported:
            raise


def stored_case(store: Store, case: str) -> NamedCase:
    """A case as its store was made from. Raises CorruptedError when it is not in the root's attributes."""
    try:
        return NamedCase.from_dict({"case_id": case, "resolved": store.attributes["configuration"][case]})
    except (KeyError, ValueError) as error:
        raise CorruptedError(
            f"the configuration of the case {case} cannot be read",
            "Use the version that wrote it",
            store.path,
        ) from error


def _residuals(store: Store, group: str, case: Case, machine: Machine, sample: int) -> Iterator[Checked]:
    kind = read_group(store, group, ()).kind
    if kind == "linear":
        yield from _equilibria(store, group, case, machine, sample)
    elif kind in CYCLES:
        yield from _cycles(
            store, group, case, machine, sample, ("clipping_width",) if kind == "curve" else ()
        )
    elif kind == "survey":
        yield from _lines(store, group, case, machine, sample)


def _equilibria(store: Store, group: str, case: Case, machine: Machine, sample: int) -> Iterator[Checked]:
    """Right-hand sides at stored equilibria, compared with the residual that Newton's method left."""
    rows = read_group(store, group, ("speed", "state", "newton_residual"))
    parameters = parameter_vector(case)
    for row in _spread(np.flatnonzero(np.isfinite(rows["state"]).all(axis=1)), sample):
        parameters[film.SPEED] = rows["speed"][row]
        rates = machine.rates(MEAN_PHASE, rows["state"][row], at_rest(parameters))
        left = max(float(rows["newton_residual"][row]), case.numerics.newton_tolerance)
        yield Checked(group, row, float(np.max(np.abs(rates))), _SLACK * left)


def _cycles(
    store: Store, group: str, case: Case, machine: Machine, sample: int, more: tuple[str, ...]
) -> Iterator[Checked]:
    """Mismatches of stored cycles after their period, relative to the largest component.

    Newton's method uses the same scale.  ``more``: further arrays that these cycles have.
    """
    rows = read_group(store, group, ("state", "period", "steps_per_period", *more, *PARAMETERS))
    turns = int(rows.attributes.get("turns", 1))
    exact = with_multiplied_period(cycle_problem(machine, case), turns).period_map
    widths = rows.arrays.get("clipping_width", np.zeros(rows.n_points))
    chosen = _spread(np.arange(rows.n_points), sample)
    regularised = {width: smooth_maps(case, exact, (width,))[0] for width in {*widths[chosen]} if width > 0.0}
    for row in chosen:
        state, parameters = rows["state"][row], stored_parameters(rows.arrays, row)
        steps = int(rows["steps_per_period"][row])
        image = regularised.get(widths[row], exact).evaluate(
            state, parameters, float(rows["period"][row]), steps
        )
        scale = max(1.0, float(np.max(np.abs(state))))
        mismatch = float(np.max(np.abs(image.state - state))) / scale
        yield Checked(group, row, mismatch, _SLACK * case.numerics.newton_tolerance)


def _lines(store: Store, group: str, case: Case, machine: Machine, sample: int) -> Iterator[Checked]:
    """Lines of a survey against the same lines, computed again."""
    rows, problem = read_group(store, group), survey_problem(machine, case, parameter_vector(case))
    for row in _spread(np.arange(rows.n_points), sample):
        again = compute_line(problem, row)
        same = rows["status"][row] == again["status"]
        change = np.abs(rows["multiplier"][row] - again["multiplier"])
        change = np.where(same, np.nan_to_num(change, nan=0.0), np.inf)
        yield Checked(group, row, float(np.max(change)), _SLACK * case.survey.multiplier_tolerance)


def _spread(rows: np.ndarray, count: int) -> list[int]:
    """Up to ``count`` of the rows, including the first and the last."""
    chosen = np.linspace(0, len(rows) - 1, min(count, len(rows)))
    return [int(rows[k]) for k in np.unique(np.round(chosen).astype(int))]


def _finding(store: Store, checked: Checked) -> Finding:
    path = store.path / checked.group
    return Finding(
        path,
        f"row {checked.row} does not solve the equations: residual {checked.residual:.2g}, at most "
        f"{checked.tolerance:.2g} is allowed",
        _ADVICE.format(path=path),
    )
