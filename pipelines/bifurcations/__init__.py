"""Continuation of cycles, of bifurcation curves and of tori.

- continuation: the driver of all continuations: steps, their lengths, the state that is stored
- acceptance: the rule by which a step is accepted
- branch, arclength: branches of cycles: options and results; the continuation
- detection, location: bifurcations between two cycles: their test functions; where they are
- cycles: behind these: `segment` of a branch, `double_crossings` within it, `crossing_cycles` (own
  doubling, own pitchfork)
- plane: cycles over a plane of two parameters: problem, positions, metric
- curve, curve_continuation: period-doubling, Neimark-Sacker and fold curves: options and results; the
  continuation
- critical: behind these: test functions, critical vectors and correctors
- curves: behind these: first point, segment, special points, known curves
- normal_forms: critical normal-form coefficients
- switching: from a bifurcation to the curves and branches that start there
- hopf_point: where cycles of an autonomous system are born
- tori: invariant curves of the period map: continuation, stability, starts
"""
