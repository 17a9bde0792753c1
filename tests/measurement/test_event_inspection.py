"""The first look at records: windows, depth, what a record can tell, and what contradicts
itself.
"""

import json
from pathlib import Path

import numpy as np
import pytest

from ibrid.cli import main
from ibrid.measurement.formats.event_csv import write_events
from ibrid.measurement.quality.event_contradictions import contradictions
from ibrid.measurement.quality.event_inspection import RecordInspection, inspect_events
from ibrid.measurement.recordings.event_rest import record_from_rest
from ibrid.measurement.recordings.event_windows import windows_of
from ibrid.measurement.recordings.events import EventRecord, Events

F0, CYCLE = 50.0, 0.02
TIME = np.arange(0, 0.5, 1e-4)
AWAY = (TIME > 0.1) & (TIME < 0.25)


def record(
    v: np.ndarray, i: np.ndarray | complex = 0.8 - 0.1j, time: np.ndarray = TIME, **more: float
) -> EventRecord:
    return record_from_rest(
        "a", time, v.astype(complex), np.broadcast_to(i, v.shape).astype(complex), F0, **more
    )


def first_look(v: np.ndarray, i: np.ndarray | complex = 0.8 - 0.1j) -> RecordInspection:
    return looked_at(record(v, i))


def looked_at(one: EventRecord) -> RecordInspection:
    return inspect_events(Events((one,), f0_hz=F0)).records[0]


def told(*parts: str) -> str:
    return "; ".join(parts)


DIP = np.where(AWAY, 0.6, 1.0)


def test_noise_of_the_voltage_is_told_by_its_rest_and_smoothed_away_where_nothing_else_moves_it():
    wrong = []
    for samples, turns in (
        (200, 0),
        (200, -2),
        (64, 6),
        (32, 12),
        (20, 6),
    ):  # of a cycle; of a wave in the frame, over f0
        time = np.arange(0, 0.5, CYCLE / samples)
        clean = np.where((time > 0.1) & (time < 0.25), 0.6, 1.0) + 0.01 * np.exp(
            2j * np.pi * turns * F0 * time
        )
        noise = 5e-4 * (np.random.default_rng(0).standard_normal((2, len(time))).T @ [1, 1j])
        seen, known = (record(one, time=time) for one in (clean + noise, clean))
        left = np.abs((seen.voltage(time) - known.v) @ [1, 1j])
        told = (
            abs(seen.voltage_noise / 5e-4 - 1) < 0.25
            and np.linalg.norm(left) < np.linalg.norm(noise) / 2
        )
        whole = (
            left.max() < 5 * 5e-4 and np.abs(known.voltage(time) - known.v).max() < 1e-12
        )  # steps and clean waves
        wrong += [] if told and whole else [(samples, turns, seen.voltage_noise, left.max())]
    assert not wrong


def test_a_dip_has_five_windows_that_follow_each_other():
    windows = windows_of(record(DIP), F0)
    assert list(windows) == ["pre", "first cycle", "during", "recovery", "after"]
    edges = np.array(list(windows.values()))
    np.testing.assert_allclose(
        edges[:, 0], [0, 0.1, 0.1 + CYCLE, 0.25, 0.25 + 5 * CYCLE], atol=2e-4
    )
    np.testing.assert_array_equal(edges[1:, 0], edges[:-1, 1])
    assert edges[-1, 1] == TIME[-1]


