"""The angle of the measuring frame: read where it rests, put right by the file's key, never seen in
correct data.
"""

from dataclasses import replace

import numpy as np
import pytest
from collecting import each_of
from ibrid_bench.recipes import recipes

import ibrid
from ibrid.cli import main
from ibrid.errors import SweepError
from ibrid.measurement import OperatingPoint, PointSweep, Sweep, add_noise, check_conventions
from ibrid.measurement.conventions.frame_angle import MISTAKES, frame_reading, turned_frame
from ibrid.measurement.conventions.labels import Convention
from ibrid.measurement.conventions.rotation import half_turn, rotation, straightened
from ibrid.measurement.formats.csv_file import write_sweep
from ibrid.measurement.sweeps.noise import estimate, estimate_point
from ibrid.plants.published import PLANTS
from ibrid.plants.sweeping import sweep as sweep_of

POINTS = ((1.0, 0.3), (0.6, -0.3), (0.8, 0.1))
T, SAME = np.diag([1.0, -1.0]), np.eye(2)


def constant_power(p: float, q: float, frequency: np.ndarray, slow_hz: float) -> PointSweep:
    """Y of a device whose angle rests at once, and whose magnitude follows below `slow_hz`: the
    second column is that of the angle law, the first one changes from that of constant current to
    that of constant power.
    """
    part = 1 / (1 + 1j * frequency / slow_hz)
    first = part[:, None] * np.array([-p, q])
    second = np.broadcast_to([q, p], first.shape)
    return PointSweep(
        OperatingPoint(f"p={p:g}", p, q), frequency, np.stack([first, second], axis=2)
    )


def device(slow_hz: float = 3.0) -> Sweep:
    frequency = np.geomspace(1.0, 40.0, 20)
    return Sweep(
        tuple(constant_power(p, q, frequency, slow_hz) for p, q in POINTS), power_node="pcc"
    )


def turned(
    sweep: Sweep, degrees: tuple[float, ...], sign: int = 1, mirror: np.ndarray = SAME
) -> Sweep:
    points = [
        straightened(point, -np.radians(angle))
        for point, angle in zip(sweep.points, degrees, strict=False)
    ]
    written = [replace(one, admittance=sign * mirror @ one.admittance @ mirror) for one in points]
    return replace(sweep, points=tuple(written))


@pytest.mark.slow
@each_of("degrees", [-80.0, -45.0, 20.0, 60.0, 89.0])
@each_of("slow_hz", [0.3, 3.0, 1e3])
def test_the_null_vector_of_the_angle_law_reads_the_angle(degrees, slow_hz):
    (point, *_) = turned(device(slow_hz), (degrees,) * 3).points
    reading = frame_reading(point.frequency, point.admittance, point.op, estimate_point(point))
    assert reading is not None
    assert abs(half_turn(reading.angle - np.radians(degrees))) < 1e-6


@pytest.mark.slow
@each_of("noise_db", [None, 50, 40])
@each_of("degrees", [(45.0,) * 3, (-70.0,) * 3, (17.0, 40.0, -30.0)])
def test_a_turned_frame_is_said_with_what_to_write(noise_db, degrees):
    sweep = turned(device(), degrees)
    sweep = (
        sweep
        if noise_db is None
        else add_noise(sweep, noise_db, rng=np.random.default_rng(0), record_sigma=True)
    )
    frame = turned_frame(sweep, estimate(sweep))
    assert frame is not None
    wanted = degrees[:1] if len(set(degrees)) == 1 else degrees
    np.testing.assert_allclose(np.degrees(frame.angles), wanted, atol=2)
    (said,) = check_conventions(sweep).warnings
    assert "write # frame_deg: " in said
    assert len(said.split("# frame_deg: ")[1].split(", ")) == len(wanted)


def test_the_side_of_q_and_the_direction_of_the_current_are_said_with_the_angle():
    sweep = sweep_of(PLANTS["gfl_l_filter"], None, np.geomspace(2.0, 5000.0, 30))
    for sign, mirror, words in ((-1, np.eye(2), "# current: in"), (1, T, "# q_axis: lags")):
        (said,) = check_conventions(turned(sweep, (50.0,) * 9, sign, mirror)).warnings
        assert words in said
        assert "# frame_deg: 50 " in said


def test_at_constant_power_the_other_current_in_a_frame_a_quarter_turn_on_is_said_too():
    """Identity: -R(a) Y(0) R(-a) is R(a + 90) Y(0) R(-a - 90) where Y(0) = -[[p, -q], [-q, -p]]."""
    (said,) = check_conventions(turned(device(1e3), (-60.0,) * 3, -1)).warnings
    assert "write # frame_deg: 30; or # frame_deg: -60 and # current: in" in said


def test_p_and_q_exchanged_or_reversed_are_no_turned_frame():
    sweep = device(1e3)
    for mistake in MISTAKES:
        wrong = replace(
            sweep, points=tuple(replace(point, op=mistake(point.op)) for point in sweep.points)
        )
        assert turned_frame(wrong, estimate(wrong)) is None


