"""Model files of others: each way to fail is one sentence, and no process is left."""

import io
import os
from pathlib import Path

import numpy as np
import psutil
import pytest
from collecting import each_of
from model_files import BAD, DEVICE, GOOD

import ibrid
from ibrid.devices import MeasureSettings, ProcessLimits, measure_events
from ibrid.devices.isolation.child import receive
from ibrid.errors import IbridError

FREQUENCY = (20.0, 45.0, 90.0)
#: Two processor seconds, and two seconds in which nothing is done, are a hang here.
HASTY = MeasureSettings(limits=ProcessLimits(processor_s=2.0, still=20))


def device(folder: Path, model: str, more: str = "", sign: int = 1) -> Path:
    (folder / "model.py").write_text(model)
    file = folder / "DEVICE.toml"
    file.write_text(DEVICE.format(more=more, sign=sign))
    return file


def test_a_model_in_a_file_is_measured_in_another_process(tmp_path: Path):
    file = device(tmp_path, GOOD)
    file.write_text(file.read_text() + "[parameters]\nconductance = 0.4\n")
    sweep = ibrid.measure(file, ["p=0.5,q=0.2"], FREQUENCY)
    np.testing.assert_allclose(
        sweep.points[0].admittance, np.broadcast_to(-0.4 * np.eye(2), (3, 2, 2)), atol=1e-9
    )
    assert (sweep.f0_hz, sweep.power_node) == (50.0, "pcc")
    assert any("p_ref = 0.9" in note for note in sweep.notes)


def test_units_signs_and_scales_of_signals_are_taken_off(tmp_path: Path):
    """The same device in V, A and kW, its current counted into it."""
    peak = 400 * np.sqrt(2 / 3)
    amperes = 10e3 / (1.5 * peak)
    model = GOOD.replace(
        "(self.p_ref - 1j * self.q_ref)",
        f"(self.p_ref / 10 * {amperes} - 1j * self.q_ref / 10 * {amperes})",
    )
    model = model.replace("return ", "return -1 * (").replace(
        "+ self.offset", f"* {amperes / peak})"
    )
    bases = "s_base_va = 10e3\nv_base_v = 400.0"
    file = device(tmp_path, model, bases, sign=-1)
    text = (
        file.read_text()
        .replace('v = { unit = "pu"', 'v = { unit = "V"')
        .replace('i = { unit = "pu"', 'i = { unit = "A"')
    )
    file.write_text(text.replace('_ref", unit = "pu"', '_ref", unit = "kW"'))
    (point,) = ibrid.measure(file, ["p=0.5,q=0.2"], FREQUENCY).points
    np.testing.assert_allclose(
        point.admittance, np.broadcast_to(-0.8 * np.eye(2), (3, 2, 2)), atol=1e-9
    )
    assert (point.op.p, point.op.q) == pytest.approx((0.5, 0.2), abs=2e-5)


DEEDS = {
    "ctypes.string_at(0)": "model.py:Inverter: crashed, its process ended with signal 11",
    "os._exit(3)": "model.py:Inverter: crashed, its process ended with exit status 3",
    "while True: pass": "model.py:Inverter: hangs, its process took more than 2 s of processor "
    "time",
    "time.sleep(1000)": "model.py:Inverter: hangs, its process did nothing in 20 looks",
    "return np.full(3, np.nan)": r"model.py:Inverter: its current is not a finite number from t = 0.05\d* s on",
    "return np.zeros(2)": r"step must answer three currents, i_a, i_b, i_c; found an answer of shape \(2,\)",
    "raise ValueError('no licence')": "model.py:Inverter: it failed with ValueError: no licence",
    "sys.exit(1)": "model.py:Inverter: it failed with SystemExit: 1",
    "return 'a'": r"model.py:Inverter: step must answer three currents, .* shape \(\)",
    "return ['a', 'b', 'c']": "model.py:Inverter: step must answer three real numbers; found str",
    "return 1j * v_abc": "three real numbers; found complex128 ones",
    "return np.ma.masked_less(v_abc, 0.0)": "three real numbers; found masked ones",
    "raise GeneratorExit": "model.py:Inverter: it failed with GeneratorExit",
    "os.close(1); time.sleep(1000)": "model.py:Inverter: hangs",
    "return -50 * v_abc": "the device is unstable at p=0.5,q=0.2",
}


