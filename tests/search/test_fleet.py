"""`ibrid fleet`: every device has its answer, whatever a file does to its worker and whenever the
fleet is killed.
"""

import csv
import importlib.util
import json
import os
import shutil
import signal
import subprocess
import sys
import time
from dataclasses import replace
from math import exp, log, sqrt
from pathlib import Path

import numpy as np
import pytest
import toy_fleet
from ibrid_search.archives.prior import (
    ANYTHING,
    BELIEVED,
    FIRST,
    DeviceAnswer,
    DeviceFamily,
    Prior,
    joined,
    learned,
    learned_from,
)
from ibrid_search.evaluation.processes import ProcessEvaluator
from ibrid_search.evaluation.ray_session import open_session
from ibrid_search.fleet.devices import content_of, enlist, files_of
from ibrid_search.fleet.examining import DeviceJob, Examiner
from ibrid_search.fleet.running import Earlier, fleet
from ibrid_search.run.store import Store
from ibrid_search.settings import Workers
from ibrid_search.step import Status
from jsonschema import Draft202012Validator
from page_reader import self_contained
from toy_fleet import ToyExaminer, device, examined, typical, write_fleet

import ibrid
from ibrid import cli
from ibrid.errors import IbridError
from ibrid.measurement.formats.csv_file import write_sweep
from ibrid.schemas import schema