@pytest.mark.slow
def test_correct_data_of_every_inverter_show_no_turned_frame():
    for benchmark in recipes():
        for lowest, noise_db in ((0.05, None), (1.0, 60), (4.0, 40)):
            sweep = sweep_of(
                benchmark.plant, None, np.geomspace(lowest, 5000.0, 24), noise_db=noise_db
            )
            assert turned_frame(sweep, estimate(sweep)) is None, (benchmark.name, lowest)


def written(sweep: Sweep, folder, *keys: str):
    """A file of numbers as a scan tool has them, with header lines."""
    path = folder / "scan.csv"
    write_sweep(sweep, path)
    path.write_text("".join(f"# {key}\n" for key in keys) + path.read_text())
    return path


def test_the_key_turns_all_operating_points_or_each_by_its_own_angle(tmp_path):
    """Identity: what was turned by R(a) reads as it was, with its noise and its repeats."""
    clean = device()
    runs = [
        add_noise(clean, 50, rng=np.random.default_rng(seed), record_sigma=False)
        for seed in range(3)
    ]
    repeats = [
        replace(point, repeats=np.array([run.points[k].admittance for run in runs]))
        for k, point in enumerate(clean.points)
    ]
    sweep = replace(
        clean, points=tuple(replace(one, admittance=one.repeats.mean(axis=0)) for one in repeats)
    )
    for degrees, key in (((30.0,) * 3, "30"), ((12.0, 30.0, -75.0), "12, 30, -75")):
        read = ibrid.read_sweep(written(turned(sweep, degrees), tmp_path, f"frame_deg: {key}"))
        for point, wanted in zip(read.points, sweep.points, strict=True):
            np.testing.assert_allclose(point.admittance, wanted.admittance, atol=1e-12)
            np.testing.assert_allclose(point.repeats, wanted.repeats, atol=1e-12)
    with pytest.raises(SweepError, match="2 numbers for 3 operating points"):
        ibrid.read_sweep(written(sweep, tmp_path, "frame_deg: 12, 30"))
    with pytest.raises(SweepError, match="frame_deg must be a finite number"):
        ibrid.read_sweep(written(sweep, tmp_path, "frame_deg: left"))


def test_the_side_of_q_is_put_right_before_the_angle(tmp_path):
    sweep = device()
    scan = turned(sweep, (50.0,) * 3, mirror=T)
    read = ibrid.read_sweep(written(scan, tmp_path, "frame_deg: 50", "q_axis: lags"))
    np.testing.assert_allclose(read.points[0].admittance, sweep.points[0].admittance, atol=1e-12)


def test_a_frame_by_operating_point_is_written_back_as_it_was_found():
    sweep, angles = device(), (("p=1", 0.3), ("p=0.6", -1.2), ("p=0.8", 0.9))
    convention = Convention(angles=angles)
    scan = turned(sweep, tuple(np.degrees([angle for _, angle in angles])))
    for point, wanted in zip(convention.undone(scan).points, sweep.points, strict=True):
        np.testing.assert_allclose(point.admittance, wanted.admittance, atol=1e-12)
        again = convention.written(point.admittance, point.op.name)
        turn = rotation(dict(angles)[point.op.name])
        np.testing.assert_allclose(again, turn @ wanted.admittance @ turn.T, atol=1e-12)
    assert (
        Convention.told([{"id": name, **told} for name, told in convention.ids.items()], scan)
        == convention
    )
    assert convention.remedy.startswith("Write # frame_deg: 17.2, -68.8, 51.6 ")


def test_import_asks_for_the_angle_that_the_lowest_frequencies_show(tmp_path, capsys):
    sweep = sweep_of(PLANTS["gfl_l_filter"], None, np.geomspace(2.0, 5000.0, 30))
    scan = turned(sweep, (50.0,) * 9)
    point = scan.points[0]
    names = "f,Ydd_re,Ydd_im,Ydq_re,Ydq_im,Yqd_re,Yqd_im,Yqq_re,Yqq_im"
    pairs = zip(point.frequency.tolist(), point.admittance, strict=True)
    rows = [",".join(map(repr, [f, *matrix.ravel().view(float).tolist()])) for f, matrix in pairs]
    (tmp_path / "table.csv").write_text("\n".join([names, *rows]))
    command = [
        "import",
        str(tmp_path / "table.csv"),
        "--out",
        str(tmp_path / "out.csv"),
        "--unit",
        "pu",
    ]
    command += ["--f0-hz", f"{sweep.f0_hz:g}", "--p", repr(point.op.p), "--q", repr(point.op.q)]
    assert main(command) == 2
    assert "--frame-deg 50 or --frame-deg 0" in capsys.readouterr().err
    assert main([*command, "--frame-deg", "50"]) == 0
    read = ibrid.read_sweep(tmp_path / "out.csv").points[0]
    np.testing.assert_allclose(read.admittance, sweep.points[0].admittance, atol=1e-9)