@pytest.mark.parametrize(
    ("v", "event"),
    [
        (DIP, "dip from 1 to 0.6 for 0.15 s"),
        (np.where(AWAY, 1.2, 1.0), "swell from 1 to 1.2 for 0.15 s"),
        (np.where(TIME > 0.1, 0.8, 1.0), "dip from 1 to 0.8, to the end"),
        (np.where(AWAY, 0.3, np.where(TIME > 0.2, 0.9, 1.0)), "dip from 1 to 0.3 for 0.15 s"),
        (np.exp(1j * np.deg2rad(20) * AWAY), "the angle moves by 20 degrees for 0.15 s"),
        (
            np.exp(2j * np.pi * 0.5 * np.clip(TIME - 0.1, 0, None) ** 2),
            "frequency from 50.03 to 50.38 Hz",
        ),
        (np.ones(len(TIME)), "nothing happens"),
    ],
    ids=["dip", "swell", "step", "partly back", "phase", "frequency", "nothing"],
)
def test_the_voltage_names_the_event(v: np.ndarray, event: str):
    """50 Hz + (t - 0.1): its mean over a cycle, seen through one over half a cycle, from 0.12 s and
    to 0.5 s on.
    """
    assert first_look(v).event == event


def test_depth_is_a_mean_of_half_a_cycle_so_that_a_spike_and_a_negative_sequence_leave_it():
    ripple = DIP * np.exp(1j * 0) + 0.05 * np.exp(-4j * np.pi * F0 * TIME)
    ripple[3000] = 3.0
    found = first_look(ripple)
    assert found.lowest == pytest.approx(
        0.6, abs=2e-3
    )  # of the magnitude, second order in the ripple
    assert found.highest == pytest.approx(1.02, abs=1e-2)
    assert found.negative == pytest.approx(0.05, abs=1e-9)


def test_what_a_record_never_reaches_it_cannot_tell():
    small = first_look(np.where(AWAY, 0.95, 1.0))
    assert "never falls below 0.9" in told(*small.cannot_tell)
    assert "never rises above 1.1" in told(*small.cannot_tell)
    assert "never larger than at rest, none was reached" in told(*small.cannot_tell)
    assert not small.tells
    deep = first_look(DIP, np.where(AWAY, 1.1, 0.8))
    assert "the voltage falls to 0.6" in told(*deep.tells)
    assert "up to 1.1: one above was not reached" in told(*deep.tells)
    assert "stands at 1.1 in the event (current_limit?)" in told(*deep.tells)
    assert "the record ends before the voltage comes back" in told(
        *first_look(np.where(TIME > 0.1, 0.6, 1)).cannot_tell
    )
    ceased = first_look(DIP, np.where(AWAY, 0, 0.8))
    assert "falls to 0 while the voltage is away (momentary_cessation?)" in told(*ceased.tells)
    ramped = first_look(np.exp(2j * np.pi * 0.5 * np.clip(TIME - 0.1, 0, None) ** 2))
    assert "loops that act on the frequency" in told(*ramped.tells)


def test_the_noise_of_the_current_is_read_at_rest():
    """From 1000 samples of two components the estimate is within a tenth, many deviations of it."""
    rng = np.random.default_rng(4)
    i = 0.8 + 0.02 * (rng.normal(size=len(TIME)) + 1j * rng.normal(size=len(TIME)))
    noisy = record(DIP, i)
    assert looked_at(noisy).noise == pytest.approx(0.02, rel=0.1)
    assert "anything finer" in told(*first_look(DIP, i).cannot_tell)
    assert looked_at(record(DIP, sigma=np.full(len(TIME), 0.3))).noise == 0.3


