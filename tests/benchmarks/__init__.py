"""Measurements behind the table of configs/performance.md, not tests: ``python -m tests.benchmarks``.

One BLAS thread, as the command sets it for itself, and set before numpy is imported.
"""

from __future__ import annotations

import os

for name in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"):
    os.environ.setdefault(name, "1")
