"""What a command may write: no input, nothing through a link, no file that it did not write
itself.
"""

import os
import subprocess
import sys
import zipfile
from pathlib import Path

import numpy as np
import pytest
from given_records import given_record
from ibrid_search.running import search
from made_gap import made

from ibrid import cli
from ibrid.errors import IbridError
from ibrid.measurement.read import read_sweep
from ibrid.own_files import LIST, adopt, writing_as
from ibrid.plants.benchmarks import benchmarks
from ibrid.structure.diagrams.library import textbook
from ibrid.writing import write_json, write_whole

PRECIOUS = "precious"
#: Channels of a run of PSCAD, of which a file holds ten.
PSCAD_NAMES = ("Va", "Vb", "Vc", "Ia", "Ib", "Ic", "X7", "X8", "X9", "X10", "X11", "X12")
PSCAD_UNITS = ("kV",) * 3 + ("kA",) * 3 + ("",) * 6
SAID_OF_A_TABLE = "# unit: pu\n# current: out\n# q_axis: leads\n# f0_hz: 60\n# power_node: pcc"


def said(capsys: pytest.CaptureFixture[str], *words: object, status: int = 2) -> str:
    """What a command says on the error stream."""
    capsys.readouterr()
    assert cli.main([str(word) for word in words]) == status
    return capsys.readouterr().err


def gapped(folder: Path, *more: str) -> list[str]:
    """A command that writes a folder, whose work is made up (`quick_gap`)."""
    return ["gap", "gfl_exact", "paper_like", "--out", str(folder), *more]


