"""What `ibrid predict` and `ibrid nfp` print: operating points, a plant, the power Jacobian; at
most 110 columns wide.
"""

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from ibrid.analysis.grids.power_jacobian import PowerJacobian
from ibrid.analysis.models.modes import QUANTILE, Mode, least_damped
from ibrid.analysis.models.prediction import Prediction
from ibrid.foreign_text import controls_shown, csv_text
from ibrid.measurement.sweeps.amplitudes import evenly
from ibrid.measurement.sweeps.quantities import hertz
from ibrid.report.look.numbers import number, percent
from ibrid.report.texts.text import listed, table

if TYPE_CHECKING:  # a plant takes fits with it, which few predictions need
    from ibrid.analysis.several_devices.plant import Equivalent, PlantPrediction

#: Modes that are listed for each operating point.
LISTED = 5


@controls_shown
def format_predictions(predictions: Sequence[Prediction]) -> str:
    """A table of points, a table of modes, and the warnings."""
    parts = [
        _points(predictions),
        *(mode_table(f"at {one.op.name}", one.modes) for one in predictions),
    ]
    warnings = list(dict.fromkeys(sentence for one in predictions for sentence in one.warnings))
    parts += [listed("warnings", warnings)] if warnings else []
    return "\n\n".join("\n".join(part) for part in parts) + "\n"


def mode_words(mode: Mode) -> list[str]:
    """Frequency, damping ratio with band, real part with band, and who takes part."""
    real = number(mode.pole.real, 4)
    damping = percent(mode.damping) if mode.frequency else "no oscillation"
    if mode.real_deviation is not None:
        real += f" +- {number(QUANTILE * mode.real_deviation, 2)}"
        if mode.frequency:
            damping = (
                f"{number(100 * mode.damping, 3)} +- "
                f"{number(100 * QUANTILE * (mode.damping_deviation or 0.0), 2)} %"
            )
    return [
        hertz(mode.frequency),
        damping,
        real,
        ", ".join(f"{name} {percent(share)}" for name, share in mode.states),
    ]


def shown_modes(modes: Sequence[Mode]) -> list[Mode]:
    """The least damped oscillating modes and the slowest of the others, and whatever is
    unstable.
    """
    chosen = [one for one in modes if not one.stable]
    chosen += [one for one in least_damped(modes) if one not in chosen][
        : max(LISTED - len(chosen), 1)
    ]
    return chosen + [one for one in modes if one.frequency == 0 and one not in chosen][:1]


def _points(predictions: Sequence[Prediction]) -> list[str]:
    rows = []
    for point in predictions:
        band = point.relative_band
        words = "unknown"
        if band is not None:
            worst = int(band.argmax())
            words = (
                f"+- {percent(float(band[worst]))} of |Y| at {hertz(float(point.frequency[worst]))}"
            )
        rows.append(
            [
                point.op.name,
                "stable" if point.stable else "UNSTABLE",
                f"{len(point.frequency)}",
                words,
            ]
        )
    return table(
        ["operating point", "ideal grid", "frequencies", "widest 95 % band"], rows, right=(2,)
    )


def mode_table(where: str, modes: Sequence[Mode]) -> list[str]:
    """The modes of a model that matter, under their heading."""
    rows = [mode_words(mode) for mode in shown_modes(modes)]
    head = ["frequency", "damping ratio", "real part (1/s)", "states that take part"]
    return [f"modes {where} (95 % bands)", *table(head, rows, right=(0,))]


#: Rows that are printed of each operating point.
_ROWS = 12
_ENTRIES = ("p_theta", "p_v", "q_theta", "q_v", "nfp")


@controls_shown
def format_jacobian(jacobian: PowerJacobian) -> str:
    """A table of at most twelve frequencies, in dB and degrees, and what its columns mean."""
    chosen = evenly(len(jacobian.frequency), _ROWS)
    head = ["f", *(f"{name.replace('_', '/')}" for name in _ENTRIES)]
    rows = [
        [
            hertz(float(jacobian.frequency[k])),
            *(_polar(complex(getattr(jacobian, name)[k])) for name in _ENTRIES),
        ]
        for k in chosen
    ]
    meaning = (
        "dB and degrees; delivered p, q over angle (rad) and relative voltage; nfp: p over "
        "relative frequency"
    )
    return "\n".join([f"at {jacobian.op}", *table(head, rows), meaning])


def jacobian_csv(points: Sequence[PowerJacobian]) -> str:
    """One row a frequency and operating point, per unit on the inverter's base."""
    head = ["op", "freq_hz", *(f"{name}_{part}" for name in _ENTRIES for part in ("re", "im"))]
    rows: list[Sequence[object]] = [head]
    for point in points:
        entries = (
            np.column_stack([getattr(point, name) for name in _ENTRIES]).astype(complex).view(float)
        )
        rows += ([point.op, *row] for row in np.column_stack([point.frequency, entries]).tolist())
    base = (
        "# per unit on the inverter's base, p and q delivered; theta in rad, v and frequency "
        "relative"
    )
    return csv_text(rows, [base])


def _polar(value: complex) -> str:
    return f"{20 * np.log10(abs(value)):.1f} {np.degrees(np.angle(value)):.0f}" if value else "zero"


@controls_shown
def format_plant(prediction: "PlantPrediction") -> str:
    """Where each device works, and how far one device in place of all would be."""
    rows = [
        [name, op, *(number(one, 3) for one in (rest.p, rest.q, rest.v))]
        for name, rests in prediction.devices.items()
        for op, rest in rests.items()
    ]
    head = ["device", "at the plant's", "own p", "own q", "own v"]
    warned = ["", *listed("warnings", prediction.warnings)] if prediction.warnings else []
    return "\n".join(
        [*table(head, rows, right=(2, 3, 4)), *warned, "", prediction.equivalent.sentence]
    )


def equivalent_file(found: "Equivalent") -> str:
    """TOML, per unit of the plant, as --port takes it."""
    lines = [f"# {found.sentence}", 'power_node = "outside"']
    for element in found.elements:
        numbers = [f"{name} = {value:.9g}" for name, value in element.values.items()]
        lines += ["", "[[element]]", f'kind = "{element.kind}"', *numbers, 'unit = "pu"']
    return "\n".join(lines) + "\n"
