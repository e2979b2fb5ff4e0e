"""Stores: the only package that touches result files.

- schema, layout, metadata: what a store holds, as data; its arrays on the disk; its `zarr.json` files
- chunks, durable, locking: one chunk, one file; files that survive; one writer per group
- store, branch: making and opening a store; writing groups, branches row by row
- records, reading, curves: rows in memory; groups as plain arrays; curves between their points
- provenance, failures: where a store comes from; which stages failed
- integrity, comparison, watching: is a store whole; two stores against each other; a store seen from
  outside
- exporting: files of other programs
- errors: what can be wrong with a store
"""
