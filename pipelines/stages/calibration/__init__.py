"""Keys fitted to target thresholds.

- calibrate: the stage
- targets: what a machine reaches of the targets
- onset_speed: the lowest speed of instability
- fit: bounded least squares
- report: the result of a stored calibration
"""
