"""`agfb run`: the chain."""

from __future__ import annotations

from agfb_cli.commands.figures import draw_beside
from agfb_cli.commands.stage import Outcome, Request, close, stage_command
from agfb_cli.console import Console
from agfb_cli.options import NO_FIGURES, REFINE

HELP = """Run all analyses of a case and draw the figures.

Runs linearize, criticals and continue-cycles for every case, then searches the plane of [track_curves] for
all bifurcation curves as [bifurcation_set] says (with bifurcation_set.certify compared with a survey and
searched on where they disagree), and draws the figures into the directory NAME-figures beside the store
NAME.zarr.
"""

CHAIN = ("linearize", "criticals", "continue_cycles", "bifurcation_set")


def _conclude(outcome: Outcome, request: Request, console: Console) -> None:
    """Draw, and show everything."""
    close(outcome, request, console, None if request.own["no_figures"] else draw_beside)


run = stage_command(CHAIN, (REFINE, NO_FIGURES), conclude=_conclude)
