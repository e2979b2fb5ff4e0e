"""`agfb verify --plane`: do the stored curves explain the stability everywhere in their plane?

Each case is compared with its survey, which is computed if the store has none, and with cycles at random
points (`pipelines.stages.certificate`). The certificate is the group ``certificate/verified``, unless the
search has left one of the same curves.
"""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

from pipelines.case.reading import stage_problems
from pipelines.datasets.reading import list_cases
from pipelines.datasets.store import open_for_reading
from pipelines.stages.certificate.certify import CONTAINER, Request, certify, checksum, stored_curves
from pipelines.stages.certificate.summary import Summary
from pipelines.stages.job import Job
from pipelines.stages.parts import compute_alone
from pipelines.stages.reports.verify import stored_case
from pipelines.stages.results import Report
from pipelines.stages.survey.survey import SurveyPlan

VERIFIED = f"{CONTAINER}/verified"
SET = "bifurcation_set"


def verify_plane(store_path: Path, report: Report) -> Iterator[tuple[str, Summary | str]]:
    """The certificate of each case of a store, or why it has none.

    Raises StoreError, OSError for a store that cannot be written.
    """
    store = open_for_reading(store_path)
    for case_id in list_cases(store):
        named = stored_case(store, case_id)
        reason = next((problem.message for problem in stage_problems(named, ("survey",))), None)
        if reason is not None:
            yield case_id, f"its plane cannot be surveyed: {reason}"
            continue
        yield case_id, _certified(Job.of("verify", named, store_path, report, lambda: False))


def _certified(job: Job) -> Summary:
    """A certificate of the stored curves, taken from the store if it has one."""
    compute_alone(SurveyPlan(job))
    searched = job.read(SET, ()).attributes if job.groups(SET) else {}
    request = Request.of_search(searched)
    group = _same(job, request)
    if group is None:
        group = VERIFIED
        certify(job, group, request)
    return Summary.stored(job.read(group))


def _same(job: Job, request: Request) -> str | None:
    """The newest certificate of the same curves for the same request."""
    now = checksum(stored_curves(job))
    for group in reversed(job.groups(CONTAINER)):
        attributes = job.read(group, ()).attributes
        if attributes["curves_checksum"] == now and request.is_of(attributes):
            return group
    return None
