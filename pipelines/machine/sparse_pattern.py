"""Sparse matrices whose entries change and whose places do not: they are sorted into columns once."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy import sparse

Places = tuple[NDArray[np.intp], NDArray[np.intp]]  # rows and columns


@dataclass(frozen=True)
class SparsePattern:
    """The places of the entries of a square matrix, each at most once.

    ``places``: in the order in which `matrix` takes the entries.
    ``order``, ``rows``, ``starts``: the entries' permutation to compressed columns, the rows there, and where
    each column starts.
    """

    size: int
    places: Places
    order: NDArray[np.intp]
    rows: NDArray[np.int32]
    starts: NDArray[np.int32]

    @classmethod
    def of(cls, size: int, places: Sequence[Places]) -> SparsePattern:
        """The pattern of blocks of places, one after the other."""
        rows, columns = (np.concatenate(parts) for parts in zip(*places, strict=True))
        numbered = sparse.coo_array((np.arange(len(rows)), (rows, columns)), shape=(size, size)).tocsc()
        return cls(size, (rows, columns), numbered.data, numbered.indices, numbered.indptr)

    def matrix(self, entries: Sequence[NDArray[np.float64]]) -> sparse.csc_array:
        """The matrix with the entries of all blocks."""
        values = np.concatenate(entries)[self.order]
        return sparse.csc_array((values, self.rows, self.starts), shape=(self.size, self.size))


def grid(rows: NDArray[np.intp], columns: NDArray[np.intp]) -> Places:
    """The places of a dense block, row by row."""
    return np.repeat(rows, len(columns)), np.tile(columns, len(rows))
