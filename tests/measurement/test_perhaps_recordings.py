"""A recording whose columns have no known names is refused as one, with the forms that may be told;
a sweep without its frequency is refused as a sweep.
"""

from pathlib import Path

import numpy as np
import pytest
from recording_makes import BASE, F0, P, Q, current, times, voltage

import ibrid
from ibrid import cli

TIME = times(1000.0)
POLAR = [abs(voltage(TIME)), np.rad2deg(np.angle(voltage(TIME)))]
POLAR += [abs(current(TIME)), np.rad2deg(np.angle(current(TIME)))]
CLOCK = [f"2025-03-14T10:00:{5 + t:09.6f}" for t in TIME]
FORMS = ("va=2", "vd=2", "v_mag=2,v_ang=3,i_mag=4,i_ang=5", "v=2,p=3,q=4")


def table(folder: Path, names: str, first: list[str]) -> Path:
    """Phasors behind a first column, and a frequency where a fifth name stands for it."""
    columns = [[f"{x:.9f}" for x in column] for column in POLAR]
    columns += [[f"{F0:g}"] * len(TIME)] * (names.count(",") - 4)
    rows = zip(first, *columns, strict=True)
    path = folder / "rec.csv"
    path.write_text("\n".join([names, *map(",".join, rows)]), encoding="utf-8")
    return path


@pytest.mark.parametrize(
    ("names", "first"),
    [
        ("Timestamp,V1 Magn (V),V1 Angl,I1 Magn (A),I1 Angl,Frequency (Hz)", CLOCK),
        ("When,A,B,C,D", CLOCK),
        ("second,Volt,B,Ampere,D", [f"{t:.4f}" for t in TIME]),
        ("X,Volt,B,Ampere,D", [f"{t:.4f}" for t in TIME]),
        ("X,A,B,C,D", [f"{t:.4f}" for t in TIME]),
    ],
)
def test_a_recording_without_known_names_is_told_how_to_name_them(tmp_path, capsys, names, first):
    """The forms are those that --channels takes: told so, the file is read."""
    path = table(tmp_path, names, first)
    assert cli.main(["import", str(path), *BASE, "--out", str(tmp_path / "o.csv")]) != 0
    said = capsys.readouterr().err
    assert "probably a recording" in said
    assert all(form in said for form in FORMS)
    events = ibrid.read_events(
        path,
        channels="t=1,v_mag=2[pu],v_ang=3[deg],i_mag=4[pu],i_ang=5[deg]",
        window="none",
        base="10MVA,20kV",
        f0_hz=F0,
    )
    rest = events.records[0].rest
    assert np.allclose([rest.p, rest.q], [P, Q], atol=1e-4)


@pytest.mark.parametrize("names", ["Frequency (Hz),A,B,C,D", "X,p [kW],v [kV],C,D"])
def test_a_sweep_without_known_names_is_refused_as_a_sweep(tmp_path, capsys, names):
    """Frequencies on a logarithmic grid."""
    path = table(tmp_path, names, [f"{f:.5g}" for f in np.geomspace(1, 2000, len(TIME))])
    assert cli.main(["import", str(path), *BASE, "--out", str(tmp_path / "o.csv")]) != 0
    assert "recording" not in capsys.readouterr().err
