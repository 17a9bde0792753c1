"""What is found of an inverter on one grid: closed-loop modes, the Nyquist count, the source that
keeps the operating point.
"""

from dataclasses import dataclass

from ibrid.analysis.grids.grid import MeasuredGrid, SeriesRL
from ibrid.analysis.grids.nyquist import Nyquist
from ibrid.analysis.models.modes import Mode, least_damped
from ibrid.writing import PlainData

#: What is stable is barely so below one of these: gain margin, phase margin (degrees), damping
#: ratio of a mode.
GAIN, PHASE, DAMPING = 1.25, 10.0, 0.01


@dataclass(frozen=True, eq=False)
class GridCase:
    """The inverter on one grid.

    `modes` : of the closed loop, the rightmost first; None for a measured impedance, which has no
    poles. `thevenin` : |v_Th| that keeps the operating point, per unit; None where it is not known.
    """

    grid: SeriesRL | MeasuredGrid
    modes: tuple[Mode, ...] | None
    nyquist: Nyquist
    thevenin: float | None

    @property
    def stable(self) -> bool:
        """By the poles; for a measured impedance by the Nyquist count."""
        return self.nyquist.stable if self.modes is None else all(one.stable for one in self.modes)

    @property
    def margins(self) -> dict[str, float | None]:
        """Gain and phase (degrees) to instability, the frequency of the smallest distance from -1
        (Hz), the least damping ratio of a closed-loop mode that oscillates or grows; None where
        there is none, both margins where it is unstable.
        """
        modes = self.modes or ()
        telling = [*least_damped(modes), *(mode for mode in modes if not mode.stable)]
        held = self.stable and self.nyquist.stable
        return {
            "gain": self.nyquist.gain_margin if held else None,
            "phase_deg": self.nyquist.phase_margin if held else None,
            "frequency_hz": self.nyquist.vector_margin_hz,
            "least_damping": min((mode.damping for mode in telling), default=None),
        }

    @property
    def slim(self) -> tuple[str, ...]:
        """In words, the margins that are too small to trust; also that poles and Nyquist count
        disagree.
        """
        gain, phase, _, damping = self.margins.values()
        words = []
        if phase is not None and phase < PHASE:
            words.append(f"phase margin {phase:.2g} degrees")
        if gain is not None and gain < GAIN:
            words.append(f"gain margin {gain:.3g}")
        if damping is not None and damping < DAMPING:
            words.append(f"damping {100 * damping:.2g} %")
        if self.nyquist.stable != self.stable:
            words.append("poles and Nyquist count disagree")
        return tuple(words)

    @property
    def grade(self) -> str:
        """stable, barely stable or unstable."""
        return ("barely stable" if self.slim else "stable") if self.stable else "unstable"

    def plain(self) -> PlainData:
        """For JSON."""
        rl = self.grid if isinstance(self.grid, SeriesRL) else None
        counts = ("stable", "certain", "unstable_poles", "open_loop_unstable", "turns")
        margins = ("vector_margin", "vector_margin_hz", "gain_margin")
        return {
            "scr": None if rl is None else rl.scr,
            "r": None if rl is None else rl.r,
            "x": None if rl is None else rl.x,
            "file": None if isinstance(self.grid, SeriesRL) else self.grid.name,
            "thevenin_voltage": self.thevenin,
            "stable": self.stable,
            "grade": self.grade,
            "margins": self.margins,
            "modes": None if self.modes is None else [one.plain() for one in self.modes],
            "nyquist": {
                **{name: getattr(self.nyquist, name) for name in (*counts, *margins)},
                "phase_margin_deg": self.nyquist.phase_margin,
            },
        }
