"""A generic planning model of whatever is at hand: recordings, or an identified model."""

from collections.abc import Mapping, Sequence
from os import PathLike

from ibrid.arguments.coercion import load
from ibrid.errors import IbridError
from ibrid.evaluation.record import Record
from ibrid.generic.answer import GenericAnswer, fit_generic_model
from ibrid.generic.projection import project_generic_model
from ibrid.measurement.recordings.events import Events
from ibrid.measurement.sweeps.sweep import OperatingPoint


def generic_model(
    data: Events | Record | str | PathLike[str],
    model: str = "wecc_regc_a+reec_a",
    *,
    points: Sequence[OperatingPoint] = (),
    start: Mapping[str, float] | None = None,
    dialect: str = "wecc",
) -> GenericAnswer:
    """Fit a generic planning model, REGC_A + REEC_A, to recordings or to an identified model.

    data : records of events, a record of `evaluate`, `search` or `gap`, or the file of either. An
    identified model answers standard events, half of which no fit sees. points : of an identified
    model, p, q and v at the PCC, per unit; without, those of the record. start : values of a .dyr,
    whose flags are kept. dialect : wecc, andes, openipsl, dynawo or gridkit.

    Raises IbridError for other data, and where nothing happens in the records.
    """
    given = load(data) if isinstance(data, str | PathLike) else data
    if isinstance(given, Record):
        return project_generic_model(given, model, points=points, start=start, dialect=dialect)
    if not isinstance(given, Events):
        raise IbridError(
            "a generic model is fitted to records of events, or to a record with an identified "
            f"model; found {type(given).__name__}"
        )
    if points:
        raise IbridError(
            "operating points (--op) belong to an identified model; recordings bring their own"
        )
    return fit_generic_model(given, model, start=start, dialect=dialect)
