"""PSCAD's .psout is read through the package of its makers, for which a stand-in answers here; what
is not read is said.
"""

import json
import sys
from types import ModuleType

import numpy as np
import pytest
from recording_makes import P, Q, six

import ibrid
from ibrid import cli
from ibrid.measurement.importing.binary.psout_file import REMARKS, psout_arrays

#: Calls above a trace, traces with a domain, runs: as the package has them.
STAND_IN = """
import json
from array import array
class Call:
    def __init__(self, said, parent=None): self.said, self.parent = said, parent
    def variables(self): return self.said
class Trace:
    def __init__(self, calls, data, domain):
        self.call, self.data, self.own_domain = None, array("d", data), domain
        for said in calls: self.call = Call(said, self.call)
    def variables(self): return {}
    @property
    def domain(self):
        if self.own_domain is None: raise AttributeError("it has no domain")
        return self.own_domain
class File:
    def __init__(self, path):
        with open(path) as file: self.held = json.load(file)
        self.num_runs = self.held.get("runs", 1)
    def __enter__(self): return self
    def __exit__(self, *error): pass
    def run(self, index): return self
    def traces(self):
        for calls, data, domain in self.held["traces"]:
            axis = None if domain is None else Trace([domain[0]], domain[1], None)
            yield Trace(calls, data, axis)
"""
ROOT = {"Name": "Root"}
TIME = [0.0, 0.1, 0.2]
AXIS = ({"Name": "time", "Unit": "s"}, TIME)


def named(name: str, unit: str = "", data=TIME, axis=AXIS, **beside: str):
    """A trace as PSCAD writes it: its number below the call that has its name."""
    calls = [ROOT, {"Name": name, "Unit": unit, **beside}, {"Name": "0"}]
    return calls, list(data), axis


@pytest.fixture
def read(monkeypatch):
    """The arrays of a file that holds such traces."""
    package, module = ModuleType("mhi"), ModuleType("mhi.psout")
    exec(STAND_IN, module.__dict__)
    monkeypatch.setitem(sys.modules, "mhi", package)
    monkeypatch.setitem(sys.modules, "mhi.psout", module)

    def read(*traces, **held) -> dict[str, np.ndarray]:
        return psout_arrays(json.dumps({"traces": traces, **held}).encode())

    return read


def test_psout_is_read_by_the_package_of_its_makers_where_it_is_there(
    tmp_path, monkeypatch, capsys
):
    """In the process that reads it; signals at other times and further runs are said."""
    time, values = six()
    axis = ({"Name": "time", "Unit": "s"}, list(time))
    traces = [
        named(name, "kV" if name[0] == "V" else "kA", one / 1e3, axis)
        for name, one in zip(("Va", "Vb", "Vc", "Ia", "Ib", "Ic"), values, strict=True)
    ]
    others = [named("speed", "", time, axis), named("P_grid", "MW")]
    held = json.dumps({"traces": [*traces, *others], "runs": 3})
    path = tmp_path / "run.psout"
    path.write_text(held)
    with pytest.raises(ibrid.IbridError, match="pip install mhi-psout"):
        ibrid.read_events(path, base="10MVA,20kV")
    (tmp_path / "mhi" / "psout").mkdir(parents=True)
    (tmp_path / "mhi" / "psout" / "__init__.py").write_text(STAND_IN)
    monkeypatch.syspath_prepend(str(tmp_path))
    (record,) = ibrid.read_events(path, base="10MVA,20kV").records
    assert abs(record.rest.p - P) < 1e-6 > abs(record.rest.q - Q)
    out = str(tmp_path / "events.csv")
    assert cli.main(["import", str(path), "--base", "10MVA,20kV", "--out", out]) == 0
    said = capsys.readouterr().err
    assert "signals at other times than the first are left out: P_grid" in said
    assert "the first of its 3 runs is read" in said


def test_signals_at_other_times_are_left_out_and_named(read):
    later = ({"Name": "time", "Unit": "s"}, [0.05, 0.15, 0.25])
    arrays = read(
        named("Va", "kV"),
        named("Vb", "kV", axis=later),
        named("Vc", "kV", [1.0, 2.0]),
        named("Ia", "kA"),
    )
    remark = str(arrays.pop(REMARKS)[0])
    assert list(arrays) == ["time [s]", "Va [kV]", "Ia [kA]"]
    assert remark == "signals at other times than the first are left out: Vb, Vc"


def test_what_has_no_time_and_what_is_no_voltage_current_or_power_is_no_signal(read):
    spectrum = ({"Name": "frequency", "Unit": "Hz"}, TIME)
    arrays = read(
        named("speed", "rad/s"),
        named("Va", "kV", axis=None),
        named("Ia", "kA", axis=spectrum),
        named("P_poc", "MW"),
    )
    assert list(arrays) == ["time [s]", "P_poc [MW]"]


def test_a_time_in_milliseconds_becomes_seconds(read):
    axis = ({"Name": "time", "Unit": "ms"}, [0.0, 100.0, 200.0])
    np.testing.assert_allclose(read(named("Va", "kV", axis=axis))["time [s]"], TIME)


def test_a_file_without_a_signal_says_what_it_would_need(read):
    for traces in ((), (named("speed"),), (named("Va", "kV", axis=None),)):
        with pytest.raises(ValueError, match="no signal that is called as a voltage"):
            read(*traces)


def test_names_and_units_stand_in_the_nearest_call_that_says_something(read):
    """Plain calls, Record and Data, say nothing; of several dimensions the number counts from 1."""
    plain = [ROOT, {"Name": "Main"}, {"Name": "Vpoc", "Unit": "kV", "Dim": "3"}, {"Name": "Record"}]
    phases = [([*plain, {"Name": str(k)}], TIME, AXIS) for k in range(3)]
    labelled = ([ROOT, {"Label": "Ia", "Units": "kA"}, {"Name": "Data"}], TIME, AXIS)
    arrays = read(*phases, labelled, named("Ia", "kA"))
    assert list(arrays) == [
        "time [s]",
        "Vpoc:1 [kV]",
        "Vpoc:2 [kV]",
        "Vpoc:3 [kV]",
        "Ia [kA]",
        "Ia [kA] #5",
    ]
