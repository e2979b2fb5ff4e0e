"""One pass over a period: orbit, tangent columns and parameter columns.

- equations: what a pass integrates, with the oscillator of Eq. 17, and its derivatives
- propagation: a pass with an explicit Runge-Kutta stepper
- esdirk, implicit: a step of a diagonally implicit Runge-Kutta stepper; a pass with it
- passes: calls of these compiled loops with their arrays
"""
