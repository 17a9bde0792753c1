"""DEVICE.toml: every key is read, or refused in a sentence that names it."""

import tomllib
from copy import deepcopy
from datetime import date
from pathlib import Path
from typing import Any

import pytest
from collecting import each_of

from ibrid.devices import read_device
from ibrid.devices.device_file import device_of
from ibrid.errors import IbridError
from ibrid.plants import PLANTS

WHOLE = """
kind = "python"
file = "model.py:Inverter"
step_s = 1e-4
f0_hz = 60.0
s_base_va = 1e6
v_base_v = 690.0
sampling_hz = 5000.0
[signals]
v = { unit = "kV" }
i = { unit = "A", sign = -1, scale = 2.0 }
p_ref = { name = "Pref", unit = "MW" }
f_ref = { name = "f", unit = "rad/s" }
[start]
enable = 1
[parameters]
gain = 2
mode = "following"
fast = true
"""

STAGE = """
kind = "cigre"
file = "control.so"
s_base_va = 1e6
v_base_v = 690.0
[signals]
v = { name = ["va", "vb", "vc"], unit = "V" }
u = { name = ["ma", "mb", "mc"], unit = "m" }
[power_stage]
unit = "pu"
v_dc = 2.0
L_f = 0.1
R_f = 0.01
delay_steps = 1
"""


def read(text: str, folder: Path):
    (folder / "DEVICE.toml").write_text(text)
    return read_device(folder / "DEVICE.toml")


def test_every_key_is_read(tmp_path: Path):
    device = read(WHOLE, tmp_path)
    peak = 690 * (2 / 3) ** 0.5
    assert device.file == str(tmp_path / "model.py:Inverter")
    assert (device.step_s, device.f0_hz, device.sampling_hz) == (1e-4, 60.0, 5000.0)
    assert device.signals["v"].per_unit == pytest.approx(1e3 / peak)
    assert device.signals["i"].per_unit == pytest.approx(-2 * 1.5 * peak / 1e6)
    assert device.signals["p_ref"].per_unit == pytest.approx(1.0)
    assert device.signals["p_ref"].names == ("Pref",)
    assert device.signals["f_ref"].per_unit == pytest.approx(1 / (120 * 3.141592653589793))
    assert device.start == {"enable": 1.0}
    assert device.parameters == {"gain": 2.0, "mode": "following", "fast": 1.0}
    assert device.references == ("p_ref", "f_ref")


def test_a_reference_inverter_brings_its_frequency_base_and_references(tmp_path: Path):
    device = read(
        'kind = "reference"\nfile = "paper_like"\nstep_s = 2e-5\n[parameters]\n"plant.L_F" = '
        "0.12\n",
        tmp_path,
    )
    assert (device.file, device.f0_hz) == ("paper_like", PLANTS["paper_like"].f0_hz)
    assert device.references == ("p_ref", "q_ref")
    with pytest.raises(IbridError, match=r"there is no reference inverter called nobody"):
        read('kind = "reference"\nfile = "nobody"\n', tmp_path)
    with pytest.raises(
        IbridError, match=r"has f0_hz, which a reference inverter brings itself; leave it out"
    ):
        read('kind = "reference"\nfile = "paper_like"\nf0_hz = 50.0\n', tmp_path)


WRONG = [
    ("kind = 3", 'kind = "python"', "kind of .* must be one of python, reference"),
    ('file = ""', 'file = "model.py:Inverter"', "file of .* must be FILE.py:OBJECT"),
    ("step_s = 1.0", "step_s = 1e-4", "step_s of .* must be 1e-09 to 0.1 s; found 1"),
    ('step_s = "1e-4"', "step_s = 1e-4", "step_s of .* must be a finite number; found '1e-4'"),
    ("f0_hz = nan", "f0_hz = 60.0", "f0_hz of .* must be a finite number; found nan"),
    ("step = 1e-4", "step_s = 1e-4", "has 'step'; did you mean step_s"),
    ("v = 3", 'v = { unit = "kV" }', "signals.v of .* must be a table such as"),
    ('w = { unit = "kV" }', 'v = { unit = "kV" }', "signals.w of .*: is no signal of a device"),
    (
        'v = { unit = "kA" }',
        'v = { unit = "kV" }',
        "unit of signals.v of .* is of a current, and voltage is meant",
    ),
    ('v = { unit = "MV" }', 'v = { unit = "kV" }', "must be pu or one of V, kV"),
    ("sign = 2", "sign = -1", "sign of signals.i of .* must be 1 or -1; found 2"),
    ("scale = 0", "scale = 2.0", "scale of signals.i of .* must not be 0"),
    (
        "name = 3",
        'name = "Pref"',
        "name of signals.p_ref of .* must be a name or a list of names; found 3",
    ),
    (
        'name = ["a", "b"]',
        'name = "Pref"',
        "name of signals.p_ref of .* must be one name, of the device's input; found 2",
    ),
    ('enable = "on"', "enable = 1", "enable of start of .* must be a finite number; found 'on'"),
    (
        "gain = [1]",
        "gain = 2",
        r"parameters.gain of .* must be a finite number or text; found \[1\]",
    ),
    ("", "v_base_v = 690.0", "is in SI units, which need s_base_va and v_base_v"),
    ("= 3", "v_base_v = 690.0", "is no TOML: .*; ibrid measure FILE --describe writes one"),
]


@each_of(("wrong", "right", "said"), WRONG)
def test_what_is_wrong_is_named(wrong: str, right: str, said: str, tmp_path: Path):
    assert right in WHOLE
    with pytest.raises(IbridError, match=said) as caught:
        read(WHOLE.replace(right, wrong), tmp_path)
    assert "\n" not in str(caught.value)


def test_a_file_that_is_not_there_is_named(tmp_path: Path):
    with pytest.raises(
        IbridError, match=r"the device .* cannot be read .*; give the path of a DEVICE\.toml"
    ):
        read_device(tmp_path / "DEVICE.toml")


#: One value of each kind that TOML has.
OF_EACH_KIND = (1, 1.5, "text", "", True, [], ["a"], {}, {"a": 1}, float("nan"), date(2026, 1, 1))


def _places(content: dict[str, Any], path: tuple[str, ...] = ()) -> list[tuple[str, ...]]:
    """The paths of all keys."""
    places = [(*path, key) for key in content]
    for key, value in content.items():
        if isinstance(value, dict):
            places += _places(value, (*path, key))
    return places


@each_of("text", [WHOLE, STAGE])
def test_every_key_is_of_its_kind_or_named(text: str, tmp_path: Path):
    """What is no sentence fails here."""
    whole = tomllib.loads(text)
    device_of(whole, tmp_path, "the device")
    failed = []
    for path in _places(whole):
        for value in OF_EACH_KIND:
            content = deepcopy(whole)
            held = content
            for key in path[:-1]:
                held = held[key]
            held[path[-1]] = value
            try:
                device_of(content, tmp_path, "the device")
            except IbridError as error:
                if path[-1] not in str(error) and "signals" not in str(error):
                    failed.append((path, value, str(error)))
            except Exception as error:
                failed.append((path, value, repr(error)))
    assert not failed
