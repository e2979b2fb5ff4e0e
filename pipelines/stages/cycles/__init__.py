"""Compute branches of cycles into a store.

- continue_cycles: the stage
- problem: the continuation problem of a case
- start: the first cycle of a branch
- branch: one branch: start, continue, resume, end
- rows: points of a branch as rows, and back
"""
