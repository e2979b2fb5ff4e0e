"""Isolate the process from its surroundings: environment variables, warnings, settings files.

Nothing outside agfb's own options changes what is computed or drawn. What only says where things lie
(NUMBA_CACHE_DIR, MPLCONFIGDIR, TMPDIR) is followed.
"""

from __future__ import annotations

import contextlib
import logging
import os
import sys
import warnings
from importlib import import_module

# numba, numpy and BLAS: which instructions of the processor they use, among others
_CHOOSING = ("NUMBA_", "NPY_", "NUMPY_", "OPENBLAS_", "MKL_")
_KEPT = ("NUMBA_CACHE_DIR", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS")
_MATPLOTLIB = "MPLCONFIGDIR"


def settle() -> None:
    """Remove environment variables that would change numbers or figures, also for child processes.

    No warning becomes an error. This must precede the import of numpy, numba and matplotlib.
    """
    for name in [name for name in os.environ if name.startswith(_CHOOSING) and name not in _KEPT]:
        del os.environ[name]
    os.environ["NUMBA_DISABLE_JIT"] = "0"  # also where a .numba_config.yaml says otherwise
    os.environ["MPLBACKEND"] = "agg"  # notebooks name their own, which may not be installed here
    os.environ["MATPLOTLIBRC"] = os.devnull
    os.environ.pop("SOURCE_DATE_EPOCH", None)  # a date that no figure shows, but must be a number
    os.environ.pop("PYTHONWARNINGS", None)
    if sys.warnoptions:  # from -W or PYTHONWARNINGS; child processes get them again
        sys.warnoptions.clear()
        warnings.simplefilter("ignore")


def load_matplotlib() -> None:
    """Import matplotlib without the file `matplotlibrc` of the working directory.

    If its folder of settings is not writable it silently uses a temporary one.
    """
    logging.getLogger("matplotlib").setLevel(logging.ERROR)
    if chosen := os.environ.get(_MATPLOTLIB):
        os.environ[_MATPLOTLIB] = os.path.abspath(chosen)
    with contextlib.chdir(os.path.dirname(__file__)):
        import_module("matplotlib")
