"""Tori as invariant curves of the period map.

- fourier: trigonometric interpolation on the circle
- circle_map: maps over a circle of angles
- problem: problem, unknowns, closing condition, metric
- system: the linear system of Newton-Picard
- slow_bases: slow subspaces along a curve
- invariant_curve: the corrector
- stability, events: the spectrum of the linearised flow; bifurcations between two tori
- torus, segment, continuation: branches of tori: options and results; one step; the continuation
- start: where branches of tori start
"""
