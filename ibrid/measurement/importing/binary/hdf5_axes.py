"""What an HDF5 file says of the axes of an array: labels of dimensions, and scales attached to
them, as netCDF has them.
"""

import re
import unicodedata
from typing import Any

import numpy as np

from ibrid.measurement.formats.response_labels import q_first
from ibrid.measurement.importing.binary.foreign_binary import plain_text

#: Words that say which axis of a response counts its rows (outputs), and which its columns
#: (inputs): English, German, French, Spanish, Italian, Dutch, Chinese; without accents.
_ROWS = {
    "output",
    "out",
    "row",
    "response",
    "to",
    "measured",
    "effect",
    "ausgang",
    "ausgange",
    "zeile",
    "zeilen",
    "antwort",
    "wirkung",
    "sortie",
    "ligne",
    "reponse",
    "effet",
    "salida",
    "fila",
    "respuesta",
    "efecto",
    "uscita",
    "riga",
    "risposta",
    "uitgang",
    "rij",
    "输出",
    "行",
    "响应",
}
_COLUMNS = {
    "input",
    "in",
    "column",
    "col",
    "excitation",
    "injection",
    "injected",
    "perturbation",
    "disturbance",
    "from",
    "cause",
    "stimulus",
    "eingang",
    "eingange",
    "spalte",
    "spalten",
    "anregung",
    "ursache",
    "storung",
    "einspeisung",
    "entree",
    "colonne",
    "entrada",
    "columna",
    "excitacion",
    "causa",
    "ingresso",
    "colonna",
    "ingang",
    "kolom",
    "输入",
    "列",
    "激励",
}
#: Letters that tell rows and columns beside each other alone.
_PAIRS = (("i", "j"), ("y", "u"))
#: Names that programs give to an axis of which nothing is known.
_NUMBERED = re.compile(r"(?:phony_|unlimited_)?(?:dim|dimension|axis)?[_ ]?\d+", re.IGNORECASE)
#: Attributes that say which index runs fastest, and how they say that it is the first.
_ORDER = re.compile(r"(?:(?:memory|array|storage|index|data)_?)?(?:order|ordering|layout)", re.I)
_FIRST_FASTEST = re.compile(r"f|fortran.*|col(?:umn)?s?[ _-]?(?:major|first|wise).*", re.I)


def in_rows_and_columns(path: str, item: Any, value: np.ndarray) -> np.ndarray:
    """A stack of 2 x 2 matrices with outputs before inputs, as the file calls its axes; any other
    array as it is.

    Raises ValueError for axes whose names tell no order (voltage and current without the quantity,
    words that are not known), for those without names where the first index runs fastest, and for
    an axis whose scale names q before d.
    """
    axes = [axis for axis, size in enumerate(value.shape) if size == 2]
    if len(axes) != 2 or value.ndim < 3 or value.shape != item.shape:
        return value
    names = [_name(item, axis) for axis in axes]
    for axis, name in zip(axes, names, strict=True):
        if q_first(_entries(item, axis)):
            raise ValueError(
                f"the axis {name} of {path} names q before d, exchange its entries and their names"
            )
    parts = _parts([_words(name) for name in names])
    if not any(map(any, parts)) and not _tells_nothing(names):
        raise ValueError(
            f"the axes of {path} are called {' and '.join(names)}, call them output and input"
        )
    if not any(map(any, parts)) and (said := _first_fastest(item)):
        raise ValueError(
            f"{said} of {path} says that the first index runs fastest, which may turn its axes "
            "round, call them output and input"
        )
    columns_first = parts[0] == (False, True) or parts[1] == (True, False)
    return np.swapaxes(value, *axes) if columns_first and parts[0] != parts[1] else value


def _parts(words: list[set[str]]) -> list[tuple[bool, bool]]:
    """Whether each axis is called one of rows, and one of columns."""
    for row, column in _PAIRS:
        if words in ([{row}, {column}], [{column}, {row}]):
            return [(said == {row}, said == {column}) for said in words]
    return [(bool(said & _ROWS), bool(said & _COLUMNS)) for said in words]


def _tells_nothing(names: list[str]) -> bool:
    """Whether the names of two axes are numbers alone, or one and the same."""
    return len(set(names)) == 1 or all(_NUMBERED.fullmatch(name) for name in names)


def _first_fastest(item: Any) -> str:
    """The attribute of an array, its group or the file that says that its first index runs fastest;
    "" without one.
    """
    for holder in (item, item.parent, item.file):
        for key, value in holder.attrs.items():
            plain = str(plain_text(np.ravel(value)[0])) if np.size(value) == 1 else ""
            if _ORDER.fullmatch(key) and _FIRST_FASTEST.fullmatch(plain.strip()):
                return key
    return ""


def _name(item: Any, axis: int) -> str:
    """The label of an axis, else the name of the scale that is attached to it; its number without
    either.
    """
    scales = [scale.name.rsplit("/", 1)[-1] for scale in item.dims[axis].values()]
    return item.dims[axis].label.strip() or next(iter(scales), str(axis + 1))


def _words(name: str) -> set[str]:
    """The words of a name such as input_axis or InputAxis, small, without accents and in the
    singular.
    """
    marked = unicodedata.normalize("NFKD", name)
    plain = "".join(one for one in marked if not unicodedata.combining(one))
    found = re.findall(r"[A-Z]?[a-z]+|[A-Z]+|[^\W\d_a-zA-Z]+", plain)
    return {word.lower().removesuffix("s") for word in found}


def _entries(item: Any, axis: int) -> list[str]:
    """How a scale of texts calls the two indices of an axis; none for numbers."""
    scales = [
        scale
        for scale in item.dims[axis].values()
        if scale.shape == (2,) and scale.dtype.kind in "SO"
    ]
    return [str(plain_text(one)) for scale in scales[:1] for one in scale[()]]
