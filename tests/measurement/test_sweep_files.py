"""Sweep files: every convention arrives in ours, what is written is read again, and bad files get
one sentence.
"""

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from ibrid.errors import OperatingPointError, SweepError
from ibrid.measurement import (
    OperatingPoint,
    PointSweep,
    Sweep,
    add_noise,
    from_frd,
    from_responses,
    hardware_sweeps,
    merge,
    read_sweep,
    write_sweep,
    write_touchstone,
)
from ibrid.measurement.conventions.rotation import propagate

FREQUENCY = np.array([5.0, 50.0, 500.0, 5000.0])
ENTRIES = ("dd", "dq", "qd", "qq")
HEAD = "op,p,q,freq_hz,Ydd_re,Ydd_im,Ydq_re,Ydq_im,Yqd_re,Yqd_im,Yqq_re,Yqq_im"
ROW = "a,1,0.3,50,1,2,3,4,5,6,7,8"
T = np.diag([1.0, -1.0])


def matrices(count: int = 4, seed: int = 0) -> np.ndarray:
    rng = np.random.default_rng(seed)
    return rng.standard_normal((count, 2, 2)) + 1j * rng.standard_normal((count, 2, 2))


Y = matrices()


def table(
    values: np.ndarray, letter: str = "Y", entries: tuple[str, ...] = ENTRIES, header: str = ""
) -> str:
    names = [f"{letter}{entry}_{part}" for entry in entries for part in ("re", "im")]
    lines = [header.rstrip("\n")] if header else []
    lines.append(",".join(["op", "p", "q", "freq_hz", *names]))
    for frequency, matrix in zip(FREQUENCY, values, strict=True):
        parts = [repr(float(part)) for entry in matrix.ravel() for part in (entry.real, entry.imag)]
        lines.append(",".join(["a", "1", "0.3", repr(float(frequency)), *parts]))
    return "\n".join(lines) + "\n"


@pytest.fixture
def read(tmp_path):
    def reader(text: str | bytes, name: str = "scan.csv", **keys) -> Sweep:
        path = tmp_path / name
        path.write_bytes(text if isinstance(text, bytes) else text.encode())
        return read_sweep(path, **keys)

    return reader


def test_columns_arrive_as_written(read):
    sweep = read(
        table(
            Y,
            header="# f0_hz: 50\n# power_node: pcc\n# sampling_hz: 20000\n# measured on a Tuesday",
        )
    )
    assert (sweep.f0_hz, sweep.power_node, sweep.sampling_hz) == (50, "pcc", 20000)
    assert sweep.notes == ("measured on a Tuesday",)
    assert sweep.points[0].op == OperatingPoint("a", 1, 0.3)
    np.testing.assert_array_equal(sweep.points[0].frequency, FREQUENCY)
    np.testing.assert_array_equal(sweep.points[0].admittance, Y)
    assert sweep.omega_0 == pytest.approx(100 * np.pi)


def test_impedance_columns_are_inverted(read):
    np.testing.assert_allclose(
        read(table(np.linalg.inv(Y), "Z")).points[0].admittance, Y, rtol=1e-12
    )


@pytest.mark.parametrize(("letter", "unit"), [("Y", "S"), ("Z", "ohm")])
def test_physical_units_use_the_base(read, letter, unit):
    base = 400.0**2 / 1000.0
    values = Y / base if letter == "Y" else np.linalg.inv(Y) * base
    header = f"# unit: {unit}\n# s_base_va: 1000\n# v_base_v: 400"
    np.testing.assert_allclose(
        read(table(values, letter, header=header)).points[0].admittance, Y, rtol=1e-12
    )


def test_current_into_the_inverter_changes_the_sign(read):
    np.testing.assert_array_equal(read(table(-Y, header="# current: in")).points[0].admittance, Y)


def test_lagging_q_axis_is_mirrored(read):
    np.testing.assert_array_equal(
        read(table(T @ Y @ T, header="# q_axis: lags")).points[0].admittance, Y
    )


def test_sequence_columns_become_dq(read):
    # the transform as the literature prints it
    forward, backward = 0.5 * np.array([[1, 1j], [1, -1j]]), np.array([[1, 1], [-1j, 1j]])
    sweep = read(table(forward @ Y @ backward, entries=("pp", "pn", "np", "nn")))
    np.testing.assert_allclose(sweep.points[0].admittance, Y, rtol=1e-12)


