"""Dynamical systems, their period maps, cycles, equilibria and transients.

- system, compiled: definition of a system; systems from Python functions
- solving: linear equations whose matrix may be singular
- vectors: points, directions, metric and constraints of continuations
- steppers: Runge-Kutta tableaux
- integration: one pass over a period: `propagation` explicit, `implicit` diagonally implicit
- period_map: the map over one period and its derivatives
- floquet: multipliers from the slow invariant subspace
- shooting: Newton-Picard shooting for cycles
- time_steps: number of time steps per period, and the error that they leave
- harmonic_balance, forced_cycle: cycles without a cycle beside them; their leading multipliers
- grazing: where an orbit touches the ambient pressure without slope
- hopf_start, machine_cycles: the first cycle beside a Hopf point; the machine as a system, and the shape of
  its cycles
- equilibria: `equilibrium`, `linear` (coefficients, eigenvalues), `modes`, `campbell`, `critical_speeds`
- time_runs: `transient` along a `drive`, with unbalance over a period in `unbalanced_map`; `envelope`,
  `poincare`, `spectrum`, `modal_energy`, `classification`
"""