DEVICES = 20


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Files of devices of one make."""
    return write_fleet(tmp_path_factory.mktemp("fleet") / "devices", DEVICES)


@pytest.fixture(scope="module")
def whole(folder: Path) -> Path:
    """The fleet of them, examined by one worker without a break."""
    out = folder.parent / "whole"
    examined(folder, out)
    return out


def records(out: Path) -> list[dict]:
    """What is known of every device, without the time that it took."""
    with Store.open(out / "archive.sqlite", read_only=True) as store:
        return [{**store.record(step.number).to_json(), "seconds": 0} for step in store.steps()]


def table(out: Path) -> list[dict[str, str]]:
    with (out / "devices.csv").open(newline="") as stream:
        return list(csv.DictReader(stream))


@pytest.mark.nightly
def test_two_equal_fleets_are_equal_whatever_the_number_of_workers(
    folder: Path, whole: Path, tmp_path: Path
):
    examined(folder, tmp_path / "out", workers=3)
    assert (tmp_path / "out/devices.csv").read_text() == (whole / "devices.csv").read_text()
    assert records(tmp_path / "out") == records(whole)


@pytest.mark.nightly
def test_a_fleet_searches_on_an_existing_ray_cluster_as_on_its_own_processes(
    folder: Path, tmp_path: Path
):
    """Two devices, whose workers import the real examiner."""
    if importlib.util.find_spec("ray") is None:
        pytest.skip("Ray is not installed (pip install 'ibrid[ray]')")
    few = tmp_path / "few"
    few.mkdir()
    for number in range(2):
        shutil.copy(folder / f"device_{number:02d}.csv", few)
    cluster = open_session(2)
    try:
        address = cluster.ray.get_runtime_context().gcs_address
        asked = {"job": "search", "budget": 6}
        found = fleet(few, tmp_path / "there", workers=Workers(2, address), **asked)
        assert cluster.ray.is_initialized()  # what was there before stays
    finally:
        cluster.close()
    assert [row["grade"] for row in table(tmp_path / "there")] == ["explains"] * 2
    assert not found.summary.failed
    fleet(few, tmp_path / "here", workers=Workers(1), **asked)
    assert (tmp_path / "there/devices.csv").read_text() == (
        tmp_path / "here/devices.csv"
    ).read_text()


@pytest.mark.nightly
def test_a_fleet_that_is_killed_twice_goes_on_and_loses_nothing(
    folder: Path, whole: Path, tmp_path: Path
):
    out = tmp_path / "out"
    environment = {**os.environ, "PYTHONPATH": os.pathsep.join(filter(None, sys.path))}
    answered: dict[int, dict] = {}
    held = tmp_path / "held"
    for sitting, wanted in enumerate((3, 9)):
        # so that it is killed in the midst of its devices, however late it is looked at
        held.touch()
        environment["TOY_FLEET_HELD"] = f"{wanted} {held}"
        command = [
            sys.executable,
            "-c",
            "import toy_fleet; toy_fleet.main()",
            str(folder),
            str(out),
        ]
        command += ["--resume"] * (sitting > 0)
        process = subprocess.Popen(command, env=environment, stderr=subprocess.DEVNULL)
        while len(done := _answered(out)) < wanted:
            assert process.poll() is None
            time.sleep(0.02)
        process.send_signal(signal.SIGKILL)
        process.wait()
        held.unlink()  # the workers that it left end
        done = _answered(out)
        assert {number: done[number] for number in answered} == answered
        answered = done
    assert len(answered) == 9
    examined(folder, out, workers=2, resume=True)
    assert {number: _answered(out)[number] for number in answered} == answered
    assert (out / "devices.csv").read_text() == (whole / "devices.csv").read_text()
    assert records(out) == records(whole)


def _answered(out: Path) -> dict[int, dict]:
    """Records, times included, of a store that another process may be making."""
    try:
        with Store.open(out / "archive.sqlite", read_only=True) as store:
            return {
                step.number: store.record(step.number).to_json()
                for step in store.steps()
                if step.status is Status.OK
            }
    except IbridError:
        return {}


@pytest.mark.nightly
def test_a_bad_file_is_one_line_in_the_table(folder: Path, tmp_path: Path):
    """Also one that ends its worker, or keeps it for ever; the others have their answers."""
    mixed = tmp_path / "mixed"
    mixed.mkdir()
    for name in ("device_00.csv", "device_01.csv"):
        (mixed / name).write_bytes((folder / name).read_bytes())
    (mixed / "a_picture.csv").write_bytes(b"\x89PNG\r\n\x1a\n" + bytes(64))
    (mixed / "empty.csv").write_bytes(b"")
    (mixed / "it_dies.csv").write_bytes((folder / "device_02.csv").read_bytes())
    (mixed / "it_hangs.csv").write_bytes((folder / "device_03.csv").read_bytes())
    found = examined(mixed, tmp_path / "out", workers=2, still=5)
    lines = {line["name"]: line for line in table(tmp_path / "out")}
    assert [line["status"] for line in lines.values()] == [
        "failed",
        "ok",
        "ok",
        "failed",
        "lost",
        "unfinished",
    ]
    assert lines["it_dies.csv"]["attempts"] == "3"
    assert "did nothing in 5 looks and was ended" in lines["it_hangs.csv"]["words"]
    for name in ("a_picture.csv", "empty.csv", "it_dies.csv", "it_hangs.csv"):
        assert lines[name]["words"].strip()
        assert "\n" not in lines[name]["words"]
    page = (tmp_path / "out/report.html").read_text()
    self_contained(page)
    assert all(name in page for name in ("a_picture.csv", "it_dies.csv"))
    assert Draft202012Validator(schema("fleet")).is_valid(
        json.loads(json.dumps(found.summary.to_json()))
    )


def test_links_to_files_are_devices_and_what_is_no_file_is_a_line_of_its_own(tmp_path: Path):
    folder, out = tmp_path / "folder", tmp_path / "folder/out"
    out.mkdir(parents=True)
    (tmp_path / "elsewhere.csv").write_text("a sweep")
    os.mkfifo(folder / "pipe.csv")
    for name, target in (
        ("linked", "elsewhere.csv"),
        ("lost", "nowhere.csv"),
        ("circle", "folder"),
        ("own", "folder/out"),
    ):
        (folder / name).symlink_to(tmp_path / target)
    (folder / "itself").symlink_to(folder / "itself")
    told = {}
    with Store.create(tmp_path / "archive.sqlite", {}) as store:
        for step in enlist(store, folder, files_of(folder, out), "start"):
            try:
                told[step.note] = content_of(folder, step).decode()
            except IbridError as error:
                told[step.note] = str(error)
    assert list(told) == ["circle", "itself", "linked", "lost", "pipe.csv"]
    assert told["linked"] == "a sweep"
    for name, words in (
        ("circle", "found a folder"),
        ("lost", "found nothing there"),
        ("pipe.csv", "device or pipe"),
    ):
        assert words in told[name]


def test_a_file_that_changes_before_its_turn_is_told(tmp_path: Path):
    (tmp_path / "one.csv").write_text("before")
    with Store.create(tmp_path / "archive.sqlite", {}) as store:
        (step,) = enlist(store, tmp_path, ["one.csv"], "start")
        assert content_of(tmp_path, step) == b"before"
        (tmp_path / "one.csv").write_text("after")
        with pytest.raises(IbridError, match="changed since the fleet began"):
            content_of(tmp_path, step)


@pytest.mark.slow
def test_a_file_that_is_new_is_a_new_device_behind_the_others(folder: Path, tmp_path: Path):
    few = tmp_path / "few"
    few.mkdir()
    (few / "one.csv").write_bytes((folder / "device_00.csv").read_bytes())
    out = tmp_path / "out"
    examined(few, out)
    (few / "two.csv").write_bytes((folder / "device_01.csv").read_bytes())
    examined(few, out, resume=True)
    assert [(line["name"], line["status"]) for line in table(out)] == [
        ("one.csv", "ok"),
        ("two.csv", "ok"),
    ]


@pytest.mark.nightly
def test_no_more_devices_are_handed_over_than_twice_the_workers(
    folder: Path, tmp_path: Path, monkeypatch
):
    """What is not handed over is not in memory: the content of a file and the prior it gets are its
    job.
    """
    most, waiting = [0], [0]
    submit, collect = ProcessEvaluator.submit, ProcessEvaluator.collect

    def submitted(self: ProcessEvaluator, job: DeviceJob) -> None:
        waiting[0] += 1
        most[0] = max(most[0], waiting[0])
        submit(self, job)

    def collected(self: ProcessEvaluator, number: int):
        waiting[0] -= 1
        return collect(self, number)

    monkeypatch.setattr(ProcessEvaluator, "submit", submitted)
    monkeypatch.setattr(ProcessEvaluator, "collect", collected)
    examined(folder, tmp_path / "out", workers=2)
    assert most[0] == 4


@pytest.mark.slow
def test_a_device_learns_from_half_of_those_before_it_at_powers_of_two(whole: Path):
    assert [learned_from(number) for number in (0, 15, 16, 31, 32, 999)] == [0, 0, 8, 8, 16, 256]
    assert all(learned_from(number) <= number / 2 for number in range(2000))
    told = [record["settings"]["prior"] for record in records(whole)]
    assert [one["devices"] for one in told] == [0] * 2 * FIRST + [FIRST] * (DEVICES - 2 * FIRST)
    assert told[-1]["of_the_family"] == FIRST
    assert "typical" not in told[0]


def _answer(value: float, interval: tuple[float, float]) -> DeviceAnswer:
    deviation = log(interval[1] / interval[0]) / 3.92
    return DeviceAnswer("s", "make", "program", "explains", {"pll.kP": (value, deviation)})


def test_the_typical_value_is_the_median_and_its_spread_is_shrunk_towards_a_factor_of_two():
    values = [exp(one) for one in (-0.3, -0.1, 0.0, 0.1, 0.3)]
    (family,) = learned([_answer(value, (0.9, 1.1)) for value in values], 5).families
    typical_value, spread = family.typical["pll.kP"]
    assert typical_value == pytest.approx(1.0)
    own = 0.2 / 1.349  # the quartiles are -0.1 and 0.1
    assert spread == pytest.approx(sqrt((5 * own**2 + BELIEVED * ANYTHING**2) / (5 + BELIEVED)))


@pytest.mark.slow
def test_only_devices_that_are_explained_and_values_that_their_data_determine_are_learnt_from(
    whole: Path,
):
    with Earlier(whole) as known:
        record = known.record("device_00.csv")
    name = next(iter(record.intervals["p=0.8,q=0.2"]))
    wide = {**record.intervals["p=0.8,q=0.2"], name: (1e-3, 1e3)}
    assert name not in DeviceAnswer.of(replace(record, intervals={"p=0.8,q=0.2": wide})).values
    assert learned([replace(DeviceAnswer.of(record), grade="rough")], 1).families == ()


@pytest.mark.slow
def test_data_and_prior_are_joined_as_two_measurements(whole: Path):
    """A prior without width is the answer, one of no weight changes nothing; between, the deviation
    is smaller than both.
    """
    with Earlier(whole) as known:
        record = known.record("device_00.csv")
    values = record.parameters["p=0.8,q=0.2"]
    usual = {name: 1.1 * value for name, value in values.items()}

    def with_spread(spread: float) -> dict[str, list[float]]:
        told = {name: (value, spread) for name, value in usual.items()}
        return joined(record, DeviceFamily("s", "make", record.program, 9, told))

    for name, (value, low, high) in with_spread(1e-5).items():
        assert value == pytest.approx(
            usual[name], rel=1e-3
        )  # of the data's own weight at this spread
        assert abs(log(high / low)) < 1e-3
    loose = with_spread(20.0)
    for name, ends in record.intervals["p=0.8,q=0.2"].items():
        if ends is not None and abs(log(ends[1] / ends[0])) < 0.3:
            assert loose[name][0] == pytest.approx(values[name], rel=1e-3)
    middle = with_spread(0.1)
    for name, (_, low, high) in middle.items():
        assert abs(log(high / low)) / 3.92 < 0.1 * 1.001
        assert abs(log(high / low)) <= abs(log(loose[name][2] / loose[name][1])) * 1.001


def test_a_device_of_a_known_family_is_explained_by_it_and_says_so(tmp_path: Path):
    """Without a look at anything else; an unknown one is asked as if it were the only one."""
    program = ibrid.program_text(ibrid.textbook(toy_fleet.PROGRAM))
    prior = Prior(
        40,
        (
            DeviceFamily(
                "?", "make", program, 40, {name: (value, 0.2) for name, value in typical().items()}
            ),
        ),
    )
    values = {name: value * 1.2 for name, value in typical().items()}
    write_sweep(device(values, 1), tmp_path / "it.csv")
    job = DeviceJob(0, "", name="it.csv", content=(tmp_path / "it.csv").read_bytes(), prior=prior)
    record = Examiner().assess(job)
    assert record.grade == "explains"
    told = record.settings["fleet"]
    assert (told["diagram"], told["expected"]) == (toy_fleet.PROGRAM, True)
    for name, value in record.parameters["p=0.8,q=0.2"].items():
        ends = record.intervals["p=0.8,q=0.2"][name]
        if ends is not None and abs(log(ends[1] / ends[0])) < 0.3:
            assert value == pytest.approx(values[name], rel=0.3)


@pytest.mark.nightly
def test_a_gain_that_is_unlike_the_familys_is_an_outlier(folder: Path, tmp_path: Path):
    odd = tmp_path / "odd"
    odd.mkdir()
    for file in folder.iterdir():
        (odd / file.name).write_bytes(file.read_bytes())
    write_sweep(
        device({**typical(), "pll.kP_pll": 8 * typical()["pll.kP_pll"]}, 3), odd / "device_99.csv"
    )
    found = examined(odd, tmp_path / "out", workers=2)
    assert [line.name for line in found.summary.outliers] == ["device_99.csv"]
    assert found.summary.outliers[0].words.startswith("pll.kP_pll is 8")


@pytest.mark.nightly
def test_drift_finds_the_one_device_that_changed(folder: Path, whole: Path, tmp_path: Path, capsys):
    now = tmp_path / "now"
    now.mkdir()
    for number in range(3):
        rng = np.random.default_rng([7, number])
        values = {
            name: value * np.exp(0.1 * rng.standard_normal()) for name, value in typical().items()
        }
        values["pll.kP_pll"] *= 0.5 if number == 1 else 1.0
        write_sweep(device(values, 100 + number), now / f"device_{number:02d}.csv")
    write_sweep(device(typical(), 1), now / "new.csv")
    out = tmp_path / "out"
    words = [
        "fleet",
        str(now),
        "--out",
        str(out),
        "--job",
        "drift",
        "--before",
        str(whole),
        "--workers",
        "2",
    ]
    assert cli.main([*words, "--json"]) == 0
    found = json.loads(capsys.readouterr().out)
    assert [one["device"] for one in found["drifted"]] == ["device_01.csv"]
    assert found["drifted"][0]["words"].startswith("pll.kP_pll went from")
    assert [one["device"] for one in found["failed"]] == ["new.csv"]
    assert found["failed"][0]["words"].endswith(
        "has no model of it; examine an earlier sweep of it there first"
    )
    self_contained((out / "report.html").read_text())


def test_no_fleet_is_written_among_its_measurements(tmp_path: Path, capsys):
    (tmp_path / "devices").mkdir()
    (measured := tmp_path / "devices" / "devices.csv").write_text("op,p,q\n", encoding="utf-8")
    (tmp_path / "link").symlink_to(tmp_path / "devices")
    for out in ("devices", "link"):
        words = ["fleet", str(tmp_path / "devices"), "--out", str(tmp_path / out), "--overwrite"]
        assert cli.main(words) == 2
        assert "must be a folder of the fleet's own" in capsys.readouterr().err
    assert measured.read_text(encoding="utf-8") == "op,p,q\n"


@pytest.mark.slow
def test_what_cannot_be_done_is_one_sentence(folder: Path, whole: Path, tmp_path: Path, capsys):
    refused = (
        (str(tmp_path / "nowhere"), "must be a folder"),
        (str(folder), "holds a run already"),
        (str(folder), "since an earlier fleet", "--job", "drift"),
        (str(folder), "does start, search, drift", "--job", "guess"),
    )
    for where, words, *options in refused:
        out = whole if words.startswith("holds") else tmp_path / "out"
        assert cli.main(["fleet", where, "--out", str(out), *options]) == 2
        said = capsys.readouterr().err
        assert words in said
        assert said.count("\n") == 1
    with pytest.raises(IbridError, match="made with"):
        fleet(folder, whole, job=ToyExaminer(seed=3), seed=3, resume=True)


@pytest.mark.slow
def test_the_record_of_a_device_is_asked_for_by_its_file(
    folder: Path, whole: Path, tmp_path: Path, capsys
):
    where = ["fleet", str(folder), "--out", str(whole), "--device"]
    assert cli.main([*where, "device_03.csv", "--json", str(tmp_path / "it.json")]) == 0
    assert ibrid.read_record(tmp_path / "it.json").grade == "explains"
    assert cli.main([*where, "device_3.csv"]) == 2
    assert "device_03.csv" in capsys.readouterr().err


@pytest.mark.slow
def test_the_page_of_a_fleet_can_be_written_while_it_runs(whole: Path, tmp_path: Path, capsys):
    assert cli.main(["report", str(whole), "--out", str(tmp_path / "page.html")]) == 0
    self_contained((tmp_path / "page.html").read_text())
