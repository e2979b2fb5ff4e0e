"""Compute transients into a store.

- transient: the stage
- start: the initial condition
- run: its request, drive, time steps and place in the store
- analysis: analysis of the samples
"""
