"""The compiler of numba, without settings of the working folder: they could load machine code from
it, and change the last digits of an answer.
"""

import os

from ibrid.lazy import NUMBA, without_settings

with without_settings(NUMBA):
    from numba import njit
    from numba.core import config

# Read again before each compilation; that is no regular file, and is passed over.
config._config_fname = os.devnull  # type: ignore[attr-defined]

__all__ = ["OPTIONS", "config", "njit"]


def _nothing() -> None:
    return None


def _can_keep_compiled() -> bool:
    """True when compiled code can be kept on disk; a read-only installation compiles anew in every
    process.
    """
    try:
        njit(cache=True)(_nothing)
    except RuntimeError:
        return False
    return True


#: Of `njit`, for every compiled loop.
OPTIONS = {
    "cache": _can_keep_compiled(),
    "error_model": "numpy",
    "fastmath": {"contract", "reassoc", "nsz"},
    "nogil": True,
}
