"""`ibrid measure`: a sweep, records, a description; stopped and begun again."""

from pathlib import Path

import pytest
from collecting import collecting
from model_files import DEVICE, GOOD

import ibrid
from ibrid.cli import main
from ibrid.devices import MeasureSettings, read_device
from ibrid.devices.fresh_device import FreshDevice
from ibrid.devices.kept_points import KeptPoints
from ibrid.devices.multisine import multisine_for


@pytest.fixture(autouse=True)
def _elsewhere(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    Path("model.py").write_text(GOOD)
    Path("DEVICE.toml").write_text(DEVICE.format(more="", sign=1))


@pytest.mark.slow
def test_the_command_writes_a_sweep_that_is_read_again(capsys):
    line = [
        "measure",
        "DEVICE.toml",
        "--op",
        "p=0.5,q=0.2",
        "--op",
        "p=0.2,q=0",
        "--freq",
        "20:200:5",
        "--out",
        "a.csv",
    ]
    assert main(line) == 0
    told = capsys.readouterr()
    assert "a.csv: 5 frequencies at p=0.5,q=0.2; p=0.2,q=0" in told.out
    assert "model.py in a process of its own" in told.err
    sweep = ibrid.read_sweep("a.csv")
    assert sweep.points[0].sigma is not None
    assert any("made by: ibrid measure DEVICE.toml" in note for note in sweep.notes)
    assert not Path("a.part").exists()


@pytest.mark.slow
def test_the_command_writes_records_that_are_read_again(capsys):
    line = [
        "measure",
        "DEVICE.toml",
        "--op",
        "p=0.5,q=0.2",
        "--event",
        "dip:0.6",
        "--rate",
        "1000",
        "--out",
        "e.csv",
    ]
    assert main(line) == 0
    assert "e.csv: 1 record: dip:0.6" in capsys.readouterr().out
    assert ibrid.read_events("e.csv").names == ("dip:0.6",)


@pytest.mark.slow
def test_what_is_described_can_be_measured(capsys):
    assert main(["measure", "model.py", "--describe"]) == 0
    text = capsys.readouterr().out
    assert "has step(t, v_abc) in Inverter" in text
    assert "Inverter takes conductance = 0.8" in text
    assert main(["measure", "model.py", "--describe", "--out", "described.toml"]) == 0
    assert Path("described.toml").read_text() == text
    device = read_device("described.toml")
    assert device.parameters == {"conductance": 0.8, "offset": 0.0}
    assert (
        main(
            [
                "measure",
                "described.toml",
                "--op",
                "p=0.5,q=0.2",
                "--freq",
                "100:900:3",
                "--out",
                "b.csv",
            ]
        )
        == 0
    )


@pytest.mark.slow
def test_a_measurement_that_was_stopped_goes_on_where_it_ended(monkeypatch: pytest.MonkeyPatch):
    asked: list[str] = []
    make = FreshDevice.bench

    def counted(self: FreshDevice):
        if len(asked) == 1:
            raise KeyboardInterrupt
        asked.append("a point")
        return make(self)

    points, frequency = ["p=0.5,q=0.2", "p=0.2,q=0"], (50.0, 150.0)
    with monkeypatch.context() as counting:
        counting.setattr(FreshDevice, "bench", counted)
        with pytest.raises(KeyboardInterrupt):
            ibrid.measure("DEVICE.toml", points, frequency, out="a.csv")
        assert Path("a.part").is_file()
        model = Path("model.py").read_text()
        Path("model.py").write_text(model + "# another version\n")
        with pytest.raises(
            ibrid.IbridError,
            match=r"a\.part has points of another measurement: the device, model file",
        ):
            ibrid.measure("DEVICE.toml", points, frequency, out="a.csv")
        Path("model.py").write_text(model)
        asked.clear()
        again = ibrid.measure("DEVICE.toml", points, frequency, out="a.csv")
        assert len(asked) == 1
    whole = ibrid.measure("DEVICE.toml", points, frequency)
    for name in whole.names:
        assert (again[name].admittance == whole[name].admittance).all()


@pytest.mark.slow
def test_kept_points_of_another_model_or_changed_ones_are_not_gone_on_with(
    monkeypatch: pytest.MonkeyPatch,
):
    """A neighbour that the model imports, data that it reads, and numbers that somebody edited."""
    Path("gains.csv").write_text("0.8\n")
    Path("helper.py").write_text("G = 1.0\n")
    model = Path("model.py").read_text()
    read = "import helper\nassert open('gains.csv').read()\n"
    log = "open('model.log', 'a').write('made\\n')\n"
    Path("model.py").write_text(read + log + model)
    monkeypatch.setattr(KeptPoints, "drop", lambda self: None)
    points, frequency = ["p=0.5,q=0.2"], (50.0, 150.0)
    ibrid.measure("DEVICE.toml", points, frequency, out="a.csv")
    kept = Path("a.part").read_text()
    Path("model.log").write_text("another line of the log that the model writes\n")
    ibrid.measure("DEVICE.toml", points, frequency, out="a.csv")
    for name, content in (("gains.csv", "0.5\n"), ("helper.py", "G = 2.0\n")):
        before = Path(name).read_text()
        Path(name).write_text(content)
        with pytest.raises(ibrid.IbridError, match=rf"a\.part has points .* file .*{name}, which"):
            ibrid.measure("DEVICE.toml", points, frequency, out="a.csv")
        Path(name).write_text(before)
    damaged = [
        '{"key": "another", "points": []}',
        "[]",
        *(kept.replace(old, new) for old, new in EDITED),
    ]
    with collecting() as failures:
        for text in damaged:
            with failures.case(text[:40]):
                assert text != kept
                Path("a.part").write_text(text)
                with pytest.raises(ibrid.IbridError, match=r"a\.part must be as a measurement"):
                    ibrid.measure("DEVICE.toml", points, frequency, out="a.csv")


EDITED = (
    ('"admittance": [', '"admittance": [1e308, '),
    ('"guard": [', '"guard": [[], '),
    ('"periods": ', '"periods": -'),
    ('"p_ref"', '"p\\nref"'),
    ('"distortion": [', '"distortion": null, "was": ['),
)


@pytest.mark.slow
def test_what_is_measured_replaces_no_file_of_the_device(capsys):
    Path("helper.py").write_text("G = 1.0\n")
    Path("model.py").write_text("import helper\n" + Path("model.py").read_text())
    before = {name: Path(name).read_text() for name in ("DEVICE.toml", "model.py", "helper.py")}
    for name in before:
        with pytest.raises(ibrid.IbridError, match=r"would overwrite the input .*, the same file"):
            ibrid.measure("DEVICE.toml", ["p=0.5,q=0.2"], (50.0, 150.0), out=name)
        words = ["measure", "DEVICE.toml", "--op", "p=0.5,q=0.2", "--event", "dip:0.6"]
        assert main([*words, "--out", name]) == 2
        assert "would overwrite" in capsys.readouterr().err
    assert {name: Path(name).read_text() for name in before} == before
    assert not Path("helper.part").exists()


def test_an_operating_point_is_measured_once():
    with pytest.raises(ibrid.IbridError, match="found one twice"):
        ibrid.measure("DEVICE.toml", ["p=0.5,q=0", "p=0.5,q=0"], (50.0, 150.0))


def test_a_sweep_is_not_named_as_a_measurement_that_is_not_finished():
    with pytest.raises(ibrid.IbridError, match=r"the ending \.part is that of a measurement"):
        ibrid.measure("DEVICE.toml", ["p=0.5,q=0.2"], (50.0, 150.0), out="s.part")
    assert not Path("s.part").exists()


def test_the_place_of_kept_points_is_looked_at_first():
    Path("a.part").mkdir()
    with pytest.raises(ibrid.IbridError, match=r"a\.part: is a folder"):
        ibrid.measure("DEVICE.toml", ["p=0.5,q=0.2"], (50.0, 150.0), out="a.csv")


@pytest.mark.skipif(not Path("/dev/null").exists(), reason="POSIX")
def test_a_sweep_into_a_device_keeps_nothing_beside_it():
    file = read_device("DEVICE.toml")
    settings = MeasureSettings()
    multisine = multisine_for((50.0, 150.0), file.step_s, file.f0_hz, file.sampling_hz)
    assert KeptPoints.beside("a.csv", file, [], multisine, settings).place == Path("a.part")
    assert KeptPoints.beside("/dev/null", file, [], multisine, settings).place is None


def test_wrong_uses_are_one_sentence(capsys):
    uses = {
        ("--freq", "20:200:5"): "--op p=..,q=.. and --out FILE must be given to measure a device",
        (
            "--op",
            "p=1,q=0",
            "--out",
            "model.py",
        ): "model.py: would overwrite the model file, the same file",
        ("--op", "p=1,q=0", "--out", "DEVICE.toml"): "DEVICE.toml: would overwrite",
        (
            "--op",
            "p=1,q=0",
            "--freq",
            "1:2:3",
            "--event",
            "dip:0.5",
            "--out",
            "a.csv",
        ): "--freq asks for a sweep and --event",
        (
            "--op",
            "p=1,q=0",
            "--peak",
            "3",
            "--out",
            "a.csv",
        ): "the peak of the injected voltage must be 1e-09 to 1 per unit",
    }
    for options, said in uses.items():
        assert main(["measure", "DEVICE.toml", *options]) == 2, options
        assert said in capsys.readouterr().err, options
