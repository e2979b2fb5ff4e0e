"""Pieces of a branch of cycles.

- segment: the metric of a branch, and the piece between two cycles
- branch_points: the cycle at a branch point, between cycles beside it
- crossing_cycles: the branch that a branch was born on, met again: own period doubling, own pitchfork
- double_crossings: two bifurcations within one step
"""
