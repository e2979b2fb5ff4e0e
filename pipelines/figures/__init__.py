"""Pictures drawn from stores alone: nothing here computes physics.

- drawing: all figures of a store: which there are, what they need, where their files go
- contents, case_tables, runs, several_cases: what figures are drawn from
- axes, placement, style: axes with dimensional twins; places for labels; one look for all
- machine_drawing, linearization, campbell, condensation: the machine and its linear behaviour
- bifurcation_diagram, bifurcation_tree, multipliers, orbits, refinement: branches of cycles
- stability_map, map_sets, resonance_lines: bifurcation sets in the plane
- response_envelope, run_motion, tori: transients and tori
"""
