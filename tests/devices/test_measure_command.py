"""`ibrid measure`: a sweep, records, a description; stopped and begun again."""

from pathlib import Path

import pytest
from model_files import DEVICE, GOOD

import ibrid
from ibrid.cli import main
from ibrid.devices import read_device
from ibrid.devices.fresh_device import FreshDevice


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
            match=r"a\.part has points of another measurement: another device, model file",
        ):
            ibrid.measure("DEVICE.toml", points, frequency, out="a.csv")
        Path("model.py").write_text(model)
        asked.clear()
        again = ibrid.measure("DEVICE.toml", points, frequency, out="a.csv")
        assert len(asked) == 1
    whole = ibrid.measure("DEVICE.toml", points, frequency)
    for name in whole.names:
        assert (again[name].admittance == whole[name].admittance).all()
    Path("b.part").write_text('{"key": "another", "points": []}')
    with pytest.raises(
        ibrid.IbridError,
        match=r"b\.part has points of another measurement: .* remove it, or measure into another",
    ):
        ibrid.measure("DEVICE.toml", points, frequency, out="b.csv")


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
