"""Files of dynamic data: what is written is read back, and each wrong file is one sentence."""

from pathlib import Path

import pytest

from ibrid.errors import IbridError
from ibrid.generic.dyr import dyr_text, range_warnings, read_dyr, values_from
from ibrid.generic.model import MODELS

MODEL = MODELS["wecc_regc_a+reec_a"]


def written(folder: Path, text: str) -> Path:
    path = folder / "plant.dyr"
    path.write_text(text, encoding="utf-8")
    return path


#: As PSS/E writes it, the id in quotes with a space.
REGCA1 = "1 'REGCA1' '1 ' 1 0.02 10 0.9 0.5 1.22 1.2 0.8 0.4 -1.3 0.02 0.7 999 -999 0.7 /\n"


def test_what_is_written_is_read_back(tmp_path: Path):
    values = {**MODEL.typical, "Kqv": 3.25, "QFLAG": 1.0}
    path = written(tmp_path, dyr_text(MODEL.blocks, values, 12, "A1"))
    assert values_from(read_dyr(path), MODEL.blocks) == (values, 12, "A1")


def test_records_have_as_many_numbers_as_wecc_says(tmp_path: Path):
    path = written(tmp_path, dyr_text(MODEL.blocks, MODEL.typical, 1, "1"))
    counts = {record.model: len(record.numbers) for record in read_dyr(path)}
    assert counts == {"REGCA1": 1 + 14, "REECA1": 6 + 45}


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("1 'REGCA1' 1 1 0.02 /\n", "must hold 15 numbers"),
        ("1 'REECB1' 1 0 0 /\n", "prohibited by NERC"),
        ("1 'REGCA1' 1 1 fast /\n", "must hold finite numbers; found 'fast'"),
        ("1 'REGCA1' 1 1 nan /\n", "must hold finite numbers; found 'nan'"),
        (REGCA1.replace("' 1 0.02", "' 7 0.02"), "Lvplsw of REGCA1 must be 0 or 1; found 7"),
        ("1 'REGCA1' 1 1 0.02\n", "end with a slash"),
        ("1 'REGCA1' 1 1 0_02 /\n", "must hold finite numbers; found '0_02'"),
        ("1 'GENROU' 1 1 0.02 /\n", "must hold REGCA1; found GENROU at bus 1, id 1"),
        ("a,b\n1,2\n", "must hold REGCA1; found nothing"),
        (REGCA1 + REGCA1, "leave out all but one"),
        ("1 'A'" + 20_000 * " " + "!/\n", "a record is written bus 'MODEL' id numbers /"),
    ],
)
def test_a_wrong_file_is_one_sentence(tmp_path: Path, text: str, said: str):
    with pytest.raises(IbridError, match=said):
        values_from(read_dyr(written(tmp_path, text)), MODEL.blocks)


def test_two_generators_need_a_bus(tmp_path: Path):
    texts = [dyr_text(MODEL.blocks, MODEL.typical, bus, "1") for bus in (3, 4)]
    records = read_dyr(written(tmp_path, "".join(texts)))
    with pytest.raises(IbridError, match="--bus"):
        values_from(records, MODEL.blocks)
    assert values_from(records, MODEL.blocks, 4)[1] == 4


def test_two_machines_of_a_bus_need_an_id(tmp_path: Path):
    texts = [dyr_text(MODEL.blocks, MODEL.typical, 3, machine) for machine in ("1", "2")]
    records = read_dyr(written(tmp_path, "".join(texts)))
    with pytest.raises(IbridError, match="--id"):
        values_from(records, MODEL.blocks, 3)
    assert values_from(records, MODEL.blocks, machine="2")[1:] == (3, "2")
    with pytest.raises(IbridError, match="with id 7"):
        values_from(records, MODEL.blocks, machine="7")


def test_blocks_of_different_generators_make_no_plant(tmp_path: Path):
    regca1, reeca1 = (
        dyr_text((block,), MODEL.typical, bus, "1")
        for block, bus in zip(MODEL.blocks, (3, 4), strict=True)
    )
    records = read_dyr(written(tmp_path, regca1 + reeca1))
    with pytest.raises(IbridError, match="one generator; found bus 3, id 1 and bus 4, id 1"):
        values_from(records, MODEL.blocks)


def test_an_id_in_quotes_is_read_without_its_space(tmp_path: Path):
    (record,) = read_dyr(written(tmp_path, REGCA1))
    assert (record.id, len(record.numbers)) == ("1", 15)


def test_what_is_no_file_of_text_is_one_sentence(tmp_path: Path):
    (tmp_path / "plant.dyr").write_bytes(b"\xff\xfe\x00")
    for path, said in ((tmp_path / "plant.dyr", "no text in UTF-8"), (tmp_path, "cannot be read")):
        with pytest.raises(IbridError, match=said):
            read_dyr(path)


def test_unusual_values_and_crossed_bounds_are_said():
    said = range_warnings(MODEL.blocks, {**MODEL.typical, "Kqv": 50.0, "VMIN": 1.2})
    assert any("Kqv = 50" in sentence for sentence in said)
    assert any("VMIN = 1.2 must be below" in sentence for sentence in said)
    assert range_warnings(MODEL.blocks, MODEL.typical) == ()
