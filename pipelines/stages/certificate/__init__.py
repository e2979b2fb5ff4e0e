"""Whether the bifurcation curves of a plane explain the stability that was found at its points.

- crossings: where straight paths through the plane meet the curves, and what that does to the count
- agreement: cells and pairs of cells compared with the curves between them
- asked: the lines that a search shall add, through the cells that disagree
- comparison: both together, with random points: whether the curves are certified
- certify: a certificate made from what a store holds, as a group of it
- summary: a certificate in numbers and words, also a stored one
"""
