"""The computations of agfb, in layers: each layer imports only the layers below it.

- stages: groups of a store, computed from a case; scheduling of many cases
- figures: drawn from stores alone
- datasets: stores of results
- bifurcations: continuation of cycles, bifurcation curves and tori
- orbits: dynamical systems, period maps, cycles, equilibria, transients
- machine: rotor, gas films, foils and active rings, compiled
- case: the description of a case
"""
