"""Generic models of planning programs (WECC, second generation): their blocks, laws and files, and
how they are fitted to recordings and to identified models.

Names are imported when they are first used.
"""

from typing import TYPE_CHECKING

from ibrid.lazy import imported_by_need

if TYPE_CHECKING:  # the same names for type checkers
    from ibrid.generic.answer import GenericAnswer
    from ibrid.generic.fitting import generic_model

__all__ = ["GenericAnswer", "generic_model"]

#: Public name -> the module that it is imported from when it is first used.
HOMES = {
    "GenericAnswer": "ibrid.generic.answer",
    "generic_model": "ibrid.generic.fitting",
}

if not TYPE_CHECKING:  # with it every misspelt name would have the type Any
    __getattr__ = imported_by_need(__name__, HOMES)
