"""Linear analyses along the speed.

- linearize: equilibria, bearing coefficients, eigenvalues
- criticals: Campbell diagram, critical speeds, predicted resonances
- condensed_modes: how far the condensed rotor is off
- missing_speeds: speeds without equilibrium
"""
