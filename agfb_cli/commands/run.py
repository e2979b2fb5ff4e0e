"""`agfb run`: the chain."""

from __future__ import annotations

from agfb_cli.commands.figures import draw_beside
from agfb_cli.commands.stage import stage_command

HELP = """The whole chain and its figures.

Computes linearize, criticals and continue-cycles, one after the other on every case, then draws. Figures go
to the directory NAME-figures beside the store NAME.zarr.
"""

run = stage_command(("linearize", "criticals", "continue_cycles"), afterwards=draw_beside)
