"""Several devices behind one PCC: exact against nodal analysis, the one that differs is found, an
equivalent tells its error.
"""

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from collecting import each_of
from jsonschema import Draft202012Validator
from scipy.optimize import root

import ibrid
from ibrid.analysis.new_data.drift import drift
from ibrid.analysis.several_devices.collector import Collector
from ibrid.analysis.several_devices.collector_file import KnownBases, read_collector
from ibrid.analysis.several_devices.freed_fits import plant_model
from ibrid.analysis.several_devices.plant import equivalent_of, predict_plant
from ibrid.assembly.symbolic import symbolic_model
from ibrid.cli import main
from ibrid.errors import IbridError, SweepError
from ibrid.evaluation.record import Record
from ibrid.fit.kernel import admittance
from ibrid.measurement.sweeps.sweep import OperatingPoint, PointSweep, Sweep
from ibrid.schemas import schema
from ibrid.structure.diagrams.diagram import Diagram
from ibrid.structure.diagrams.library import textbook
from ibrid.structure.network.port_file import read_port
from ibrid.structure.reading.wiring import wire

OMEGA_0 = 2 * np.pi * 60
FREQUENCY = np.geomspace(5, 5000, 20)
POINTS = tuple(
    OperatingPoint(name, p, q, 1.0) for name, p, q in (("a", 1, 0.3), ("b", 1, -0.3), ("c", 0.4, 0))
)
I, J = np.eye(2), np.array([[0.0, -1.0], [1.0, 0.0]])
BASES = KnownBases(None, None, 60.0)
NETWORK = """
[[element]]
kind = "transformer"
R = 0.005
L = 0.06
unit = "pu"
[[branch]]
name = "near"
rating = 0.5
element = [{kind = "series", R = 0.01, L = 0.03, unit = "pu"}]
[[branch]]
name = "feeder"
element = [{kind = "series", R = 0.02, L = 0.05, unit = "pu"}]
[[branch.branch]]
name = "middle"
rating = 0.3
element = [{kind = "series", R = 0.02, L = 0.1, unit = "pu"}, {kind = "shunt", R = 0.01, C = 0.02, unit = "pu"}]
[[branch.branch]]
name = "far"
rating = 0.2
element = [{kind = "series", R = 0.04, L = 0.25, unit = "pu", tolerance = TOLERANCE}]
"""


def network(folder: Path, text: str = NETWORK, tolerance: float = 0.0) -> Collector:
    (folder / "network.toml").write_text(text.replace("TOLERANCE", str(tolerance)))
    return read_collector(folder / "network.toml", BASES)


def device(diagram: Diagram, values, p: float, q: float, v: float) -> np.ndarray:
    """Admittance of one device at its own terminals."""
    model = symbolic_model(
        wire(diagram, ibrid.VOCABULARY), equilibrium="exact", power_node="pcc", omega_0=OMEGA_0
    )
    theta = np.array([values.get(one.name, one.typical) for one in model.parameters])
    return admittance(model, theta, (p, q, v), 2 * np.pi * FREQUENCY)


