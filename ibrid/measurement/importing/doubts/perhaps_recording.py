"""Tables refused as sweeps that are probably recordings: what shows it, and how their columns are
told.
"""

import re

import numpy as np

from ibrid.errors import some
from ibrid.measurement.importing.foreign_table import ForeignTable
from ibrid.measurement.importing.timed.signal_names import signal_of, size_of, split_unit

#: Words that begin the name of a time, and those of voltages and currents.
_TIME = re.compile(r"\s*(time|seconds?|sec|date|datum|zeit|uhrzeit|temps|heure|hora|tiempo)", re.I)
_WORDS = {
    "v": re.compile(r"volt|spannung|tension|tensi[oó]n|\bv[abc]_", re.I),
    "i": re.compile(r"amp[eè]re|\bamps?\b|current|strom|courant|corriente|\bi[abc]_", re.I),
}
_DIMENSIONS = {"v": "voltage", "i": "current"}
#: Names that count columns: A, B, C.
_LETTERS = frozenset("abcdefgh")
_CLOCK = re.compile(r"\d{1,2}:\d{2}:\d{2}")
#: So many rows at even steps from one to the next are samples.
_EVEN_ROWS = 200


def recording_refused(table: ForeignTable, *, has_frequency: bool) -> str:
    """The sentence on a table that is probably a recording; "" where nothing shows that it is one.

    has_frequency : whether a column is called a frequency, as sweeps have one; recorders of phasors
    too, beside times and voltages or currents.
    """
    timed = any(_is_time(name, values) for name, values in table.columns.items())
    measured = {letter for letter in "vi" if any(_speaks_of(letter, n) for n in table.columns)}
    if has_frequency and not (timed and measured):
        return ""
    if timed:
        shown = "a column of times"
    elif len(measured) == 2:
        shown = "columns of voltages and currents"
    elif _is_even(table):
        shown = "many rows at even steps of its first column, as of a time"
    else:
        return ""
    return (
        f"{table.where} has {shown}, so it is probably a recording, of which voltages and currents "
        f"must be known; found {some(table.columns, 12)}, say which they are: --channels "
        "t=1,va=2,vb=3,vc=4,ia=5,ib=6,ic=7 or t=1,vd=2,vq=3,id=4,iq=5 or "
        "t=1,v_mag=2,v_ang=3,i_mag=4,i_ang=5 or t=1,v=2,p=3,q=4 (numbers or names of columns, "
        "[kV] behind one is its unit); of a sweep --map freq=COLUMN,Ydd=A+jB,.."
    )


def _is_time(name: str, values: np.ndarray) -> bool:
    if values.dtype.kind in "fc":
        return signal_of(name).quantity == "t" or _TIME.match(name) is not None
    return all(_CLOCK.search(str(cell)) for cell in values[:8].tolist()) and len(values) > 0


def _speaks_of(letter: str, name: str) -> bool:
    if name.strip().lower() in _LETTERS:
        return False
    dimension = (size_of(split_unit(name)[1]) or ("",))[0]
    named = signal_of(name).quantity[:1] == letter or dimension == _DIMENSIONS[letter]
    return named or _WORDS[letter].search(name) is not None


def _is_even(table: ForeignTable) -> bool:
    first = next(iter(table.columns.values()), np.zeros(0))
    if first.dtype.kind != "f" or len(first) < _EVEN_ROWS or len(table.columns) < 4:
        return False
    steps = np.diff(first)
    return bool(np.isfinite(steps).all() and steps.min() > 0 and np.ptp(steps) < steps.mean() / 10)
