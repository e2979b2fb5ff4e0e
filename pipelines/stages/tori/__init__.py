"""Compute branches of tori into a store.

- continue_tori: the stage
- sources: where branches begin
- branch: one branch: start, continue, resume, end
- rows: tori as rows, and back
"""