def nodal(op: OperatingPoint, diagrams, values) -> tuple[np.ndarray, np.ndarray]:
    """The network above by its matrix of nodes (pcc, bus, feeder, near, middle, far), devices as
    injections; the voltages at rest by Newton from the power that every device feeds in, the
    admittance by eliminating all nodes but the PCC.
    """
    lines = [
        (0, 1, 0.005, 0.06),
        (1, 2, 0.02, 0.05),
        (1, 3, 0.01, 0.03),
        (2, 4, 0.02, 0.1),
        (2, 5, 0.04, 0.25),
    ]
    at, ratings = (3, 4, 5), (0.5, 0.3, 0.2)

    def matrix(s: complex) -> np.ndarray:
        whole = np.zeros((6, 6, 2, 2), dtype=complex)
        for a, b, r, x in lines:
            y = np.linalg.inv(r * I + x * (s * I + J))
            for i, j, sign in ((a, a, 1), (b, b, 1), (a, b, -1), (b, a, -1)):
                whole[i, j] += sign * y
        whole[4, 4] += np.linalg.inv(0.01 * I + np.linalg.inv(0.02 * (s * I + J)))
        return whole.transpose(0, 2, 1, 3).reshape(12, 12)

    def imbalance(z: np.ndarray) -> np.ndarray:
        """z : voltages of the five inner nodes, then the current into each device's node."""
        v, i = z[:10], z[10:].reshape(3, 2)
        injected = np.zeros((6, 2))
        injected[list(at)] = i
        flow = matrix(0.0).real @ np.concatenate([[op.v, 0.0], v]) - injected.ravel()
        out = -flow[:2]  # into the grid
        bus, feeder, near, middle = v.reshape(5, 2)[:4]
        into = {}
        for name, (a, b), (r, x) in (
            ("plant", (bus, [op.v, 0.0]), (0.005, 0.06)),
            ("near", (near, bus), (0.01, 0.03)),
            ("middle", (middle, feeder), (0.02, 0.1)),
        ):
            into[name] = np.linalg.solve(r * I + x * J, np.asarray(a) - np.asarray(b))
        halves = into["near"] - 0.5 * into["plant"], into["middle"] - 0.6 * 0.5 * into["plant"]
        return np.concatenate([flow[2:], out - [op.p, -op.q], *halves])

    found = root(imbalance, np.concatenate([np.tile([op.v, 0.0], 5), np.zeros(6)]), tol=1e-13)
    assert np.abs(found.fun).max() < 1e-11
    devices = []
    for node, i, rating, diagram, own in zip(
        at, found.x[10:].reshape(3, 2), ratings, diagrams, values, strict=True
    ):
        v = found.x[2 * node - 2 : 2 * node] @ [1, 1j]
        power = v * np.conj(i @ [1, 1j]) / rating
        angle = np.angle(v)
        turn = np.cos(angle) * I + np.sin(angle) * J
        devices.append(
            rating * turn @ device(diagram, own, power.real, power.imag, abs(v)) @ turn.T
        )
    answers = []
    for k, frequency in enumerate(FREQUENCY):
        whole = matrix(1j * frequency / 60)
        for node, one in zip(at, devices, strict=True):
            whole[2 * node : 2 * node + 2, 2 * node : 2 * node + 2] -= one[k]
        inner = np.linalg.solve(whole[2:, 2:], whole[2:, :2])
        answers.append(-(whole[:2, :2] - whole[:2, 2:] @ inner))
    return np.array(answers), found.x


def measured(seed: int, diagrams, values, noise_db: float = 50) -> Sweep:
    points = [PointSweep(op, FREQUENCY, nodal(op, diagrams, values)[0]) for op in POINTS]
    return ibrid.add_noise(
        Sweep(tuple(points), 60.0, "pcc"), noise_db, rng=np.random.default_rng(seed)
    )


@pytest.fixture(scope="module")
def record() -> Record:
    """Of one device, from a sweep of it alone at 50 dB."""
    points = [
        PointSweep(op, FREQUENCY, device(textbook("gfl_exact"), {}, op.p, op.q, op.v))
        for op in POINTS
    ]
    alone = ibrid.add_noise(Sweep(tuple(points), 60.0, "pcc"), 50, rng=np.random.default_rng(1))
    return ibrid.evaluate(textbook("gfl_exact"), alone)


def values_of(record: Record) -> dict[str, float]:
    return dict(next(iter(record.parameters.values())))


def changed(record: Record, name: str, factor: float) -> dict[str, float]:
    values = values_of(record)
    return values | {name: factor * values[name]}


@pytest.mark.slow
def test_one_device_behind_elements_is_the_diagram_behind_a_port(record: Record, tmp_path: Path):
    line = "[[element]]\nkind = 'transformer'\nR = 0.01\nL = 0.08\nratio = 1.05\nunit = 'pu'\n"
    text = line + "[[element]]\nkind = 'shunt'\nC = 0.05\nunit = 'pu'\n"
    alone = network(tmp_path, text)
    points = [PointSweep(op, FREQUENCY, np.ones((20, 2, 2), dtype=complex)) for op in POINTS]
    plant = plant_model(record, alone, points)
    diagram = record.diagram.behind(read_port(tmp_path / "network.toml", BASES))
    for op, found in zip(POINTS, plant.responses(plant.x), strict=True):
        np.testing.assert_allclose(
            found, device(diagram, values_of(record), op.p, op.q, op.v), rtol=1e-9, atol=1e-12
        )


