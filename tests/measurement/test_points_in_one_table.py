"""Several operating points in one table: told apart by whatever tells them apart, never averaged
unless file or user says so.
"""

import re
from pathlib import Path

import numpy as np
import pytest

from ibrid.errors import SweepError
from ibrid.measurement.importing.importing import Imported, import_files

F0 = 50.0
SAID = {"unit": "pu", "f0_hz": F0, "current": "out", "q_axis": "leads"}
PARTS = [f"Y{entry}_{part}" for entry in ("dd", "dq", "qd", "qq") for part in ("re", "im")]
POWERS = [(0.8, 0.1), (0.3, -0.2), (0.55, 0.25), (-0.4, 0.0)]


def admittance(p: float, q: float, hertz: np.ndarray) -> np.ndarray:
    """(n, 2, 2) of a device that controls p and q slowly and its current fast, with Y(0) = -[[p,
    -q], [-q, -p]].
    """
    s = 2j * np.pi * hertz[:, None, None]
    slow = -np.array([[p, -q], [-q, -p]]) / (1 + s / 60)
    filter_ = np.linalg.inv(
        0.15 * (s / (2 * np.pi * F0) * np.eye(2) + np.array([[0, -1], [1, 0]])) + 0.3 * np.eye(2)
    )
    return slow - s / (s + 3000) * filter_


HZ = np.geomspace(1.0, 1000.0, 12)


def table(
    path: Path, head: str, blocks: list[tuple[str, float, float, np.ndarray]], noise: float = 0.0
) -> Path:
    """Blocks of (cells before the frequency, p, q, frequencies)."""
    rng = np.random.default_rng(3)
    lines = [",".join([head, "f_Hz", *PARTS]).lstrip(",")]
    for cells, p, q, hertz in blocks:
        y = admittance(p, q, hertz)
        y = y * (1 + noise * (rng.standard_normal(y.shape) + 1j * rng.standard_normal(y.shape)))
        for f, row in zip(hertz, y.reshape(-1, 4).view(float), strict=True):
            lines.append(",".join([cells, repr(float(f)), *map(repr, row.tolist())]).lstrip(","))
    path.write_text("\n".join(lines))
    return path


def assert_points(
    imported: Imported, powers: list[tuple[float, float]], names: list[str] | None = None
) -> None:
    sweep = imported.answered()
    np.testing.assert_allclose([point.op.pqv[:2] for point in sweep.points], powers, atol=1e-12)
    assert names is None or list(sweep.names) == names
    for point in sweep.points:
        np.testing.assert_allclose(
            point.admittance, admittance(point.op.p, point.op.q, point.frequency), atol=1e-9
        )
        assert point.repeats is None


@pytest.mark.slow
@pytest.mark.parametrize(
    "head",
    [
        "case_name",
        "scenario",
        "id",
        "Lastfall",
        "escenario",
        "算例",
        "Operating Condition No.",
        "test_id",
        "工况编号",
    ],
)
@pytest.mark.parametrize("count", [2, 4])
def test_a_column_tells_points_apart_and_p_and_q_of_each_are_asked_for(
    tmp_path: Path, head: str, count: int
):
    names = [f"{'' if head == 'id' else 'c'}{k}" for k in range(1, count + 1)]
    blocks = [(name, *powers, HZ) for name, powers in zip(names, POWERS, strict=False)]
    path = table(tmp_path / "scan.csv", head, blocks)
    for said in ({}, {"p": 0.8, "q": 0.1}):
        asked = import_files([path], **SAID, **said).asked
        assert f"of each operating point: {', '.join(names)}" in asked
        read = dict(re.findall(r"--op (\w+):p=(\S+),q=", asked))
        assert [float(read[name]) for name in names] == pytest.approx(
            [p for p, _ in POWERS[:count]], rel=0.05
        )
    op = [f"{name}:p={p},q={q}" for name, (p, q) in zip(names, POWERS, strict=False)]
    assert_points(import_files([path], **SAID, op=op[::-1]), POWERS[:count], names)
    assert_points(
        import_files([path], **SAID, op=[text.partition(":")[2] for text in op]),
        POWERS[:count],
        names,
    )


