"""One pass over a period: orbit, tangent columns and parameter columns.

- equations: what a pass integrates, with the oscillator of Eq. 17, and its derivatives
- propagation: explicit Runge-Kutta steppers
- esdirk, implicit: a step of diagonally implicit Runge-Kutta steppers; a pass with them
- passes: how both are called
"""
