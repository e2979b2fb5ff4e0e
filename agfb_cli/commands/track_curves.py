"""`agfb track-pd`, `agfb track-ns` and `agfb track-folds`."""

from __future__ import annotations

from agfb_cli.commands.stage import stage_command
from agfb_cli.options import REFINE

_COMMON = """
Curves start at every bifurcation of this kind on the stored branches, and where they meet stored curves (at
R1, R2 and second bifurcations). They run over the plane [track_curves] and end at its border, on themselves
or at a resonance; points of codimension two are located on the way. If the store has no branch,
continue-cycles computes one first. Every point is committed as it is found. Writes"""

PERIOD_DOUBLING_HELP = f"Curves of period doublings over two parameters.\n{_COMMON} cases/CASE/pd/c000, ...\n"
NEIMARK_SACKER_HELP = (
    f"Curves of Neimark-Sacker points over two parameters.\n{_COMMON} cases/CASE/ns/c000, ...\n"
)
FOLD_HELP = f"Curves of folds of cycles over two parameters.\n{_COMMON} cases/CASE/folds/c000, ...\n"

track_pd = stage_command(("continue_cycles", "track_pd"), (REFINE,))
track_ns = stage_command(("continue_cycles", "track_ns"), (REFINE,))
track_folds = stage_command(("continue_cycles", "track_folds"), (REFINE,))