@pytest.mark.parametrize("names", [("full", "half"), ("1", "2")])
def test_a_row_without_the_name_of_its_point_is_refused(tmp_path: Path, names: tuple[str, str]):
    blocks = [(f"{name},{p},{q}", p, q, HZ) for name, (p, q) in zip(names, POWERS, strict=False)]
    path = table(tmp_path / "scan.csv", "op,p,q", blocks)
    lines = path.read_text().splitlines()
    path.write_text("\n".join([*lines[:4], lines[4].removeprefix(names[0]), *lines[5:]]))
    with pytest.raises(
        SweepError, match="line 5: op must name an operating point; found an empty cell"
    ):
        import_files([path], **SAID)
    path.write_text(
        "\n".join(
            [lines[0], *(line.partition(",")[1] + line.partition(",")[2] for line in lines[1:])]
        )
    )
    assert_points(import_files([path], **SAID), POWERS[:2])


def test_runs_of_which_none_covers_another_are_asked_for(tmp_path: Path):
    blocks = [("a", 0.8, 0.1, HZ[:1] / 2), ("b", 0.3, -0.2, HZ), ("b", 0.3, -0.2, HZ)]
    path = table(tmp_path / "scan.csv", "case", blocks)
    assert "no frequencies of the first lie within another" in import_files([path], **SAID).asked


def test_rows_of_points_may_be_mixed(tmp_path: Path):
    blocks = [
        (name, p, q, HZ[k : k + 1])
        for k in range(len(HZ))
        for name, (p, q) in zip("ab", POWERS, strict=False)
    ]
    path = table(tmp_path / "scan.csv", "scenario", blocks)
    assert_points(
        import_files([path], **SAID, op=["a:p=0.8,q=0.1", "b:p=0.3,q=-0.2"]), POWERS[:2], ["a", "b"]
    )


@pytest.mark.parametrize(
    "grids", [(HZ, HZ), (HZ, HZ * 1.1), (HZ[::-1], HZ[::-1])], ids=["same", "other", "downwards"]
)
def test_frequencies_that_begin_anew_are_asked_about(
    tmp_path: Path, grids: tuple[np.ndarray, np.ndarray]
):
    blocks = [("", p, q, hertz) for (p, q), hertz in zip(POWERS, grids, strict=False)]
    path = table(tmp_path / "scan.csv", "", blocks)
    for said in ({}, {"p": 0.8, "q": 0.1}):
        asked = import_files([path], **SAID, **said).asked
        assert (
            "whether the 2 runs over the frequencies are operating points or repeats of one"
            in asked
        )
        assert asked.count("p and q, delivered") == 0
        assert "--op p=" in asked
    assert_points(import_files([path], **SAID, op=["p=0.8,q=0.1", "p=0.3,q=-0.2"]), POWERS[:2])
    assert_points(
        import_files([path], **SAID, op=["a:p=0.8,q=0.1", "b:p=0.3,q=-0.2"]), POWERS[:2], ["a", "b"]
    )


def test_repeats_are_taken_where_the_user_says_so(tmp_path: Path):
    path = table(tmp_path / "scan.csv", "", [("", *POWERS[0], HZ)] * 3, noise=1e-3)
    assert "whether the 3 runs" in import_files([path], **SAID, p=0.8, q=0.1).asked
    (point,) = import_files([path], **SAID, op="full", p=0.8, q=0.1).answered().points
    assert point.repeats is not None
    assert len(point.repeats) == 3
    same = import_files([path], **SAID, op=["p=0.8,q=0.1"] * 3).answered()
    assert [len(one.repeats) for one in same.points] == [3]


def test_a_case_column_with_real_repeats_in_it(tmp_path: Path):
    """The case alone leaves open what comes again; p and q of each case, or a column that numbers
    it, settle it.
    """
    blocks = [
        (f"{name},{run}", p, q, HZ)
        for name, (p, q) in zip("ab", POWERS, strict=False)
        for run in (1, 2, 3)
    ]
    op = ["a:p=0.8,q=0.1", "b:p=0.3,q=-0.2"]
    plain = table(
        tmp_path / "plain.csv", "case", [(c[:1], *rest) for c, *rest in blocks], noise=1e-3
    )
    asked = import_files([plain], **SAID).asked
    assert (
        "whether the 6 runs over the frequencies of a, b are operating points or repeats" in asked
    )
    assert "--op a:p=P,q=Q --op b:p=P,q=Q (repeats)" in asked
    numbered = table(tmp_path / "numbered.csv", "case,repeat", blocks, noise=1e-3)
    assert "of each operating point: a, b" in import_files([numbered], **SAID).asked
    for path in (plain, numbered):
        sweep = import_files([path], **SAID, op=op).answered()
        assert sweep.names == ("a", "b")
        assert [len(point.repeats) for point in sweep.points] == [3, 3]
    six = import_files([plain], **SAID, op=[f"p={0.1 * k:g},q=0" for k in range(1, 7)]).answered()
    assert [point.repeats for point in six.points] == [None] * 6


