"""Bifurcation curves into a store.

- track_curves: the stages of period-doubling, Neimark-Sacker and fold curves
- starts: where curves can start, and which start comes next
- rows: points of a curve as rows, and back
- bifurcation_set: the search for the whole set
"""
