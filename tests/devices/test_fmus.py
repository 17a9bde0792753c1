"""FMUs as devices: of FMI 3.0 with three phases, of FMI 2.0 as it is exported here; what cannot be
opened.
"""

import shutil
import subprocess
import tempfile
import zipfile
from pathlib import Path

import numpy as np
import pytest
from fitted import evaluated

import ibrid
from ibrid.cli import main
from ibrid.devices import DeviceFile
from ibrid.devices.device_file import device_of
from ibrid.errors import IbridError
from ibrid.export.compiling import COMPILERS

pytest.importorskip("fmpy", reason="FMPy is not installed (pip install fmpy)")
SOURCE = Path(__file__).resolve().parents[1] / "helpers" / "fmi3_device.c"
COMPILER = next(filter(None, map(shutil.which, COMPILERS)), None)
needs_compiler = pytest.mark.skipif(COMPILER is None, reason="a C compiler is needed")
FREQUENCY = (50.0, 150.0, 450.0)
NUMBER = '<Float64 name="{name}" valueReference="{place}" {more}/>'
WORDS = {"v": "terminal voltage", "i": "current", "g": "conductance", "p": "active power"}
DESCRIPTION = """<?xml version="1.0" encoding="UTF-8"?>
<fmiModelDescription fmiVersion="3.0" modelName="closed form" instantiationToken="1">
  <{kind} modelIdentifier="device"/>
  <TypeDefinitions>
    <EnumerationType name="Tenths"><Item name="five" value="5"/><Item name="eight" value="8"/></EnumerationType>
  </TypeDefinitions>
  <ModelVariables>
    <Float64 name="time" valueReference="0" causality="independent" variability="continuous"/>
    {variables}
    <Boolean name="enable" valueReference="9" causality="input" variability="discrete" start="false"/>
    <Enumeration name="tenths" declaredType="Tenths" valueReference="10" causality="parameter" variability="tunable" start="5"/>
  </ModelVariables>
  <ModelStructure>{outputs}</ModelStructure>
</fmiModelDescription>
"""


def description(kind: str = "CoSimulation") -> str:
    start = {
        "input": 'variability="continuous" start="0"',
        "output": 'variability="continuous"',
        "parameter": 'variability="tunable" start="0.5"',
    }
    names = {
        **{f"v_{phase}": ("input", 1 + k) for k, phase in enumerate("abc")},
        **{f"i_{phase}": ("output", 4 + k) for k, phase in enumerate("abc")},
        "g": ("parameter", 7),
        "p_ref": ("input", 8),
    }
    variables = [
        NUMBER.format(
            name=name,
            place=place,
            more=f'causality="{causality}" {start[causality]} description="{WORDS[name[0]]}, per '
            'unit"',
        )
        for name, (causality, place) in names.items()
    ]
    outputs = "".join(f'<Output valueReference="{place}"/>' for place in (4, 5, 6))
    return DESCRIPTION.format(kind=kind, variables="\n    ".join(variables), outputs=outputs)


def packed(path: Path, text: str, binary: bytes, platform: str = "x86_64-linux") -> Path:
    with zipfile.ZipFile(path, "w") as archive:
        archive.writestr("modelDescription.xml", text)
        archive.writestr(
            f"binaries/{platform}/device.{'dll' if 'windows' in platform else 'so'}", binary
        )
    return path


@pytest.fixture(scope="module")
def binary(tmp_path_factory: pytest.TempPathFactory) -> bytes:
    out = tmp_path_factory.mktemp("fmu") / "device.so"
    subprocess.run(
        [str(COMPILER), "-shared", "-fPIC", "-O2", "-o", str(out), str(SOURCE), "-lm"], check=True
    )
    return out.read_bytes()


def device(file: Path, **changes: object) -> DeviceFile:
    signals = {
        "v": {"name": ["v_a", "v_b", "v_c"]},
        "i": {"name": ["i_a", "i_b", "i_c"]},
        "p_ref": {"name": "p_ref"},
    }
    content = {
        "kind": "fmu",
        "file": str(file),
        "step_s": 5e-4,
        "f0_hz": 50.0,
        "signals": signals,
        "start": {"enable": 1},
    }
    return device_of(content | changes, file.parent, "the device")


