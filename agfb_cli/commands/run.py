"""`agfb run`: the chain."""

from __future__ import annotations

from agfb_cli.commands.figures import draw_beside
from agfb_cli.commands.stage import stage_command

HELP = """Run all analyses of a case and draw the figures.

Runs linearize, criticals and continue-cycles for every case, then searches the plane of [track_curves] for
all bifurcation curves as [bifurcation_set] says, and draws the figures into the directory NAME-figures
beside the store NAME.zarr.
"""

CHAIN = ("linearize", "criticals", "continue_cycles", "bifurcation_set")

run = stage_command(CHAIN, afterwards=draw_beside)
