"""Linear analyses along the speed.

- linearize: equilibria, bearing coefficients, eigenvalues
- operating_point: static deflection, bearings and modes at the operating speed
- coefficients: stiffness and damping of the bearings over speed and whirl frequency
- criticals: Campbell diagram, critical speeds, predicted resonances
- unbalance_response: amplitude and phase under unbalance, amplification factors
- condensed_modes: error of the condensed rotor
- along_speed, missing_speeds: what they share: following the equilibrium; speeds without equilibrium
"""