def test_a_column_of_another_name_is_told_and_found_by_the_names_of_the_points(tmp_path: Path):
    blocks = [(name, p, q, HZ) for name, (p, q) in zip(("voll", "halb"), POWERS, strict=False)]
    path = table(tmp_path / "scan.csv", "Leistungsstufe", blocks)
    asked = import_files([path], **SAID).asked
    assert "Leistungsstufe tells them apart" in asked
    assert "--op voll:p=0." in asked
    op = ["halb:p=0.3,q=-0.2", "voll:p=0.8,q=0.1"]
    assert_points(import_files([path], **SAID, op=op), POWERS[:2], ["voll", "halb"])
    with pytest.raises(SweepError, match="--op ganz: no operating point is called so"):
        import_files([path], **SAID, op=["ganz:p=0.3,q=-0.2", "voll:p=0.8,q=0.1"]).answered()


def test_names_that_say_p_and_q_need_no_question(tmp_path: Path):
    blocks = [(f"P{p}_Q{q}", p, q, HZ) for p, q in POWERS]
    assert_points(import_files([table(tmp_path / "scan.csv", "case", blocks)], **SAID), POWERS)


def test_what_numbers_rows_or_frequencies_names_no_point(tmp_path: Path):
    rows = [(f"{k},{k % 12}", *POWERS[0], HZ[k : k + 1]) for k in range(12)]
    path = table(tmp_path / "scan.csv", "id,point", rows)
    assert_points(import_files([path], **SAID, p=0.8, q=0.1), POWERS[:1])


def test_two_columns_name_a_point_together(tmp_path: Path):
    cells = ["weak,full", "weak,part", "strong,full", "strong,part"]
    blocks = [(cell, p, q, HZ) for cell, (p, q) in zip(cells, POWERS, strict=True)]
    path = table(tmp_path / "scan.csv", "scenario,case", blocks)
    assert "weak_full, weak_part, strong_full" in import_files([path], **SAID).asked
    op = [
        f"{cell.replace(',', '_')}:p={p},q={q}" for cell, (p, q) in zip(cells, POWERS, strict=True)
    ]
    assert_points(import_files([path], **SAID, op=op), POWERS)


def test_p_and_q_of_each_row_say_which_rows_are_repeats(tmp_path: Path):
    blocks = [(f"{p},{q}", p, q, HZ) for p, q in (*POWERS[:2], *POWERS[:2])]
    sweep = import_files([table(tmp_path / "scan.csv", "p,q", blocks)], **SAID).answered()
    assert [len(point.repeats) for point in sweep.points] == [2, 2]


def with_powers(
    path: Path, slips: dict[int, tuple[float, float]], powers: list[tuple[float, float]]
) -> Path:
    """Operating points of twelve rows each with p and q in every row, and rows with others by their
    line.
    """
    blocks = [(f"{p},{q}", p, q, HZ) for p, q in powers]
    lines = table(path, "p,q", blocks).read_text().splitlines()
    for line, (p, q) in slips.items():
        lines[line - 1] = ",".join([str(p), str(q), *lines[line - 1].split(",")[2:]])
    path.write_text("\n".join(lines))
    return path


@pytest.mark.parametrize(
    ("row", "words"),
    [
        ((0.08, 0.1), "a slip of the decimal point in p"),
        ((8.0, 0.1), "a slip of the decimal point in p"),
        ((-0.8, 0.1), "the other sign in p"),
        ((0.8, -0.1), "the other sign in q"),
        ((0.8, 0.01), "a slip of the decimal point in q"),
        ((0.6, 0.1), "a slip of p or q"),
    ],
)
@pytest.mark.parametrize("powers", [[(0.8, 0.1)], [(0.8, 0.1), (0.3, -0.2)]])
def test_a_slip_in_p_or_q_of_a_row_is_said_with_its_line(tmp_path: Path, row, words: str, powers):
    imported = import_files([with_powers(tmp_path / "scan.csv", {5: row}, powers)], **SAID)
    (remark,) = [one for one in imported.remarks if "lack" in one]
    assert "scan.csv line 5 is read as at" in remark
    assert "11 rows at p=0.8 q=0.1 lack" in remark
    assert f"is that {words}? Then correct it" in remark


