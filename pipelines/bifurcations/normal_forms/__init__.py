"""Critical normal forms.

- coefficients: normal-form coefficients of the period map (Kuznetsov)
- section: the return map to a section, for cycles of unknown period
- smoothed: normal forms of piecewise smooth maps
"""
