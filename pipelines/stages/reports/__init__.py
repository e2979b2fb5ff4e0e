"""Conclusions from stored results.

- first_boundary: the first bifurcation above the lowest speed
- margin: distances of the operating point from the boundaries of stable cycles
- operating_range: `agfb report`
- rotor_at_rest: mass, centre of gravity, static loads of the bearings
- survey_summary: what it says of a survey
- paper_comparison: `agfb compare-paper`
- verify: `agfb verify`
"""
