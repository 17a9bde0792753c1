"""The decimal mark of numbers, and the mark between their thousands: 1.234,5 and 1,234.5 show them,
1.234 alone has two readings.
"""

import re
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace

from ibrid.errors import SweepError, some

#: Digits with marks among them, and the power of ten behind.
_MARKED = re.compile(r"(?:\d+(?:[.,]\d*)+|[.,]\d+)(?:[eEdD][-+]?\d+)?")
#: Digits of which one mark may be the decimal one or part thousands.
_EITHER = re.compile(r"[1-9]\d{0,2}[.,]\d{3}")
_GROUPED = {
    ".": re.compile(r"\d{1,3}(?:,\d{3})+(?:\.\d*)?"),
    ",": re.compile(r"\d{1,3}(?:\.\d{3})+(?:,\d*)?"),
}
#: One mark that can be nothing but the decimal one: behind no digits, a zero or four digits, before
#: less or more than three, or before a power of ten.
_EVIDENT = {
    mark: re.compile(
        rf"(?<![\d.,])(?:0\d*|\d{{4,}}|){mark}\d|\d{mark}(?:\d{{4,}}|\d{{0,2}}(?![\d.,])|\d+[eEdD])"
    )
    for mark in (r"\.", ",")
}
_EVIDENT["."] = _EVIDENT.pop(r"\.")
_TWICE = re.compile(r",\d{3},")
_OTHER = {".": ",", ",": "."}
_WORDS = {".": "point", ",": "comma"}
#: A number behind a name, among words.
_BESIDE = re.compile(r"(?<!\d)([:=]\s*+[-+−]?)(\d++(?:[.,]\d++)++)")


def with_point(text: str, comma: bool) -> str:
    """The numbers in a cell with a decimal point and without marks between thousands.

    comma : whether a comma may be the decimal mark; it is that of numbers with two readings then.
    What is no number is left as it stands.
    """

    def plain(match: re.Match[str]) -> str:
        mark = shown_mark(match[0])
        if mark is None or (mark == "," and not comma):
            return match[0]
        mark = mark or ("," if comma else ".")
        return match[0].replace(_OTHER[mark], "").replace(mark, ".")

    return _MARKED.sub(plain, text)


def shown_mark(digits: str) -> str | None:
    """The decimal mark that digits with marks show: "" where they have two readings, None where
    they have none.
    """
    mantissa = re.split("[eEdD]", digits)[0]
    marks = re.sub(r"\d", "", mantissa)
    if len(marks) == 1:
        return "" if _EITHER.fullmatch(digits) else marks
    mark = marks[-1] if marks[-1] != marks[0] else _OTHER[marks[0]]
    return mark if _GROUPED[mark].fullmatch(mantissa) else None


@dataclass(frozen=True)
class ShownMarks:
    """Which decimal marks the cells of a column show.

    evident : mark -> the first cell that can have no other.
    either : mark -> the first cell in which it is the decimal mark or parts thousands; not told of
    the only mark of a column that is evident.
    parted : the first cell in which thousands are parted for certain, None for none.
    """

    evident: Mapping[str, int]
    either: Mapping[str, int]
    parted: int | None = None


def shown_marks(cells: Sequence[str]) -> ShownMarks:
    """The marks of a column of numbers."""
    text = "\0".join(cells)
    marks = [mark for mark in ".," if mark in text]
    if not marks:
        return ShownMarks({}, {})
    if len(marks) == 1 and not (marks == [","] and _TWICE.search(text)):
        match = _EVIDENT[marks[0]].search(text)
        if match:
            row = text.count("\0", 0, match.end())
            return ShownMarks({marks[0]: row}, {})
    evident: dict[str, int] = {}
    either: dict[str, int] = {}
    parted: list[int] = []
    for row, cell in enumerate(cells):
        for digits in _MARKED.findall(cell):
            mark = shown_mark(digits)
            if mark:
                evident.setdefault(mark, row)
                parted += [row] * (_OTHER[mark] in digits)
            elif mark == "":
                either.setdefault("." if "." in digits else ",", row)
    return ShownMarks(evident, either, parted[0] if parted else None)


@dataclass(frozen=True)
class DecimalMarks:
    """The decimal mark of each column in which there are any; and what is said of them."""

    of_column: Mapping[str, str]
    remarks: tuple[str, ...]

    @property
    def of_table(self) -> str:
        """The mark of all columns, "" where they differ or have none."""
        marks = {*self.of_column.values()}
        return marks.pop() if len(marks) == 1 else ""


