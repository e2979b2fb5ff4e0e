"""Continuation of cycles, of bifurcation curves and of tori.

- continuation: the driver of all continuations: steps, their lengths, the state that is stored
- acceptance: the rule by which a step is accepted
- branch, arclength: branches of cycles: options and results; the continuation
- detection, location: detect bifurcations between two cycles by test functions; locate them
- roots: zeros of functions whose every value costs passes
- cycles: parts of the branch continuation: `segment` of a branch, `double_crossings` within it,
  `crossing_cycles` (own doubling, own pitchfork)
- plane: cycles over a plane of two parameters: problem, positions, metric
- curve, curve_continuation: period-doubling, Neimark-Sacker and fold curves: options and results; the
  continuation
- critical: critical cycles: test functions, critical vectors and correctors
- curves: parts of the curve continuation: first point, segment, special points, known curves
- normal_forms: critical normal-form coefficients
- switching: start curves and branches at a bifurcation
- hopf_point: where cycles of an autonomous system are born
- tori: invariant curves of the period map: continuation, stability, starts
"""
