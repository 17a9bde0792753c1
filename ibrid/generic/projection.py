"""A generic model fitted to what an identified model answers to standard events, and judged by
events that no fit saw.
"""

from collections.abc import Mapping, Sequence
from dataclasses import replace

from ibrid.border import takes_kinds
from ibrid.evaluation.record import Record
from ibrid.generic.answer import GenericAnswer, fit_generic_model, played_events
from ibrid.generic.blind_bands import blind_bands
from ibrid.generic.standard_events import answers_to_standard_events
from ibrid.measurement.sweeps.sweep import OperatingPoint
from ibrid.playback.compare import model_of_record


@takes_kinds
def project_generic_model(
    record: Record,
    model: str = "wecc_regc_a+reec_a",
    *,
    points: Sequence[OperatingPoint] = (),
    start: Mapping[str, float] | None = None,
    dialect: str = "wecc",
) -> GenericAnswer:
    """Fit a generic model to the answers of an identified one to standard events.

    record : of `evaluate`, `search` or `gap`, with shared parameters and the exact equilibrium.
    points : p, q and v at the PCC; without, those of the record. model, start, dialect : as of
    `fit_generic_model`. The answer has the events that no fit saw in `held_out`, and in
    `cannot_show` the bands in which the generic model is blind.

    Raises IbridError where the record cannot be played, and where it answers no event.
    """
    detailed = model_of_record(record)
    places = points or [_at_terminals(record, name) for name in record.settings["operating_points"]]
    answers = answers_to_standard_events(detailed, places, record.settings["f0_hz"])
    fitted = fit_generic_model(answers.fitted, model, start=start, dialect=dialect, measured=False)
    held_out = () if answers.held_out is None else played_events(fitted, answers.held_out)
    return replace(
        fitted,
        held_out=held_out,
        cannot_show=tuple(
            band for played in (*fitted.played, *held_out) for band in blind_bands(played)
        ),
        left_out=answers.left_out,
    )


def _at_terminals(record: Record, name: str) -> OperatingPoint:
    """The operating point at the PCC, with the voltage on d."""
    (v_d, v_q), (i_d, i_q) = record.terminal_point(name)
    power = complex(v_d, v_q) * complex(i_d, i_q).conjugate()
    return OperatingPoint(name, power.real, power.imag, abs(complex(v_d, v_q)))
