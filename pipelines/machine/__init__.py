"""The machine in dimensionless form: rotor, films and rings, compiled, with their derivatives.

- shaft, condensation, condensation_check, condensation_error: finite-element rotor, its condensation, and
  how far that is off
- rotor_modes, unbalance: linear vibrations of the rotor; the force of its unbalance
- axial, film, film_force: the gas film of one bearing and its force
- lanes, plain_lanes, vector_lanes: sums over columns side by side, in vector registers where possible
- ring, bearing, regrid: the active ring; a bearing with its unknowns; a state on another grid
- sparse_pattern: sparse matrices with fixed places
- kernels, rates, shifted, extremes: the compiled machine: signatures, rates and Jacobian action, implicit
  steps, extremes of the films
- assembly: the machine of a case
"""
