"""One pass over a period: orbit, tangent columns and parameter columns.

- propagation: explicit Runge-Kutta steppers
- implicit: diagonally implicit Runge-Kutta steppers
- passes: how both are called
"""
