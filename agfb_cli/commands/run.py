"""`agfb run`: the chain."""

from __future__ import annotations

from agfb_cli.commands.figures import draw_beside
from agfb_cli.commands.stage import stage_command

HELP = """The whole chain and its figures.

Computes linearize, criticals and continue-cycles, then searches the plane of [track_curves] for all curves of
bifurcations as [bifurcation_set] says, one after the other on every case, and draws. Figures go to the
directory NAME-figures beside the store NAME.zarr.
"""

CHAIN = ("linearize", "criticals", "continue_cycles", "bifurcation_set")

run = stage_command(CHAIN, afterwards=draw_beside)
