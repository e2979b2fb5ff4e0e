"""Figures drawn from stores alone: nothing here computes physics.

- drawing: all figures of a store: which exist, what they need, where their files go
- contents, case_tables, runs, several_cases: data of the figures
- axes, placement, style: axes with dimensional twins; positions of labels; common style
- on_axes: the main figures on axes of your own
- machine_drawing, linearization, campbell, condensation, bode: the machine and its linear behaviour
- bifurcation_diagram, bifurcation_tree, multipliers, orbits, refinement: branches of cycles
- stability_map, map_sets, resonance_lines: bifurcation sets in the plane
- survey: growth rates over the plane, cell by cell
- response_envelope, run_motion, tori: transients and tori
- changes: the first bifurcation with one change of the keys at a time
- sensitivity: results over the keys in which the cases differ
"""
