"""`agfb survey`."""

from __future__ import annotations

from agfb_cli.commands.stage import stage_command

HELP = """Stability over a grid of the plane, without continuation.

At every cell of a grid over the plane of [track_curves] (table [survey]) the limit cycle is found alone, by
harmonic balance or Newton's method, with its leading Floquet multipliers: the largest growth rate, the
bifurcation behind it (fold, period doubling, Neimark-Sacker) and the number of unstable multipliers.
A first look before the curves are traced, and an independent check of them. Every line of the grid is
committed at once; an interrupted survey resumes after its last line. Writes cases/CASE/survey, which
`agfb figures` draws alone and under the stability map.
"""

survey = stage_command(("survey",))
