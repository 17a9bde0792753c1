"""What a table does not say and must be told, in the words of the command line and of Python."""

import re

from ibrid.errors import SweepError


class UnsaidError(SweepError):
    """A table was understood, and something must be said first.

    `options` : the sentence with the options of `ibrid import`; the error itself has the arguments
    of `read_sweep`.
    """

    def __init__(self, sentence: str) -> None:
        super().__init__(in_python(sentence))
        self.options = sentence


def in_python(sentence: str) -> str:
    """A sentence with options of the command line as the arguments of a call: `--unit pu` is
    unit="pu".
    """

    def argument(said: re.Match[str]) -> str:
        name, value = said[1].replace("-", "_"), said[2].rstrip(".,;:)")
        behind = said[2][len(value) :]
        plain = value if re.fullmatch(r"-?[\d.]+", value) else f'"{value}"'
        return f"{_KEYS.get(name, name)}={plain}{behind}"

    return re.sub(r"--([a-z][a-z0-9-]*) ([^\s-][^\s]*)", argument, sentence)


#: Options that a call names otherwise.
_KEYS = {"from": "begin", "to": "end"}
