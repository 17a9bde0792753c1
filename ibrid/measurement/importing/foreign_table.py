"""Anybody's table as named columns: text with any separator and decimal mark, workbooks, Parquet,
MATLAB and HDF5 files.

Nothing is understood here but what a number is: where the names stand, which rows hold numbers,
what is written above them.
"""

import re
from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from itertools import islice
from typing import Any

import numpy as np

from ibrid.errors import SweepError
from ibrid.measurement.formats.csv_table import comments_and_body
from ibrid.measurement.formats.response_labels import require_plain_responses
from ibrid.measurement.importing.cell_number import number, polar_cell
from ibrid.measurement.importing.column_words import meaning_of, unit_of
from ibrid.measurement.importing.numbers.decimal_mark import (
    beside_with_point,
    decimal_marks,
    shown_marks,
)
from ibrid.measurement.importing.numbers.number_format import UNSAID, NumberFormat
from ibrid.measurement.importing.numbers.polar_cells import SIGNS, largest_angle, spice_number
from ibrid.measurement.importing.shapes.stacks import matrix_and_part, ports_of, with_ports
from ibrid.measurement.importing.timed.signal_names import size_of

_SEPARATORS = (";", "\t", ",", "|", None)
_COMMA = re.compile(r"\d,\d")
#: A number with a decimal comma in quotes, between commas that part cells.
_QUOTED_COMMA = re.compile(r'"\s*[-+]?\d+,\d+(?:[eE][-+]?\d+)?\s*"')
#: Names of arrays of matrices that say no more than that.
_PLAIN_MATRIX = re.compile("(dq0?|matrix|matrices)_?(matrix|frame)?", re.IGNORECASE)
_MARKS = re.compile(r"(?<!\s)\s*(?:#|%|!|//|\*+\s)")
#: More columns than any sweep has.
MOST_COLUMNS = 400
#: Lines of a long table that choose its separator.
CHOOSING = 2_000
#: Rows of them in which numbers are counted.
COUNTED = 40
#: Characters of a line beside the numbers that are read for what they say.
LONGEST_NOTE = 2_000
#: What stands in a line of units for none.
_NO_UNIT = ("#", "-", "--", "[-]", "(-)", "[]", "1", "[1]", "n/a")
#: What belongs to the name before it: a unit; the node of ATP to which a current flows.
_UNIT_BEHIND, _NODE_BEHIND = r"[\[(].*[\])]|/.*", r"-[^\W\d].*"
#: Lines above the numbers in which names are looked for.
NAMES_ABOVE = 50
#: A line that is a power of ten and a sign of multiplication, as MATLAB writes it above numbers
#: that it shows divided by it.
_FACTOR = re.compile(r"(?:1(?:\.0*)?[eE][-+]?\d{1,3}|10\s?(?:\^|\*\*)\s?[-+]?\d{1,3})\s*[*×x]")
#: Said of a first column without a name that names the rows.
_NAMES_OF_ROWS = (
    "the first column has no name and only counts or names the rows: the names are those of the "
    "columns behind it"
)


@dataclass(frozen=True, eq=False)
class ForeignTable:
    """Columns of one length: numbers (NaN: empty), complex numbers, or text.

    where : file and sheet, for sentences. stem, book : names of file or sheet, and of a file with
    sheets; they may tell p and q.
    line : (n,) where each row stands. notes : what is written above the table. comments : lines
    behind a #, with their numbers.
    op : of the operating point, where it is named beside the table. remarks : what of the file was
    left out. cells : of a workbook, how the cells of a column are called before their row. numbered
    : columns that an array has by number alone. decimal : the decimal mark of all columns, "" where
    they differ. polar_angle : the largest angle of polar cells that say no unit where nobody does,
    as it is written; else 0. percent : columns that a workbook shows in percent throughout, whose
    names do not say %. made_of : columns of which others are made.
    """

    where: str
    stem: str
    columns: dict[str, np.ndarray]
    line: np.ndarray
    notes: tuple[str, ...] = ()
    book: str = ""
    comments: tuple[tuple[int, str], ...] = ()
    op: str = ""
    remarks: tuple[str, ...] = ()
    cells: Mapping[str, str] = field(default_factory=dict)
    numbered: frozenset[str] = frozenset()
    decimal: str = ""
    polar_angle: float = 0.0
    percent: frozenset[str] = frozenset()
    made_of: frozenset[str] = frozenset()

    def place(self, row: int, name: str) -> str:
        """Where the number of a row and a column stands, for sentences."""
        return _place(self.where, int(self.line[row]), name, self.cells.get(name, ""))


