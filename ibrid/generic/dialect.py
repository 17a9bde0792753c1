"""Where implementations of one generic model differ: switches with names, of the law here and of
programs that read its files.

Law: above Brkpt LVPL is free (ANDES, dynawo, GridPACK) or Lvpl1 (OpenIPSL,
PowerSimulationsDynamics, GridKit); rate limits are of the state, per unit per s (InterPSS,
GridKit), or of the input of its lag, so that the state moves by limit / T (ANDES, OpenIPSL); Thld >
0 holds Iqfrz behind a dip (WECC) or the support (dynawo).
"""

from collections import namedtuple
from collections.abc import Mapping

from ibrid.errors import IbridError, near

#: Numba reads the names of its fields.
Dialect = namedtuple("Dialect", ("lvpl_capped", "rate_over_tg", "thld_reversed"))
DIALECTS: Mapping[str, Dialect] = {
    "wecc": Dialect(False, False, False),
    "andes": Dialect(False, True, False),
    "openipsl": Dialect(True, True, False),
    "dynawo": Dialect(False, False, True),
    "gridkit": Dialect(True, False, False),
}


def dialect_named(name: str) -> Dialect:
    """The switches of a program; IbridError, with the near names, for one that is not known."""
    if name not in DIALECTS:
        raise IbridError(f"no dialect is called {name!r}; {near(name, DIALECTS)}")
    return DIALECTS[name]
