"""COMTRADE records: one made dip in every format and with what recorders do to the standard is read
as the same numbers.
"""

import shutil
import struct
from pathlib import Path

import numpy as np
import pytest

pytest.importorskip(
    "comtrade", reason="COMTRADE files are read by comtrade (pip install 'ibrid[comtrade]')"
)

from ibrid.errors import SweepError
from ibrid.measurement.importing.timed import comtrade_file
from ibrid.measurement.importing.timed.recording_files import each_once
from ibrid.measurement.quality.event_contradictions import contradictions
from ibrid.measurement.read_events import is_events_file, read_events
from ibrid.measurement.recordings.channels import Channel, role_of
from ibrid.measurement.recordings.events import EventRecord

F0, RATE, BEGIN, END = 50.0, 5000.0, 0.10005, 0.20005
V_BASE, S_BASE = 20e3, 1e6
BASES = {"s_base_va": S_BASE, "v_base_v": V_BASE}
PEAK_V, PEAK_I = V_BASE * np.sqrt(2 / 3), S_BASE / V_BASE * np.sqrt(2 / 3)
TIME = np.arange(1500) / RATE
NAMES = ("VA", "VB", "VC", "IA", "IB", "IC")
#: One step of a 16-bit channel over its range, per unit: what rounding can make.
STEP = 3.0 / 32767


def phases(time: np.ndarray) -> np.ndarray:
    """(6, n) per unit: 1 to 0.6 and back, a current of 0.9 at 20 degrees behind that grows to
    1.2.
    """
    v = np.where((time > BEGIN) & (time < END), 0.6, 1.0)
    i = np.where(time > BEGIN, 1.2, 0.9) * np.exp(-1j * np.deg2rad(20))
    turns = [np.exp(1j * (2 * np.pi * F0 * time - 2 * np.pi * k / 3)) for k in range(3)]
    return np.stack([(value * turn).real for value in (v, i) for turn in turns])


def configuration(
    kind: str,
    year: str = ",1999",
    factors: np.ndarray | None = None,
    skew: tuple[float, ...] = (0,) * 6,
    side: str = ",1,1,P",
    states: int = 1,
    rates: str = f"1\n{RATE:.0f},{len(TIME)}",
    end: str = "1\n",
    names: tuple[str, ...] = NAMES,
) -> str:
    a = np.repeat([PEAK_V, PEAK_I], 3) * STEP if factors is None else factors
    lines = [f"Some station,recorder{year}", f"{6 + states},6A,{states}D"]
    for k, name in enumerate(names):
        unit = "V" if k < 3 else "A"
        lines.append(f"{k + 1},{name},,,{unit},{float(a[k])!r},0.0,{skew[k]},-32767,32767{side}")
    lines += [f"{k + 1},TRIP{k},,,0" for k in range(states)]
    lines += [f"{F0:.0f}", rates, "01/02/2024,10:20:30.000000", "01/02/2024,10:20:30.100000", kind]
    return "\n".join(lines) + ("\n" + end if year else "\n")


