"""Compute branches of cycles into a store.

- continue_cycles: the stage
- problem: from a case to the continuation problem
- start: the first cycle of a branch
- branch: one branch: started, followed, resumed, ended
- rows: points of a branch as rows, and back
"""
