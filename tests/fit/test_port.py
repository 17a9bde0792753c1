"""A port between PCC and filter: exact against a chain of matrices, fitted within its tolerances,
refused in a sentence.
"""

import json
from dataclasses import replace

import numpy as np
import pytest
from collecting import each_of
from scipy.optimize import root

import ibrid
from ibrid.assembly.modules_at import module_matrices
from ibrid.assembly.numeric import closed_loop
from ibrid.assembly.symbolic import symbolic_model
from ibrid.cli import main
from ibrid.errors import SweepError
from ibrid.evaluation.evaluate import record_at
from ibrid.fit import kernel
from ibrid.fit.problem import Problem
from ibrid.measurement.formats.csv_file import write_sweep
from ibrid.measurement.sweeps.noise import add_noise
from ibrid.measurement.sweeps.sweep import OperatingPoint, PointSweep, Sweep
from ibrid.modules.vocabulary import VOCABULARY
from ibrid.report.block_diagrams.block_graph import block_graph
from ibrid.structure.diagrams.diagram import Diagram
from ibrid.structure.diagrams.library import textbook
from ibrid.structure.network.outside import Outside, PortElement
from ibrid.structure.network.port_file import read_port
from ibrid.structure.reading.parameters import parameter_table, parameters_at
from ibrid.structure.reading.wiring import wire

OMEGA_0 = 2 * np.pi * 60
I, J = np.eye(2), np.array([[0.0, -1.0], [1.0, 0.0]])
POINT = (0.8, 0.2, 1.02)
FREQUENCY = np.geomspace(3, 5000, 25)
SERIES, INNER = (
    PortElement("series", {"R": 0.01, "L": 0.08}),
    PortElement("series", {"R": 0.005, "L": 0.1}),
)
PORTS = {
    "shunt": (PortElement("shunt", {"R": 0.3, "C": 0.05}),),
    "series": (SERIES,),
    "tee": (SERIES, PortElement("shunt", {"R": 0.02, "C": 0.05}), INNER),
    "transformer": (
        PortElement("transformer", {"R": 0.01, "L": 0.08, "ratio": 1.05}),
        PortElement("shunt", {"R": 0.1, "C": 0.05}),
        PortElement("shunt", {"R": 0.01, "C": 0.02}),
        PortElement("series", {"R": 0.005, "L": 0.0}),
    ),
}


def admittance(diagram: Diagram, point, power_node: str) -> np.ndarray:
    model = symbolic_model(
        wire(diagram, VOCABULARY), equilibrium="exact", power_node=power_node, omega_0=OMEGA_0
    )
    theta = np.array([one.typical for one in model.parameters])
    return kernel.admittance(model, theta, point, 2 * np.pi * FREQUENCY)


def chain(elements, s: complex) -> np.ndarray:
    """(v, i) at the PCC -> (v, i) at the device, 4 x 4, with every element's own law."""
    whole = np.eye(4, dtype=complex)
    for element in elements:
        values, zero = element.values, 0 * I
        if element.kind == "shunt":
            branch = values["R"] * I + np.linalg.inv(values["C"] / OMEGA_0 * (s * I + OMEGA_0 * J))
            step = np.block([[I, zero], [np.linalg.inv(branch), I]])
        else:
            step = np.block(
                [[I, values["R"] * I + values["L"] / OMEGA_0 * (s * I + OMEGA_0 * J)], [zero, I]]
            )
            if (ratio := values.get("ratio")) is not None:
                step = np.block([[I / ratio, zero], [zero, I * ratio]]) @ step
        whole = step @ whole
    return whole