def _place(where: str, row: int, name: str, cell: str) -> str:
    return f"{where} {cell}{row} ({name})" if cell else f"{where} line {row}: {name}"


def frame_table(frame: Any, form: NumberFormat = UNSAID) -> ForeignTable:
    """The columns of a DataFrame, of pandas or any library with `columns` and `frame[name]`."""
    names = [_flat(name) for name in frame.columns]
    if twice := [name for name, count in Counter(names).items() if count > 1]:
        raise SweepError(
            f"DataFrame: column {twice[0]!r} must be there once; found it twice, rename one."
        )
    held = {_flat(name): _unmasked(frame[name]) for name in frame.columns}
    columns = {name: _plain(column, form) for name, column in held.items()}
    if truths := [
        _flat(name) for name in frame.columns if np.asarray(frame[name]).dtype.kind == "b"
    ]:
        raise SweepError(
            f"DataFrame: column {truths[0][:40]} must hold numbers or text; found true and false, "
            "leave it out."
        )
    length = len(next(iter(columns.values()), ()))
    table = ForeignTable("DataFrame", "op", columns, np.arange(1, length + 1))
    return replace(table, polar_angle=_polar_angle_of_text(held, table, form))


def _flat(name: Any) -> str:
    """The name of a column, of several levels joined: ("Ydd", "re") is Ydd_re."""
    return (
        "_".join(str(level) for level in name if str(level))
        if isinstance(name, tuple)
        else str(name)
    )


def _unmasked(column: Any) -> np.ndarray:
    """A column in which what is masked is not a number."""
    if not isinstance(column, np.ma.MaskedArray) or column.dtype.kind not in "biufc":
        return np.asarray(column)
    return np.ma.filled(column.astype(complex if column.dtype.kind == "c" else float), np.nan)


def text_table(
    lines: Sequence[str], where: str, stem: str, form: NumberFormat = UNSAID, before: int = 0
) -> ForeignTable:
    """The separator is that which makes the most numbers in rows of one length; numbers have a
    decimal comma where that makes more of them.

    before : lines of the file before these.
    """
    numbered = [(n, line) for n, line in enumerate(lines, 1 + before) if line.strip()]
    separator, comma = _separator(numbered, where, form)
    rows = [(number, _cells(line, separator)) for number, line in numbered]
    marked = [number for number, _ in rows if _MARKS.match(lines[number - 1 - before])]
    # a comma that parts cells is no decimal mark of them, nor is a point then one of thousands
    supposed = "." if separator == "," and not comma else ""
    table = rows_table(rows, marked, where, stem, comma, form, supposed=supposed)
    first = int(table.line[0])
    hidden = set(marked)
    notes = [line for number, line in numbered if number < first or number in hidden]
    notes = [
        _MARKS.sub("", line.lstrip()[: LONGEST_NOTE + 1]).strip()[:LONGEST_NOTE] for line in notes
    ]
    notes = [beside_with_point(note, table.decimal) for note in notes]
    return replace(table, notes=(*notes, *table.notes), comments=tuple(comments_and_body(lines)[0]))