@pytest.fixture
def quick_gap(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("ibrid.gap.workflow.find_gap", lambda *_, **__: made("unexplained"))


def precious(path: Path) -> Path:
    path.write_text(PRECIOUS, encoding="utf-8")
    return path


def test_a_measurement_is_not_replaced_by_what_was_imported_of_it(tmp_path, capsys):
    measured = tmp_path / "sweep.csv"
    said(
        capsys, "sweep", "paper_like", "--freq", "5:500:3", "--out", tmp_path / "made.csv", status=0
    )
    rows = (
        (tmp_path / "made.csv")
        .read_text(encoding="utf-8")
        .replace('"p=1,q=', '"p=1 q=')
        .splitlines()
    )
    lines = [row.replace(",", ";") for row in rows if not row.startswith("#")]
    measured.write_text("\n".join([SAID_OF_A_TABLE, *lines]), encoding="utf-8")
    before = measured.read_bytes()
    for more in ((), ("--overwrite",)):
        said(capsys, "start", measured, "--out", tmp_path, *more, status=0)
        assert measured.read_bytes() == before


@pytest.mark.slow
@pytest.mark.usefixtures("quick_gap")
def test_a_file_of_the_users_is_not_replaced_in_a_folder(tmp_path, capsys):
    own = precious(tmp_path / "model.json")
    assert "ibrid gap did not write it" in said(capsys, *gapped(tmp_path))
    assert own.read_text(encoding="utf-8") == PRECIOUS
    assert cli.main(gapped(tmp_path, "--overwrite")) == 0
    assert own.read_text(encoding="utf-8") != PRECIOUS


@pytest.mark.slow
@pytest.mark.usefixtures("quick_gap")
def test_an_empty_file_holds_nothing_to_lose(tmp_path):
    (tmp_path / "model.json").touch()
    assert cli.main(gapped(tmp_path)) == 0


@pytest.mark.usefixtures("quick_gap")
def test_an_answer_that_was_edited_is_not_replaced(tmp_path, capsys):
    assert cli.main(gapped(tmp_path)) == 0
    answer = tmp_path / "model.py"
    answer.write_text(answer.read_text(encoding="utf-8") + "# mine\n", encoding="utf-8")
    assert "was changed since ibrid gap wrote it" in said(capsys, *gapped(tmp_path))
    assert cli.main(gapped(tmp_path, "--overwrite")) == 0
    assert cli.main(gapped(tmp_path)) == 0


@pytest.mark.slow
def test_the_answer_of_another_command_is_not_replaced(tmp_path, monkeypatch, capsys):
    monkeypatch.setattr(
        "ibrid_search.starting.start.start", lambda *_, **__: pytest.fail("work was done")
    )
    monkeypatch.setattr("ibrid.gap.workflow.find_gap", lambda *_, **__: made("unexplained"))
    assert cli.main(gapped(tmp_path)) == 0
    assert "is an answer of ibrid gap" in said(capsys, "start", "paper_like", "--out", tmp_path)


@pytest.mark.usefixtures("quick_gap")
@pytest.mark.parametrize("more", [(), ("--overwrite",)])
def test_nothing_is_written_through_a_link_in_a_folder(more, tmp_path, capsys):
    target = precious(tmp_path / "elsewhere.json")
    (tmp_path / "out").mkdir()
    (tmp_path / "out" / "model.json").symlink_to(target)
    assert "found a link" in said(capsys, *gapped(tmp_path / "out", *more))
    assert target.read_text(encoding="utf-8") == PRECIOUS


@pytest.mark.skipif(
    not Path("/proc/self/cwd").exists(), reason="the system shows no process as files"
)
def test_a_link_is_followed_nowhere_but_to_open_files(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "x.json").symlink_to(target := precious(tmp_path / "elsewhere.json"))
    with (
        writing_as("inspect", named=["/proc/self/cwd/x.json"]),
        pytest.raises(IbridError, match="found a link"),
    ):
        write_whole(Path("/proc/self/cwd/x.json"), "new")
    assert target.read_text(encoding="utf-8") == PRECIOUS


@pytest.mark.usefixtures("quick_gap")
def test_a_link_that_leads_nowhere_makes_no_file(tmp_path, capsys):
    (tmp_path / "model.json").symlink_to(tmp_path / "nowhere.json")
    said(capsys, *gapped(tmp_path))
    assert not (tmp_path / "nowhere.json").exists()


@pytest.mark.usefixtures("quick_gap")
def test_a_folder_that_is_a_link_is_written_into(tmp_path):
    (tmp_path / "results").mkdir()
    (tmp_path / "link").symlink_to(tmp_path / "results")
    assert cli.main(gapped(tmp_path / "link")) == 0
    assert cli.main(gapped(tmp_path / "results")) == 0


def test_an_input_is_not_replaced_by_an_answer(tmp_path, capsys):
    assert (
        cli.main(["sweep", "paper_like", "--freq", "5:500:3", "--out", str(tmp_path / "a.csv")])
        == 0
    )
    before = (tmp_path / "a.csv").read_bytes()
    assert "would overwrite DATA" in said(
        capsys, "inspect", tmp_path / "a.csv", "--json", tmp_path / "a.csv"
    )
    assert (tmp_path / "a.csv").read_bytes() == before


def test_data_of_a_record_are_no_output_which_is_said_before_the_work(
    tmp_path, monkeypatch, capsys
):
    monkeypatch.setattr(
        "ibrid.analysis.new_data.experiments.experiments", lambda *_: pytest.fail("work was done")
    )
    data = precious(tmp_path / "a.csv")
    record = given_record("paper_like")
    write_json(
        tmp_path / "fit.json",
        {**record.to_json(), "settings": {**record.settings, "data": str(data)}},
    )
    assert "would overwrite the record's data" in said(
        capsys, "next", tmp_path / "fit.json", "--json", data
    )


def test_files_of_a_run_that_is_read_are_not_replaced_by_a_named_file(tmp_path, capsys):
    run = tmp_path / "run"
    search(read_sweep(benchmarks()["paper_like"]), run, budget=1, start=textbook("naive"))
    archive = (run / "archive.sqlite").read_bytes()
    assert "a name that ibrid keeps for itself" in said(
        capsys, "next", run, "--json", run / "archive.sqlite"
    )
    heard = said(capsys, "next", run, "--json", run / "best.json")
    assert "is an answer of ibrid search, which ibrid next would replace" in heard
    assert "--overwrite" not in heard  # which it does not have
    heard = said(
        capsys,
        "evaluate",
        run / "best.py",
        "paper_like",
        "--restarts",
        "0",
        "--json",
        run / "archive.sqlite",
    )
    assert "a name that ibrid keeps for itself" in heard
    heard = said(
        capsys,
        "evaluate",
        run / "best.py",
        "paper_like",
        "--restarts",
        "0",
        "--json",
        run / "run.toml",
    )
    assert "is an answer of ibrid search, which ibrid evaluate would replace" in heard
    assert (run / "archive.sqlite").read_bytes() == archive


def test_a_file_beside_the_archive_of_a_new_run_is_not_lost_to_a_fleet(tmp_path, capsys):
    (tmp_path / "devices").mkdir()
    said(
        capsys,
        "sweep",
        "paper_like",
        "--freq",
        "5:500:3",
        "--out",
        tmp_path / "devices" / "a.csv",
        status=0,
    )
    (tmp_path / "out").mkdir()
    mine = precious(tmp_path / "out" / "archive.sqlite-wal")
    heard = said(
        capsys, "fleet", tmp_path / "devices", "--out", tmp_path / "out", "--effort", "low"
    )
    assert "archive.sqlite-wal: is there already" in heard
    assert mine.read_text(encoding="utf-8") == PRECIOUS


@pytest.mark.parametrize("more", [[], ["--overwrite"]])
def test_a_sweep_of_a_fleet_is_not_replaced_by_its_answer(more, tmp_path, capsys):
    (tmp_path / "devices").mkdir()
    sweep = precious(tmp_path / "devices" / "a.csv")
    heard = said(
        capsys, "fleet", tmp_path / "devices", "--out", tmp_path / "out", "--json", sweep, *more
    )
    assert "ibrid fleet did not write it" in heard
    assert sweep.read_text(encoding="utf-8") == PRECIOUS


def test_a_file_that_is_named_in_the_folder_of_an_answer_obeys_the_rule(tmp_path):
    told = tmp_path / "told.json"
    for content in ("1", "2"):
        with writing_as("fleet", named=[str(tmp_path), str(told)]):
            write_whole(told, content)
    precious(told)
    with (
        writing_as("fleet", named=[str(tmp_path), str(told)]),
        pytest.raises(IbridError, match="was changed since"),
    ):
        write_whole(told, "3")


@pytest.mark.parametrize("name", ["run.toml", "archive.lock", "archive.sqlite-wal", LIST])
def test_what_a_command_keeps_in_its_folder_is_no_place_for_a_named_file(name, tmp_path):
    with writing_as("fleet", named=[str(tmp_path)]):
        write_whole(tmp_path / "run.toml", "goal = 1")
    before = (tmp_path / "run.toml").read_bytes()
    named = tmp_path / name
    with writing_as("fleet", named=[str(tmp_path), str(named)]), pytest.raises(IbridError):
        write_whole(named, "{}")
    assert (tmp_path / "run.toml").read_bytes() == before


def test_the_lines_of_meta_beside_a_file_are_an_input(tmp_path, capsys):
    (tmp_path / "t.s2p").write_text("# HZ Y RI R 1\n", encoding="utf-8")
    meta = precious(tmp_path / "t.s2p.meta")
    assert "would overwrite t.s2p.meta of" in said(
        capsys, "inspect", tmp_path / "t.s2p", "--json", meta
    )
    assert meta.read_text(encoding="utf-8") == PRECIOUS


def test_the_samples_beside_a_comtrade_configuration_are_an_input(tmp_path, capsys):
    samples = precious(tmp_path / "dip.dat")
    precious(tmp_path / "dip.cfg")
    assert "would overwrite dip.dat of" in said(
        capsys, "inspect", tmp_path / "dip.cfg", "--json", samples
    )
    assert samples.read_text(encoding="utf-8") == PRECIOUS


def pscad_run(folder: Path) -> None:
    """A run of PSCAD of twelve channels: two files of samples and what describes them."""
    lines = [
        f'PGB({k}) Output Desc="{name}" Group="Main" Max=2 Min=-2 Units="{unit}"'
        for k, (name, unit) in enumerate(zip(PSCAD_NAMES, PSCAD_UNITS, strict=True), 1)
    ]
    (folder / "run.inf").write_text("\n".join(lines) + "\n", encoding="utf-8")
    time = np.arange(0, 0.2, 2e-4)
    waves = [np.cos(2 * np.pi * 60 * time - k * 2 * np.pi / 3) for k in range(12)]
    np.savetxt(folder / "run_01.out", np.column_stack([time, *waves[:10]]))
    np.savetxt(folder / "run_02.out", np.column_stack([time, *waves[10:]]))


@pytest.mark.parametrize(
    ("command", "read", "option", "written"),
    [
        ("import", "run_01.out", "--out", "run_02.out"),
        ("import", "run_01.out", "--out", "run.inf"),
        ("import", "run.inf", "--out", "run_01.out"),
        ("inspect", "run_01.out", "--json", "run_02.out"),
        ("inspect", "run_01.out", "--json", "run.inf"),
    ],
)
def test_every_file_of_a_run_of_pscad_is_an_input(command, read, option, written, tmp_path, capsys):
    pscad_run(tmp_path)
    before = (tmp_path / written).read_bytes()
    words = [command, tmp_path / read, "--base", "10MVA,20kV", "--f0-hz", "60"]
    assert "would overwrite the input" in said(capsys, *words, option, tmp_path / written)
    assert (tmp_path / written).read_bytes() == before


@pytest.mark.parametrize(("command", "option"), [("inspect", "--json"), ("import", "--out")])
def test_the_archive_of_a_file_that_is_read_is_an_input(command, option, tmp_path, capsys):
    table = tmp_path / "a.csv"
    said(capsys, "sweep", "paper_like", "--freq", "5:500:3", "--out", table, status=0)
    archive = tmp_path / "a.zip"
    with zipfile.ZipFile(archive, "w") as held:
        held.write(table, "a.csv")
    before = archive.read_bytes()
    assert "would overwrite the input" in said(capsys, command, archive / "a.csv", option, archive)
    assert archive.read_bytes() == before


@pytest.mark.parametrize("name", ["model.py", "model.json", "start.json", "report.html"])
def test_start_finds_files_of_the_users_before_its_work(name, tmp_path, monkeypatch, capsys):
    monkeypatch.setattr(
        "ibrid_search.starting.start.start", lambda *_, **__: pytest.fail("work was done")
    )
    own = precious(tmp_path / name)
    assert "ibrid start did not write it" in said(capsys, "start", "paper_like", "--out", tmp_path)
    assert own.read_text(encoding="utf-8") == PRECIOUS


@pytest.mark.parametrize("name", ["gap.json", "model.diff", "report.html"])
def test_gap_neither_replaces_nor_deletes_files_of_the_users(name, tmp_path, monkeypatch, capsys):
    monkeypatch.setattr(
        "ibrid.gap.workflow.find_gap", lambda *_, **__: pytest.fail("work was done")
    )
    own = precious(tmp_path / name)
    assert "ibrid gap did not write it" in said(
        capsys, "gap", "gfl", "paper_like", "--out", tmp_path
    )
    assert own.read_text(encoding="utf-8") == PRECIOUS


@pytest.mark.slow
def test_gap_says_that_earlier_versions_left_no_list(tmp_path, monkeypatch, capsys):
    monkeypatch.setattr("ibrid.gap.workflow.find_gap", lambda *_, **__: made("unexplained"))
    precious(tmp_path / "gap.json")
    assert "earlier versions left no list" in said(
        capsys, "gap", "gfl_exact", "paper_like", "--out", tmp_path
    )
    said(capsys, "gap", "gfl_exact", "paper_like", "--out", tmp_path, "--overwrite", status=0)
    said(capsys, "gap", "gfl_exact", "paper_like", "--out", tmp_path, status=0)


@pytest.mark.parametrize("name", ["best.py", "archive.sqlite-wal"])
def test_a_search_of_python_replaces_no_file_of_the_users(name, tmp_path):
    precious(tmp_path / name)
    with pytest.raises(IbridError, match=name):
        search(read_sweep(benchmarks()["paper_like"]), tmp_path, budget=1, start=textbook("naive"))
    assert [one.name for one in tmp_path.iterdir()] == [name]
    assert (tmp_path / name).read_text(encoding="utf-8") == PRECIOUS


def test_files_of_a_run_of_an_earlier_version_are_taken_for_its_own(tmp_path):
    precious(tmp_path / "best.py")
    with writing_as("search"):
        adopt(tmp_path, ["best.py", "best.json"])
        write_whole(tmp_path / "best.py", "new")
    assert (tmp_path / "best.py").read_text(encoding="utf-8") == "new"


@pytest.mark.usefixtures("quick_gap")
def test_a_list_that_is_damaged_makes_files_unknown_and_nothing_else(tmp_path, capsys):
    assert cli.main(gapped(tmp_path)) == 0
    (tmp_path / LIST).write_bytes(b'{"file": 1}\n\xff\n[]\n{"by"')
    assert "did not write it" in said(capsys, *gapped(tmp_path))


@pytest.mark.usefixtures("quick_gap")
def test_a_list_of_other_things_and_a_pipe_in_its_place_are_passed_over(tmp_path):
    told = precious(tmp_path / "told.json")
    (tmp_path / LIST).write_text(
        '{"file": "told.json", "sha256": "x", "by": 5}\n{"file": 1}\n[]\n', encoding="utf-8"
    )
    with writing_as("gap"), pytest.raises(IbridError, match="ibrid gap did not write it"):
        write_whole(told, "1")
    (tmp_path / LIST).unlink()
    os.mkfifo(tmp_path / LIST)
    with writing_as("gap"):
        write_whole(tmp_path / "new.json", "1")
    assert (tmp_path / "new.json").read_text(encoding="utf-8") == "1"


@pytest.mark.usefixtures("quick_gap")
def test_a_list_that_is_a_link_is_neither_read_nor_written(tmp_path):
    elsewhere = precious(tmp_path / "elsewhere")
    (tmp_path / "out").mkdir()
    (tmp_path / "out" / LIST).symlink_to(elsewhere)
    assert cli.main(gapped(tmp_path / "out")) == 0
    assert elsewhere.read_text(encoding="utf-8") == PRECIOUS


def test_an_answer_so_far_is_replaced_by_its_command_where_no_list_can_be(tmp_path):
    (tmp_path / LIST).symlink_to(precious(tmp_path / "elsewhere"))
    with writing_as("gap"):
        for text in ("so far", "whole"):
            write_whole(tmp_path / "gap.json", text)
    with writing_as("gap"), pytest.raises(IbridError, match="ibrid gap did not write it"):
        write_whole(tmp_path / "gap.json", "another answer")
    assert (tmp_path / "gap.json").read_text(encoding="utf-8") == "whole"


def test_every_command_that_writes_a_folder_can_be_told_to_overwrite(capsys):
    for name in ("start", "playback", "gap", "search", "mcp", "fleet", "policy", "report"):
        assert cli.main([name, "--help"]) == 0
        assert "--overwrite" in capsys.readouterr().out, name


def test_a_file_that_is_protected_a_folder_and_a_loop_of_links_are_no_places(tmp_path, monkeypatch):
    with pytest.raises(IbridError, match="is the name of a folder"):
        write_whole(f"{tmp_path / 'new'}/", "1")
    (tmp_path / "one").symlink_to(tmp_path / "two")
    (tmp_path / "two").symlink_to(tmp_path / "one")
    with pytest.raises(IbridError, match="leads to itself"):
        write_whole(tmp_path / "one", "1")
    held = precious(tmp_path / "held.json")
    monkeypatch.setattr(
        "ibrid.writing.os.access", lambda path, *_: Path(path) != held
    )  # the user may be root
    with pytest.raises(IbridError, match="protected against writing"):
        write_whole(held, "1")
    assert held.read_text(encoding="utf-8") == PRECIOUS


@pytest.mark.parametrize("name", ["archive.sqlite", "best.py", "page.html"])
def test_a_link_elsewhere_replaces_nothing_in_a_run(name, tmp_path, capsys):
    (tmp_path / "run").mkdir()
    (tmp_path / "run" / "archive.sqlite").write_bytes(b"steps")
    kept = (
        precious(tmp_path / "run" / name) if name != "archive.sqlite" else tmp_path / "run" / name
    )
    before = kept.read_bytes()
    (tmp_path / "fit.json").symlink_to(kept)
    assert "found a link" in said(capsys, "list", "--json", tmp_path / "fit.json")
    assert kept.read_bytes() == before


def test_the_list_of_a_folder_is_nobodys_output(tmp_path, capsys):
    assert "keeps for itself" in said(capsys, "list", "--json", tmp_path / LIST)
    assert not (tmp_path / LIST).exists()


def test_standard_output_may_be_named_where_it_goes_into_a_file(tmp_path):
    command = [sys.executable, "-m", "ibrid", "list", "--json", "/dev/stdout"]
    with (tmp_path / "answer").open("wb") as out:
        subprocess.run(command, stdout=out, check=True, timeout=600)
    assert (tmp_path / "answer").stat().st_size > 100


def test_standard_output_that_is_added_to_a_file_keeps_what_is_there(tmp_path):
    (tmp_path / "log").write_text("kept\n")
    with (tmp_path / "log").open("ab") as out:
        subprocess.run(
            [sys.executable, "-m", "ibrid", "list", "--json", "/dev/stdout"],
            stdout=out,
            check=True,
            timeout=600,
        )
    assert (tmp_path / "log").read_text().startswith('kept\n{\n "textbook_diagrams"')


@pytest.mark.skipif(not Path("/dev/fd").is_dir(), reason="the system names no open files")
def test_what_the_process_has_open_is_written_and_no_file_of_another_name_made(tmp_path):
    with (
        (tmp_path / "gone").open("w+b") as gone,
        (tmp_path / "read").open("wb"),
        (tmp_path / "read").open("rb") as read,
    ):
        (tmp_path / "gone").unlink()
        write_whole(f"/dev/fd/{gone.fileno()}", "new")
        gone.seek(0)
        assert gone.read() == b"new"
        with pytest.raises(IbridError, match="cannot be written"):
            write_whole(f"/dev/fd/{read.fileno()}", "new")
        with pytest.raises(IbridError, match="cannot be written"):
            write_whole(f"/dev/fd/{10**8}", "new")
    assert [one.name for one in tmp_path.iterdir()] == ["read"]


def test_a_list_that_is_another_name_of_a_file_or_none_of_ours_is_left_as_it_is(tmp_path):
    kept = tmp_path / "kept.csv"
    kept.write_text('{"file": "looks like a list"\n')
    for name, make in {
        "linked": lambda place: place.hardlink_to(kept),
        "note": lambda place: place.write_text("mine"),
    }.items():
        (tmp_path / name).mkdir()
        make(tmp_path / name / LIST)
        before = (tmp_path / name / LIST).read_bytes()
        with writing_as("gap"):
            write_whole(tmp_path / name / "gap.json", "answer")
        assert (tmp_path / name / LIST).read_bytes() == before
        assert (tmp_path / name / "gap.json").read_text() == "answer"


def test_a_list_that_ends_within_a_line_goes_on_with_a_new_one(tmp_path):
    (tmp_path / LIST).write_text('{"file": "gap.json", "sha256": "1e67')  # a disk was full
    for answer in ("one", "two"):
        with writing_as("gap"):
            write_whole(tmp_path / "gap.json", answer)
    assert (tmp_path / "gap.json").read_text() == "two"


@pytest.mark.skipif(not Path("/dev/stdin").exists(), reason="the system names no open files")
def test_standard_input_is_no_output(tmp_path):
    (tmp_path / "kept").write_text("kept")
    command = [sys.executable, "-m", "ibrid", "list", "--json", "/dev/stdin"]
    with (tmp_path / "kept").open("rb") as given:
        ended = subprocess.run(
            command, stdin=given, capture_output=True, text=True, check=False, timeout=600
        )
    assert ended.returncode == 2
    assert "/dev/stdin: cannot be written" in ended.stderr
    assert (tmp_path / "kept").read_text() == "kept"