def test_symmetric_inductance_has_no_sequence_coupling(read):
    # L s in the stationary frame is L (s + j w0) for p and L (s - j w0) for n, hence L s I + w0 L J
    # in dq
    s, reactance = 2j * np.pi * FREQUENCY, 0.15
    scaled = s / (2 * np.pi * 60)
    positive, negative = 1 / (reactance * (scaled + 1j)), 1 / (reactance * (scaled - 1j))
    zero = np.zeros_like(positive)
    sweep = read(
        table(
            np.array([[positive, zero], [zero, negative]]).transpose(2, 0, 1),
            entries=("pp", "pn", "np", "nn"),
        )
    )
    J = np.array([[0, -1], [1, 0]])
    expected = np.linalg.inv(reactance * (scaled[:, None, None] * np.eye(2) + J))
    np.testing.assert_allclose(sweep.points[0].admittance, expected, rtol=1e-12)


def test_keywords_win_over_the_file(read):
    np.testing.assert_array_equal(
        read(table(Y, header="# current: in"), current="out").points[0].admittance, Y
    )


def test_sigma_of_impedances_is_propagated_to_first_order(read):
    Z = np.linalg.inv(Y)
    sigma = 1e-4 * np.arange(1, 17).reshape(4, 2, 2)
    lines = table(Z, "Z").splitlines()
    lines[0] += "".join(f",sigma_{entry}" for entry in ENTRIES)
    lines[1:] = [
        line + "".join(f",{value!r}" for value in map(float, s.ravel()))
        for line, s in zip(lines[1:], sigma, strict=True)
    ]
    point = read("\n".join(lines)).points[0]
    rng = np.random.default_rng(0)
    errors = sigma * (
        rng.standard_normal((20000, 4, 2, 2)) + 1j * rng.standard_normal((20000, 4, 2, 2))
    )
    scatter = np.linalg.inv(Z + errors)
    # 20000 draws know a standard deviation to 0.5 %; the second order of 1e-3 errors is far smaller
    np.testing.assert_allclose(point.sigma, scatter.real.std(axis=0), rtol=0.03)
    np.testing.assert_allclose(point.sigma, scatter.imag.std(axis=0), rtol=0.03)


def test_one_sigma_column_means_all_entries(read):
    lines = table(Y).splitlines()
    text = "\n".join([lines[0] + ",sigma", *(line + ",0.01" for line in lines[1:])])
    np.testing.assert_array_equal(read(text).points[0].sigma, np.full((4, 2, 2), 0.01))


def test_sigma_of_single_runs_shrinks_with_repeats(read):
    lines = table(Y).splitlines()
    text = [
        lines[0] + ",repeat,sigma",
        *(f"{line},{run},0.01" for run in range(4) for line in lines[1:]),
    ]
    np.testing.assert_allclose(read("\n".join(text)).points[0].sigma, 0.005)


def test_repeats_become_mean_and_scatter(tmp_path):
    clean = Sweep((PointSweep(OperatingPoint("a", 1, 0), np.geomspace(5, 5000, 40), matrices(40)),))
    noisy = add_noise(clean, 40, rng=np.random.default_rng(1), repeats=5, record_sigma=False)
    write_sweep(noisy, tmp_path / "scan.csv")
    point = read_sweep(tmp_path / "scan.csv").points[0]
    np.testing.assert_array_equal(point.repeats, noisy.points[0].repeats)
    np.testing.assert_array_equal(point.admittance, noisy.points[0].repeats.mean(axis=0))
    norm = np.linalg.norm(clean.points[0].admittance, axis=(1, 2))[:, None, None]
    true = norm / (2 * np.sqrt(2)) * 1e-2 / np.sqrt(5)
    # 40 degrees of freedom each: 11 % per entry, four times that at the most
    assert np.abs(point.sigma / true - 1).max() < 0.5
    assert np.sqrt(np.mean((point.sigma / true) ** 2)) == pytest.approx(1, abs=0.05)


def test_two_repeats_leave_sigma_unknown(tmp_path):
    sweep = Sweep(
        (PointSweep(OperatingPoint("a", 1, 0), FREQUENCY, Y, repeats=np.array([Y, Y * 1.01])),)
    )
    write_sweep(sweep, tmp_path / "scan.csv")
    assert read_sweep(tmp_path / "scan.csv").points[0].sigma is None


def test_a_note_may_begin_with_a_word_that_is_a_key(read):
    notes = ("current sweep", "unit cells", "f0_hz unknown", "frame by frame")
    assert set(notes) <= set(read("".join(f"# {note}\n" for note in notes) + FIRST).notes)