def _separator(
    numbered: Sequence[tuple[int, str]], where: str, form: NumberFormat
) -> tuple[str | None, bool]:
    """The separator, and whether numbers may have a decimal comma; of a long table some of its
    lines choose.
    """
    chosen = [line for _, line in numbered[:: -(-len(numbered) // CHOOSING) or 1]]
    tried: list[tuple[float, int, bool, int]] = []
    for k, separator in enumerate(_SEPARATORS):
        rows = [
            (n, _cells(line, separator)) for n, line in enumerate(chosen) if not _MARKS.match(line)
        ]
        quoted = form.mark == "," or any(map(_QUOTED_COMMA.search, chosen))
        comma = quoted if separator == "," else any(map(_COMMA.search, chosen))
        for decimal in {False, comma}:
            if data := data_rows(rows, decimal):
                some_rows = data[:: -(-len(data) // COUNTED)]
                numbers = sum(_numbers_in(cells, decimal) for _, cells in some_rows)
                tried.append(
                    (len(data) * numbers / len(some_rows), -len(data[0][1]), not decimal, -k)
                )
    if not tried:
        raise SweepError(f"{where} must hold rows of numbers, two columns or more; found none.")
    *_, point, k = max(tried)
    return _SEPARATORS[-k], not point


def _cells(line: str, separator: str | None) -> list[str]:
    line = line.strip() if separator is None else line.strip("\n\r ")
    if separator is None:
        line = re.sub(r"\(([^()]*)\)", lambda inner: re.sub(r"\s", "", inner[0]), line)
        line = re.sub(r"\s([-+−])\s+(?=[ij]|[\d.,]+(?:[eE][-+]?\d+)?\s?\*?[ij]\b)", r"\1", line)
        return line.split()
    if '"' not in line:
        return [*map(str.strip, line.split(separator))]
    return [cell.strip().strip('"').strip() for cell in _apart(line, separator)]


def _apart(line: str, separator: str) -> list[str]:
    """The line between its separators; one behind which a quote that is open is closed belongs to
    the text in quotes.
    """
    cells: list[list[str]] = []
    quotes = 0
    for piece in reversed(line.split(separator)):
        if quotes % 2:
            cells[-1].append(piece)
        else:
            cells.append([piece])
        quotes += piece.count('"')
    return [separator.join(reversed(cell)) for cell in reversed(cells)]


def data_rows(rows: Sequence[tuple[int, list[str]]], comma: bool) -> list[tuple[int, list[str]]]:
    """Rows with as many numbers as most have, two at least, in cells that are as many as in most of
    them.

    Empty cells are numbers, but a word or two with empty cells behind them are a title.
    """
    counted = [(row, _numbers_in(row[1], comma), len(row[1])) for row in rows]
    numeric = [
        one
        for one in counted
        if one[1] >= 2
        and 2 * one[1] >= one[2]
        and (one[1] == one[2] or not _is_title(one[0][1], comma))
    ]
    if not numeric:
        return []
    width = Counter(width for _, _, width in numeric).most_common(1)[0][0]
    usual = Counter(count for _, count, cells in numeric if cells == width).most_common(1)[0][0]
    return [
        row for row, count, cells in numeric if cells == width and count >= usual and any(row[1])
    ]


def _numbers_in(cells: Sequence[str], comma: bool) -> int:
    """How many cells are numbers."""
    text = "".join(cells)
    if not ("_" in text or (comma and "." in text)):
        try:
            return len([*map(float, cells)])
        except ValueError:
            pass
    return sum(number(cell, comma) is not None for cell in cells)


def _is_title(cells: Sequence[str], comma: bool) -> bool:
    """Whether there are words and less than two numbers."""
    filled = [cell for cell in cells if cell]
    numbers = islice((cell for cell in filled if number(cell, comma) is not None), 2)
    return len(list(numbers)) < min(2, len(filled))


def rows_table(
    rows: Sequence[tuple[int, list[str]]],
    marked: Sequence[int],
    where: str,
    stem: str,
    comma: bool,
    form: NumberFormat,
    *,
    supposed: str = "",
    called: Sequence[str] = (),
    alike: bool = True,
) -> ForeignTable:
    """A table of rows with their numbers.

    comma : whether a comma may be their decimal mark. supposed, alike : of `decimal_marks`.
    called : how the cells of each column are called, before their row.
    """
    hidden = set(marked)
    data = data_rows([row for row in rows if row[0] not in hidden], comma)
    first, width = data[0][0], len(data[0][1])
    _require_no_factor(rows, where)
    if width > MOST_COLUMNS:
        raise SweepError(f"{where} must have at most {MOST_COLUMNS} columns; found {width}.")
    body = [cells for _, cells in data]
    names = _names([row for row in rows if row[0] < first], hidden, body, comma, where)
    shown = [name or f"#{k + 1}" for k, name in enumerate(names or [""] * width)]
    taken = hidden | {row for row, _ in data}
    begin = max(
        (row for row, cells in rows if row < first and _mostly_words(cells, width)), default=first
    )
    strays = [
        (row, cells) for row, cells in rows if row > begin and row not in taken and any(cells)
    ]
    numeric = [
        k
        for k in range(width)
        if strays and all(number(cells[k], comma) is not None for _, cells in data)
    ]
    for row, cells in strays:
        words = [k for k in numeric if k < len(cells) and number(cells[k], comma) is None]
        if (
            words
            and len(cells) == width
            and 2 * len(words) <= width
            and not _is_title(cells, comma)
        ):
            place = _place(where, row, shown[words[0]], called[words[0]] if called else "")
            found = cells[words[0]][:40]
            raise SweepError(
                f"{place} must be a number; found {found!r}, correct it or leave the row out."
            )
        if first < row < data[-1][0]:
            raise SweepError(
                f"{where} line {row} must be a row like the others, {width} cells; found "
                f"{len(cells)}: "
                f"{' '.join(cells)[:60]!r}, is it cut off?"
            )
    behind = [
        (row, cells)
        for row, cells in strays
        if row > data[-1][0] and number(cells[0], comma) is not None
    ]
    cut = [
        f"line {row}, behind the last whole one, has {len(cells)} of {width} cells: left out, is "
        "the file cut off?"
        for row, cells in behind
    ]
    columns: dict[str, np.ndarray] = {}
    cells_of: dict[str, str] = {}
    written: dict[str, list[str]] = {}
    for k in range(width):
        cells = [row[k] for _, row in data]
        if any(cells) or not names or names[k]:
            name = _unlike(shown[k], columns)
            columns[name] = _column(cells, comma, form)
            if columns[name].dtype.kind != "O" and spice_number(cells[0]) is None:
                written[name] = cells
            if called:
                cells_of[name] = called[k]
    lines = np.array([n for n, _ in data])

    def place_of(row: int, name: str) -> str:
        return _place(where, int(lines[row]), name, cells_of.get(name, ""))

    marks = decimal_marks(written, form.mark, supposed, place_of, alike=alike)
    for name, mark in marks.of_column.items():
        if (mark == ",") != comma:
            columns[name] = _column(written[name], mark == ",", form)
    above = ["\t".join(filter(None, cells)) for number, cells in rows if number < first]
    pairs = (
        re.sub(r"\t(?=[^\t=:]{1,20}[=:][^\t]*\d)", "; ", line[:LONGEST_NOTE]) for line in above
    )
    above = [re.sub(r"(?<![:=])\t(?=[-+−.]?\d)", ": ", line).replace("\t", " ") for line in pairs]
    above = [beside_with_point(line, marks.of_table) for line in above]
    comments = tuple(
        (number, " ".join(cells)[1:]) for number, cells in rows if cells[0].startswith("#")
    )
    left_out = (
        names
        and not names[0]
        and all(len(cells) < width for number, cells in rows if number < first)
    )
    remarks = (*((_NAMES_OF_ROWS,) if left_out else ()), *cut[:1], *marks.remarks)
    return ForeignTable(
        where,
        stem,
        columns,
        lines,
        tuple(above),
        comments=comments,
        remarks=remarks,
        cells=cells_of,
        decimal=marks.of_table,
        polar_angle=_polar_angle(written, comma, form, place_of),
    )


def _require_no_factor(rows: Sequence[tuple[int, list[str]]], where: str) -> None:
    """Raise SweepError for a line that multiplies the numbers below it: of these some digits are
    shown alone.
    """
    for number_of_line, cells in rows:
        words = [cell for cell in cells if cell]
        if 1 <= len(words) <= 2 and _FACTOR.fullmatch(" ".join(words)):
            raise SweepError(
                f"{where} line {number_of_line} must be a row of names or numbers; found "
                f"{' '.join(words)}, a factor of all "
                "numbers below it as MATLAB displays them, write the table itself: writematrix, "
                "writetable, or save with -v7."
            )


def _mostly_words(cells: Sequence[str], width: int) -> bool:
    return (
        len(cells) == width and sum(any(c.isalpha() for c in cell) for cell in cells) * 2 >= width
    )


def _names(
    above: Sequence[tuple[int, list[str]]],
    marked: set[int],
    body: Sequence[list[str]],
    comma: bool,
    where: str,
) -> list[str]:
    """The last line above the numbers that has as many cells; a line of units below the names goes
    into them.

    body : the cells of the rows with numbers.
    """
    above = above[-NAMES_ABOVE:]
    width = len(body[0])
    for k, (number_of_line, cells) in reversed(list(enumerate(above))):
        cells = _unmarked(cells, width) if number_of_line in marked else cells
        if 2 <= width - 1 == len(cells):
            cells = _as_wide(cells, body, comma, f"{where} line {number_of_line}")
        if len(cells) > width:
            cells = _glued(cells, width)
        if len(cells) != width:
            continue
        bare = ["" if cell in _NO_UNIT else cell.strip("[](){} ") for cell in cells]
        units = [unit_of(cell) or size_of(cell) for cell in bare]
        parts = [meaning_of(cell).role in ("re", "im", "mag", "phase") for cell in bare]
        known = [
            not cell or unit or part for cell, unit, part in zip(bare, units, parts, strict=True)
        ]
        if k and any(bare) and 2 * sum(map(bool, known)) > width:
            upper = _names(above[:k], marked, body, comma, where) or _titles(above[k - 1][1], width)
            own = [not one and not name for one, name in zip(known, upper, strict=False)]
            for at in range(1, len(upper)):  # a name may stand above several parts
                upper[at] = upper[at] or upper[at - 1] * (bool(bare[at]) and not own[at])
            words = [
                f"[{cell}]" if unit else name if alone else cell
                for cell, name, unit, alone in zip(bare, cells, units, own, strict=False)
            ]
            if upper and all(one or alone for one, alone in zip(known, own, strict=True)):
                return [f"{name} {word}".strip() for name, word in zip(upper, words, strict=True)]
        if _mostly_words(cells, width):
            return cells
    return []


def _titles(cells: list[str], width: int) -> list[str]:
    """Cells that name some matrices, of which each stands above several columns; else none."""
    if len(cells) != width or sum(bool(meaning_of(cell).entry) for cell in cells) < 2:
        return []
    return list(cells)


def _as_wide(cells: list[str], body: Sequence[list[str]], comma: bool, where: str) -> list[str]:
    """Names that are one less than the cells of a row: the last column has none where it is empty,
    the first where it names rows.

    Of a line that names no quantity the cells as they are. Raises SweepError where nothing says
    which column has no name.
    """
    last = [row[-1] for row in body]
    rows_named = _names_rows(body, comma)
    measured = any(
        (value := number(cell, comma)) is not None and np.isfinite(value) for cell in last
    )
    if not any(last) or not (measured or rows_named):
        return [*cells, ""]
    if rows_named and measured:
        return ["", *cells]
    if not any(meaning_of(cell).role for cell in cells) and not all(
        unit_of(cell.strip("[](){} ")) for cell in cells
    ):
        return cells
    raise SweepError(
        f"{where} must name each column; found {len(cells)} names above rows of {len(body[0])} "
        "cells, add the one "
        'that is missing where its column stands ("row" for numbers of rows).'
    )


def _names_rows(body: Sequence[list[str]], comma: bool) -> bool:
    """Whether the first column counts the rows from 0 or 1 on, or is another text in each, as R and
    pandas write it.

    R writes numbers of rows in quotes, of which some are left out where rows are.
    """
    first = [row[0] for row in body]
    if all(re.fullmatch('".*"', cell) for cell in first) and not any(
        row[1].startswith('"') for row in body
    ):
        return len({*first}) == len(first) > 1
    values = [number(cell, comma) for cell in first]
    if all(value is None for value in values):
        return len({*first}) == len(first) > 1
    return any(values == [*range(begin, begin + len(values))] for begin in (0, 1))


def _unmarked(cells: list[str], width: int) -> list[str]:
    """A line of names behind a comment mark, which may stand alone as the first of its cells."""
    first = _MARKS.sub("", cells[0] + " ").strip()
    return cells[1:] if not first and len(cells) == width + 1 else [first, *cells[1:]]


def _glued(cells: list[str], width: int) -> list[str]:
    """As many names as there are columns, where blanks separate them: units in brackets and "/
    unit" belong to the word before them, and where that is not enough, "-NODE" to which a current
    flows.

    The cells as they are where that does not make so many.
    """
    for behind in (_UNIT_BEHIND, f"{_UNIT_BEHIND}|{_NODE_BEHIND}"):
        joined: list[str] = []
        for cell in cells:
            if joined and (re.fullmatch(behind, cell) or joined[-1].endswith("/")):
                joined[-1] = f"{joined[-1]} {cell}"
            else:
                joined.append(cell)
        if len(joined) == width:
            return joined
    return cells


def _unlike(name: str, taken: dict[str, Any]) -> str:
    """A name that no other column has."""
    return (
        name
        if name not in taken
        else next(new for k in range(2, 999) if (new := f"{name} #{k}") not in taken)
    )


def _column(cells: Sequence[str], comma: bool, form: NumberFormat) -> np.ndarray:
    text = "\0".join(cells)
    if not ("_" in text or (comma and "." in text)):
        plain = text.replace(",", ".").split("\0") if comma else cells
        try:
            return np.array(list(map(float, plain)))
        except ValueError:
            pass
    radians = form.polar == "rad"
    values = [number(cell, comma, radians=radians) for cell in cells]
    if any(value is None for value in values):
        return np.array(cells, dtype=object)
    return _plain(np.array(values, dtype=complex))


def _polar_angle(
    columns: Mapping[str, Sequence[str]],
    comma: bool,
    form: NumberFormat,
    place: Callable[[int, str], str],
) -> float:
    """The largest angle of the polar cells of a table; of `largest_angle`."""
    polar = {
        name: [polar_cell(cell, comma) for cell in cells]
        for name, cells in columns.items()
        if _holds_polar_sign(cells)
    }
    return largest_angle(polar, place, form.polar)


def _holds_polar_sign(cells: Sequence[str]) -> bool:
    text = "\0".join(cells)
    return any(sign in text for sign in SIGNS)


def _polar_angle_of_text(
    held: Mapping[str, np.ndarray], table: ForeignTable, form: NumberFormat
) -> float:
    """The same of arrays, in the columns of which text became numbers."""
    written = {
        name: [*map(str, column.ravel().tolist())]
        for name, column in held.items()
        if column.dtype.kind not in "biufc" and table.columns[name].dtype.kind != "O"
    }
    return _polar_angle(written, False, form, table.place)


def _plain(values: np.ndarray, form: NumberFormat = UNSAID) -> np.ndarray:
    """Real numbers as such, complex ones, or text; text that is all numbers is numbers."""
    if values.dtype.kind in "biuf":
        return values.astype(float)
    if values.dtype.kind == "c":
        real = np.nan_to_num(np.imag(values)) == 0
        return np.real(values).astype(float) if real.all() else values
    text = ["" if value is None else str(value) for value in values.ravel().tolist()]
    if any("," in cell for cell in text) and _may_be_decimal_commas(text):
        return np.array(text, dtype=object)
    read = [number(cell, False, radians=form.polar == "rad") for cell in text]
    if text and all(value is not None for value in read):
        return _plain(np.array(read, dtype=complex))
    return np.array(text, dtype=object)


def _may_be_decimal_commas(cells: Sequence[str]) -> bool:
    """Whether commas may part thousands or be decimal marks, and no cell shows which."""
    marks = shown_marks(cells)
    return "," in marks.either and "." not in marks.evident


def array_table(
    arrays: dict[str, np.ndarray],
    where: str,
    stem: str,
    *,
    of_matlab: bool = False,
    form: NumberFormat = UNSAID,
) -> ForeignTable:
    """Columns of the most frequent length; matrices 2x2xK become four columns, tables KxN as many;
    single numbers are notes.

    of_matlab : of two frequencies, the last index of a matrix 2x2x2 counts them. Raises SweepError
    where nothing says which does.
    """
    numeric = {
        name: value
        for name, value in arrays.items()
        if value.dtype.kind in "biufc" and value.size > 1
    }
    if not numeric:
        raise SweepError(
            f"{where} must hold arrays of numbers; found {', '.join(arrays)[:120] or 'nothing'}."
        )
    require_plain_responses(arrays, where)
    length = _length(numeric)
    columns, used, remarks = with_ports(numeric, length)
    numbered: set[str] = set()
    for name, value in numeric.items():
        if name in used:
            continue
        shape = value.shape
        squeezed = value.squeeze()
        if value.size == length:
            columns[name] = value.ravel()
            if re.search(r"\{\d+\}$", name):  # of a cell array
                numbered.add(name)
        elif squeezed.ndim == 3 and squeezed.shape in ((2, 2, length), (length, 2, 2)):
            if length == 2 and not of_matlab:
                raise SweepError(
                    f"{where}: {name} must say which of its indices counts the frequencies; found "
                    "shape (2, 2, 2), save its "
                    "entries as Ydd, Ydq, Yqd and Yqq."
                )
            first = squeezed.shape[0] == length != 2
            matrix = squeezed if first else np.moveaxis(squeezed, -1, 0)
            base, part = matrix_and_part(name)
            base = "" if _PLAIN_MATRIX.fullmatch(base) else base
            for row, column in np.ndindex(2, 2):
                columns[f"{base}({row + 1},{column + 1}){part}"] = matrix[:, row, column]
        elif squeezed.ndim == 3 and (ports := ports_of(squeezed.shape)):
            raise SweepError(
                f"{where}: {name} is {ports}x{ports} at each frequency; save the 2x2 block of d "
                "and q at the device's terminal, such as Y(1:2,1:2,:), of an impedance that of its "
                "inverse, or all entries by name, Ydd .. Ydcdc."
            )
        elif value.ndim == 2 and length in shape and value.size // length <= MOST_COLUMNS:
            for k, column in enumerate(value.T if shape[0] == length else value, 1):
                columns[f"{name}:{k}"] = column
                numbered.add(f"{name}:{k}")
    columns |= {
        name: value.ravel()
        for name, value in arrays.items()
        if value.dtype.kind == "U" and value.size == length
    }
    short = {name: name.rsplit(".", 1)[-1] for name in columns}
    ends = Counter(short.values())
    short = {name: end if ends[end] == 1 else name for name, end in short.items()}
    held = {short[name]: column for name, column in columns.items()}
    columns = {name: _plain(column, form) for name, column in held.items()}
    for name, value in arrays.items():
        if (
            value.size == 1
            and value.dtype.kind == "c"
            and meaning_of(name.rsplit(".", 1)[-1]).role in ("p", "q", "v")
        ):
            raise SweepError(
                f"{where}: {name} must be a real number; found {value.ravel()[0]}, save its real "
                "part if it is meant."
            )
    single = [
        f"{name.rsplit('.', 1)[-1]}: {value.ravel()[0]}"
        for name, value in arrays.items()
        if value.size == 1
    ]
    single = [note[:LONGEST_NOTE] for note in single]
    by_number = frozenset(short[name] for name in numbered)
    line, notes = np.arange(1, length + 1), tuple(single)
    table = ForeignTable(where, stem, columns, line, notes, remarks=remarks, numbered=by_number)
    return replace(table, polar_angle=_polar_angle_of_text(held, table, form))


def _length(numeric: Mapping[str, np.ndarray]) -> int:
    """How many frequencies arrays have: the most frequent size, or that of the array which is
    called so, where it is 2, 4 or 8.

    These are also the sizes of matrices and of their parts.
    """
    lengths = Counter(size for value in numeric.values() for size in {*value.shape} - {1, 2, 4, 8})
    vectors = {
        name: value.size for name, value in numeric.items() if value.size == max(value.shape)
    }
    named = [
        size
        for name, size in vectors.items()
        if meaning_of(name.rsplit(".", 1)[-1]).role in ("freq", "omega")
    ]
    if named and not lengths.keys() & {*named}:
        return named[0]
    if lengths:
        return lengths.most_common(1)[0][0]
    if vectors:
        return max(vectors.values())
    return max(
        max(value.shape) if value.ndim == 3 else value.shape[0] for value in numeric.values()
    )
