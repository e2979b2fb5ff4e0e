"""Linear analyses along the speed.

- linearize: equilibria, bearing coefficients, eigenvalues
- criticals: Campbell diagram, critical speeds, predicted resonances
- condensed_modes: error of the condensed rotor
- missing_speeds: speeds without equilibrium
"""