def test_operating_points_may_have_different_grids(read):
    text = (
        f"{HEAD}\n{ROW}\n"
        + ROW.replace("a,1", "b,0.5").replace(",50,", ",70,")
        + "\n"
        + ROW.replace(",50,", ",20,")
    )
    sweep = read(text)
    assert sweep.names == ("a", "b")
    np.testing.assert_array_equal(sweep.point("a").frequency, [20, 50])
    np.testing.assert_array_equal(sweep.point("b").frequency, [70])
    assert sweep.only("b").names == sweep.without(["a"]).names == ("b",)
    with pytest.raises(OperatingPointError, match=r"did you mean|known are"):
        sweep.point("c")
    with pytest.raises(OperatingPointError, match="at least one operating point must remain"):
        sweep.without(["a", "b"])


def test_arrays_cannot_be_changed_afterwards():
    frequency = FREQUENCY.copy()
    point = PointSweep(OperatingPoint("a", 1, 0), frequency, Y)
    frequency[0] = 1.0
    assert point.frequency[0] == 5.0
    with pytest.raises(ValueError, match="read-only"):
        point.admittance[0] = 0


finite = st.floats(-1e6, 1e6, allow_subnormal=False).filter(lambda x: x == 0 or abs(x) > 1e-9)
powers = st.floats(-7.0, 7.0, allow_subnormal=False)  # what a device can have
names = st.text(min_size=1, max_size=12).filter(
    lambda s: s == s.strip() and s.isprintable() and s[0] != "#"
)


@st.composite
def sweeps(draw) -> Sweep:
    points = []
    for name in draw(st.lists(names, min_size=1, max_size=3, unique=True)):
        frequency = sorted(draw(st.sets(st.floats(1e-3, 1e5), min_size=1, max_size=4)))
        count = len(frequency)
        values = draw(st.lists(finite, min_size=8 * count, max_size=8 * count).filter(any))
        matrix = np.array(values).view(complex).reshape(count, 2, 2)
        sigma = np.abs(matrix) + 1.0 if draw(st.booleans()) else None
        amplitude = np.full(count, draw(finite)) if draw(st.booleans()) else None
        op = OperatingPoint(name, draw(powers), draw(powers), draw(st.sampled_from([1.0, 0.93])))
        points.append(PointSweep(op, np.array(frequency), matrix, sigma, None, amplitude))
    notes = draw(
        st.lists(
            st.sampled_from(["a note", "unit: ohm", "f0_hx: 3", "source: elsewhere"]), max_size=2
        )
    )
    base = draw(st.sampled_from([None, 1e3]))
    return Sweep(
        tuple(points), draw(st.sampled_from([50.0, 60.0, 399.9])), "pcc", base, base, tuple(notes)
    )


