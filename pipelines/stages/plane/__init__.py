"""The bifurcation set of a plane for equations of one's own: in memory, without a case and without a store.

- problem: the plane, how it is searched, and the cycle at a place of it
- survey: the cycles at the cells of a grid and at random points
- tracing: branches along lines of the plane, and the curves that they meet
- search: lines, curves and comparison with the survey, until no place disagrees
"""