@needs_compiler
@pytest.mark.slow
def test_an_fmu_of_three_phases_is_measured_and_leaves_no_files(binary: bytes, tmp_path: Path):
    before = set(Path(tempfile.gettempdir()).iterdir())
    made = device(packed(tmp_path / "device.fmu", description(), binary), parameters={"g": 0.8})
    (point,) = ibrid.measure(made, ["p=0.5,q=0"], FREQUENCY).points
    np.testing.assert_allclose(
        point.admittance, np.broadcast_to(-0.8 * np.eye(2), (3, 2, 2)), atol=1e-9
    )
    assert point.op.p == pytest.approx(0.5, abs=2e-5)
    left = {one for one in Path(tempfile.gettempdir()).iterdir() if one not in before}
    assert not [
        one
        for one in left
        if one.name.startswith(("ibrid-", "tmp")) and (one / "modelDescription.xml").exists()
    ]


@needs_compiler
@pytest.mark.slow
def test_an_enumeration_of_fmi_3_is_set(binary: bytes, tmp_path: Path):
    made = device(packed(tmp_path / "device.fmu", description(), binary), parameters={"tenths": 8})
    (point,) = ibrid.measure(made, ["p=0.5,q=0"], FREQUENCY).points
    np.testing.assert_allclose(
        point.admittance, np.broadcast_to(-0.8 * np.eye(2), (3, 2, 2)), atol=1e-9
    )


@needs_compiler
@pytest.mark.slow
def test_what_is_wrong_with_an_fmu_is_one_sentence(binary: bytes, tmp_path: Path):
    good = packed(tmp_path / "device.fmu", description(), binary)
    text = tmp_path / "text.fmu"
    text.write_text("no archive")
    cases = {
        "is no FMU that can be read": device(text),
        "there is no such file": device(tmp_path / "nothing.fmu"),
        "has no binary for .*, only for win64; measure it there": device(
            packed(tmp_path / "w.fmu", description(), binary, "x86_64-windows")
        ),
        "is for model exchange alone": device(
            packed(tmp_path / "m.fmu", description("ModelExchange"), binary)
        ),
        "has no variable 'h'": device(good, parameters={"h": 1.0}),
        "g is of type Float64, found 'much' for it": device(good, parameters={"g": "much"}),
        "must be three names, or two of d and q; found 1": device(
            good, signals={"v": {"name": "v_a"}}
        ),
        "g must be an input that is a number; it is parameter": device(
            good, signals={"v": {"name": ["g", "v_b", "v_c"]}}
        ),
        "device.fmu: it failed with FMICallException": device(good, parameters={"g": 6.0}),
    }
    for said, made in cases.items():
        with pytest.raises(IbridError, match=said) as caught:
            ibrid.measure(made, ["p=0.5,q=0"], FREQUENCY)
        assert "\n" not in str(caught.value)


@needs_compiler
@pytest.mark.slow
def test_what_an_fmu_offers_is_guessed(
    binary: bytes, tmp_path: Path, capsys: pytest.CaptureFixture
):
    file = packed(tmp_path / "device.fmu", description(), binary)
    assert main(["measure", str(file), "--describe"]) == 0
    text = capsys.readouterr().out
    assert "# device.fmu: closed form, FMI 3.0" in text
    assert "# parameter g = 0.5 [pu] conductance, per unit" in text
    assert "guessed from names and units: v = v_a v_b v_c, i = i_a i_b i_c, p_ref = p_ref" in text
    assert "[start] holds the inputs enable: put in what they should be" in text


@needs_compiler
@pytest.mark.nightly
def test_an_exported_fmu_answers_as_the_model_that_it_was_made_of(tmp_path: Path):
    record = evaluated("gfl_pll_filter_exact", restarts=0)
    op = next(iter(record.parameters))
    ibrid.export(record, tmp_path / "own.fmu", "fmu", op, nonlinear=True)
    signals = {"v": {"name": ["v_D", "v_Q"]}, "i": {"name": ["i_D", "i_Q"]}}
    made = device(tmp_path / "own.fmu", signals=signals, start={}, step_s=2e-5, f0_hz=60.0)
    with pytest.raises(IbridError, match="takes no p_ref and q_ref, and rests at") as caught:
        ibrid.measure(made, ["p=-9,q=-9"], FREQUENCY)
    rest = str(caught.value).split("rests at ")[1].split(" with")[0]
    (point,) = ibrid.measure(made, [rest], FREQUENCY).points
    model = record.state_space(op)
    truth = np.array([model(2j * np.pi * hz) for hz in point.frequency])
    error = np.linalg.norm(point.admittance - truth, axis=(1, 2)) / np.linalg.norm(
        truth, axis=(1, 2)
    )
    # the mean of two samples in place of a line: (omega h)^2 / 6
    assert error.max() < 2e-3