def test_a_slip_that_makes_a_row_one_of_another_point_is_refused(tmp_path: Path):
    path = with_powers(tmp_path / "scan.csv", {12: (0.8, -0.1)}, [(0.8, 0.1), (0.8, -0.1)])
    with pytest.raises(
        SweepError, match=r"line 24: repeat 2 of operating point .* must have the same frequencies"
    ):
        import_files([path], **SAID)


@pytest.mark.parametrize("powers", [[(0.8, 0.1), (0.8, -0.1), (0.08, 0.1)], [(0.8, 0.1)]])
def test_points_at_all_frequencies_have_no_slips(tmp_path: Path, powers):
    imported = import_files([with_powers(tmp_path / "scan.csv", {}, powers)], **SAID)
    assert not [one for one in imported.remarks if "lack" in one]


def test_a_sweep_in_any_order_or_in_pieces_is_one_point(tmp_path: Path):
    order = np.random.default_rng(0).permutation(len(HZ))
    for number, grids in enumerate(
        ([HZ[order]], [HZ[6:], HZ[:6]], [HZ, np.array([3.3, 44.0])], [HZ[::-1]])
    ):
        path = table(tmp_path / f"{number}.csv", "", [("", *POWERS[0], hertz) for hertz in grids])
        assert_points(import_files([path], **SAID, p=0.8, q=0.1), POWERS[:1])


def test_powers_of_points_may_have_units(tmp_path: Path):
    path = table(
        tmp_path / "scan.csv",
        "case",
        [(name, *powers, HZ) for name, powers in zip("ab", POWERS, strict=False)],
    )
    op = ["a:p=80kW,q=10kvar", "b:p=30kW,q=-20kvar"]
    assert_points(import_files([path], **SAID, base="100kVA,400V", op=op), POWERS[:2])
    assert "the inverter's base" in import_files([path], **SAID, op=op).asked
    with pytest.raises(SweepError, match="--op is written NAME"):
        import_files([path], **SAID, op=["a:p=80V,q=0", "b:p=1,q=0"])


def test_files_of_one_point_each_are_answered_in_the_same_way(tmp_path: Path):
    paths = [
        table(tmp_path / f"{name}.csv", "", [("", *powers, HZ)])
        for name, powers in zip("ab", POWERS, strict=False)
    ]
    assert "--op a:p=0." in import_files(paths, **SAID).asked
    assert_points(
        import_files(paths, **SAID, op=["b:p=0.3,q=-0.2", "a:p=0.8,q=0.1"]), POWERS[:2], ["a", "b"]
    )


@pytest.mark.parametrize("head", ["run", "rep", "trial", "shot", "measurement_no"])
def test_a_column_of_runs_does_not_say_whether_they_are_repeats(tmp_path: Path, head: str):
    blocks = [(str(k), p, q, HZ) for k, (p, q) in enumerate(POWERS[:2], 1)]
    path = table(tmp_path / "scan.csv", head, blocks)
    asked = import_files([path], **SAID, p=0.8, q=0.1).asked
    assert "whether the 2 runs" in asked
    assert f"{head} tells them apart" in asked
    assert_points(import_files([path], **SAID, op=["1:p=0.8,q=0.1", "2:p=0.3,q=-0.2"]), POWERS[:2])


@pytest.mark.parametrize("head", ["repeat", "repetition"])
def test_repeats_that_differ_too_much_are_asked_about(tmp_path: Path, head: str):
    other = table(
        tmp_path / "other.csv", head, [(str(k), p, q, HZ) for k, (p, q) in enumerate(POWERS[:2], 1)]
    )
    assert "repeats of one (they differ by" in import_files([other], **SAID, p=0.8, q=0.1).asked
    assert_points(import_files([other], **SAID, op=["p=0.8,q=0.1", "p=0.3,q=-0.2"]), POWERS[:2])
    assert (
        len(
            import_files([other], [f"repeat={head}"], **SAID, p=0.8, q=0.1)
            .answered()
            .points[0]
            .repeats
        )
        == 2
    )
    same = table(
        tmp_path / "same.csv", head, [(str(k), *POWERS[0], HZ) for k in range(3)], noise=0.01
    )
    assert len(import_files([same], **SAID, p=0.8, q=0.1).answered().points[0].repeats) == 3


