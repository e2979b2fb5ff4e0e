"""Preloaded by a worker, it kills the process as soon as one case is computed."""

from __future__ import annotations

import os
import signal
from collections.abc import Mapping
from typing import Any

from pipelines.stages.scheduling import campaign, tasks

POISONED = "displacement=0.2"


def poisoned(work: Mapping[str, Any], *others: Any) -> dict[str, Any]:
    if work["case"]["case_id"] == POISONED:
        os.kill(os.getpid(), signal.SIGKILL)
    return tasks.ask_plan(work, *others)


campaign.ask_plan = poisoned
