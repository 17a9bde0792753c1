"""The formats of `ibrid export`, each a function from a linear model to the content of a file."""

from collections.abc import Callable, Mapping
from pathlib import Path
from types import MappingProxyType

from ibrid.analysis.linear_model import LinearModel, linear_model
from ibrid.errors import IbridError, near
from ibrid.evaluation.record import Record
from ibrid.export.control_json import control_json
from ibrid.export.mat_file import mat_file
from ibrid.export.npz_file import npz_file
from ibrid.writing import require_place, write_whole

FORMATS: Mapping[str, Callable[[LinearModel], bytes]] = MappingProxyType(
    {"control-json": control_json, "mat": mat_file, "npz": npz_file}
)


def export(record: Record, path: str | Path, format: str, op: str | None = None) -> LinearModel:
    """Write the linear model of a record at an operating point (see `linear_model`) and return it.

    Raises IbridError for an unknown format or operating point, a record without a fit, or a place that is not writable.
    """
    if format not in FORMATS:
        raise IbridError(f"there is no export format {format!r}; {near(format, FORMATS)}")
    require_place(path)
    model = linear_model(record, op)
    write_whole(path, FORMATS[format](model))
    return model
