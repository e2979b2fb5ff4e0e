"""Scheduling of the stages of many cases.

- registry: the stages by name
- tasks: one stage on one case; how it ended, recorded in the store
- first_run: compiling the kernels in two processes
- pool, campaign: where tasks run; the tasks of many cases on a Dask cluster
- agenda: what of many cases may be computed now
- preparation: the store that a run writes to
- durations, plan: timed pieces of work; plan of a dry run
"""