@pytest.mark.slow
@each_of(("deed", "said"), list(DEEDS.items()), ids=list(DEEDS))
def test_a_model_that_fails_is_one_sentence_and_leaves_no_process(
    deed: str, said: str, tmp_path: Path
):
    with pytest.raises(IbridError, match=said) as caught:
        ibrid.measure(
            device(tmp_path, BAD.format(deed=deed)), ["p=0.5,q=0.2"], FREQUENCY, settings=HASTY
        )
    assert "\n" not in str(caught.value)
    assert not [
        child
        for child in psutil.Process().children(recursive=True)
        if "ibrid.devices" in " ".join(child.cmdline())
    ]


@pytest.mark.slow
def test_a_model_that_prints_without_end_is_measured_all_the_same(tmp_path: Path):
    deed = (
        "[os.write(1, b'line of a model\\n' * 2000) for _ in range(5)]; print('x' * 10000); "
        "sys.stderr.write('y' * 10000)"
    )
    model = BAD.format(deed=deed).replace("    p_ref = q_ref = 0.0\n", "    pass\n")
    file = device(tmp_path, model)
    file.write_text(
        "".join(line for line in file.read_text().splitlines(True) if "_ref" not in line)
    )
    (point,) = ibrid.measure(file, ["p=-0.5,q=0"], FREQUENCY).points
    np.testing.assert_allclose(
        point.admittance, np.broadcast_to(-0.5 * np.eye(2), (3, 2, 2)), atol=1e-9
    )


BEGUN = (
    "os.fork()",
    "subprocess.Popen(['sleep', '1000'])",
    "subprocess.Popen(['sleep', '1000'], start_new_session=True)",
    "multiprocessing.Process(target=time.sleep, args=[1000], daemon=True).start()",
    "subprocess.Popen(['sleep', '1000.25'], start_new_session=True, env={})",
    "subprocess.run(['sh', '-c', 'sleep 1000.25 &'], start_new_session=True, env={})",
)


@pytest.mark.slow
@pytest.mark.skipif(not hasattr(os, "fork"), reason="processes are copied on POSIX alone")
@each_of("deed", BEGUN)
def test_what_a_model_begins_ends_with_it_and_answers_nothing(deed: str, tmp_path: Path):
    once = f"self.t_begun = getattr(self, 't_begun', None) or [{deed}]"
    model = BAD.replace("import ctypes", "import multiprocessing, subprocess, ctypes")
    file = device(tmp_path, model.format(deed=once).replace("    p_ref = q_ref = 0.0\n", ""))
    lines = [line for line in file.read_text().splitlines(True) if "_ref" not in line]
    file.write_text("".join(lines))
    (point,) = ibrid.measure(file, ["p=-0.5,q=0"], FREQUENCY).points
    np.testing.assert_allclose(
        point.admittance, np.broadcast_to(-0.5 * np.eye(2), (3, 2, 2)), atol=1e-9
    )
    left = [process for process in psutil.process_iter() if _is_a_models(process)]
    assert left == []


def _is_a_models(process: psutil.Process) -> bool:
    try:
        if "1000.25" in process.cmdline():
            return True
        return Path(process.environ().get("TMPDIR", "")).name.startswith(f"ibrid-{os.getpid()}-")
    except psutil.Error:
        return False


FORGED = """
import io
import os


class Inverter:
    p_ref = q_ref = 0.0

    def step(self, t, v_abc):
        for number in range(3, 20):
            try:
                os.write(number, b'{"numbers": 1}\\n' + bytes(24))
            except OSError:
                pass
        return -0.5 * v_abc
"""


@pytest.mark.slow
def test_a_model_that_writes_into_our_answers_is_one_sentence(tmp_path: Path):
    with pytest.raises(IbridError, match=r"answered 1 samples where [0-9]+ were asked for"):
        ibrid.measure(device(tmp_path, FORGED), ["p=0.5,q=0.2"], FREQUENCY)


