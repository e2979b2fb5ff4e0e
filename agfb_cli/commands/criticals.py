"""`agfb criticals`."""

from __future__ import annotations

from agfb_cli.commands.stage import stage_command

HELP = """Critical speeds, modes and parametric resonances.

Also Campbell data. Compares the full with the condensed rotor: frequencies, decrements, mode shapes and
unbalance response. Speeds are inserted where modes come close. Lists speeds without equilibrium; the case
fails if these are more than a tenth, or if critical speeds may lie between them. Writes cases/CASE/criticals
into the store.
"""

criticals = stage_command(("criticals",))
