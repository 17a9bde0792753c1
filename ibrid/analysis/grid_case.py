"""What is found of an inverter on one grid: closed-loop modes, the Nyquist count, the source that keeps the operating point."""

from dataclasses import dataclass
from typing import Any

from ibrid.analysis.grid import MeasuredGrid, SeriesRL
from ibrid.analysis.modes import Mode
from ibrid.analysis.nyquist import Nyquist


@dataclass(frozen=True, eq=False)
class GridCase:
    """The inverter on one grid.

    `modes` : of the closed loop, the rightmost first; None for a measured impedance, which has no poles. `thevenin` : |v_Th|
    that keeps the operating point, per unit; None where it is not known.
    """

    grid: SeriesRL | MeasuredGrid
    modes: tuple[Mode, ...] | None
    nyquist: Nyquist
    thevenin: float | None

    @property
    def stable(self) -> bool:
        """By the poles; for a measured impedance by the Nyquist count."""
        return self.nyquist.stable if self.modes is None else all(one.stable for one in self.modes)

    def plain(self) -> dict[str, Any]:
        """For JSON."""
        rl = self.grid if isinstance(self.grid, SeriesRL) else None
        return {
            "scr": None if rl is None else rl.scr,
            "r": None if rl is None else rl.r,
            "x": None if rl is None else rl.x,
            "file": None if isinstance(self.grid, SeriesRL) else self.grid.name,
            "thevenin_voltage": self.thevenin,
            "stable": self.stable,
            "modes": None if self.modes is None else [one.plain() for one in self.modes],
            "nyquist": {
                "stable": self.nyquist.stable,
                "certain": self.nyquist.certain,
                "unstable_poles": self.nyquist.unstable_poles,
                "open_loop_unstable": self.nyquist.open_loop_unstable,
                "turns": self.nyquist.turns,
                "vector_margin": self.nyquist.vector_margin,
                "vector_margin_hz": self.nyquist.vector_margin_hz,
                "gain_margin": self.nyquist.gain_margin,
                "phase_margin_deg": self.nyquist.phase_margin,
            },
        }