def test_what_is_no_message_is_none_of_ours():
    lines = (
        b'{"numbers": 1000000000000000000}',
        b'{"numbers": -5}',
        b'{"numbers": Infinity}',
        b'{"numbers": 1.5}',
        b'{"numbers": ' + b"9" * 10_000 + b"}",
        b'{"numbers": 0, "a": ' + b"[" * 200_000 + b"}",
        b"[]",
        b"{}",
        b"\xff",
    )
    for line in lines:
        with pytest.raises(ValueError, match=r"."):
            receive(io.BytesIO(line + b"\n"))
    assert receive(io.BytesIO(b"x" * 20_000_000)) is None
    assert receive(io.BytesIO(b'{"numbers": 3}\n' + bytes(24))) is None


FILES = {
    "def broken(:": "model.py: it failed with SyntaxError",
    "raise RuntimeError('no key')": "model.py, line 1: it failed with RuntimeError: no key; mend "
    "it until it runs",
    "other = 3": "model.py: has no Inverter; there is none",
    "class Inverter:\n    p_ref = q_ref = 0.0": r"must have step\(t, v_abc\), which answers three currents; found a Inverter",
    "class Inverter:\n    def step(self, t, v_abc): return v_abc": "the object has no attribute "
    "'p_ref'",
    GOOD.replace("conductance=0.8", "conductance"): "it failed with TypeError: Inverter.__init__",
}


@pytest.mark.slow
@each_of(("model", "said"), list(FILES.items()))
def test_a_file_that_is_no_device_is_one_sentence(model: str, said: str, tmp_path: Path):
    with pytest.raises(IbridError, match=said):
        ibrid.measure(device(tmp_path, model), ["p=0.5,q=0.2"], FREQUENCY)


def test_the_other_sign_is_said_where_the_device_follows_its_references(tmp_path: Path):
    file = device(tmp_path, GOOD.replace("conductance=0.8", "conductance=0.001"), sign=-1)
    with pytest.raises(
        IbridError,
        match=r"its current counts the other way; write sign = -1 at i in .signals., or 1 where -1",
    ):
        ibrid.measure(file, ["p=0.5,q=0.2"], FREQUENCY)


@pytest.mark.slow
def test_records_are_taken_of_a_model_in_a_file(tmp_path: Path):
    events = measure_events(
        device(tmp_path, GOOD), ["p=0.5,q=0.2"], ["dip:0.6"], settings=MeasureSettings(rate=1000.0)
    )
    record = events["dip:0.6"]
    during = record.i[np.searchsorted(record.time, 0.2)] - record.i[0]
    np.testing.assert_allclose(during, [0.8 * 0.4, 0.0], atol=1e-9)


@pytest.mark.slow
def test_a_model_is_told_its_new_set_point(tmp_path: Path):
    """Its current follows at once: the change of p_ref on d, of q_ref on -q."""
    for event, moved in (("p_ref:0.9", [0.3, 0.0]), ("q_ref:0.5", [0.0, -0.2])):
        file = device(tmp_path, GOOD.replace("conductance=0.8", "conductance=0.0"))
        (record,) = measure_events(file, ["p=0.6,q=0.3"], [f"{event},at=0.1"]).records
        np.testing.assert_allclose(record.i[-1] - record.i[0], moved, atol=1e-4)
        (told,) = record.told.values()
        assert told[-1] - told[0] == pytest.approx(sum(map(abs, moved)), abs=1e-4)
        assert record.rest_end == pytest.approx(0.1, abs=1e-3)


def test_an_event_on_a_reference_that_a_device_does_not_take_is_refused(tmp_path: Path):
    file = device(tmp_path, GOOD)
    file.write_text(
        "".join(line for line in file.read_text().splitlines(True) if "q_ref" not in line)
    )
    with pytest.raises(
        IbridError, match=r"the event q_ref:0.5 moves q_ref, and the device takes p_ref of the"
    ):
        measure_events(file, ["p=0.6,q=0.3"], ["q_ref:0.5"])
