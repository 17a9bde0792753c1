"""A page says what it is evidence of: version, command, and hashes of the files that were read."""

import html
from hashlib import sha256
from pathlib import Path

import ibrid
from ibrid.cli import main
from ibrid.own_files import announce, writing_as
from ibrid.report.facts.evidence import MOST_FILES, command_line, evidence_now
from ibrid.report.pages.page import report_html


def page_of(folder: Path, *more: str) -> str:
    data = folder / "scan.csv"
    data.write_bytes(ibrid.benchmarks()["gfl_l_filter"].read_bytes())
    words = ["evaluate", "gfl_l_filter", str(data), "--restarts", "0", *more]
    assert main([*words, "--report", str(folder / "fit.html")]) == 0
    return html.unescape((folder / "fit.html").read_text(encoding="utf-8"))


def test_a_page_says_version_command_and_hash_of_its_data(tmp_path):
    page = page_of(tmp_path)
    digest = sha256((tmp_path / "scan.csv").read_bytes()).hexdigest()
    assert f"Version {ibrid.__version__}" in page
    assert f"ibrid evaluate gfl_l_filter {tmp_path}/scan.csv --restarts 0" in page
    assert "(left out: where answers go, on how many cores)" in page
    assert f"DATA: scan.csv, SHA-256 {digest}" in page


def test_a_file_that_changed_since_it_was_read_has_no_hash(tmp_path):
    data, other = tmp_path / "scan.csv", tmp_path / "scan.csv.meta"
    for file in (data, other):
        file.write_text("read")
    with writing_as("evaluate", {"DATA": data}):
        announce(other)
        assert [len(file.sha256) for file in evidence_now().files] == [64, 64]
        data.write_text("edited meanwhile")
        assert [len(file.sha256) for file in evidence_now().files] == [0, 64]
        other.unlink()
        assert [len(file.sha256) for file in evidence_now().files] == [0]


def test_where_an_answer_goes_is_no_part_of_the_evidence(tmp_path):
    assert page_of(tmp_path) == page_of(tmp_path, "--json", str(tmp_path / "fit.json"))
    words = ("search", "a b.csv", "--out=run", "--workers", "2", "--seed", "1", "--overwrite")
    assert command_line(words) == "ibrid search 'a b.csv' --seed 1"


def test_names_and_passwords_of_addresses_are_left_out():
    words = ("search", "a.csv", "--server", "http://user:secret@host:1/v1")
    assert command_line(words) == "ibrid search a.csv --server http://host:1/v1"


def test_in_python_a_page_says_the_version_and_the_model():
    assert (evidence_now().command, evidence_now().files) == ("", ())
    record = ibrid.evaluate("naive", "paper_like", restarts=0)
    program = sha256(record.program.encode()).hexdigest()
    page = report_html(record)
    assert f"Version {ibrid.__version__}<br>Model: its program, SHA-256 {program}</p>" in page


def test_files_that_are_not_listed_are_counted(tmp_path):
    for number in range(MOST_FILES + 3):
        (tmp_path / f"{number:02}.csv").write_text("read")
    inputs = {f"DATA {file.stem}": file for file in tmp_path.iterdir()}
    with writing_as("evaluate", inputs):
        evidence = evidence_now()
    assert (len(evidence.files), evidence.more_files) == (MOST_FILES, 3)


def test_a_fit_that_is_stopped_before_its_page_says_where_it_is(tmp_path, monkeypatch, capsys):
    def interrupted(*_, **__):
        raise KeyboardInterrupt

    monkeypatch.setattr("ibrid.report.pages.page.write_report", interrupted)
    json, page = str(tmp_path / "fit.json"), str(tmp_path / "fit.html")
    words = ["evaluate", "naive", "paper_like", "--restarts", "0", "--report", page]
    assert main([*words, "--json", json]) == 130
    assert f"ibrid report {json} --out {page}" in capsys.readouterr().err
    monkeypatch.undo()
    assert main(["report", json, "--out", page]) == 0
