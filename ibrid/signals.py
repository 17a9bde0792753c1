"""The three kinds of signal that a port may carry; a connection joins ports of the same kind."""

from enum import StrEnum
from typing import NoReturn

from ibrid.errors import IbridError, near


class Signal(StrEnum):
    """Kind of a port; all quantities are small deviations in per unit unless the port says
    otherwise.
    """

    SCALAR = "scalar"
    DQ_VEC = "dq_vec"
    POWER_PAIR = "power_pair"

    @classmethod
    def _missing_(cls, value: object) -> NoReturn:
        raise IbridError(
            f"Signal must be the name of a kind of port, {near(value, cls)}; found {value!r:.40}"
        )

    @property
    def width(self) -> int:
        """Number of scalar channels."""
        return 1 if self is Signal.SCALAR else 2
