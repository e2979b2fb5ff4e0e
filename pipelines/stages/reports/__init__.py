"""Conclusions from stored results.

- first_boundary: the first bifurcation above the lowest speed
- operating_range: `agfb report`
- survey_summary: what it says of a survey
- paper_planes: the bifurcation sets of the paper's cases
- paper_rows: rows of the comparison with the paper, and the verdict on each
- paper_statements: what the paper states in words
- paper_comparison: `agfb compare-paper`
- verify: `agfb verify`
"""
