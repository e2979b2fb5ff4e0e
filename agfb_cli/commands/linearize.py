"""`agfb linearize`."""

from __future__ import annotations

from agfb_cli.commands.stage import stage_command

HELP = """Equilibria along the rotating speed, eigenvalues, bearing coefficients and the instability speed.

Follows the equilibrium of every case over linearize.speed_range with the active rings at their mean
deformation. Writes cases/CASE/linear into the store.
"""

linearize = stage_command(("linearize",))
