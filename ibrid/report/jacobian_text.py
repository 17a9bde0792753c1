"""What `ibrid nfp` prints and writes: magnitudes and angles over frequency, the complex numbers as a table."""

from collections.abc import Sequence

import numpy as np

from ibrid.analysis.power_jacobian import PowerJacobian
from ibrid.measurement.amplitudes import evenly
from ibrid.measurement.quantities import hertz
from ibrid.report.text import table

#: Rows that are printed of each operating point.
_ROWS = 12
_ENTRIES = ("p_theta", "p_v", "q_theta", "q_v", "nfp")


def format_jacobian(found: PowerJacobian) -> str:
    """A table of at most twelve frequencies, in dB and degrees, and what its columns mean."""
    chosen = evenly(len(found.frequency), _ROWS)
    head = ["f", *(f"{name.replace('_', '/')}" for name in _ENTRIES)]
    rows = [
        [hertz(float(found.frequency[k])), *(_polar(complex(getattr(found, name)[k])) for name in _ENTRIES)]
        for k in chosen
    ]
    meaning = "dB and degrees; delivered p, q over angle (rad) and relative voltage; nfp: p over relative frequency"
    return "\n".join([f"at {found.op}", *table(head, rows), meaning])


def jacobian_csv(points: Sequence[PowerJacobian]) -> str:
    """One row a frequency and operating point, per unit on the inverter's base."""
    head = ["op", "freq_hz", *(f"{name}_{part}" for name in _ENTRIES for part in ("re", "im"))]
    lines = [
        "# per unit on the inverter's base, p and q delivered; theta in rad, v and frequency relative",
        ",".join(head),
    ]
    for point in points:
        op = f'"{point.op}"' if "," in point.op else point.op
        for k, frequency in enumerate(point.frequency.tolist()):
            values = [complex(getattr(point, name)[k]) for name in _ENTRIES]
            lines.append(
                ",".join([op, repr(frequency), *(repr(part) for one in values for part in (one.real, one.imag))])
            )
    return "\n".join(lines) + "\n"


def _polar(value: complex) -> str:
    size = 20 * np.log10(abs(value)) if value else -np.inf
    return f"{size:.1f} {np.degrees(np.angle(value)):.0f}"
