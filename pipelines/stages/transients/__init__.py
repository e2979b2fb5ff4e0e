"""Transients: time integration of a case into a store.

- transient: the stage
- start: where a run starts
- run: its request, drive, time steps and place in the store
- analysis: envelopes, spectra and kind of motion of its samples
"""