CONTRADICTIONS = {
    "square root of three": (
        record(DIP * np.sqrt(3)),
        "1.732 per unit, nearly 1.732: between two phases",
    ),
    "rms for peak": (record(DIP / np.sqrt(2)), "nearly 0.7071: the columns hold rms"),
    "kilovolts": (record(DIP / 1e3 * 50), "the voltage at rest is 0.05 per unit, check unit"),
    "volts": (record(DIP * 1000), "nearly 1000: the columns are in V"),
    "amperes": (record(DIP, 420.0), "the current at rest is 420 per unit, A in place of kA"),
    "kiloamperes": (record(DIP, 0.001), "never above 0.001 per unit, kA in place of A"),
    "current in": (
        record(DIP, -0.8),
        "p at rest is -0.8, .*--current in, .* current: in into .*the sign is a hint",
    ),
    "cut before the event": (
        record(DIP[TIME < 0.09], time=TIME[TIME < 0.09]),
        "nothing happens in it, .* from 0 to 0.0899 s; was it cut before the event",
    ),
    "negative sequence": (
        record(DIP + 0.05 * np.exp(-4j * np.pi * F0 * TIME)),
        "negative sequence of 5 %",
    ),
    "zero sequence": (record(DIP, zero=0.2), "zero sequence of up to 20 %"),
    "a gap": (
        record(DIP[kept], time=TIME[kept])
        if (kept := (TIME < 0.24) | (TIME > 0.27)) is not None
        else None,
        "1 gap in time, the longest 30.2 ms at 0.2399 s",
    ),
    "a gap that hides the dip": (
        record(DIP[kept], time=TIME[kept])
        if (kept := (TIME < 0.09) | (TIME > 0.27)) is not None
        else None,
        "1 gap in time, the longest .* ms at 0.08.* s in which the voltage may have left and come "
        "back",
    ),
    "clipping": (
        record(DIP, remarks=("channel IA reaches the end of its range: it is clipped",)),
        "it is clipped",
    ),
}


@pytest.mark.parametrize("case", CONTRADICTIONS)
def test_what_contradicts_itself_is_said_in_a_sentence(case: str):
    odd, sentence = CONTRADICTIONS[case]
    found = contradictions(Events((odd,), f0_hz=F0))
    assert len(found) == 1
    with pytest.raises(AssertionError, match=sentence):
        raise AssertionError(found[0])


def test_nothing_is_said_of_a_plain_record_also_where_rest_is_sampled_thinly():
    assert contradictions(Events((record(DIP),), f0_hz=F0)) == ()
    thin = np.concatenate([np.arange(0, 0.0951, 0.005), TIME[TIME > 0.098]])
    assert contradictions(Events((record(np.interp(thin, TIME, DIP), time=thin),), f0_hz=F0)) == ()


def test_inspect_tells_an_events_file_from_a_sweep(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
):
    write_events(Events((record(DIP),), f0_hz=F0), tmp_path / "dip.csv")
    assert main(["inspect", str(tmp_path / "dip.csv")]) == 0
    text = capsys.readouterr().out
    assert "dip from 1 to 0.6 for 0.15 s" in text
    assert "cannot tell: high-voltage logic" in text
    assert main(["inspect", str(tmp_path / "dip.csv"), "--json"]) == 0
    plain = json.loads(capsys.readouterr().out)
    assert plain["schema"] == "ibrid.event-inspection/1"
    assert plain["records"][0]["rest"]["p"] == pytest.approx(0.8)
    assert main(["inspect", str(tmp_path / "nothing.cfg")]) == 2


@pytest.mark.slow
def test_import_writes_a_recorders_table_as_an_events_file(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
):
    v, i = DIP * 326.6, np.full(len(TIME), -10.0)
    rows = [
        ";".join(f"{x:.6f}".replace(".", ",") for x in row)
        for row in np.stack([TIME, v, 0 * v, i, 0 * i], -1)
    ]
    (tmp_path / "scope.txt").write_text("\n".join(["time;ud;uq;jd;jq", *rows]))
    words = [
        "import",
        str(tmp_path / "scope.txt"),
        "--out",
        str(tmp_path / "dip.csv"),
        "--f0-hz",
        "50",
    ]
    told_by = [
        "--channels",
        "vd=ud,vq=uq,id=jd,iq=jq",
        "--unit",
        "si",
        "--base",
        "10kVA,400V",
        "--current",
        "in",
    ]
    assert main([*words, *told_by]) == 0
    assert "scope (5000 samples)" in capsys.readouterr().out
    from ibrid.measurement.read_events import read_events

    rest = read_events(tmp_path / "dip.csv")["scope"].rest
    assert (rest.v, rest.p) == pytest.approx((1.0, 10 * 326.6 * 1.5 / 10e3), rel=1e-4)
    assert main([*words, *told_by, "--p", "1"]) == 2
    assert "--p says nothing of records in time" in capsys.readouterr().err
