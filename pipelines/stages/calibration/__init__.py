"""Fit keys to target thresholds.

- calibrate: the stage
- targets: values that a machine reaches for the targets
- onset_speed: the lowest speed of instability
- fit: bounded least squares
- report: report on a stored calibration
"""
