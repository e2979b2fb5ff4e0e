"""The inverse of a small matrix: compiling that of numpy takes twelve seconds, and a call of it allocates."""

from __future__ import annotations

import numpy as np
from numba import types

from .kernels import kernel

_MATRIX = types.float64[:, ::1]


@kernel(types.void(_MATRIX, _MATRIX), error_model="numpy")
def invert(matrix, out):  # type: ignore[no-untyped-def]
    """out = matrix^-1 by Gauss-Jordan elimination with row pivots; ``matrix`` is lost.

    NaN if the matrix is not finite or singular.
    """
    size = matrix.shape[0]
    out[:] = 0.0
    for i in range(size):
        out[i, i] = 1.0
    for k in range(size):
        pivot = k
        for i in range(k + 1, size):
            if abs(matrix[i, k]) > abs(matrix[pivot, k]):
                pivot = i
        for j in range(size):
            matrix[k, j], matrix[pivot, j] = matrix[pivot, j], matrix[k, j]
            out[k, j], out[pivot, j] = out[pivot, j], out[k, j]
        if not np.isfinite(matrix[k, k]):
            out[:] = np.nan
            return
        scale = 1.0 / matrix[k, k]
        for j in range(size):
            matrix[k, j] *= scale
            out[k, j] *= scale
        for i in range(size):
            factor = matrix[i, k]
            if i != k and factor != 0.0:
                for j in range(size):
                    matrix[i, j] -= factor * matrix[k, j]
                    out[i, j] -= factor * out[k, j]
