"""The description of a case: models, units and scales, sweep expansion, identity."""
