"""Tables whose names, attributes or rows say more than their numbers: what would change the
meaning is refused or said.
"""

import numpy as np
import pytest

from ibrid.errors import SweepError
from ibrid.measurement.importing.importing import Imported, import_files

FREQUENCY = np.geomspace(1.0, 1000.0, 12)
MATRIX = np.array([[-1 + 0.25j, 0.125 - 0.5j], [0.0625, 1.5 - 2.375j]]) / (
    1 + FREQUENCY[:, None, None] / 100j
)
SAID = {"unit": "pu", "f0_hz": 60.0, "current": "out", "q_axis": "leads", "voltage_axis": "d"}
POWERS = {"p": 0.8, "q": 0.1}


def text(frequency="f", frame="dq", at=FREQUENCY, matrix=MATRIX) -> str:
    """A table with real and imaginary parts of four entries."""
    entries = {"dq": ("dd", "dq", "qd", "qq"), "pn": ("pp", "pn", "np", "nn")}[frame]
    names = [f"Y{entry}_{part}" for entry in entries for part in ("re", "im")]
    rows = [
        ",".join(map(repr, [float(f), *one.ravel().view(float).tolist()]))
        for f, one in zip(at, matrix, strict=True)
    ]
    return "\n".join([",".join([frequency, *names]), *rows]) + "\n"


def of_text(tmp_path, content: str, maps=(), **said) -> Imported:
    path = tmp_path / "table.csv"
    path.write_text(content)
    return import_files([path], maps, **SAID, **said)


@pytest.mark.parametrize("name", ["f_network", "network_frequency [Hz]", "omega_network"])
def test_dq_entries_at_frequencies_of_the_network_are_refused(tmp_path, name):
    with pytest.raises(SweepError, match="by its name that of the network") as refused:
        of_text(tmp_path, text(name, at=FREQUENCY + 60), **POWERS)
    option = str(refused.value).partition("--map ")[2].partition(" if")[0]
    taken = of_text(tmp_path, text(name, at=FREQUENCY + 60), [option], **POWERS).sweep
    turns = 2 * np.pi if option.startswith("omega") else 1.0
    assert np.allclose(taken.points[0].frequency, (FREQUENCY + 60) / turns)


def test_sequence_entries_at_frequencies_of_the_network_are_read(tmp_path):
    """Law: the dq frequency is that of the network less f0."""
    sweep = of_text(tmp_path, text("f_network", "pn", FREQUENCY + 60), **POWERS).sweep
    assert np.allclose(sweep.points[0].frequency, FREQUENCY)
