"""How an evaluation can end; an illegal diagram or a failed fit is an outcome, not an exception."""

from enum import StrEnum


class Outcome(StrEnum):
    """`ok`: fitted. `invalid`: the grammar refuses the diagram. `failed`: no fit exists. `timeout`: stopped."""

    OK = "ok"
    INVALID = "invalid"
    FAILED = "failed"
    TIMEOUT = "timeout"
