"""Survey the stability of cycles over a grid of two parameters.

- survey: the stage
- cells: a cycle of the machine found alone, and what is told of it
- line: one line of the grid: its cycles, as a row of the store
- onsets: where the growth rate passes zero
"""
