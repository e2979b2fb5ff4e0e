"""Compute transients into a store.

- transient: the stage
- start: where a run starts
- run: its request, drive, time steps and place in the store
- analysis: what its samples tell
"""
