"""`agfb criticals`."""

from __future__ import annotations

from agfb_cli.commands.stage import stage_command

HELP = """Critical speeds, modes and parametric resonances.

Also Campbell data. Compares the full with the condensed rotor: frequencies, decrements, mode shapes and
unbalance response. Writes cases/CASE/criticals into the store.
"""

criticals = stage_command(("criticals",))
