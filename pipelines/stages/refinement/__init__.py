"""Recompute bifurcations on finer grids.

- refine: the stage
- points: the bifurcation points to recompute
- levels: one point on a family of grids
- extrapolation: Richardson extrapolation and observed order
"""
