"""`agfb continue-cycles`, also called `agfb continue`."""

from __future__ import annotations

from agfb_cli.commands.stage import stage_command
from agfb_cli.options import REFINE

HELP = """Limit cycles, Floquet multipliers and bifurcations.

Continues a branch of limit cycles in the parameter continue_cycles.parameter over continue_cycles.range, and
locates folds, period doublings and Neimark-Sacker points on it. Every point is committed as it is found; an
interrupted branch resumes from its last point. With continue_cycles.doublings the branches of period-doubled
cycles follow. Writes cases/CASE/cycles/b000 (and d000, ...) into the store.
"""

continue_cycles = stage_command(("continue_cycles",), (REFINE,))