def test_powers_of_rows_that_differ_by_little_are_asked_about(tmp_path: Path):
    near = [(0.8, 0.1), (0.81, 0.1)]
    path = table(tmp_path / "scan.csv", "p,q", [(f"{p},{q}", p, q, HZ) for p, q in near])
    asked = import_files([path], **SAID).asked
    assert "whether the 2 runs" in asked
    assert "--op NAME (repeats of one)" in asked
    assert_points(import_files([path], **SAID, op=["p=.8,q=.1", "P=0.81,Q=0.1"]), near)
    assert len(import_files([path], **SAID, op="all").answered().points[0].repeats) == 2


def with_sign(path: Path, name: str, part: str) -> Path:
    """The same table with the other sign of one column."""
    head, *rows = path.read_text().splitlines()
    place = head.split(",").index(part)
    cells = [row.split(",") for row in rows]
    lines = [",".join([*row[:place], repr(-float(row[place])), *row[place + 1 :]]) for row in cells]
    (path.parent / name).write_text("\n".join([head, *lines]))
    return path.parent / name


def test_two_files_of_one_point_with_opposite_signs_are_refused(tmp_path: Path):
    """Averaged, the entry would be zero, while the median over the whole matrix hides it."""
    first = table(tmp_path / "a.csv", "case,p,q", [("full,0.8,0.1", *POWERS[0], HZ)], noise=1e-3)
    for part, words in (("Yqq_re", "the real part of qq"), ("Ydd_im", "the imaginary part of dd")):
        with pytest.raises(
            SweepError, match=f"lines 2 and 2 of .*a.csv.*b.csv.*found {words} of the opposite sign"
        ):
            import_files([first, with_sign(first, "b.csv", part)], **SAID)
    again = table(tmp_path / "c.csv", "case,p,q", [("full,0.8,0.1", *POWERS[0], HZ)], noise=1e-2)
    assert len(import_files([first, again], **SAID).answered().points[0].repeats) == 2
    twice = table(tmp_path / "d.csv", "case,p,q", [("full,0.8,0.1", *POWERS[1], HZ)])
    with pytest.raises(SweepError, match="apart in the median, give one another name"):
        import_files([first, twice], **SAID)


def test_runs_in_one_table_with_an_entry_of_opposite_signs_are_asked_about(tmp_path: Path):
    first = table(tmp_path / "a.csv", "p,q", [("0.8,0.1", *POWERS[0], HZ)])
    other = with_sign(first, "b.csv", "Yqq_re").read_text().splitlines()[1:]
    (tmp_path / "both.csv").write_text("\n".join([first.read_text(), *other]))
    assert (
        "with the real part of qq of the opposite sign"
        in import_files([tmp_path / "both.csv"], **SAID).asked
    )


@pytest.mark.slow
def test_runs_are_compared_where_both_are(tmp_path: Path):
    """The same device over other frequencies differs by nothing, as far as that can be seen."""
    path = table(
        tmp_path / "scan.csv",
        "",
        [("", *POWERS[0], np.geomspace(*ends, 200)) for ends in ((1, 100), (50, 1000))],
    )
    asked = import_files([path], **SAID).asked
    assert "% in the median from 50" in asked
    assert float(re.search(r"differ by ([\d.]+) ?%", asked)[1]) < 0.5


@pytest.mark.parametrize(
    ("op", "words"),
    [
        (["full:p=0.8,q=0.1", "full:p=0.7,q=0.1"], "--op full must be said with one p, q and v"),
        (["full:r=1"], "--op is written NAME"),
        ([":"], "--op is written NAME"),
        (["full:p=0.8,p=0.7"], "says p twice"),
        (["p=0.8,q=0", "p=0.7,q=0", "p=0.6,q=0"], "found 3 for 1 run over the frequencies"),
    ],
)
def test_points_that_are_said_wrongly_are_refused(tmp_path: Path, op: list[str], words: str):
    path = table(tmp_path / "scan.csv", "", [("", *POWERS[0], HZ)])
    with pytest.raises(SweepError, match=re.escape(words)):
        import_files([path], **SAID, op=op)


def test_a_name_that_the_column_does_not_hold_is_refused(tmp_path: Path):
    path = table(tmp_path / "scan.csv", "case", [("voll", *POWERS[0], HZ)])
    for op in ("ganz:p=0.8,q=0.1", "ganz"):
        with pytest.raises(SweepError, match="--op ganz: no operating point is called so"):
            import_files([path], **SAID, op=op).answered()
    assert_points(import_files([path], **SAID, op="voll:p=0.8,q=0.1"), POWERS[:1], ["voll"])
