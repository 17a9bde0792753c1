"""Labels of data as data with uncertainty: a wrong one is named and put right, right ones are
believed, also by a search.
"""

import tomllib
from dataclasses import replace

import numpy as np
import pytest
from collecting import each_of

import ibrid
from ibrid.assembly.symbolic import symbolic_model
from ibrid.cli import main
from ibrid.errors import IbridError
from ibrid.fit.problem import Problem
from ibrid.fit.settings import FitSettings
from ibrid.measurement.conventions.labels import Convention
from ibrid.measurement.formats.csv_file import write_sweep
from ibrid.measurement.sweeps.noise import add_noise
from ibrid.measurement.sweeps.sweep import OperatingPoint, PointSweep, Sweep
from ibrid.modules.vocabulary import VOCABULARY
from ibrid.schemas import breach
from ibrid.structure.diagrams.library import textbook
from ibrid.structure.reading.wiring import wire

DEVICE, ROOT_2 = "gfl_l_filter", 2**0.5
LITTLE = FitSettings(starts=32, kept=4, kept_misfit=4, restarts=0, hops=0)
#: Id -> what the file says, over the truth.
WRONG = {
    "power_scale": Convention(power=1 / ROOT_2),
    "current_sign": Convention(sign=-1),
    "base_impedance": Convention(factor=2 / 3),
    "axes_exchanged": Convention(axes=-1),
    "frame_rotation": Convention(angles=(("p=1", 0.9), ("p=0.5", -0.3))),
}


@pytest.fixture(scope="module")
def sweep() -> Sweep:
    """A textbook inverter at typical values."""
    frequency = np.geomspace(3, 5000, 16)
    model = symbolic_model(
        wire(textbook(DEVICE), VOCABULARY),
        equilibrium="exact",
        power_node="pcc",
        omega_0=2 * np.pi * 60,
    )
    ones = np.ones((len(frequency), 2, 2), dtype=complex)
    empty = [
        PointSweep(OperatingPoint(f"p={p:g}", p, q), frequency, ones)
        for p, q in ((1.0, 0.3), (0.5, -0.3))
    ]
    problem = Problem(model, empty)
    x = problem.coordinates.to_x(np.array([one.parameter.typical for one in problem.numbers]))
    points = [
        replace(point, admittance=y) for point, y in zip(empty, problem.responses(x), strict=True)
    ]
    return add_noise(
        Sweep(tuple(points), power_node="pcc"), 50, rng=np.random.default_rng(1), record_sigma=True
    )


@pytest.mark.nightly
@each_of("wrong", WRONG)
def test_a_wrong_label_is_named_and_the_record_is_of_the_data_put_right(wrong: str, sweep: Sweep):
    written = WRONG[wrong].undone(sweep)
    record = ibrid.evaluate(textbook(DEVICE), written, labels="uncertain", settings=LITTLE)
    (told,) = record.labels
    assert wrong in (told["id"], *told["indistinguishable_from"])
    assert record.grade == "explains"
    assert Convention.told(record.labels, written).undone(written).points[0].op.p == pytest.approx(
        record.settings["operating_points"][sweep.names[0]]["p"]
    )
    assert breach(record.to_json(), "record") is None


@pytest.mark.nightly
def test_right_labels_are_believed_also_beside_a_diagram_that_lacks_something(sweep: Sweep):
    assert ibrid.evaluate(textbook(DEVICE), sweep, labels="uncertain", settings=LITTLE).labels == ()
    lacking = ibrid.evaluate(
        textbook("gfl_l_filter_delay"), sweep, labels="uncertain", settings=LITTLE
    )
    assert lacking.grade != "explains"
    assert lacking.labels == ()


@pytest.mark.nightly
def test_a_search_puts_a_wrong_label_right_and_says_so_in_its_answer(sweep: Sweep, tmp_path):
    written = Convention(power=1 / ROOT_2).undone(sweep)
    found = ibrid.search(
        written,
        tmp_path / "run",
        start=textbook(DEVICE),
        budget=1,
        labels="uncertain",
        progress="silent",
    )
    assert found.best is not None
    assert found.best.labels[0]["id"] == "power_scale"
    assert "peak and rms" in found.best.labels[0]["sentence"]
    assert found.best.grade == "explains"
    assert tomllib.loads((tmp_path / "run" / "run.toml").read_text())["labels"] == ["power_scale"]


@pytest.mark.nightly
def test_the_command_says_what_to_write(sweep: Sweep, tmp_path, capsys):
    write_sweep(Convention(power=1 / ROOT_2).undone(sweep), tmp_path / "data.csv")
    assert main(["evaluate", DEVICE, str(tmp_path / "data.csv"), "--labels", "uncertain"]) == 0
    assert "Divide the columns p and q by 1.414" in capsys.readouterr().out.replace("\n    ", " ")
    assert main(["evaluate", DEVICE, str(tmp_path / "data.csv"), "--labels", "wrong"]) == 2
    assert "labels must be one of exact, uncertain" in capsys.readouterr().err


def test_uncertain_labels_need_shared_parameters(sweep: Sweep):
    with pytest.raises(IbridError, match="drop labels"):
        ibrid.evaluate(textbook(DEVICE), sweep, labels="uncertain", parameters="per-op")


def test_one_angle_of_all_operating_points_comes_before_one_for_each(sweep: Sweep):
    written = Convention(angle=-0.9).undone(sweep)
    (told,) = ibrid.evaluate(textbook(DEVICE), written, labels="uncertain", settings=LITTLE).labels
    assert (told["id"], "angles" in told) == ("frame_rotation", False)
    assert told["angle"] == pytest.approx(0.9, abs=0.01)