@pytest.mark.slow
def test_a_tree_of_devices_is_what_nodal_analysis_says_where_one_differs_too(
    record: Record, tmp_path: Path
):
    text = NETWORK.replace('name = "middle"', 'name = "middle"\nvalues = {"pll.kI_pll" = 700.0}')
    collector = network(tmp_path, text)
    values = values_of(record)
    points = [PointSweep(op, FREQUENCY, np.ones((20, 2, 2), dtype=complex)) for op in POINTS]
    plant = plant_model(record, collector, points)
    for op, found in zip(POINTS, plant.responses(plant.x), strict=True):
        expected, _ = nodal(
            op, [record.diagram] * 3, [values, values | {"pll.kI_pll": 700.0}, values]
        )
        np.testing.assert_allclose(found, expected, rtol=1e-8, atol=1e-10)


def test_slopes_are_differences_those_of_the_network_too(record: Record, tmp_path: Path):
    collector = network(tmp_path, tolerance=0.05)
    points = [PointSweep(op, FREQUENCY, np.ones((20, 2, 2), dtype=complex)) for op in POINTS]
    plant = plant_model(record, collector, points)
    assert plant.names[-2:] == ("far.port.1.R", "far.port.1.L")
    slopes = plant.jacobians(plant.x)

    for j in (*range(0, len(plant.x), 5), len(plant.x) - 2, len(plant.x) - 1):
        step = 1e-6 * (np.arange(len(plant.x)) == j)
        ends = plant.responses(plant.x + step), plant.responses(plant.x - step)
        for high, low, slope in zip(*ends, slopes, strict=True):
            error = np.linalg.norm((high - low) / 2e-6 - slope[..., j])
            assert error < 1e-5 * np.linalg.norm(slope[..., j]) + 1e-7, plant.names[j]


@pytest.mark.slow
def test_a_plant_that_did_not_change_is_the_same(record: Record, tmp_path: Path):
    collector = network(tmp_path, tolerance=0.05)
    data = measured(3, [record.diagram] * 3, [values_of(record)] * 3)
    assert drift(record, data, collector).verdict == "same"


@pytest.mark.nightly
@each_of("place, parameter, factor", [("near", "pll.kI_pll", 0.5), ("far", "plant.C_F", 1.3)])
def test_the_device_that_changed_is_named_with_its_factor(
    record: Record, tmp_path: Path, place, parameter, factor
):
    """Behind a line that is known to 5 %, too."""
    own = [values_of(record)] * 3
    own[("near", "middle", "far").index(place)] = changed(record, parameter, factor)
    found = drift(record, measured(4, [record.diagram] * 3, own), network(tmp_path, tolerance=0.05))
    assert (found.verdict, found.device) == ("parameters", place), found.sentence
    (change,) = found.changed
    assert change.parameter == f"{place}.{parameter}"
    assert change.after / change.before == pytest.approx(factor, rel=0.1)


@pytest.mark.nightly
def test_a_change_of_all_devices_is_told_from_that_of_one(record: Record, tmp_path: Path):
    found = drift(
        record,
        measured(5, [record.diagram] * 3, [changed(record, "pll.kP_pll", 1.3)] * 3),
        network(tmp_path),
    )
    assert [one.parameter for one in found.changed] == ["all.pll.kP_pll"]
    assert found.device is None


@pytest.mark.nightly
def test_which_of_devices_in_the_same_place_changed_is_left_open(record: Record, tmp_path: Path):
    """They are behind equal lines: no measurement at the PCC can tell one from the other."""
    line = '[[branch]]\nelement = [{kind = "series", R = 0.01, L = 0.1, unit = "pu"}]\n'
    collector = network(tmp_path, 2 * line)
    assert [one.name for one in collector.devices] == ["device_1", "device_2"]
    points = [PointSweep(op, FREQUENCY, np.ones((20, 2, 2), dtype=complex)) for op in POINTS]
    plant = plant_model(record, collector, points)
    x = plant.x + np.log(0.5) * (np.array(plant.names) == "device_1.pll.kI_pll")
    answers = [
        replace(one, admittance=y) for one, y in zip(points, plant.responses(x), strict=True)
    ]
    data = ibrid.add_noise(Sweep(tuple(answers), 60.0, "pcc"), 50, rng=np.random.default_rng(6))
    (change,) = drift(record, data, collector).changed
    assert {change.parameter, *change.alike} >= {"device_1.pll.kI_pll", "device_2.pll.kI_pll"}


