"""One BLAS thread for every test, as the command sets it for itself: spinning threads slow small matrices.

Set before numpy is imported.
"""

from __future__ import annotations

import os

for name in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"):
    os.environ.setdefault(name, "1")
