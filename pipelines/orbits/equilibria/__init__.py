"""Equilibria and small motions about them.

- equilibrium: damped Newton for a film or the machine
- linear: bearing coefficients, leading eigenvalues, the speed of instability
- static_deflection: bearing reactions, the shaft under its weight
- bearing_coefficients: stiffness and damping of the bearings over the whirl frequency
- modes: oscillating modes at one speed, and their matching between speeds
- campbell: modes followed over the speed
- followed_mode: one mode, followed to any speed
- synchronous_response: motion under unbalance over the speed, and its peaks
- critical_speeds: critical speeds, their count, predicted parametric resonances
"""
