"""Recompute bifurcations on finer grids.

- refine: the stage
- points: which bifurcations are worth it
- levels: one point on a family of grids
- extrapolation: Richardson extrapolation and observed order
"""
