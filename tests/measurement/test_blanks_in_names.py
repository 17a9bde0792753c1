"""Names and notes of tables of 2,000 characters of any kind are read to their end: one that took
the square would take hours.
"""

from collections.abc import Callable
from contextlib import suppress

import pytest

from ibrid.errors import SweepError
from ibrid.measurement.importing.cell_number import number
from ibrid.measurement.importing.column_words import entry_named, meaning_of, without_unit
from ibrid.measurement.importing.foreign_table import LONGEST_NOTE
from ibrid.measurement.importing.frequency_unit import measure_keyed, measure_of, units_spoken_of
from ibrid.measurement.importing.table_files import read_tables
from ibrid.measurement.importing.told import base_of, numbers_beside, point_said, told_beside

READERS: dict[str, Callable[[str], object]] = {
    "numbers": lambda text: numbers_beside("", [text]),
    "stem": lambda text: numbers_beside(text[:255], []),
    "words": lambda text: told_beside("", [text]),
    "point": point_said,
    "base": lambda text: base_of(text, "--base"),
    "measure": measure_of,
    "key": lambda text: measure_keyed([text], {}, "tone", where="a file"),
    "spoken": lambda text: units_spoken_of([text], []),
    "column": meaning_of,
    "unit": without_unit,
    "entry": entry_named,
    "cell": lambda text: number(text, True),
}
#: What a text begins with, what fills it, what it ends with.
BEGINNINGS = ("", "Station", "grid frequency", "rad", "tone [", "p=")
FILLINGS = (" ", "\t", "a", "1", "(", "[", "_", "/", ".", "-", "a ", "rad ", "p= ", "(1)", "f0 ")
ENDINGS = ("", "North (", "!", "=")


@pytest.mark.parametrize("reader", READERS)
def test_a_text_of_two_thousand_characters_is_read_or_refused_whatever_fills_it(reader: str):
    """No clock is asked: expressions that go back over blanks took 17 s for each of 360 texts, and
    take none now.
    """
    for beginning in BEGINNINGS:
        for filling in FILLINGS:
            body = (filling * LONGEST_NOTE)[:LONGEST_NOTE]
            for ending in ENDINGS:
                text = beginning + body + ending
                with suppress(SweepError):
                    assert READERS[reader](text) is not text


def test_a_line_of_blanks_above_the_numbers_is_a_note(tmp_path):
    path = tmp_path / "scan.csv"
    blanks = " " * 19_900
    path.write_text(
        f"Station{blanks}North (\n# a{blanks}b\nf [Hz],Ydd{blanks}!\n1,2\n2,3\n", encoding="utf-8"
    )
    (table,) = read_tables(path)
    assert told_beside("", table.notes) == {}
    assert table.notes[:2] == ("Station", "a")
    assert len(table.columns) == 2


def test_blanks_in_runs_change_nothing_of_what_is_said():
    assert numbers_beside("", ["f0   [Hz]   =   50"]) == {"f0": (50.0, "Hz")}
    assert numbers_beside("", ["S base (kVA): 10", "V base\t=\t400 V"]) == {
        "S base": (10.0, "kVA"),
        "V base": (400.0, "V"),
    }
    assert without_unit("omega   in   rad / s") == ("omega", "rad / s")
    assert without_unit("Re_Ydd _ / S") == ("Re_Ydd _", "S")
    assert without_unit("f_rad_s") == ("f", "rad_s")
    assert measure_of("[rad  per   sec]") == ("angular frequency", 1.0)
    assert point_said("full : p=0.8, q=0.1,") == (
        "full",
        {"p": (0.8, "per unit"), "q": (0.1, "per unit")},
    )