@pytest.mark.slow
@settings(max_examples=60, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(sweep=sweeps())
def test_what_is_written_is_read_again_to_the_last_digit(tmp_path, sweep):
    path = tmp_path / "scan.csv"
    write_sweep(sweep, path, header=["made by a test"])
    again = read_sweep(path)
    for field in ("names", "f0_hz", "power_node", "s_base_va", "v_base_v", "sampling_hz"):
        assert getattr(again, field) == getattr(sweep, field)
    assert len(again.notes) == 1 + len(sweep.notes)
    for ours, theirs in zip(sweep.points, again.points, strict=True):
        assert ours.op == theirs.op
        for field in ("frequency", "admittance", "sigma", "amplitude"):
            first, second = getattr(ours, field), getattr(theirs, field)
            assert (first is None) == (second is None)
            if first is not None:
                np.testing.assert_array_equal(first, second)


def test_writing_replaces_the_file_whole(tmp_path):
    path = tmp_path / "scan.csv"
    path.write_text("old")
    sweep = from_responses(FREQUENCY, Y, p=1, q=0)
    write_sweep(sweep, path)
    assert read_sweep(path).names == sweep.names
    assert [entry.name for entry in tmp_path.iterdir()] == ["scan.csv"]
    for bad in (tmp_path, tmp_path / "none" / "scan.csv"):
        with pytest.raises(SweepError, match=r"is a folder|there is no folder"):
            write_sweep(sweep, bad)


FIRST, SECOND = f"{HEAD}\n{ROW}", "\n" + ROW.replace(",50,", ",60,")


@pytest.mark.slow
@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("", "empty file"),
        ("\n \n", "empty file"),
        ("# f0_hz: 50\n# note", "only comments"),
        (HEAD, "only the column names in line 1"),
        ("nonsense", "line 1 must hold column names"),
        (HEAD.replace(",", ";") + "\n1;2", "replace the semicolons"),
        (HEAD.replace(",", "\t") + "\n1", "replace the tabs"),
        (FIRST.replace("freq_hz", "freq"), r"line 1: column freq_hz is missing; found 'freq'"),
        (
            FIRST.replace("Yqd_im", "Yqd_imag"),
            r"line 1: column Yqd_im is missing; found 'Yqd_imag'",
        ),
        (FIRST.replace(",Yqq_im", ""), "column Yqq_im is missing"),
        (FIRST.replace("op,p,q", "op,q"), "column p is missing"),
        ("op,p,q,freq_hz\na,1,0,5", "column Ydd_re is missing; the columns are"),
        (
            FIRST.replace(HEAD, HEAD + ",sigm") + ",1",
            "column 'sigm' is not known, did you mean sigma",
        ),
        (FIRST.replace(HEAD, HEAD + ",sigma_dd") + ",1", "the four columns"),
        (FIRST.replace(HEAD, HEAD + ",p") + ",1", "found it twice"),
        (FIRST + "\n" + ROW[:-2], "line 3 must have 12 values, one per column; found 11"),
        (FIRST + "\n" + ROW + ",9", "found 13, decimal commas"),
        (FIRST.replace(",8", ",eight"), "line 2: Yqq_im must be a finite number; found 'eight'"),
        (FIRST.replace(",8", ",nan"), "line 2: Yqq_im must be a finite number; found 'nan'"),
        (FIRST.replace(",8", ",inf"), "line 2: Yqq_im must be a finite number"),
        (FIRST.replace(",8", ","), "line 2: Yqq_im must be a finite number; found ''"),
        (FIRST.replace(",8", ",1_0"), "line 2: Yqq_im must be a finite number"),
        (FIRST.replace(",50,", ",0,"), "line 2: freq_hz must be positive"),
        (FIRST.replace(",50,", ",-5,"), "line 2: freq_hz must be positive"),
        (FIRST + "\n" + ROW, "line 3: 50 Hz must be there once .* in line 2 already"),
        (
            FIRST + SECOND.replace("0.3", "0.4"),
            "line 3: operating point a must keep one p, q, v; .* in line 2",
        ),
        (FIRST.replace("a,1", ",1"), "line 2: the name of an operating point must be printable"),
        (
            FIRST.replace(HEAD, HEAD + ",v") + ",0",
            "line 2: v of operating point a must be positive",
        ),
        (FIRST.replace(HEAD, HEAD + ",sigma") + ",0", "line 2: sigma must be positive"),
        (
            FIRST.replace(HEAD, HEAD + ",sigma") + ",0.1" + SECOND + ",",
            "line 3: sigma must be there in all rows",
        ),
        (
            FIRST.replace(HEAD, HEAD + ",amplitude") + ",0.1" + SECOND + ",",
            "line 3: amplitude must be there in all",
        ),
        (FIRST.replace(HEAD, HEAD + ",repeat") + ",0.5", "line 2: repeat must be a whole number"),
        (
            FIRST.replace(HEAD, HEAD + ",repeat") + ",1" + SECOND + ",2",
            "must have the same frequencies as repeat 1",
        ),
        (
            f"{HEAD}\na,1,0,50,0,0,0,0,0,0,0,0",
            "line 2: the admittance of operating point a must not be zero",
        ),
        (
            f"{HEAD.replace('Y', 'Z')}\na,1,0,50,1,0,1,0,1,0,1,0",
            "line 2: the impedance matrix must be invertible",
        ),
        (
            f"{HEAD.replace('Y', 'Z')}\na,1,0,50,0,0,0,0,0,0,0,0",
            "line 2: the impedance matrix must be invertible",
        ),
        (FIRST.replace(",8", ",1e300"), "line 2: admittance must be of a size that can be"),
        ("# f0_hx: 50\n" + FIRST, "line 1: f0_hx is not a key, did you mean f0_hz"),
        ("# f0: 50\n" + FIRST, "line 1: f0 is not a key"),
        ("# freq: 50\n" + FIRST, "line 1: freq is not a key, did you mean f0_hz"),
        ("# f0_hz 50\n" + FIRST, "line 1: a colon stands behind a key; write f0_hz: 50"),
        ("# current in\n" + FIRST, "line 1: a colon stands behind a key; write current: in"),
        ("# current_direction: in\n" + FIRST, "line 1: current_direction is not a key"),
        ("# Unit: S\n" + FIRST, "line 1: Unit is not a key"),
        ("# f0_hz: fifty\n" + FIRST, "line 1: f0_hz must be a finite number; found 'fifty'"),
        ("# f0_hz: -50\n" + FIRST, "line 1: f0_hz must be positive"),
        ("# f0_hz: 50\n# f0_hz: 60\n" + FIRST, "line 2: f0_hz must be given once"),
        ("# current: inward\n" + FIRST, "line 1: current must be out or in; found inward"),
        ("# unit: S\n" + FIRST, "unit: S must come with s_base_va and v_base_v"),
        ("# unit: ohm\n# s_base_va: 1\n# v_base_v: 1\n" + FIRST, "Y columns must be in S or pu"),
        (FIRST.replace("a,1", '"a,1'), "line 2 must be comma-separated values"),
        (b"\xff\xfe\x00\x01" + FIRST.encode(), "must be UTF-8 text; line 1"),
        (FIRST.encode() + b"\n\x00\x00", "line 3 holds a zero byte"),
    ],
)
def test_bad_file_gets_one_sentence(read, text, message):
    with pytest.raises(SweepError, match=message) as caught:
        read(text)
    assert "scan.csv" in str(caught.value)
    assert "\n" not in str(caught.value)


