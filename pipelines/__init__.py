"""The computations of agfb, in layers: each layer imports only the layers below it.

- stages: a case in, groups of a store out; the scheduling of many cases
- figures: pictures, drawn from stores alone
- datasets: stores of results
- bifurcations: continuation of cycles, bifurcation curves and tori
- orbits: dynamical systems, period maps, cycles, equilibria, runs in time
- machine: rotor, gas films, foils and active rings, compiled
- case: the description of a case
"""
