"""Critical cycles: what makes a cycle a bifurcation, and how it is corrected.

- cycle_manifold: the surface of cycles over a plane of two parameters
- critical_cycles: test function, critical vectors and their derivatives
- critical_pair: invariant plane of the critical pair of a Neimark-Sacker curve
- testfunctions: test function of each kind of curve
- bordering: bordering vectors: their start, and their update along a curve
- correction: input and result of both correctors
- extended_system: corrector with the critical vectors as unknowns (Eq. 20, 21)
- corrector: bordered corrector of a curve
"""
