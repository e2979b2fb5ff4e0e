"""Survey the stability of cycles over a grid of two parameters.

- survey: the stage
- line: one line of the grid: its cycles, as a row of the store
- onsets: where the growth rate passes zero
"""
