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

__all__ = ["config", "njit"]
