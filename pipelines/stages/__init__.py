"""Stages: compute groups of a store from a case, and schedule many cases.

- results: progress reports and result of a stage
- job: a case with its machine and its store
- parts: what of a stage may be computed side by side
- parameter_columns: parameters of a solution as columns, and back
- step_errors: points whose time-step error is unknown
- regularised: points of curves that were computed with regularised clipping
- ending: the reason why a branch or curve ended, and whether it is a success
- pass_counts: passes over the period that pieces of work take
- linear: `agfb linearize`, `coefficients`, `criticals` and `unbalance-response`
- cycles: `agfb continue-cycles`: branches of cycles
- survey: `agfb survey`: stability over a grid of the plane
- certificate: whether curves explain the stability of their plane
- curves: `agfb track-pd`, `track-ns`, `track-folds`, and the search of `agfb run` for the whole set
- plane: the same search for equations of one's own, in memory
- transients: `agfb transient`: transients and their analysis
- tori: `agfb continue-tori`: branches of tori
- refinement: `--refine`: discretisation errors of bifurcations
- calibration: `agfb calibrate`
- reports: `agfb report`, `compare-paper`, `verify`: from stored results
- scheduling: registry of the stages, tasks, campaigns of many cases, plans
"""
