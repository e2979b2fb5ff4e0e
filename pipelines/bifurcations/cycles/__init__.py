"""Pieces of a branch of cycles.

- segment: the metric of a branch, and the piece between two cycles
- branch_points: the cycle at a branch point, between cycles beside it
- crossing_cycles: where a branch meets the branch that it was born on: own period doubling, own pitchfork
- double_crossings: two bifurcations within one step
"""
