"""What a table does not say and must be told, in the words of the command line."""

from ibrid.errors import SweepError


class UnsaidError(SweepError):
    """A table was understood, and something must be said first.

    The sentence has the options of `ibrid import`; the border says them as arguments of a call.
    """