@pytest.mark.nightly
def test_a_block_that_one_device_has_and_the_others_have_not_is_named_with_the_device(
    record: Record, tmp_path: Path
):
    diagrams, values = [record.diagram, textbook("gfl_delay"), record.diagram], values_of(record)
    found = drift(record, measured(7, diagrams, [values] * 3), network(tmp_path))
    assert (found.verdict, found.device) == ("structure", "middle"), found.sentence
    assert found.gap is not None
    assert "delay" in found.gap.effects[0].id
    Draft202012Validator(schema("drift")).validate(
        json.loads(json.dumps(found.plain(), allow_nan=False))
    )


@pytest.mark.slow
def test_the_equivalent_of_equal_devices_is_exact_and_of_others_says_how_far_it_is(
    record: Record, tmp_path: Path
):
    cable = (
        '{kind = "series", R = 0.04, L = 0.2, unit = "pu"}, {kind = "shunt", R = 0.1, C = 0.01, '
        'unit = "pu"}'
    )
    line = f"[[branch]]\nelement = [{cable}]\n"
    equal = predict_plant(record, network(tmp_path, 4 * line), ["p=0.8,q=0.1"], FREQUENCY)
    assert equal.equivalent.nrmse < 1e-12
    assert equal.equivalent.elements[-1].values["C"] == pytest.approx(0.04)
    collector = network(tmp_path)
    unequal = predict_plant(record, collector, ["p=1,q=0.3", "p=0.4,q=0"], FREQUENCY)
    single = plant_model(record, equivalent_of(collector), unequal.sweep.points)
    error = [
        a - b.admittance
        for a, b in zip(single.responses(single.x), unequal.sweep.points, strict=True)
    ]
    whole = [one.admittance for one in unequal.sweep.points]
    assert unequal.equivalent.nrmse == pytest.approx(np.linalg.norm(error) / np.linalg.norm(whole))
    assert unequal.equivalent.nrmse > 1e-3
    own = {
        name: rests["a"].p for name, rests in unequal.devices.items()
    }  # as the record calls p=1,q=0.3
    assert unequal.warnings == ()
    assert "far works at" in predict_plant(record, collector, ["p=5,q=0"], FREQUENCY).warnings[-1]
    assert 1.0 < own["near"] < own["far"] < 1.1  # each with the losses on its way


@pytest.mark.slow
@each_of("ratings", [(1.0,), (0.6, 0.4)])
def test_devices_with_nothing_before_the_pcc_are_one_device(tmp_path, record, ratings):
    text = "".join(
        f'[[branch]]\nname = "d{k}"\nrating = {rating}\n' for k, rating in enumerate(ratings)
    )
    (point,) = predict_plant(
        record, network(tmp_path, text), ["p=0.8,q=0.1"], FREQUENCY
    ).sweep.points
    alone = ibrid.predict(record, "p=0.8,q=0.1", FREQUENCY).admittance
    assert point.admittance == pytest.approx(alone, rel=1e-6, abs=1e-9)


def test_bands_of_a_plant_hold_for_devices_that_are_as_the_record_knows_them(
    record: Record, tmp_path: Path
):
    """The plant of the true values, against what a record from noisy data says; sigma is of the
    noise in the record alone.
    """
    collector = network(tmp_path)
    found = predict_plant(record, collector, [f"p={op.p},q={op.q}" for op in POINTS], FREQUENCY)
    inside = []
    for op, point in zip(POINTS, found.sweep.points, strict=True):
        truth, _ = nodal(op, [record.diagram] * 3, [{}] * 3)
        inside.append(np.abs(truth - point.admittance) < 3 * np.asarray(point.sigma))
    assert np.mean(inside) > 0.8


