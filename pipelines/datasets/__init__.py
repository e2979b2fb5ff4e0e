"""Stores: the only package that touches result files.

- schema, layout, metadata: what a store holds, as data; its arrays on the disk; its `zarr.json` files
- chunks, durable, locking: one chunk, one file; durable files; one writer per group
- store, branch: making and opening a store; writing groups, branches row by row
- moving: another name for a group; groups that are not needed any more
- records, reading, curves: rows in memory; groups as plain arrays; curves between their points
- provenance, failures: where a store comes from; which stages failed
- integrity, comparison, watching: check a store; compare two stores; watch a store from another
  process
- exporting, dimensional: files for other programs; arrays in rpm, Hz, s, um
- coefficient_tables, mode_tables, case_table: tables of bearings and modes; one row for each case
- errors: what can be wrong with a store
"""