def test_absent_folder_and_huge_files_are_refused(tmp_path, monkeypatch):
    with pytest.raises(SweepError, match="must exist"):
        read_sweep(tmp_path / "nothing.csv")
    with pytest.raises(SweepError, match="found a folder"):
        read_sweep(tmp_path)
    with pytest.raises(SweepError, match=r"readable|exist"):
        read_sweep("a\0b.csv")
    (tmp_path / "long.csv").write_text(FIRST)
    monkeypatch.setattr("ibrid.measurement.formats.files.MAX_BYTES", 10)
    with pytest.raises(SweepError, match="must be at most"):
        read_sweep(tmp_path / "long.csv")


alphabet = st.sampled_from(
    [
        *"0123456789.,-+eE#:\"'\n\r\t ;",
        "nan",
        "inf",
        HEAD,
        ROW,
        "# unit: ",
        "\ufeff",
        "\u2028",
        "é",
        "\0",
    ]
)
hostile = st.one_of(
    st.lists(alphabet, max_size=60).map("".join),
    st.tuples(
        st.sampled_from(["", FIRST, FIRST + SECOND, "f a_d a_q\n", "# Hz Y RI R 1\n"]),
        st.text(max_size=80),
    ).map("".join),
)


@pytest.mark.slow
@settings(max_examples=300, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(text=hostile, name=st.sampled_from(["x.csv", "x.txt", "x.s2p"]))
def test_hostile_text_gives_a_sweep_or_one_sentence(tmp_path, text, name):
    path = tmp_path / name
    path.write_bytes(text.encode())
    try:
        assert isinstance(
            read_sweep(path, p=1, q=0) if name.endswith("2p") else read_sweep(path), Sweep
        )
    except SweepError as reason:
        said = str(reason)
    else:
        said = ""
    assert "\n" not in said


@pytest.mark.slow
@settings(max_examples=150, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(
    content=st.binary(max_size=400),
    name=st.sampled_from(["x.mat", "x.csv", "x.s2p"]),
    start=st.sampled_from([b"", b"MATLAB 5.0"]),
)
def test_hostile_bytes_give_a_sentence(tmp_path, content, name, start):
    path = tmp_path / name
    path.write_bytes(start + content)
    with pytest.raises(SweepError):
        read_sweep(path)


def test_frd_of_python_control_is_read():
    import control

    frd = control.frd(np.moveaxis(Y, 0, -1), 2 * np.pi * FREQUENCY)
    point = from_frd(frd, p=1, q=0.3, f0_hz=50, op="full").points[0]
    np.testing.assert_allclose(point.frequency, FREQUENCY, rtol=1e-14)
    np.testing.assert_array_equal(point.admittance, Y)
    with pytest.raises(SweepError, match="two inputs and two outputs"):
        from_frd(control.frd([1, 2], [1, 2]), p=1, q=0)
    with pytest.raises(SweepError, match="python-control FRD; found list"):
        from_frd([], p=1, q=0)


def test_responses_may_have_the_frequency_first_or_last():
    for response in (Y, np.moveaxis(Y, 0, -1)):
        np.testing.assert_array_equal(
            from_responses(FREQUENCY, response, p=1, q=0).points[0].admittance, Y
        )
    backwards = from_responses(FREQUENCY[::-1], np.linalg.inv(Y[::-1]), p=1, q=0, impedance=True)
    np.testing.assert_allclose(backwards.points[0].admittance, Y, rtol=1e-12)
    with pytest.raises(SweepError, match=r"must have shape \(2, 2, 4\) or \(4, 2, 2\)"):
        from_responses(FREQUENCY, Y[:3], p=1, q=0)
    with pytest.raises(
        SweepError, match=r"powernode is not something to say .* did you mean power_node"
    ):
        from_responses(FREQUENCY, Y, p=1, q=0, powernode="pcc")


def test_complex_frequencies_are_refused():
    with pytest.raises(SweepError, match="frequencies must be real numbers; found complex ones"):
        from_responses(FREQUENCY + 1j, Y, p=1, q=0)


def test_files_of_one_inverter_are_merged():
    first, second = (from_responses(FREQUENCY, Y, p=1, q=q, op=f"q={q}") for q in (0.3, -0.3))
    assert merge([first, second]).names == ("q=0.3", "q=-0.3")
    with pytest.raises(SweepError, match="agree on f0_hz"):
        merge([first, from_responses(FREQUENCY, Y, p=1, q=0, f0_hz=50)])
    with pytest.raises(SweepError, match="different names"):
        merge([first, first])


@pytest.mark.slow
@pytest.mark.parametrize("last", [True, False])
def test_mat_file_with_arrays_is_read(tmp_path, last):
    from scipy.io import savemat

    path = tmp_path / "scan.mat"
    savemat(
        path,
        {
            "w": 2 * np.pi * FREQUENCY,
            "Y": np.moveaxis(Y, 0, -1) if last else Y,
            "p": 1,
            "q": 0.3,
            "f0_hz": 50,
        },
    )
    sweep = read_sweep(path)
    assert (sweep.names, sweep.f0_hz, sweep.points[0].op.q) == (("scan",), 50, 0.3)
    np.testing.assert_array_equal(sweep.points[0].admittance, Y)
    np.testing.assert_allclose(sweep.points[0].frequency, FREQUENCY, rtol=1e-14)


@pytest.mark.slow
def test_mat_file_takes_what_it_lacks_from_the_sidecar_and_from_keywords(tmp_path):
    from scipy.io import savemat

    path = tmp_path / "scan.mat"
    savemat(path, {"frequency": FREQUENCY, "Z": np.moveaxis(np.linalg.inv(Y), 0, -1)})
    with pytest.raises(SweepError, match=r"steady state p and q .* p and q missing"):
        read_sweep(path)
    (tmp_path / "scan.mat.meta").write_text("p: 0.5\n# q: 0.1\ncurrent: in\n")
    sweep = read_sweep(path, q=0.2, op="half")
    assert sweep.points[0].op == OperatingPoint("half", 0.5, 0.2)
    np.testing.assert_allclose(sweep.points[0].admittance, -Y, rtol=1e-12)


@pytest.mark.nightly
@pytest.mark.parametrize(
    ("variables", "message"),
    [
        ({"Y": np.moveaxis(Y, 0, -1)}, "must hold w .* or frequency"),
        ({"w": FREQUENCY}, "one variable Y"),
        ({"w": FREQUENCY, "Y": Y[:3]}, r"Y must have shape \(2, 2, 4\)"),
        ({"w": FREQUENCY, "frequency": FREQUENCY, "Y": Y}, "w must be 2 pi times frequency"),
        ({"w": FREQUENCY, "Y": "text"}, "must be a full numeric array"),
        ({"w": FREQUENCY, "Y": Y, "p": [1, 2]}, "variable p must be a single number"),
        ({"w": FREQUENCY, "Y": Y, "p": 1 + 1j}, r"p must be a finite number; found '\(1\+1j\)'"),
        ({"w": FREQUENCY + 1j, "Y": Y}, r"variable w must hold real numbers; found \(5\+1j\)"),
        (
            {"frequency": FREQUENCY, "FrequencyUnit": "furlong", "Y": Y},
            "must be Hz, kHz, .* rpm; found 'furlong'",
        ),
        ({"w": -FREQUENCY, "Y": Y}, "frequencies must be positive"),
        ({"w": FREQUENCY * 0 + 1, "Y": Y}, "each frequency must be there once"),
        ({"w": FREQUENCY, "Y": Y * np.nan}, "finite numbers"),
    ],
)
def test_bad_mat_file_gets_one_sentence(tmp_path, variables, message):
    from scipy.io import savemat

    savemat(tmp_path / "scan.mat", {"p": 1, "q": 0, **variables})
    with pytest.raises(SweepError, match=message):
        read_sweep(tmp_path / "scan.mat")


def test_mat_files_of_version_7_3_are_named(read):
    with pytest.raises(SweepError, match=r"found 7\.3"):
        read(b"MATLAB 7.3 MAT-file".ljust(512) + b"\x89HDF\r\n\x1a\n" + bytes(100), "scan.mat")


def polar(entry: complex, form: str) -> tuple[float, float]:
    if form == "RI":
        return entry.real, entry.imag
    size = abs(entry) if form == "MA" else 20 * np.log10(abs(entry))
    return float(size), float(np.angle(entry, deg=True))


@pytest.mark.parametrize("form", ["RI", "MA", "DB"])
@pytest.mark.parametrize(("unit", "hz"), [("Hz", 1.0), ("kHz", 1e3), ("MHz", 1e6), ("GHz", 1e9)])
def test_touchstone_rows_are_11_21_12_22(read, form, unit, hz):
    lines = [
        "! p: 1",
        "! q: -0.2",
        "! v: 1.02",
        "! f0_hz: 50",
        "! a note",
        f"# {unit} Y {form} R 1",
    ]
    for frequency, matrix in zip(FREQUENCY, Y, strict=True):
        numbers = [frequency / hz]
        for entry in (matrix[0, 0], matrix[1, 0], matrix[0, 1], matrix[1, 1]):
            numbers += polar(entry, form)
        lines.append(" ".join(repr(float(number)) for number in numbers) + " ! row")
    point = (sweep := read("\n".join(lines), "scan.s2p")).points[0]
    assert point.op == OperatingPoint("scan", 1, -0.2, 1.02)
    assert sweep.f0_hz == 50
    np.testing.assert_allclose(point.frequency, FREQUENCY, rtol=1e-12)
    np.testing.assert_allclose(point.admittance, Y, rtol=1e-10)


def test_touchstone_normalises_to_its_resistance(read):
    keys = {"p": 1, "q": 0, "s_base_va": 1000, "v_base_v": 100}
    admittance = read("# Hz Y RI R 50\n50 1 0 0 0 0 0 1 0", "scan.y2p", **keys).points[0].admittance
    # 1 / 50 S on 10 ohm
    np.testing.assert_allclose(admittance, [np.eye(2) * 0.2], atol=1e-15)
    impedance = read("# Hz Z RI R 50\n50 1 0 0 0 0 0 1 0", "scan.z2p", **keys).points[0].admittance
    np.testing.assert_allclose(impedance, [np.eye(2) * 0.2], atol=1e-15)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("50 1 0 0 0 0 0 1 0", "must have an option line"),
        ("# Hz G RI R 50\n50 1 0 0 0 0 0 1 0", "line 1: parameter must be Y, Z or S; found G"),
        ("# Hz Y RJ R 1\n50 1 0 0 0 0 0 1 0", "line 1: RJ is not a Touchstone option"),
        ("# Hz Y RI R\n50 1 0 0 0 0 0 1 0", "R must be a finite number"),
        ("# Hz Y RI R 1\n50 1 0", "line 2 must hold nine numbers"),
        ("# Hz Y RI R 1\n50 1 0 0 0 0 0 1 x", "line 2: value 9 must be a finite number"),
        ("# Hz Y RI R 1\n", "must hold rows of numbers"),
        (
            "# Hz kHz Y RI R 1\n",
            "line 1: the unit of frequency must be said once; found HZ and KHZ, leave one out",
        ),
        ("# Hz Y Z RI R 1\n", "the parameter must be said once; found Y and Z"),
        ("# Hz Y RI MA R 1\n", "the format must be said once; found RI and MA"),
        ("# Hz Y RI R 1 R 50\n", "the resistance must be said once; found R and R"),
        (
            "# Hz Y MA R 1\n50 1 0 0 0 0 0 1 -1e300",
            "line 2: an angle must be within 1e.06 degrees; found -1e.300, is it RI",
        ),
        ("# Hz Y RI R 1\n50 1 0 0 0 0 0 1 ٣", "line 2: value 9 must be a finite number"),
        ("[Version] 2.0\n# Hz Y RI R 1\n", "must be version 1"),
        ("# Hz Y DB R 1\n50 1e9 0 0 0 0 0 1 0", "finite numbers"),
    ],
)
def test_bad_touchstone_gets_one_sentence(read, text, message):
    with pytest.raises(SweepError, match=message):
        read(text, "scan.s2p", p=1, q=0)