WRONG = {
    "no table": ("[[branch]]\nelement = 3\n", "must have elements"),
    "twice": ("[[branch]]\nname='a'\n[[branch]]\nname='a'\n", "change it"),
    "all": ("[[branch]]\nname='all'\n", "change it"),
    "a name": ("[[branch]]\nname='a.b'\n", "letters, digits"),
    "some ratings": ("[[branch]]\nrating=0.5\n[[branch]]\n", "of all, or of none"),
    "some shares": ("[[branch]]\nshare=0.5\n[[branch]]\n", "of all, or of none"),
    "too much": (
        "[[branch]]\nshare=0.9\n[[branch]]\nshare=0.9\n",
        "device_1 and device_2 of the port sum to 1.8",
    ),
    "one of three": (
        "[[branch]]\nshare=0.33\n[[branch]]\nshare=0.33\n[[branch]]\nshare=0.3\n",
        "sum to 0.96",
    ),
    "too little": ("[[branch]]\nshare=0.55\n", "sum to 0.55"),
    "VA": ("[[branch]]\nrating=2.5e6\n", "not in VA"),
    "negative": ("[[branch]]\nrating=-1\n", "positive"),
    "key": ("[[branch]]\nratng=1\n", "ratng"),
    "inside": ("power_node='inside'\n[[branch]]\n", "power_node"),
    "values": ("[[branch]]\nvalues=3\n", "must be a table"),
    "SI": (
        "[[branch]]\nelement=[{kind='series',R=1,L=1e-3,unit='si'}]\n",
        "s_base_va and v_base_v",
    ),
    "many": ("[[branch]]\n" * 101, "at most 100"),
    "a node's": ("[[branch]]\nrating=1\n[[branch.branch]]\n", "of a device"),
    "no list": ("branch = 1\n", "write [[branch]]"),
}


@each_of("text, words", WRONG.values(), ids=WRONG)
def test_what_is_wrong_in_a_network_is_said_with_what_to_change(
    tmp_path: Path, text: str, words: str
):
    with pytest.raises(SweepError) as refused:
        network(tmp_path, text)
    assert words in str(refused.value)


def test_values_in_si_units_are_on_the_base_of_the_network_file_and_so_is_what_is_predicted(
    record: Record, tmp_path: Path
):
    head = "s_base_va=10e6\nv_base_v=20e3\nf0_hz=50\n"
    collector = network(
        tmp_path, f"{head}[[branch]]\nelement=[{{kind='series',R=0.4,L=1e-3,unit='si'}}]\n"
    )
    numbers = {name: value for name, (value, _) in collector.numbers.items()}
    assert numbers == pytest.approx(
        {"device_1.port.1.R": 0.01, "device_1.port.1.L": 2 * np.pi * 50 * 1e-3 / 40}
    )
    sweep = predict_plant(record, collector, ["p=1,q=0.3"], FREQUENCY[:2]).sweep
    assert (sweep.s_base_va, sweep.v_base_v) == (10e6, 20e3)


@pytest.mark.slow
def test_the_commands_predict_a_plant_compare_it_and_refuse_it_where_one_device_is_meant(
    record: Record, tmp_path: Path, capsys: pytest.CaptureFixture[str]
):
    network(tmp_path)
    (tmp_path / "record.json").write_text(json.dumps(record.to_json()))
    at = {
        name: str(tmp_path / name)
        for name in ("record.json", "network.toml", "plant.csv", "single.toml")
    }
    words = [
        "predict",
        at["record.json"],
        "--op",
        "p=1,q=0.3",
        "--port",
        at["network.toml"],
        "--out",
        at["plant.csv"],
    ]
    assert main([*words, "--equivalent", at["single.toml"], "--freq", "5:5000:12"]) == 0
    assert "One device of rating 1" in capsys.readouterr().out
    assert len(read_port(tmp_path / "single.toml", BASES).elements) == 3
    assert (
        main(["drift", at["record.json"], at["plant.csv"], "--port", at["network.toml"], "--json"])
        == 0
    )
    assert json.loads(capsys.readouterr().out)["verdict"] == "same"
    assert main(["evaluate", "gfl_exact", at["plant.csv"], "--port", at["network.toml"]]) == 2
    assert "has branches, so several devices" in capsys.readouterr().err
    assert (
        main(
            [
                "predict",
                at["record.json"],
                "--op",
                "p=1,q=0",
                "--equivalent",
                "x.toml",
                "--out",
                at["plant.csv"],
            ]
        )
        == 2
    )
    assert "give its network with --port" in capsys.readouterr().err
    wrong = network(tmp_path, '[[branch]]\nvalues = {"pll.kX" = 1.0}\n')
    with pytest.raises(IbridError, match="has values of pll"):
        predict_plant(record, wrong, ["p=1,q=0"], FREQUENCY)
    for value in ("-0.2", "0.0", "1e308"):
        impossible = network(tmp_path, f'[[branch]]\nvalues = {{"plant.L_F" = {value}}}\n')
        with pytest.raises(IbridError, match=r"must lie in the box|number"):
            predict_plant(record, impossible, ["p=1,q=0"], FREQUENCY)
