"""The machine in dimensionless form: rotor, films and rings, compiled, with their derivatives.

Numbered equations, such as Eq. 1, are those of the paper whose model this is (see ``CITATION.cff``).

- shaft, condensation, condensation_check, condensation_error: finite-element rotor, its condensation, and
  the error of the condensation
- rotor_modes, critical_map, rotor_properties, unbalance: linear vibrations of the rotor; critical speeds over
  the support stiffness; its mass and inertia; the force of its unbalance
- axial, film, film_force: the gas film of one bearing and its force
- lanes, plain_lanes, vector_lanes: sums over columns side by side, in vector registers where possible, and
  arrays without reference counts
- inverse: the inverse of a small matrix
- ring, bearing, regrid: the active ring; a bearing with its unknowns; a state on another grid
- sparse_pattern: sparse matrices whose entries change and whose places do not
- kernels, rates, shifted, extremes: the compiled machine: signatures, rates and Jacobian action, linear
  systems of implicit steps, extremes of the films
- assembly: the machine of a case
"""
