"""`agfb continue-tori`."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

from agfb_cli.commands.stage import stage_command

if TYPE_CHECKING:
    from pipelines.case.reading import NamedCase

HELP = """Quasi-periodic orbits and their stability.

Continues branches of tori in the parameter continue_tori.parameter. With continue_tori.origin =
"neimark_sacker" they are born at the Neimark-Sacker points of the branch of continue-cycles, which is
computed first if the store has none; with "unbalance" they are the motion of the rotor with the table
[unbalance] under excitation. Every point is committed as it is found; an interrupted branch resumes from its
last point. Writes cases/CASE/tori/q000, ... (u000, ... with unbalance) into the store.
"""


def _stages(named_cases: Sequence[NamedCase]) -> tuple[str, ...]:
    """Unbalance needs no branch of cycles."""
    born = any(named.case.continue_tori.origin == "neimark_sacker" for named in named_cases)
    return ("continue_cycles", "continue_tori") if born else ("continue_tori",)


continue_tori = stage_command(_stages)
