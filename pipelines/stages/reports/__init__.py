"""Conclusions from stored results.

- machine_summary: what `agfb validate` tells of a machine
- first_boundary: the first bifurcation above the lowest speed
- margin: distances of the operating point from the boundaries of stable cycles
- operating_range: `agfb report`
- survey_summary: what it says of a survey
- paper_planes: the bifurcation sets of the paper's cases
- paper_rows: rows of the comparison with the paper, and the verdict on each
- paper_statements: what the paper states in words
- paper_comparison: `agfb compare-paper`
- verify: `agfb verify`
- verify_plane: `agfb verify --plane`: whether the curves explain the stability of their plane
"""