def test_touchstone_that_we_write_is_read_again_here_and_by_scikit_rf(tmp_path):
    sweep = from_responses(FREQUENCY, Y, p=1, q=0.3, v=0.98, f0_hz=50, power_node="pcc", op="a b")
    path = tmp_path / "scan.s2p"
    write_touchstone(sweep, path, "a b")
    again = read_sweep(path)
    assert (again.points[0].op, again.f0_hz, again.power_node) == (sweep.points[0].op, 50, "pcc")
    np.testing.assert_array_equal(again.points[0].admittance, Y)
    rf = pytest.importorskip("skrf")
    np.testing.assert_allclose(rf.Network(str(path)).y, Y, rtol=1e-9)


@pytest.mark.parametrize(
    "style",
    ["({0.real:.18e}{0.imag:+.18e}j)", "{0.real!r}{0.imag:+}i", "( {0.real!r}{0.imag:+}j )"],
)
def test_ztool_text_is_siemens_into_a_terminal_with_lagging_q(read, style):
    base = 200e3**2 / 100e6
    rows = ["f\tPCC-1_d\tPCC-1_q"]
    for frequency, matrix in zip(FREQUENCY, -(T @ Y @ T) / base, strict=True):
        rows.append(
            "\t ".join(style.format(complex(value)) for value in (frequency, *matrix.ravel()))
        )
    keys = {
        "p": 0.99,
        "q": 0.07,
        "f0_hz": 50,
        "s_base_va": 100e6,
        "v_base_v": 200e3,
        "power_node": "pcc",
    }
    sweep = read("\n".join(rows), "case#Y_AC#PCC-1#.txt", **keys)
    assert sweep.names == ("case",)
    np.testing.assert_allclose(sweep.points[0].admittance, Y, rtol=1e-12)
    leading = "\n".join(["f\tdd\tdq\tqd\tqq", *rows[1:]])
    np.testing.assert_allclose(
        read(leading, "case_dq_leading.txt", **keys).points[0].admittance, T @ Y @ T, rtol=1e-12
    )


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("f\tA_dc\n1 2", "must name one AC terminal"),
        ("f\tA_d\tA_q\n", "must hold rows"),
        (
            "f\tA_d\tA_q\n1 2 3 4",
            "line 2 must hold the frequency and four complex numbers; found 4",
        ),
        ("f\tA_d\tA_q\n1 2 3 4 x", "line 2: value 5 must be a finite complex number"),
        ("f\tA_d\tA_q\n(1+1j) 2 3 4 5", "the frequency must be real"),
        ("f\tA_d\tA_q\n(-1+0j) 2 3 4 5", "frequencies must be positive"),
        ("f\tA_d\tA_q\n1 2 3 4 5", "s_base_va is missing"),
    ],
)
def test_bad_ztool_text_gets_one_sentence(read, text, message):
    with pytest.raises(SweepError, match=message):
        read(text, "scan.txt", p=1, q=0)


