"""Fit keys to target thresholds.

- calibrate: the stage
- targets: values that a machine reaches for the targets
- doubling: how far cycles are from a period doubling, and the corner of both curves
- onset_nearby: an onset speed near a known one, from cycles found alone
- onset_speed: the lowest speed of instability
- fit: bounded least squares
- report: report on a stored calibration
"""
