"""`agfb criticals`."""

from __future__ import annotations

from agfb_cli.commands.stage import stage_command

HELP = """Critical speeds, Campbell data, mode shapes and the parametric resonances that they predict.

Also compares the full with the condensed rotor: frequencies, decrements, mode shapes and unbalance response.
Writes cases/CASE/criticals into the store.
"""

criticals = stage_command(("criticals",))
