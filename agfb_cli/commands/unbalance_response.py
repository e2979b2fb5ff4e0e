"""`agfb unbalance-response`."""

from __future__ import annotations

from agfb_cli.commands.stage import stage_command

HELP = """Unbalance response over the speed, and amplification factors.

Amplitude and phase of the motion at the probes under [unbalance], plane by plane, from the linearised
machine; speeds are inserted near resonances. Each peak has its amplification factor N / (N2 - N1), with the
speeds N1 and N2 of 0.707 of its amplitude (API Std 684). A caution says if a journal moves too far for a
linear response. Writes cases/CASE/unbalance_response into the store.
"""

unbalance_response = stage_command(("unbalance_response",))
