"""Linear analyses along the speed.

- linearize: equilibria, bearing coefficients, eigenvalues
- criticals: Campbell diagram, critical speeds, predicted resonances
- unbalance_response: amplitude and phase under unbalance, amplification factors
- condensed_modes: error of the condensed rotor
- missing_speeds: speeds without equilibrium
"""