def samples(kind: str, values: np.ndarray, states: int = 1) -> bytes:
    words = -(-states // 16)
    code = {"BINARY": "h", "BINARY32": "i", "FLOAT32": "f"}.get(kind)
    rows = []
    for n, row in enumerate(values.T.tolist(), 1):
        stamp = round((n - 1) / RATE * 1e6)
        if code:
            whole = row if code == "f" else map(round, row)
            rows.append(struct.pack(f"<II{6 * code}{words * 'H'}", n, stamp, *whole, *[0] * words))
        else:
            rows.append(
                ",".join(map(str, [n, stamp, *map(round, row), *[0] * states])).encode() + b"\r\n"
            )
    return b"".join(rows)


def store(folder: Path, cfg: str, dat: bytes, name: str = "dip") -> Path:
    path = folder / f"{name}.cfg"
    path.write_bytes(cfg.encode("cp1252"))
    path.with_suffix(".dat").write_bytes(dat)
    return path


def assert_is_the_dip(record: EventRecord, tolerance: float = 2 * STEP) -> None:
    v = np.where((record.time > BEGIN) & (record.time < END), 0.6, 1.0)
    i = np.where(record.time > BEGIN, 1.2, 0.9) * np.exp(-1j * np.deg2rad(20))
    np.testing.assert_allclose(record.v, np.stack([v, 0 * v], -1), atol=tolerance)
    np.testing.assert_allclose(record.i, np.stack([i.real, i.imag], -1), atol=tolerance)
    assert record.rest_end == pytest.approx(BEGIN, abs=1 / RATE)


@pytest.fixture
def in_process(monkeypatch: pytest.MonkeyPatch) -> None:
    """Without the other process, whose start takes most of the time."""
    monkeypatch.setattr(comtrade_file, "guarded", lambda reader, content, what: reader(content))


@pytest.mark.usefixtures("in_process")
@pytest.mark.parametrize(
    ("before", "after", "sentence"),
    [
        ("7,6A,1D", "7,6A,999999999D", "announces 1000000005 channels, more than there are lines"),
        ("\n50\n1\n", "\n50\n888888888\n", "announces 888888888 rates, more than there are lines"),
        ("\n50\n1\n", "\n50\nnan\n", "line 11 must hold a count, found nan"),
        (f",{len(TIME)}\n", ",nan\n", "line 12 must hold a count, found nan"),
    ],
)
def test_counts_that_cannot_be_are_refused_at_once(
    tmp_path: Path, before: str, after: str, sentence: str
):
    cfg = configuration("ASCII")
    assert before in cfg
    with pytest.raises((SweepError, ValueError), match=sentence):
        read_events(store(tmp_path, cfg.replace(before, after), b"1,0,0\n"), **BASES)


@pytest.mark.slow
@pytest.mark.usefixtures("in_process")
@pytest.mark.parametrize("year", [",1999", ",2013", ""], ids=["1999", "2013", "1991"])
@pytest.mark.parametrize("kind", ["ASCII", "BINARY", "BINARY32", "FLOAT32"])
def test_every_format_gives_the_same_record(tmp_path: Path, kind: str, year: str):
    end = "1\n0,0\n0,0\n" if "2013" in year else "1\n"
    path = store(tmp_path, configuration(kind, year, end=end), samples(kind, phases(TIME) / STEP))
    events = read_events(path, **BASES)
    assert events.f0_hz == F0
    assert events.names == ("dip",)
    assert_is_the_dip(events["dip"])


@pytest.mark.usefixtures("in_process")
@pytest.mark.parametrize(("begin", "end"), [("", "\r\n"), ("\ufeff", "\n"), ("", "\r")])
@pytest.mark.parametrize("kind", ["ASCII", "BINARY"])
def test_a_cff_holds_both_parts_whatever_ends_its_lines(
    tmp_path: Path, kind: str, begin: str, end: str
):
    cfg, dat = configuration(kind), samples(kind, phases(TIME) / STEP)
    path = tmp_path / "dip.cff"
    parts = f"{begin}--- file type: CFG ---\n{cfg}--- file type: HDR ---\n--- file type: INF ---\n"
    parts += f"--- file type: DAT {kind}{f': {len(dat)}' if kind == 'BINARY' else ''} ---\n"
    path.write_bytes(
        parts.replace("\n", end).encode()
        + (dat.replace(b"\n", end.encode()) if kind == "ASCII" else dat)
    )
    assert_is_the_dip(read_events(path, **BASES)["dip"])


@pytest.mark.usefixtures("in_process")
def test_secondary_values_are_taken_to_the_primary_side(tmp_path: Path):
    ratio = np.repeat([20e3 / 100, 100 / 1], 3)
    factors = np.repeat([PEAK_V, PEAK_I], 3) * STEP / ratio
    cfg = configuration("BINARY", factors=factors)
    lines = [
        line.replace(",1,1,P", f",{'20000,100' if ',V,' in line else '100,1'},S")
        if ",P" in line
        else line
        for line in cfg.split("\n")
    ]
    path = store(tmp_path, "\n".join(lines), samples("BINARY", phases(TIME) / STEP))
    record = read_events(path, **BASES)["dip"]
    assert_is_the_dip(record)
    assert "times 200" in record.remarks[0]


@pytest.mark.usefixtures("in_process")
def test_a_channel_sampled_later_is_brought_to_the_time_of_the_others(tmp_path: Path):
    """A spline through 100 samples a cycle is right to 1e-6 at rest; at the jumps of the dip itself
    nothing could be.
    """
    skew = (0.0, 30.0, 60.0, 90.0, 120.0, 150.0)
    values = np.stack([phases(TIME + late * 1e-6)[k] for k, late in enumerate(skew)])
    path = store(tmp_path, configuration("FLOAT32", skew=skew), samples("FLOAT32", values / STEP))
    record = read_events(path, **BASES)["dip"]
    rest = record.time < BEGIN - 0.01
    np.testing.assert_allclose(record.v[rest], [[1.0, 0.0]] * rest.sum(), atol=1e-5)
    assert record.negative < 1e-5


VENDORS = {
    "no newline at the end": lambda cfg: cfg.rstrip("\n"),
    "no multiplier": lambda cfg: cfg.rstrip("\n").rsplit("\n", 1)[0],
    "end-of-file marks": lambda cfg: cfg.rstrip("\n") + " \x1a\x1a\x1a\x1a",
    "windows lines": lambda cfg: cfg.replace("\n", "\r\n"),
    "padded fields": lambda cfg: cfg.replace(",", " ,  "),
    "a name in cp1252": lambda cfg: cfg.replace("Some station", "Umspannwerk Süd"),
    "times without a fraction": lambda cfg: cfg.replace("30.000000", "30").replace(
        "30.100000", "30"
    ),
    "times that are none": lambda cfg: cfg.replace("10:20:30.000000", "10:20:18581309.000"),
    "empty minimum and maximum": lambda cfg: cfg.replace("-32767,32767", ","),
    "empty skew and offset": lambda cfg: cfg.replace(",0.0,0,", ",,,"),
    "empty ratio": lambda cfg: cfg.replace(",1,1,P", ",,,P"),
    "a comma in the station": lambda cfg: cfg.replace("Some station", "Some, other station"),
    "lower case": lambda cfg: cfg.replace("BINARY", "Binary").replace("A,1D", "a,1d"),
    "an unknown year": lambda cfg: cfg.replace("1999", "2005"),
    "no count of states": lambda cfg: cfg.replace("7,6A,1D", "7,6A").replace("1,TRIP0,,,0\n", ""),
    "an empty state": lambda cfg: cfg.replace("1,TRIP0,,,0", "1,TRIP0"),
    "more samples announced": lambda cfg: cfg.replace(f",{len(TIME)}\n", ",99999\n"),
    "no samples announced": lambda cfg: cfg.replace(f",{len(TIME)}\n", ",0\n"),
    "no rate, but times": lambda cfg: cfg.replace(f"1\n{RATE:.0f},", "0\n0,"),
    "no rate and no line of it": lambda cfg: cfg.replace(f"1\n{RATE:.0f},{len(TIME)}", "0"),
    "rates as decimals": lambda cfg: cfg.replace(f"\n{RATE:.0f},", "\n5000.000000,"),
    "semicolons and decimal commas": lambda cfg: cfg.replace(",", ";").replace(".", ","),
}


@pytest.mark.slow
@pytest.mark.usefixtures("in_process")
@pytest.mark.parametrize("vendor", VENDORS)
def test_what_recorders_do_to_the_standard_is_read(tmp_path: Path, vendor: str):
    states = 0 if vendor == "no count of states" else 1
    path = store(
        tmp_path,
        VENDORS[vendor](configuration("BINARY")),
        samples("BINARY", phases(TIME) / STEP, states),
    )
    assert_is_the_dip(read_events(path, **BASES)["dip"])


@pytest.mark.usefixtures("in_process")
@pytest.mark.parametrize(
    "change",
    [
        lambda dat: dat.rstrip(b"\r\n"),
        lambda dat: dat + b"\x1a",
        lambda dat: dat.replace(b",", b" , "),
        lambda dat: dat.replace(b",0\r\n", b",\r\n"),
        lambda dat: dat + b"\r\n\r\n",
        lambda dat: b"".join(
            b"%d,," % n + line.split(b",", 2)[2] for n, line in enumerate(dat.splitlines(True), 1)
        ),
    ],
    ids=["no newline", "end-of-file mark", "padded", "empty state", "blank lines", "no times"],
)
def test_what_recorders_do_to_text_samples_is_read(tmp_path: Path, change):
    path = store(tmp_path, configuration("ASCII"), change(samples("ASCII", phases(TIME) / STEP)))
    assert_is_the_dip(read_events(path, **BASES)["dip"])


@pytest.mark.usefixtures("in_process")
def test_channels_are_told_by_number_or_name_and_may_lie_between_phases(tmp_path: Path):
    names = ("first", "second", "third", "fourth", "fifth", "sixth")
    path = store(
        tmp_path, configuration("BINARY", names=names), samples("BINARY", phases(TIME) / STEP)
    )
    with pytest.raises(
        SweepError, match=r"one channel for va; found none .*channels=.va=1.*1 first, 2 second"
    ):
        read_events(path, **BASES)
    assert_is_the_dip(
        read_events(path, channels="va=1,vb=second,vc=3,ia=4,ib=5,ic=6", **BASES)["dip"]
    )
    values = phases(TIME)
    values[:3] -= np.roll(values[:3], -1, axis=0)
    path = store(tmp_path, configuration("FLOAT32", names=names), samples("FLOAT32", values / STEP))
    assert_is_the_dip(
        read_events(path, channels="vab=1,vbc=2,vca=3,ia=4,ib=5,ic=6", **BASES)["dip"]
    )


@pytest.mark.parametrize(
    ("channel", "role"),
    [
        (Channel("UL1", "kV", ""), "va"),
        (Channel("V_b", "V"), "vb"),
        (Channel("Line 1 voltage", "kV", "C"), "vc"),
        (Channel("I A", "A"), "ia"),
        (Channel("IL2", "kA", "L2"), "ib"),
        (Channel("VAB", "V"), ""),
        (Channel("IN", "A", "N"), ""),
        (Channel("Ia", "V"), ""),
        (Channel("Frequency", "Hz", ""), ""),
    ],
)
def test_names_units_and_phases_show_the_channel(channel: Channel, role: str):
    assert role_of(channel) == role


@pytest.mark.usefixtures("in_process")
def test_a_clipped_channel_is_said(tmp_path: Path):
    values = phases(TIME) / STEP
    values[3] = np.clip(values[3], -8000, 8000)
    cfg = configuration("BINARY").replace("-32767,32767,1,1,P\n5,", "-8000,8000,1,1,P\n5,")
    record = read_events(store(tmp_path, cfg, samples("BINARY", values)), **BASES)["dip"]
    assert any("IA reaches the end of its range" in remark for remark in record.remarks)


@pytest.mark.usefixtures("in_process")
def test_a_range_without_width_tells_no_clipping(tmp_path: Path):
    cfg = configuration("BINARY").replace("-32767,32767", "0,0")
    record = read_events(store(tmp_path, cfg, samples("BINARY", phases(TIME) / STEP)), **BASES)[
        "dip"
    ]
    assert_is_the_dip(record)
    assert not record.remarks


@pytest.mark.usefixtures("in_process")
def test_a_negative_factor_is_no_clipping(tmp_path: Path):
    cfg = configuration("BINARY", factors=-np.repeat([PEAK_V, PEAK_I], 3) * STEP)
    record = read_events(store(tmp_path, cfg, samples("BINARY", -phases(TIME) / STEP)), **BASES)[
        "dip"
    ]
    assert_is_the_dip(record)
    assert not record.remarks


@pytest.mark.usefixtures("in_process")
def test_a_ratio_of_zeros_leaves_the_values_and_is_said(tmp_path: Path):
    path = store(
        tmp_path, configuration("BINARY", side=",0,0,S"), samples("BINARY", phases(TIME) / STEP)
    )
    events = read_events(path, **BASES)
    assert_is_the_dip(events["dip"])
    assert (
        len([one for one in contradictions(events) if "is secondary without a ratio" in one]) == 6
    )


@pytest.mark.usefixtures("in_process")
def test_a_ratio_is_said_where_the_configuration_has_none(tmp_path: Path):
    """Of secondary channels without a ratio; what the configuration says of others stays."""
    ratio = np.repeat([20e3 / 100, 100.0], 3)
    factors = np.repeat([PEAK_V, PEAK_I], 3) * STEP / ratio
    values = samples("BINARY", phases(TIME) / STEP)
    path = store(tmp_path, configuration("BINARY", side=",0,0,S", factors=factors), values)
    record = read_events(path, ratio="v=20000/100,i=100", **BASES)["dip"]
    assert_is_the_dip(record)
    assert "times 200, as said" in record.remarks[0]
    path = store(tmp_path, configuration("BINARY"), values)
    with pytest.raises(SweepError, match="leave out ratio"):
        read_events(path, ratio="v=20000/100,i=100", **BASES)


@pytest.mark.usefixtures("in_process")
@pytest.mark.parametrize(
    ("volts", "amperes"), [("Volts", "Amps"), ("VOLT", "AMPERES"), ("volts", "amp")]
)
def test_units_may_be_words(tmp_path: Path, volts: str, amperes: str):
    cfg = configuration("BINARY").replace(",V,", f",{volts},").replace(",A,", f",{amperes},")
    assert_is_the_dip(
        read_events(store(tmp_path, cfg, samples("BINARY", phases(TIME) / STEP)), **BASES)["dip"]
    )


@pytest.mark.usefixtures("in_process")
@pytest.mark.parametrize("kind", ["ASCII", "BINARY"])
def test_samples_that_are_announced_and_not_there_are_said(tmp_path: Path, kind: str):
    events = read_events(
        store(tmp_path, configuration(kind), samples(kind, phases(TIME)[:, :1200] / STEP)), **BASES
    )
    assert contradictions(events) == (
        "dip: the data end early, 300 samples fewer than the configuration announces.",
    )


@pytest.mark.usefixtures("in_process")
@pytest.mark.parametrize("kind", ["ASCII", "BINARY", "FLOAT32"])
def test_samples_beyond_those_announced_are_read_where_they_go_on(tmp_path: Path, kind: str):
    cfg = configuration(kind, rates=f"1\n{RATE:.0f},1100")
    dat = samples(kind, phases(TIME) / STEP)
    events = read_events(store(tmp_path, cfg, dat), **BASES)
    assert len(events["dip"].time) == len(TIME)
    assert_is_the_dip(events["dip"])
    assert any("400 samples stand behind" in sentence for sentence in contradictions(events))


@pytest.mark.usefixtures("in_process")
@pytest.mark.parametrize("kind", ["ASCII", "BINARY"])
def test_a_second_record_behind_the_announced_samples_is_said(tmp_path: Path, kind: str):
    dat = samples(kind, phases(TIME) / STEP)
    events = read_events(store(tmp_path, configuration(kind), dat + dat), **BASES)
    assert_is_the_dip(events["dip"])
    assert any("1500 rows stand behind" in sentence for sentence in contradictions(events))


@pytest.mark.usefixtures("in_process")
def test_zeros_that_fill_a_block_are_no_samples(tmp_path: Path):
    dat = samples("BINARY", phases(TIME) / STEP) + bytes(22 * 17 + 5)
    events = read_events(store(tmp_path, configuration("BINARY"), dat), **BASES)
    assert_is_the_dip(events["dip"])
    assert contradictions(events) == ()


@pytest.mark.usefixtures("in_process")
@pytest.mark.parametrize("states", [17, 40])
def test_rows_of_other_channels_than_announced_are_refused(tmp_path: Path, states: int):
    """Words of states that the configuration does not announce shift every row but the first."""
    dat = samples("BINARY", phases(TIME) / STEP, states)
    with pytest.raises(ValueError, match="do not have the channels of this configuration"):
        read_events(store(tmp_path, configuration("BINARY"), dat), **BASES)


@pytest.mark.usefixtures("in_process")
def test_lines_may_end_as_on_old_machines(tmp_path: Path):
    cfg, dat = configuration("ASCII"), samples("ASCII", phases(TIME) / STEP)
    assert_is_the_dip(
        read_events(store(tmp_path, cfg.replace("\n", "\r"), dat.replace(b"\r\n", b"\r")), **BASES)[
            "dip"
        ]
    )


@pytest.mark.nightly
def test_what_cannot_be_read_is_one_sentence(tmp_path: Path):
    dat = samples("BINARY", phases(TIME) / STEP)
    path = store(tmp_path, configuration("BINARY"), dat)
    with pytest.raises(SweepError, match="unit: si must come with s_base_va and v_base_v"):
        read_events(path)
    (tmp_path / "alone.cfg").write_text(configuration("BINARY"))
    with pytest.raises(SweepError, match=r"must lie beside the dat file .*copy alone.dat there"):
        read_events(tmp_path / "alone.cfg", **BASES)
    with pytest.raises(
        SweepError, match=r"line 3 must have the 13 fields .*a comma in a name or number"
    ):
        read_events(
            store(
                tmp_path, configuration("BINARY", names=("V,A", *NAMES[1:]), side=",1,1,P,x"), dat
            ),
            **BASES,
        )
    with pytest.raises(SweepError, match="the samples must be ASCII, BINARY, BINARY32, FLOAT32"):
        read_events(store(tmp_path, configuration("BINARY64"), dat), **BASES)
    with pytest.raises(
        SweepError, match="configuration says ASCII and the samples are binary, write BINARY"
    ):
        read_events(store(tmp_path, configuration("ASCII"), dat), **BASES)
    with pytest.raises(SweepError, match="there are no samples"):
        read_events(store(tmp_path, configuration("BINARY"), b""), **BASES)
    with pytest.raises(SweepError, match="the times of the samples must increase"):
        read_events(
            store(tmp_path, configuration("BINARY", rates="0\n0,1500"), dat[14:] + dat[:14]),
            **BASES,
        )
    gap = phases(TIME) / STEP
    gap[1, 700:710] = -32768
    with pytest.raises(
        SweepError,
        match=r"channel VB must have all its samples; 10 are missing, the first at 0.14 s",
    ):
        read_events(store(tmp_path, configuration("BINARY"), samples("BINARY", gap)), **BASES)
    garbage = np.random.default_rng(0).bytes(3000)
    (tmp_path / "dip.cfg").write_bytes(garbage)
    with pytest.raises(SweepError, match="must be a COMTRADE record; it cannot be read"):
        read_events(tmp_path / "dip.cfg", **BASES)


def test_comtrade_is_known_by_its_suffix(tmp_path: Path):
    path = store(tmp_path, configuration("BINARY"), b"")
    assert is_events_file(path)
    assert is_events_file(path.with_suffix(".dat"))
    assert not is_events_file(tmp_path / "other.dat")


@pytest.mark.usefixtures("in_process")
def test_text_rows_must_have_the_cells_of_the_configuration(tmp_path: Path):
    rows = samples("ASCII", phases(TIME) / STEP).split(b"\r\n")
    short = [*rows[:20], rows[20].rsplit(b",", 4)[0], *rows[21:]]
    with pytest.raises(ValueError, match=r"row 21 of the samples must have 8 to 9 cells"):
        read_events(store(tmp_path, configuration("ASCII"), b"\r\n".join(short)), **BASES)
    wide = [row + b",0,0,0" if row else row for row in rows]
    with pytest.raises(ValueError, match=r"row 1 of the samples must have .* found 12"):
        read_events(store(tmp_path, configuration("ASCII"), b"\r\n".join(wide)), **BASES)
    behind = [*rows[:1100], *wide[1100:]]
    cfg = configuration("ASCII", rates=f"1\n{RATE:.0f},1100")
    events = read_events(store(tmp_path, cfg, b"\r\n".join(behind)), **BASES)
    assert len(events["dip"].time) == 1100
    assert any("400 rows stand behind" in sentence for sentence in contradictions(events))


def test_a_rate_that_no_recorder_has_is_refused(tmp_path: Path):
    cfg = configuration("ASCII", rates=f"1\n1e-308,{len(TIME)}")
    path = store(tmp_path, cfg, samples("ASCII", phases(TIME) / STEP))
    with pytest.raises(SweepError, match="rate of sampling"):
        read_events(path, **BASES)


@pytest.mark.usefixtures("in_process")
@pytest.mark.filterwarnings("error")
@pytest.mark.parametrize(
    ("numbers", "sentence"),
    [
        (
            {"factors": np.full(6, 1e300)},
            "the factor a of channel .* must be at most 1e.09; found 1e.300",
        ),
        ({"side": ",1e308,1e-308,S"}, "the ratio of channel .* must be at most 1e.09; found inf"),
        ({"skew": (5e5,) + (0,) * 5}, "the skew of channel .* must be short beside the record"),
        (
            {"rates": f"0\n0,{len(TIME)}", "end": "1e-300\n"},
            "the times of the samples must lie within 1e.09 s",
        ),
    ],
)
def test_numbers_that_no_recorder_has_are_refused_without_a_warning(
    tmp_path: Path, numbers: dict, sentence: str
):
    path = store(tmp_path, configuration("ASCII", **numbers), samples("ASCII", phases(TIME) / STEP))
    with pytest.raises(SweepError, match=sentence):
        read_events(path, **BASES)


@pytest.mark.usefixtures("in_process")
def test_what_is_said_beside_the_configuration_holds_whichever_file_of_a_record_is_named(
    tmp_path: Path,
):
    path = store(tmp_path, configuration("ASCII"), samples("ASCII", phases(TIME) / STEP))
    (tmp_path / "dip.cfg.meta").write_text("current: in\n", encoding="utf-8")
    by_name = [read_events(one, **BASES)["dip"].rest.p for one in (path, path.with_suffix(".dat"))]
    assert by_name[0] == by_name[1] < 0


@pytest.mark.usefixtures("in_process")
@pytest.mark.parametrize(
    ("bundle", "names"),
    [
        ("dip.zip", ("2024/dip.CFG", "2024/dip.DAT")),
        ("dip.tar.gz", ("2024/DIP.CFG", "2024/dip.dat")),
        ("", ("dip.CFG", "Dip.DAT")),
    ],
    ids=["zip", "tar", "folder"],
)
def test_a_record_in_capitals_is_read_in_an_archive_and_in_a_folder(
    tmp_path: Path, bundle: str, names: tuple[str, str]
):
    path = store(tmp_path, configuration("BINARY"), samples("BINARY", phases(TIME) / STEP))
    for old, name in zip((path, path.with_suffix(".dat")), names, strict=True):
        new = tmp_path / "made" / name
        new.parent.mkdir(parents=True, exist_ok=True)
        old.rename(new)
    place = tmp_path / "made"
    if bundle:
        kind = "zip" if bundle.endswith("zip") else "gztar"
        place = Path(shutil.make_archive(str(tmp_path / "dip"), kind, place))
        assert place.name == bundle
    (record,) = each_once([place / names[0], place / names[1]])
    assert is_events_file(place / names[1])
    assert_is_the_dip(read_events(record, **BASES)[record.stem])
