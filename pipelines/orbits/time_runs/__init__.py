"""Time integration of the driven machine, and the analysis of its samples.

- drive: speed and ring excitation over time, in smooth pieces
- transient: the integration
- unbalanced_map: the machine with unbalance over one excitation period
- envelope, poincare, spectrum: envelopes and growth; Poincare points; amplitude spectra
- modal_energy: energy by mode of the free rotor
- classification: the kind of motion, with the evidence
"""