def test_imtb_columns_are_impedances_of_the_device(read):
    names = [
        f"Zdut_dq_{k}_{part}" for k in ("11", "12", "21", "22") for part in ("re", "im", "abs")
    ]
    lines = [",".join(["f", *names])]
    for frequency, matrix in zip(FREQUENCY, np.linalg.inv(Y), strict=True):
        cells = [repr(float(part)) for z in matrix.ravel() for part in (z.real, z.imag, abs(z))]
        lines.append(",".join([repr(float(frequency)), *cells]))
    text, name = "\n".join(lines), "IM_Zdq_MIMO_case.csv"
    keys = {"p": 1, "q": 0, "s_base_va": 1, "v_base_v": 1}
    with pytest.raises(SweepError, match="must come with current"):
        read(text, name, **keys)
    np.testing.assert_allclose(
        read(text, name, current="in", **keys).points[0].admittance, -Y, rtol=1e-12
    )


def test_a_broken_spreadsheet_is_one_sentence(read):
    with pytest.raises(SweepError, match=r"scan.xlsx .*; found"):
        read(b"PK", "scan.xlsx")


def test_uncertainty_of_a_constant_transform_is_exact():
    left = right = np.array([[1, 1j], [1, -1j]]) / np.sqrt(2)
    np.testing.assert_allclose(propagate(left, np.ones((3, 2, 2)), right), 1.0)


@pytest.mark.skipif(not hardware_sweeps(), reason="the hardware sweeps are not on this machine")
def test_hardware_sweeps_are_read_in_our_convention():
    sweep = read_sweep(hardware_sweeps()["gti_pq"])
    assert (sweep.names, sweep.f0_hz, sweep.power_node) == (("absorbing", "delivering"), 400, "pcc")
    for point in sweep.points:
        assert len(point.frequency) == 100
        # p > 0 exported: the d axis delivers current against voltage, the high end is about 1 mH on
        # 9.92 ohm
        assert point.admittance[0, 0, 0].real < 0 < point.admittance[0, 1, 1].real
        inductance = (
            1
            / np.abs(point.admittance[-1, 0, 0])
            / (2 * np.pi * point.frequency[-1])
            * 99.593**2
            / 1000
        )
        assert inductance == pytest.approx(0.95e-3, rel=0.1)
