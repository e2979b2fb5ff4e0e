"""Figures drawn from stores alone: nothing here computes physics.

- drawing: all figures of a store: which exist, what they need, where their files go
- contents, case_tables, runs, several_cases: data of the figures
- axes, placement, style: axes with dimensional twins; positions of labels; common style
- machine_drawing, operating_point, coefficients: the machine, its operating point, its bearings
- linearization, campbell, critical_map, condensation, bode, polar: its linear behaviour over the speed
- bifurcation_diagram, bifurcation_tree, multipliers, orbits, refinement: branches of cycles
- stability_map, map_sets, resonance_lines: bifurcation sets in the plane
- survey: growth rates over the plane, cell by cell
- certificate: where the curves do not explain the stability
- response_envelope, run_motion, tori: transients and tori
- page: the report of a store as one HTML page
- changes: the first bifurcation with one change of the keys at a time
- on_axes: the main figures on axes of your own
- sensitivity: results over the keys in which the cases differ
"""