def by_chain(diagram: Diagram, elements, inside: bool, power_node: str) -> np.ndarray:
    """The admittance at the PCC from the device alone, its operating point by a root finder."""
    at_rest = chain(elements, 0.0).real
    typical = {
        one.name: one.typical for one in parameter_table(wire(diagram, VOCABULARY), "exact").free
    }
    behind = inside and power_node == "capacitor" and "plant.L_g" in typical
    line = typical["plant.R_g"] * I + typical["plant.L_g"] * J if behind else 0 * I
    p, q, v = POINT

    def device(i: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        z = at_rest @ np.array([v, 0.0, *i])
        return z[:2], z[2:]

    def power(i: np.ndarray) -> np.ndarray:
        voltage, current = device(i) if inside else (np.array([v, 0.0]), i)
        voltage = voltage + line @ current
        return np.array([voltage @ current - p, voltage @ J @ current - q])

    voltage, current = device(root(power, [p / v, -q / v], tol=1e-12).x)
    node = voltage + line @ current
    size = float(np.linalg.norm(voltage))
    own = admittance(
        diagram, (node @ current, node @ J @ current, size), power_node if inside else "pcc"
    )
    turn = np.stack([voltage, J @ voltage], axis=1) / size
    result = []
    for frequency, device_y in zip(FREQUENCY, own, strict=True):
        y, whole = turn @ device_y @ turn.T, chain(elements, 2j * np.pi * frequency)
        result.append(
            np.linalg.solve(whole[2:, 2:] - y @ whole[:2, 2:], y @ whole[:2, :2] - whole[2:, :2])
        )
    return np.array(result)


@pytest.mark.slow
@each_of("name", ["gfl", "gfl_l_filter", "gfm_droop"])
@each_of("port", PORTS)
@each_of("inside", [False, True])
@each_of("power_node", ["capacitor", "pcc"])
def test_a_port_is_the_chain_of_its_elements_at_the_operating_point_behind_it(
    name, port, inside, power_node
):
    diagram, elements = textbook(name), PORTS[port]
    seen = admittance(diagram.behind(Outside(elements, inside)), POINT, power_node)
    expected = by_chain(diagram, elements, inside, power_node)
    assert np.abs(seen - expected).max() < 1e-11 * np.abs(expected).max()


@each_of("port", PORTS)
def test_the_state_space_behind_a_port_has_the_same_response(port):
    diagram = textbook("gfl_exact").behind(Outside(PORTS[port]))
    wiring = wire(diagram, VOCABULARY)
    table = parameter_table(wiring, "exact")
    values = {one.name: one.typical for one in table.free}
    physics = {"equilibrium": "exact", "power_node": "pcc", "omega_0": OMEGA_0}
    system = closed_loop(
        wiring, module_matrices(wiring, parameters_at(wiring, table, values), POINT, **physics)
    )
    response = np.moveaxis(system(2j * np.pi * FREQUENCY), -1, 0)
    np.testing.assert_allclose(
        response, admittance(diagram, POINT, "pcc"), rtol=0, atol=1e-9 * np.abs(response).max()
    )


def measured(port: Outside, noise_db: float) -> tuple[Sweep, dict[str, float]]:
    """A textbook inverter behind a port, and its values."""
    points = [(1.0, 0.3), (0.5, -0.3)]
    diagram = textbook("gfl_l_filter").behind(port)
    model = symbolic_model(
        wire(diagram, VOCABULARY), equilibrium="exact", power_node="pcc", omega_0=OMEGA_0
    )
    empty = [
        PointSweep(
            OperatingPoint(f"p={p:g}", p, q),
            FREQUENCY,
            np.ones((len(FREQUENCY), 2, 2), dtype=complex),
        )
        for p, q in points
    ]
    problem = Problem(model, empty)
    values = {one.name: one.parameter.typical for one in problem.numbers}
    responses = problem.responses(problem.coordinates.to_x(np.array(list(values.values()))))
    sweep = Sweep(
        tuple(replace(point, admittance=y) for point, y in zip(empty, responses, strict=True)),
        power_node="pcc",
        s_base_va=1e4,
        v_base_v=400.0,
    )
    return add_noise(sweep, noise_db, rng=np.random.default_rng(3)), values


TRUE = Outside(
    (
        PortElement("series", {"R": 0.0042, "L": 0.063}),
        PortElement("shunt", {"R": 0.18, "C": 0.045}),
    )
)
FILE = """power_node = "outside"
[[element]]
kind = "series"
R = 0.064
L = 2.55e-3
unit = "si"
tolerance = 0.1
[[element]]
kind = "shunt"
R = 0.2
C = 0.04
unit = "pu"
tolerance = 0.2
"""


@pytest.fixture(scope="module")
def fitted(tmp_path_factory):
    folder = tmp_path_factory.mktemp("port")
    sweep, values = measured(TRUE, 60)
    write_sweep(sweep, folder / "data.csv")
    (folder / "port.toml").write_text(FILE)
    arguments = [
        str(folder / "data.csv"),
        "--port",
        str(folder / "port.toml"),
        "--json",
        str(folder / "record.json"),
    ]
    assert main(["evaluate", "gfl_l_filter", *arguments]) == 0
    return folder, values, json.loads((folder / "record.json").read_text())


@pytest.mark.slow
def test_values_of_the_port_and_of_the_device_are_found_within_the_tolerances(fitted):
    _, values, record = fitted
    found = record["parameters"]["p=1"]
    assert record["nrmse"] < 0.0012  # 60 dB
    assert found["port.1.L"] == pytest.approx(0.063, rel=0.01)
    assert found["port.2.C"] == pytest.approx(0.045, rel=0.01)
    assert found["pll.kP_pll"] == pytest.approx(values["pll.kP_pll"], rel=0.02)


@pytest.mark.slow
def test_a_record_with_a_port_predicts_exports_and_is_drawn_with_it(fitted, capsys):
    folder, values, _ = fitted
    record = ibrid.read_record(folder / "record.json")
    diagram = textbook("gfl_l_filter").behind(TRUE)
    model = symbolic_model(
        wire(diagram, VOCABULARY), equilibrium="exact", power_node="pcc", omega_0=OMEGA_0
    )
    theta = np.array([values[one.name] for one in model.parameters])
    truth = kernel.admittance(model, theta, (0.2, 0.1, 1.0), 2 * np.pi * FREQUENCY)
    out = folder / "predicted.csv"
    assert (
        main(
            [
                "predict",
                str(folder / "record.json"),
                "--op",
                "p=0.2,q=0.1",
                "--freq",
                "3:5000:25",
                "--out",
                str(out),
            ]
        )
        == 0
    )
    predicted = ibrid.read_sweep(out).points[0].admittance
    assert np.linalg.norm(predicted - truth) < 0.01 * np.linalg.norm(truth)
    system = record.state_space("p=1")
    assert "port.2.v_C_d" in system.state_labels
    shapes = {node.name: node.kind for node in block_graph(record.diagram, VOCABULARY).nodes}
    assert shapes["port"] == "series, shunt"
    export = [
        "export",
        str(folder / "record.json"),
        "--op",
        "p=1",
        "--format",
        "modelica",
        "--nonlinear",
    ]
    assert main([*export, "--out", str(folder / "device.mo")]) == 0
    assert "put the port's elements into the network" in capsys.readouterr().err


@pytest.mark.nightly
def test_search_and_gap_see_the_port(fitted):
    folder, values, _ = fitted
    data, port, run = (
        str(folder / "data.csv"),
        ["--port", str(folder / "port.toml")],
        folder / "run",
    )
    assert main(["search", data, *port, "--budget", "4", "--out", str(run)]) == 0
    best = json.loads((run / "best.json").read_text())
    assert best["grade"] == "explains"
    assert best["parameters"]["p=1"]["port.1.L"] == pytest.approx(0.063, rel=0.02)
    lacking = ibrid.program_text(textbook("gfl_l_filter")).replace(
        '    g.connect("plant.e", "plant.u_r")\n', ""
    )
    (folder / "lacking.py").write_text(lacking)
    (folder / "values.json").write_text(json.dumps(values))
    gap = ["gap", str(folder / "lacking.py"), data, *port, "--values", str(folder / "values.json")]
    assert main([*gap, "--out", str(folder / "gap")]) == 0
    found = json.loads((folder / "gap" / "gap.json").read_text())
    assert [found["verdict"], found["effects"][0]["id"]] == ["named", "voltage_feedforward"]


@pytest.mark.slow
def test_stability_counts_the_port_to_the_device(fitted):
    folder, values, _ = fitted
    told = [
        "stability",
        str(folder / "record.json"),
        "--scr",
        "1.5:8:6",
        "--op",
        "p=1",
        "--json",
        str(folder / "grid.json"),
    ]
    assert main(told) == 0
    true = record_at(
        textbook("gfl_l_filter").behind(TRUE), ibrid.read_sweep(folder / "data.csv"), values
    )
    (exact,) = ibrid.stability(true, np.geomspace(1.5, 8, 6), op="p=1").points
    (point,) = json.loads((folder / "grid.json").read_text())["points"]
    poles = [case["modes"][0]["pole"][0] for case in point["grids"]]
    assert poles == pytest.approx([case.modes[0].pole.real for case in exact.cases], rel=0.05)


BAD = {
    "kind": (
        "[[element]]\nkind = 'capacitor'\nunit = 'pu'\n",
        "must be one of series, shunt, transformer",
    ),
    "unit": ("[[element]]\nkind = 'series'\nR = 0\nL = 0.1\n", 'must have unit = "si" or "pu"'),
    "henry per unit": (
        "[[element]]\nkind = 'shunt'\nR = 15.0\nC = 6.39e-9\nunit = 'pu'\n",
        "see that its unit is 'pu'",
    ),
    "per unit in henry": (
        "[[element]]\nkind = 'series'\nR = 0.01\nL = 0.1\nunit = 'si'\n",
        "(ohm, H, F)",
    ),
    "word": ("[[element]]\nkind = 'series'\nR = 0.01\nX = 0.1\nunit = 'pu'\n", "has 'X'"),
    "lacking": (
        "[[element]]\nkind = 'series'\nR = 0.01\nunit = 'pu'\n",
        "must be a number, found nothing",
    ),
    "tolerance": (
        "[[element]]\nkind = 'series'\nL = 0.1\nunit = 'pu'\ntolerance = 5\n",
        "must be 0 to 1",
    ),
    "node": (
        "power_node = 'pcc'\n[[element]]\nkind = 'series'\nL = 0.1\nunit = 'pu'\n",
        '"outside" or "inside"',
    ),
    "empty": ("", "must have elements"),
    "text": ("[[element]\n", "is no TOML"),
}


@each_of("name", BAD)
def test_a_bad_port_is_one_sentence_that_says_what_to_change(name, tmp_path):
    text, words = BAD[name]
    (tmp_path / "port.toml").write_text(text)
    with pytest.raises(SweepError) as error:
        read_port(tmp_path / "port.toml", measured(TRUE, 60)[0])
    assert words in str(error.value)


def test_a_port_that_cannot_carry_the_power_is_said(tmp_path, capsys):
    write_sweep(measured(TRUE, 60)[0], tmp_path / "data.csv")
    heavy = "power_node = 'inside'\n[[element]]\nkind = 'series'\nL = 1.5\nunit = 'pu'\n"
    (tmp_path / "port.toml").write_text(heavy)
    assert (
        main(
            [
                "evaluate",
                "gfl_l_filter",
                str(tmp_path / "data.csv"),
                "--port",
                str(tmp_path / "port.toml"),
            ]
        )
        == 1
    )
    assert "it cannot carry the p, q of the data" in capsys.readouterr().err
