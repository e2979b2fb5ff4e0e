"""Conclusions from stored results.

- first_boundary: the first bifurcation above the lowest speed
- operating_range: `agfb report`
- survey_summary: what it says of a survey
- paper_comparison: `agfb compare-paper`
- verify: `agfb verify`
- verify_plane: `agfb verify --plane`: whether the curves explain the stability of their plane
"""
