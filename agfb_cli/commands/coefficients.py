"""`agfb coefficients`."""

from __future__ import annotations

from agfb_cli.commands.stage import stage_command

HELP = """Stiffness and damping of the bearings over speed and whirl frequency.

K and C of film and foil in series about the equilibrium of every speed, for journals that whirl at every
frequency of [coefficients]; the active rings rest. Writes cases/CASE/coefficients into the store: `agfb
figures` draws them, `agfb export` writes them in N/m and N s/m, and with --format ross as bearings of ROSS 3.
"""

coefficients = stage_command(("coefficients",))
