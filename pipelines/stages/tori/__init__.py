"""Compute branches of tori into a store.

- continue_tori: the stage
- sources: where branches begin
- branch: one branch: started, followed, resumed, ended
- rows: tori as rows, and back
"""
