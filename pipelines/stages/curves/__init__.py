"""Stages that trace bifurcation curves and write them into a store.

- track_curves: the stages of period-doubling, Neimark-Sacker and fold curves
- parts: the curves of a case as parts of a stage, some of them traced ahead of their turn
- tracing: one curve in its group
- starts: where curves can start, and which start comes next
- rows: conversion of the points of a curve to rows of the store, and back
- lines: the branches along which a search crosses the plane
- outlook: how much of a search is left
- open_ends: ends inside the plane from which no curve goes on
- bifurcation_set: the search for all bifurcation curves of a plane
"""