def decimal_marks(
    columns: Mapping[str, Sequence[str]],
    said: str,
    supposed: str,
    place: Callable[[int, str], str],
    *,
    alike: bool,
) -> DecimalMarks:
    """The decimal mark of each column of numbers: as its cells show, else as is said, else as all
    other columns show, else as supposed.

    said, supposed : a mark, or "" for none; what is supposed holds of numbers with this mark alone.
    place : where a cell stands, for sentences.
    alike : whether all columns were written by one program, so that one shows the mark of another.

    Raises SweepError where cells of a column contradict each other, and where nothing shows the
    mark of numbers with two readings.
    """
    shown = {name: shown_marks(cells) for name, cells in columns.items()}
    if not alike:
        shown = {name: _of_text_alone(marks) for name, marks in shown.items()}
    evident = {mark for one in shown.values() for mark in one.evident} if alike else set()
    of_column: dict[str, str] = {}
    for name, marks in shown.items():
        if len(marks.evident) > 1 and not said:
            point, comma = (columns[name][marks.evident[mark]][:40] for mark in ".,")
            raise SweepError(
                f"{place(max(marks.evident.values()), name)} must have the decimal mark of its "
                f"column; found {point!r} and {comma!r} in it, correct one, or add --decimal point "
                "or --decimal comma."
            )
        if len(marks.evident) == 1:
            of_column[name] = next(iter(marks.evident))
        elif marks.evident or marks.either:
            one_mark = next(iter(evident)) if len(evident) == 1 else ""
            likely = supposed if not evident and {*marks.either} == {supposed} else ""
            of_column[name] = said or one_mark or likely
        if of_column.get(name) == "":
            raise _unsettled(name, columns[name], marks, evident, place)
    return DecimalMarks(of_column, tuple(_remarks(columns, shown, of_column, said)))


def _of_text_alone(marks: ShownMarks) -> ShownMarks:
    """What the text of a workbook shows: its numbers, which have a point here, say nothing of text
    with commas beside them.
    """
    if "," not in marks.either or marks.parted is not None:
        return marks
    return replace(marks, evident={mark: row for mark, row in marks.evident.items() if mark == ","})


def _unsettled(
    name: str,
    cells: Sequence[str],
    marks: ShownMarks,
    evident: set[str],
    place: Callable[[int, str], str],
) -> SweepError:
    """What to say about numbers with two readings."""
    row = min(marks.either.values())
    digits = next(one for one in _MARKED.findall(cells[row]) if shown_mark(one) == "")
    decimal, thousands = digits.replace(",", "."), re.sub("[.,]", "", digits)
    why = "other columns have points and commas" if evident else "no other number shows it"
    return SweepError(
        f"{place(row, name)} must show which mark is the decimal one; found {cells[row][:40]!r}, "
        f"which is {decimal} or {thousands} ({why}), add --decimal point or --decimal comma."
    )


def _remarks(
    columns: Mapping[str, Sequence[str]],
    shown: Mapping[str, ShownMarks],
    of_column: Mapping[str, str],
    said: str,
) -> list[str]:
    """Decimal commas, and marks between thousands with an example, in words."""
    remarks: list[str] = []
    for mark in ".,":
        names = [name for name, one in of_column.items() if one == mark]
        parted = [(name, row) for name in names if (row := _parted(shown[name], mark)) is not None]
        against = bool(said) and said != mark
        if not names or not (parted or against or mark == ","):
            continue
        where = f" of {some(names, 3)}" if len({*of_column.values()}) > 1 else ""
        why = f", as these numbers show, not {_WORDS[said]} as said" if against else ""
        words = f"decimal mark{where}: {_WORDS[mark]}{why}"
        if parted:
            name, row = parted[0]
            digits = next(
                one
                for one in _MARKED.findall(columns[name][row])
                if _OTHER[mark] in one and shown_mark(one) is not None
            )
            number = digits.replace(_OTHER[mark], "").replace(mark, ".")
            words += f"; the {_WORDS[_OTHER[mark]]} parts thousands, {digits} ({name}) is {number}"
        remarks.append(words)
    return remarks


def _parted(marks: ShownMarks, mark: str) -> int | None:
    """The first cell in which thousands are parted, where a mark is the decimal one."""
    return marks.either.get(_OTHER[mark], marks.parted)


def beside_with_point(words: str, mark: str) -> str:
    """Words in which numbers behind a name, such as `P: 8.000 W`, are written with the decimal mark
    of their table; as they stand where that is "".
    """

    def plain(match: re.Match[str]) -> str:
        return match[1] + with_point(match[2], mark == ",")

    return _BESIDE.sub(plain, words) if mark else words
