"""`agfb linearize`."""

from __future__ import annotations

from agfb_cli.commands.stage import stage_command

HELP = """Equilibria, eigenvalues and the instability speed.

Also stiffness and damping of the bearings, and static deflection, reactions and modes at the operating
point. Follows the equilibrium of every case over linearize.speed_range with the active rings at their mean
deformation. Lists speeds without equilibrium; the case fails if these are more than a tenth, or if the
instability lies between them. Writes cases/CASE/linear and cases/CASE/operating_point into the store.
"""

linearize = stage_command(("linearize",))
