"""Pieces of a bifurcation curve.

- first_point: the first point: bordering, tangent, sense
- segment: the end of a step, the piece before it, and special points on it
- kinks: how a curve passes the kinks of a map that is only piecewise smooth
- codimension_two: test functions of special points
- double_passages: special points passed twice within a step
- tongues: real multipliers between two strong resonances of a Neimark-Sacker curve
- fixed_parameter: a bifurcation point with one parameter held
- stored_curves: whether a point lies on a known curve
"""
