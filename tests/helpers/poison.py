"""Preloaded by a worker, it kills the process as soon as one case is computed."""

from __future__ import annotations

import os
import signal
from collections.abc import Mapping
from typing import Any

from pipelines.stages.scheduling import campaign

POISONED = "displacement=0.2"


def poisoned(work: Mapping[str, Any], *others: Any) -> dict[str, Any]:
    if work["case"]["case_id"] == POISONED:
        os.kill(os.getpid(), signal.SIGKILL)
    return carry_out(work, *others)


carry_out = campaign.carry_out
campaign.carry_out = poisoned
