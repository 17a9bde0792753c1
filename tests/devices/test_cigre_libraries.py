"""Libraries of the IEEE/CIGRE interface: layout, controllers in a power stage, faults, our own
exports, and one of others.
"""

import os
import shutil
import subprocess
from pathlib import Path

import numpy as np
import pytest
from collecting import each_of
from fitted import evaluated

import ibrid
from ibrid.cli import main
from ibrid.devices import DeviceFile, MeasureSettings, ProcessLimits, read_device
from ibrid.devices.cigre_library import CigreInstance, load_library
from ibrid.devices.device_file import device_of
from ibrid.devices.power_stage import stage_of
from ibrid.errors import IbridError
from ibrid.export.compiling import COMPILERS
from ibrid.plants.sweeping import frequency_grid

ROOT = Path(__file__).resolve().parents[2]
SOURCE = ROOT / "tests" / "helpers" / "cigre_library.c"
#: Where controllers of others lie: in a folder of data that is named, or beside the repository.
FOREIGN = (
    Path(os.environ.get("IBRID_HARDWARE_DATA") or ROOT.parent / "shared" / "data")
    / "cigre_controller"
)
FREQUENCY = (20.0, 45.0, 90.0, 300.0)
COMPILER = next(filter(None, map(shutil.which, COMPILERS)), None)
needs_compiler = pytest.mark.skipif(COMPILER is None, reason="a C compiler is needed")


def compiled(source: Path, out: Path, *options: str) -> Path:
    line = [
        str(COMPILER),
        "-shared",
        "-fPIC",
        "-O2",
        "-w",
        *options,
        "-o",
        str(out),
        str(source),
        "-lm",
    ]
    subprocess.run(line, check=True)
    return out


