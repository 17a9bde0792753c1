"""The way of the measured voltage to the command past the loops, in any diagram."""

from dataclasses import dataclass

from ibrid.parts.editing.paths import (
    command_entry,
    commanded_by,
    lags,
    loops,
    path,
    terminal_voltage,
)
from ibrid.parts.editing.view import View


@dataclass(frozen=True)
class Feedforward:
    """The way of a voltage to the command past the loops.

    `blocks` : on it, without the lags of the whole command.
    """

    voltage: str
    blocks: tuple[str, ...]

    @property
    def last(self) -> str:
        """The output that joins the command."""
        return f"{self.blocks[-1]}.out" if self.blocks else self.voltage


def feedforward(view: View) -> Feedforward | None:
    """The feedforward of the filter's voltage, else of the PCC's; None where there is none, or no
    other control.
    """
    if len(commanded_by(view.draft, command_entry(view.draft, view))) < 2:
        return None
    for voltage in dict.fromkeys((view.roles.voltage, terminal_voltage(view))):
        blocks = path(view.draft, voltage, view.roles.command, without=loops(view))
        if blocks is not None:
            row = lags(view)
            return Feedforward(voltage, tuple(name for name in blocks if name not in row))
    return None
