"""What `ibrid predict` prints: stability, modes and bands of each predicted operating point, at most 110 columns wide."""

import textwrap
from collections.abc import Sequence

from ibrid.analysis.modes import QUANTILE, Mode, least_damped
from ibrid.analysis.prediction import Prediction
from ibrid.measurement.quantities import hertz
from ibrid.report.numbers import number, percent
from ibrid.report.text import WIDTH, table

#: Modes that are listed for each operating point.
LISTED = 5


def format_predictions(predictions: Sequence[Prediction]) -> str:
    """A table of points, a table of modes, and the warnings."""
    parts = [_points(predictions), *(_modes(one) for one in predictions)]
    warnings = list(dict.fromkeys(sentence for one in predictions for sentence in one.warnings))
    parts += [warning_lines(warnings)] if warnings else []
    return "\n\n".join("\n".join(part) for part in parts) + "\n"


def warning_lines(warnings: Sequence[str]) -> list[str]:
    """Warnings under their heading."""
    return ["warnings:", *(line for one in warnings for line in wrapped(f"  - {one}", "    "))]


def wrapped(text: str, indent: str) -> list[str]:
    """Lines of a sentence, all but the first indented."""
    return textwrap.wrap(text, WIDTH, subsequent_indent=indent, break_on_hyphens=False)


def mode_words(mode: Mode) -> list[str]:
    """Frequency, damping ratio with band, real part with band, and who takes part."""
    real = number(mode.pole.real, 4)
    damping = percent(mode.damping) if mode.frequency else "no oscillation"
    if mode.real_deviation is not None:
        real += f" +- {number(QUANTILE * mode.real_deviation, 2)}"
        if mode.frequency:
            damping = (
                f"{number(100 * mode.damping, 3)} +- {number(100 * QUANTILE * (mode.damping_deviation or 0.0), 2)} %"
            )
    return [hertz(mode.frequency), damping, real, ", ".join(f"{name} {percent(share)}" for name, share in mode.states)]


def shown_modes(found: Sequence[Mode]) -> list[Mode]:
    """The least damped oscillating modes and the slowest of the others, and whatever is unstable."""
    chosen = [one for one in found if not one.stable]
    chosen += [one for one in least_damped(found) if one not in chosen][: max(LISTED - len(chosen), 1)]
    return chosen + [one for one in found if one.frequency == 0 and one not in chosen][:1]


def _points(predictions: Sequence[Prediction]) -> list[str]:
    rows = []
    for one in predictions:
        band = one.relative_band
        words = "unknown"
        if band is not None:
            worst = int(band.argmax())
            words = f"+- {percent(float(band[worst]))} of |Y| at {hertz(float(one.frequency[worst]))}"
        rows.append([one.op.name, "stable" if one.stable else "UNSTABLE", f"{len(one.frequency)}", words])
    return table(["operating point", "ideal grid", "frequencies", "widest 95 % band"], rows, right=(2,))


def _modes(one: Prediction) -> list[str]:
    rows = [mode_words(mode) for mode in shown_modes(one.modes)]
    head = ["frequency", "damping ratio", "real part (1/s)", "states that take part"]
    return [f"modes at {one.op.name} (95 % bands)", *table(head, rows, right=(0,))]