@pytest.fixture(scope="module")
def library(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return compiled(SOURCE, tmp_path_factory.mktemp("cigre") / "model.so")


def device(library: Path, **changes: object) -> DeviceFile:
    content = {
        "kind": "cigre",
        "file": str(library),
        "step_s": 5e-4,
        "f0_hz": 50.0,
        "start": {"enable": 1},
        "signals": {
            "v": {"name": "v"},
            "i": {"name": "i"},
            "p_ref": {"name": "p_ref"},
            "q_ref": {"name": "q_ref"},
        },
    }
    return device_of(content | changes, library.parent, "the device")


@needs_compiler
@pytest.mark.slow
def test_signals_of_every_type_are_found_where_they_lie(library: Path):
    made = device(library, parameters={"g": 0.75, "gain": 2.0, "site": "nowhere"})
    (point,) = ibrid.measure(made, ["p=0.5,q=0.2"], FREQUENCY).points
    # currents of 32 bits
    np.testing.assert_allclose(
        point.admittance, np.broadcast_to(-1.5 * np.eye(2), (4, 2, 2)), atol=1e-4
    )
    assert (np.abs(point.admittance + 1.5 * np.eye(2)) < 8 * point.sigma).all()
    assert (point.op.p, point.op.q) == pytest.approx((0.5, 0.2), abs=1e-4)


@needs_compiler
@pytest.mark.slow
def test_whole_numbers_are_rounded(library: Path):
    """0.3 / 0.1 is below 3, and 0.6 / 0.1 below 6."""
    instance = CigreInstance(load_library(str(library)), {"deed": 0.3 / 0.1})
    instance.put("count", 0.6 / 0.1)
    ports = instance.library
    assert instance.inputs["u2"][ports.inputs["count"].place] == 6
    assert instance.parameters["i1"][ports.parameters["deed"].place] == 3


CHANGES = [
    ({"parameters": {"deed": 1}}, "model.so: crashed, its process ended with signal 11"),
    (
        {"parameters": {"deed": 2}},
        "model.so: hangs, its process took more than 2 s of processor time",
    ),
    (
        {"parameters": {"deed": 3}},
        r"closed form: Model_Outputs refused at t = 0.05\d* s \(the fuse is gone\)",
    ),
    (
        {"parameters": {"deed": 5}},
        r"model.so: its current is not a finite number from t = 0.05\d* s on",
    ),
    (
        {"parameters": {"site": "here"}},
        r"closed form: Model_CheckParameters refused at t = 0 s \(no licence for this site\)",
    ),
    ({"parameters": {"h": 1.0}}, "closed form has no parameter 'h'; known are: deed, g"),
    ({"parameters": {"g": 11.0}}, "the parameter g must be 0 to 10; found 11"),
    ({"parameters": {"g": "much"}}, "the parameter g must be a number; found 'much'"),
    ({"start": {"on": 1}}, "closed form has no input 'on'"),
    (
        {"step_s": 1e-4},
        r"wants to be called every 0.0005 s and step_s is 0.0001; write step_s = 0.0005",
    ),
    (
        {"signals": {"v": {"name": "v"}}},
        r"\[signals\] lacks i, the three numbers of the library that it is",
    ),
    (
        {"signals": {"v": {"name": "v"}, "i": {"name": ["m_a", "m_b"]}}},
        "must be three names, or one of a signal of three",
    ),
    (
        {"signals": {"v": {"name": ["va", "vb", "vc"]}, "i": {"name": "i"}}},
        "has no 'va', which signals.v names",
    ),
    ({"file": str(SOURCE)}, "is no library; a .dll, .so or .dylib with the IEEE/CIGRE interface"),
    ({"file": "nothing.so"}, "nothing.so: cannot be read"),
]


@needs_compiler
@pytest.mark.nightly
@each_of(("changes", "said"), CHANGES, ids=[said for _, said in CHANGES])
def test_what_is_wrong_with_a_library_is_one_sentence(changes: dict, said: str, library: Path):
    hasty = MeasureSettings(limits=ProcessLimits(processor_s=2.0, still=20))
    with pytest.raises(IbridError, match=said) as caught:
        ibrid.measure(device(library, **changes), ["p=0.5,q=0.2"], FREQUENCY, settings=hasty)
    assert "\n" not in str(caught.value)


@needs_compiler
@pytest.mark.slow
def test_a_library_of_another_interface_or_system_is_one_sentence(library: Path, tmp_path: Path):
    other = compiled(SOURCE, tmp_path / "other.so", "-DMAJOR=2")
    rms = compiled(SOURCE, tmp_path / "rms.so", "-DMODE=2")
    empty = tmp_path / "empty.c"
    empty.write_text("int nothing;\n")
    windows = tmp_path / "windows.dll"
    windows.write_bytes(
        b"MZ"
        + bytes(58)
        + (64).to_bytes(4, "little")
        + b"PE\0\0"
        + (0x8664).to_bytes(2, "little")
        + bytes(100)
    )
    old = tmp_path / "old.so"
    old.write_bytes(library.read_bytes()[:4] + b"\x01" + library.read_bytes()[5:])
    said = {
        other: "has version 2.1.0.0 of the IEEE/CIGRE interface, 1.1 is known",
        rms: "rms.so: is for RMS programs alone, and instantaneous values are measured",
        compiled(
            empty, tmp_path / "empty.so"
        ): "has no function Model_GetInfo, so it is no library of the IEEE/CIGRE interface",
        windows: "windows.dll: is a library for Windows, and this is Linux; measure it there",
        old: "old.so: is a library of 32 bits, and this Python has 64",
    }
    for file, sentence in said.items():
        with pytest.raises(IbridError, match=sentence):
            ibrid.measure(device(file), ["p=0.5,q=0.2"], FREQUENCY)


@needs_compiler
@pytest.mark.slow
def test_a_library_that_talks_is_measured_all_the_same(library: Path):
    (point,) = ibrid.measure(
        device(library, parameters={"deed": 4}), ["p=0.5,q=0.2"], FREQUENCY
    ).points
    np.testing.assert_allclose(
        point.admittance, np.broadcast_to(-0.5 * np.eye(2), (4, 2, 2)), atol=1e-4
    )


STAGES = [
    {"L_f": 0.1, "R_f": 0.01, "v_dc": 2.5},
    {"L_f": 0.1, "R_f": 0.01, "C": 0.05, "R_C": 0.2, "v_dc": 2.5},
    {"L_f": 0.1, "R_f": 0.01, "C": 0.2, "R_C": 0.2, "L_g": 0.08, "R_g": 0.02, "v_dc": 2.5},
]


def passive(stage: dict[str, float], s: np.ndarray, r: float, seen: bool) -> np.ndarray:
    """Current out of the terminals over their voltage, of a phase: u = (v if seen) - r i_f; s in
    units of omega_0.
    """
    bridge = stage["R_f"] + r + s * stage["L_f"]
    if "C" not in stage:
        return (seen - 1) / bridge
    shunt = 1 / (stage["R_C"] + 1 / (s * stage["C"]))
    grid = stage.get("R_g", 0.0) + s * stage.get("L_g", 0.0)
    # at the node: i_f = (u - e) / bridge, i = i_f - shunt e, e = v + grid i
    return ((seen - 1) / bridge - shunt) / (1 + grid * (1 / bridge + shunt))


@each_of("stage", STAGES)
def test_the_law_of_a_power_stage_is_its_network(stage: dict[str, float]):
    """Two ways: the state equations, and the impedances of the network."""
    made = stage_of(stage, None, 50.0, "the stage")
    omega_0 = 100 * np.pi
    a, b, c, d = made.laws(omega_0)
    for frequency in (3.0, 50.0, 700.0):
        s = 2j * np.pi * frequency
        y = c @ np.linalg.solve(s * np.eye(len(a)) - a, b) + d
        assert y[2, 1] == pytest.approx(complex(passive(stage, s / omega_0, 0.0, False)), rel=1e-9)
        assert y[0].tolist() == [0.0, 1.0]
        # the drop over the bridge's branch
        branch = stage["R_f"] + s / omega_0 * stage["L_f"]
        assert y[3, 0] * branch == pytest.approx(1 - y[1, 0], rel=1e-9)


@needs_compiler
@pytest.mark.slow
@each_of("stage", STAGES)
def test_a_controller_is_measured_with_its_power_stage(stage: dict[str, float], library: Path):
    """Its law u = v - r i_f from sample to sample is a closed form in z, of each phase."""
    signals = {
        "v": {"name": "v"},
        "i_f": {"name": "i_f"},
        "u": {"name": ["m_a", "m_b", "m_c"], "unit": "m"},
    }
    made = device(library, signals=signals, power_stage=stage, parameters={"r": 0.3})

    def of_a_phase(frequency: np.ndarray) -> np.ndarray:
        a, b = made.power_stage.stepped(100 * np.pi, 5e-4)
        _, _, c, d = made.power_stage.laws(100 * np.pi)
        z = np.exp(2j * np.pi * np.atleast_1d(frequency) * 5e-4)[:, None, None]
        # u = (1 - r d) v - r c x
        moving = z * np.eye(len(a)) - a + 0.3 * b[:, :1] @ c[3:]
        driven = (1 - 0.3 * d[3, 1]) * b[:, 0] + b[:, 1] + b[:, 2] * z[:, :, 0]
        x = np.linalg.solve(moving, driven[:, :, None])[:, :, 0]
        return x @ c[2] + d[2, 1]

    rest = complex(of_a_phase(np.array(50.0))[0])
    (point,) = ibrid.measure(made, [f"p={rest.real},q={-rest.imag}"], FREQUENCY).points
    above, below = of_a_phase(50.0 + point.frequency), of_a_phase(50.0 - point.frequency).conj()
    along, across = (above + below) / 2, (above - below) / 2j
    truth = np.moveaxis(np.array([[along, -across], [across, along]]), 2, 0)
    # the sensed currents are handed over in 32 bits
    np.testing.assert_allclose(point.admittance, truth, atol=1e-4 * np.abs(truth).max())


WRONG_STAGES = [
    ({"L_f": 0.1}, "v_dc of .* must be a number, 0 or more; found nothing"),
    ({"L_f": 0.0, "v_dc": 2.0}, "L_f and v_dc of .* must be above 0"),
    ({"L_f": 0.1, "v_dc": 2.0, "C": 0.1}, "its capacitor at the terminals without resistance"),
    ({"L_f": 0.1, "v_dc": 2.0, "C": 0.1, "R_C": 0.2, "R_g": 0.1}, "R_g of .* needs L_g"),
    ({"L_f": 0.1, "v_dc": 2.0, "L": 0.1}, "has 'L'; did you mean"),
    ({"L_f": -0.1, "v_dc": 2.0}, "L_f of .* must be a number, 0 or more; found -0.1"),
    (
        {"L_f": 0.1, "v_dc": 2.0, "delay_steps": 0.5},
        "delay_steps of .* must be a whole number of steps",
    ),
    ({"L_f": 0.1, "v_dc": 2.0, "unit": "si"}, "is in SI units, which need s_base_va and v_base_v"),
]


@each_of(("stage", "said"), WRONG_STAGES)
def test_a_power_stage_that_cannot_be_is_one_sentence(stage: dict[str, float], said: str):
    with pytest.raises(IbridError, match=said):
        stage_of(stage, None, 50.0, "the stage")


def test_a_power_stage_in_si_units_is_that_in_per_unit():
    base = 600.0**2 / 1e6
    si = {
        "L_f": 0.1 * base / (120 * np.pi),
        "R_f": 0.01 * base,
        "C": 0.05 / base / (120 * np.pi),
        "R_C": 0.2 * base,
    }
    in_si = stage_of({**si, "v_dc": 2.5 * 490.0, "unit": "si"}, (base, 490.0), 60.0, "the stage")
    in_pu = stage_of(
        {"L_f": 0.1, "R_f": 0.01, "C": 0.05, "R_C": 0.2, "v_dc": 2.5}, None, 60.0, "the stage"
    )
    assert vars(in_si) == pytest.approx({**vars(in_pu), "limit": in_si.limit})


# --- our own exports, and a controller of others
# ----------------------------------------------------------------------------------------------


@needs_compiler
@pytest.mark.nightly
def test_an_exported_library_answers_as_the_model_that_it_was_made_of(tmp_path: Path):
    record = evaluated("gfl_pll_filter_exact", restarts=0)
    op = next(iter(record.parameters))
    ibrid.export(record, tmp_path / "own.so", "cigre", op)
    model = record.state_space(op)
    content = {
        "kind": "cigre",
        "file": str(tmp_path / "own.so"),
        "step_s": 1e-5,
        "f0_hz": 60.0,
        "signals": {"v": {"name": ["v_a", "v_b", "v_c"]}, "i": {"name": ["i_a", "i_b", "i_c"]}},
    }
    made = device_of(content, tmp_path, "the device")
    rest = resting_point(made)
    (point,) = ibrid.measure(made, [rest], frequency_grid("10:1000:12")).points
    truth = np.array([model(2j * np.pi * hz) for hz in point.frequency])
    error = np.linalg.norm(point.admittance - truth, axis=(1, 2)) / np.linalg.norm(
        truth, axis=(1, 2)
    )
    # odd powers, and the straight line between samples
    assert error.max() < 2e-3


def resting_point(made: DeviceFile) -> str:
    """Where a device without references rests, as the refusal of another point says it."""
    with pytest.raises(IbridError) as caught:
        ibrid.measure(made, ["p=-9,q=-9"], FREQUENCY)
    return str(caught.value).split("rests at ")[1].split(" with")[0]


SHIM = "#include <stdint.h>\n#define __cdecl\n#define __declspec(x)\n#define sprintf_s snprintf\n"
STAGE = {
    "unit": "si",
    "L_f": 1e-4,
    "R_f": 0.00075,
    "C": 0.0015,
    "R_C": 0.01667,
    "L_g": 1e-4,
    "R_g": 0.001,
    "v_dc": 1200.0,
}


@needs_compiler
@pytest.mark.nightly
@pytest.mark.skipif(
    not FOREIGN.is_dir(), reason="a controller of others beside the repository is needed"
)
def test_a_controller_of_others_is_measured_as_a_binary(tmp_path: Path):
    """EPRI's grid-following control, its Q control in place of the voltage control: it reaches p
    and q, and keeps them.
    """
    (tmp_path / "windows.h").write_text(SHIM)
    file = compiled(
        FOREIGN / "gfm_gfl_ibr2.c", tmp_path / "ibr2.so", "-I", str(tmp_path), "-I", str(FOREIGN)
    )
    three = {
        role: [f"{name}{phase}" for phase in "abc"]
        for role, name in (("v", "Vt"), ("i_f", "I1"), ("i", "I2"))
    }
    content = {
        "kind": "cigre",
        "file": str(file),
        "step_s": 1e-5,
        "f0_hz": 60.0,
        "s_base_va": 1e6,
        "v_base_v": 600.0,
        "settle_s": 3.5,
        "power_stage": STAGE,
        "start": {"Vdc_meas": 1.2, "Vref": 1.0},
        "parameters": {"Vt_flag": 0},
        "signals": {
            "v": {"name": three["v"], "unit": "kV"},
            "i_f": {"name": three["i_f"], "unit": "kA"},
            "i": {"name": three["i"], "unit": "kA"},
            "u": {"name": ["m_a", "m_b", "m_c"], "unit": "m"},
            "p_ref": {"name": "Pref"},
            "q_ref": {"name": "Qref"},
        },
    }
    (point,) = ibrid.measure(
        device_of(content, tmp_path, "the device"), ["p=0.5,q=0.1"], frequency_grid("2:200:10")
    ).points
    assert (point.op.p, point.op.q) == pytest.approx((0.5, 0.1), abs=1e-4)
    assert (point.sigma < 1e-3 * np.abs(point.admittance).max()).all()
    # at low frequencies it keeps P = v i_d: the d current falls as the voltage rises, p / v^2
    assert point.admittance[0, 0, 0] == pytest.approx(-0.5, abs=0.1)


@needs_compiler
@pytest.mark.slow
def test_what_a_library_offers_is_guessed_and_can_be_corrected(
    library: Path, capsys: pytest.CaptureFixture
):
    assert main(["measure", str(library), "--describe"]) == 0
    text = capsys.readouterr().out
    assert "# model.so: closed form, for tests; 1" in text
    assert "# parameter gain = 1.0 []" in text
    assert (
        "guessed from names and units: v = v[0] v[1] v[2], i = i[0] i[1] i[2], p_ref = p_ref, "
        "q_ref = q_ref" in text
    )
    file = library.parent / "described.toml"
    file.write_text(
        text.replace("enable = 0.0", "enable = 1").replace("f0_hz = 50.0", "f0_hz = 50")
    )
    assert read_device(file).signals["v"].names == ("v[0]", "v[1]", "v[2]")
    (point,) = ibrid.measure(file, ["p=0.5,q=0.2"], FREQUENCY).points
    np.testing.assert_allclose(
        point.admittance, np.broadcast_to(-0.5 * np.eye(2), (4, 2, 2)), atol=1e-4
    )
