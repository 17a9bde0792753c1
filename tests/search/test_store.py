"""The store: what was written is there, whatever happens to the process, the disk or the file; one
writer, many readers.
"""

import math
import shutil
import signal
import sqlite3
import subprocess
import sys
import zlib
from collections.abc import Iterator
from contextlib import closing, contextmanager
from dataclasses import replace
from pathlib import Path

import ibrid_search
import numpy as np
import pytest
from fitted import evaluated
from ibrid_search.run.store import FIELDS, VERSION, Store
from ibrid_search.step import Status, Step

import ibrid
from ibrid.errors import IbridError
from ibrid.evaluation.record import Record
from ibrid.modules.vocabulary import VOCABULARY

ROOT = Path(ibrid_search.__file__).parents[1]
FULL = Step(
    number=3,
    parent=1,
    island=7,
    scale="local",
    proposer="llm",
    note="adds a PLL ∠δ",
    edit="<<<<<<< SEARCH\n\t'quoted' \"twice\"\n=======\n\x00\n>>>>>>> REPLACE",
    reply="<think>…</think>",
    diagnosis="a paragraph",
    usage={"model": "m", "tokens": {"in": 12, "out": 1 / 3}, "retries": [1, None, True]},
    status=Status.DUPLICATE,
    reason="the structure of step 1",
    hash="abc",
    same_as=1,
    program="def build(g):\n    pass\n",
    nrmse=0.1 + 0.2,
    reward=-1e-17,
    stable=False,
    order=13,
    free=9,
    seconds=5.0,
)


@pytest.fixture
def path(tmp_path) -> Path:
    return tmp_path / "archive.sqlite"


@pytest.fixture
def store(path) -> Iterator[Store]:
    with Store.create(path, {"data": "op,p,q\n", "start": "def start(g): …"}) as store:
        yield store


def record() -> Record:
    return evaluated("gfl", restarts=0)


def pending(number: int, **changes) -> Step:
    return Step(number=number, parent=0, program=f"program {number}", **changes)


@contextmanager
def child(code: str, path: Path) -> Iterator[subprocess.Popen]:
    """A Python process of its own that runs `code` with the archive's path as its argument."""
    command = [
        sys.executable,
        "-c",
        "import sys\nfrom ibrid_search.step import *\nfrom ibrid_search.run.store import Store\n"
        + code,
    ]
    with subprocess.Popen([*command, path], cwd=ROOT, stdin=-1, stdout=-1, text=True) as process:
        try:
            yield process
        finally:
            process.kill()


# what was written is there


def test_a_step_comes_back_as_it_was(store):
    sparse = Step(0)
    for step in (sparse, FULL):
        store.propose(step)
    assert list(store.steps()) == [sparse, FULL]
    assert store.step(3) == FULL
    assert isinstance(store.step(3).stable, bool)


def test_the_columns_are_the_fields_of_a_step_of_this_version():
    known = (
        "number parent island scale proposer note edit reply diagnosis usage status reason hash "
        "same_as program"
    )
    numbers = "nrmse reward stable order free seconds"
    assert VERSION == 1, "say here which fields belong to the new version"
    assert [*known.split(), *numbers.split()] == [*FIELDS], (
        "raise VERSION when the fields of Step change"
    )


def test_numbers_of_numpy_are_stored_as_plain_ones(store):
    store.propose(pending(0))
    store.conclude(
        0,
        status=Status.OK,
        nrmse=np.float64(0.1),
        reward=np.float32(2),
        stable=np.bool_(True),
        order=np.int64(4),
    )
    step = store.step(0)
    assert (step.nrmse, step.reward, step.stable, step.order) == (0.1, 2.0, True, 4)
    assert type(step.order) is int


def test_half_a_surrogate_pair_of_a_servers_answer_does_no_harm(store):
    store.propose(pending(0, reply="half \ud83d of a smile", usage={"text": "\ud83d"}))
    assert store.step(0).reply == "half ? of a smile"


def test_usage_that_is_no_plain_data_is_refused_and_nothing_is_written(store):
    for usage in ({"cost": math.nan}, {"client": object()}):
        with pytest.raises(IbridError, match="plain JSON data"):
            store.propose(pending(0, usage=usage))
    assert list(store.steps()) == []


def test_a_concluded_step_has_its_record_and_the_numbers_of_it(store):
    fitted = record()
    store.propose(pending(0, diagnosis="kept"))
    store.conclude(0, status=Status.OK, record=fitted)
    step = store.step(0)
    assert step == pending(
        0,
        diagnosis="kept",
        status=Status.OK,
        nrmse=fitted.nrmse,
        reward=fitted.reward,
        stable=True,
        order=fitted.order,
        free=fitted.free_parameters,
        seconds=fitted.seconds,
    )
    assert store.record(0).to_json() == fitted.to_json()
    assert store.record(0, VOCABULARY).vocabulary == VOCABULARY


def test_a_record_as_json_is_the_same_as_the_record(store):
    for number, one in enumerate((record(), record().to_json())):
        store.propose(pending(number))
        store.conclude(number, status=Status.OK, record=one)
    first, second = store.steps()
    assert replace(second, number=0, program=first.program, seconds=first.seconds) == first
    assert store.record(0) == store.record(1)


def test_one_unstable_operating_point_makes_a_step_unstable(store):
    plain = record().to_json()
    plain["stable"] = dict.fromkeys(plain["stable"], True) | {next(iter(plain["stable"])): False}
    store.propose(pending(0))
    store.conclude(0, status=Status.OK, record=plain)
    assert store.step(0).stable is False


def test_a_record_without_a_fit_gives_no_numbers(store):
    failed = Record(
        "failed", reasons=("no operating point",), program="def build(g): pass", seconds=0.5
    )
    store.propose(pending(0))
    store.conclude(0, status=Status.FAILED, reason="no operating point", record=failed)
    step = store.step(0)
    assert (step.nrmse, step.reward, step.stable, step.order, step.seconds) == (
        None,
        None,
        None,
        None,
        0.5,
    )
    assert store.record(0).reasons == ("no operating point",)


def test_given_numbers_stand_before_those_of_the_record(store):
    store.propose(pending(0))
    store.conclude(0, status=Status.REQUIRED, record=record(), stable=False, seconds=9.0)
    assert (store.step(0).stable, store.step(0).seconds) == (False, 9.0)
    assert store.step(0).nrmse == record().nrmse


def test_a_conclusion_is_written_whole_or_not_at_all(store):
    store.propose(pending(0))
    with pytest.raises(IbridError):
        store.conclude(
            0, status=Status.OK, nrmse=0.1, attempts=object()
        )  # refused after the step was changed
    assert store.step(0) == pending(0)
    store.conclude(0, status=Status.OK, nrmse=0.2)
    assert store.step(0).nrmse == 0.2


def test_only_a_pending_step_can_be_concluded_and_a_number_is_given_once(store):
    store.propose(pending(0))
    store.conclude(0, status=Status.LOST)
    with pytest.raises(IbridError, match="must be pending to be concluded, it is lost"):
        store.conclude(0, status=Status.OK)
    with pytest.raises(IbridError, match="there is a step 0 already"):
        store.propose(pending(0))
    with pytest.raises(IbridError, match="there is no step 1; the last is 0"):
        store.conclude(1, status=Status.OK)


def test_a_step_without_record_says_how_it_ended(store):
    store.propose(FULL)
    with pytest.raises(IbridError, match="step 3 has no record, it is duplicate"):
        store.record(3)
    with pytest.raises(IbridError, match="there is no step 9; the last is 3"):
        store.record(9)


def test_texts_stay_and_can_be_replaced(path, store):
    store.set_meta("best", "12")
    store.set_meta("data", "other")
    store.close()
    with Store.open(path) as again:
        assert again.meta == {"data": "other", "start": "def start(g): …", "best": "12"}


# questions


def test_steps_come_in_order_beyond_a_page_and_after_a_number(store):
    for number in reversed(range(1203)):
        store.propose(pending(number))
    assert [one.number for one in store.steps()] == list(range(1203))
    assert [one.number for one in store.steps(after=1199)] == [1200, 1201, 1202]


def test_steps_written_while_reading_are_met(store):
    store.propose(pending(0))
    met = []
    for step in store.steps():
        met.append(step.number)
        if step.number < 3:
            store.propose(pending(step.number + 1))
    assert met == [0, 1, 2, 3]


def test_pending_steps_are_found(store):
    for number, status in enumerate(
        [Status.OK, Status.PENDING, Status.NO_MATCH, Status.PENDING, Status.OK]
    ):
        store.propose(pending(number, status=status))
    assert [one.number for one in store.pending()] == [1, 3]


def test_repeated_evaluations_are_known(store):
    for number, attempts in enumerate([1, 3, 2]):
        store.propose(pending(number))
        store.conclude(number, status=Status.OK, attempts=attempts)
    assert store.retried() == {1: 3, 2: 2}


def test_a_lost_step_can_wait_again_and_keeps_count_of_its_attempts(store):
    store.propose(pending(0, note="kept"))
    store.conclude(0, status=Status.LOST, reason="3 workers died on it", seconds=9.0, attempts=3)
    store.reopen(0)
    assert store.step(0) == pending(0, note="kept")
    store.conclude(0, status=Status.OK, record=record())
    assert (store.step(0).status, store.step(0).reason) == (Status.OK, "")
    assert store.record(0).to_json() == record().to_json()
    assert store.retried() == {0: 4}


def test_only_a_lost_step_can_wait_again(store):
    for number, status in enumerate([Status.OK, Status.PENDING, Status.FAILED]):
        store.propose(pending(number, status=status))
        with pytest.raises(
            IbridError,
            match=f"step {number} must be lost or unfinished to be evaluated again, it is {status}",
        ):
            store.reopen(number)
        assert store.step(number).status is status
    with pytest.raises(IbridError, match="there is no step 7"):
        store.reopen(7)


def test_a_step_of_an_old_run_that_ran_out_of_time_is_unfinished_and_may_wait_again(path, store):
    store.propose(pending(0))
    store.conclude(0, status=Status.UNFINISHED, reason="it hung")
    store.close()
    spoilt(path, "UPDATE steps SET status = 'timeout'")
    with Store.open(path) as again:
        assert again.step(0).status is Status.UNFINISHED
        again.reopen(0)
        assert again.step(0).status is Status.PENDING


# the process dies


WRITING = """
with Store.create(sys.argv[1], {}) as store:
    for number in range(200):
        store.propose(Step(number, reply="x" * 5000))
        store.conclude(number, status=Status.OK, nrmse=number / 7, record={"number": number})
        print(number, flush=True)
"""


@pytest.mark.slow
@pytest.mark.skipif(not hasattr(signal, "SIGKILL"), reason="no SIGKILL here")
@pytest.mark.parametrize("printed", [1, 60])
def test_a_killed_process_loses_no_step(path, printed):
    with child(WRITING, path) as process:
        lines = [process.stdout.readline() for _ in range(printed)]
        process.send_signal(signal.SIGKILL)
        lines += process.stdout.readlines()
        assert process.wait() == -signal.SIGKILL
    told = [int(line) for line in lines if line.endswith("\n")]
    assert told == list(range(len(told)))
    with Store.open(path, read_only=True) as store:
        seen = list(store.steps())
    with Store.open(path) as store:  # the lock died with its process
        assert list(store.steps()) == seen
        whole = [one for one in seen if one.status is Status.OK]
        assert [one.number for one in whole][: len(told)] == told
        assert all(one.nrmse == one.number / 7 and len(one.reply) == 5000 for one in whole)
        assert len(seen) - len(told) <= 2  # the one in flight, and one whose number was not printed
        store.propose(pending(999))


# one writer, many readers


HOLDING = """
store = Store.open(sys.argv[1])
store.propose(Step(0))
print("open", flush=True)
for line in sys.stdin:
    store.propose(Step(int(line)))
    print(line, end="", flush=True)
"""


@pytest.mark.slow
def test_a_live_writer_keeps_others_from_writing_but_not_from_reading(path):
    Store.create(path, {"data": "text"}).close()
    with child(HOLDING, path) as process:
        assert process.stdout.readline() == "open\n"
        for attempt in (Store.open, lambda place: Store.create(place, {})):
            with pytest.raises(IbridError, match="another live run is writing it"):
                attempt(path)
        with Store.open(path, read_only=True) as reader:
            assert [one.number for one in reader.steps()] == [0]
            print(1, file=process.stdin, flush=True)
            assert process.stdout.readline() == "1\n"
            assert [one.number for one in reader.steps()] == [0, 1]
            assert reader.meta == {"data": "text"}
        process.stdin.close()
        assert process.wait() == 0
    Store.open(path).close()


def test_a_second_writer_in_the_same_process_is_refused_until_the_first_closes(path, store):
    with pytest.raises(IbridError, match="another live run is writing it"):
        Store.open(path)
    store.close()
    store.close()
    Store.open(path).close()


def test_a_reader_cannot_write(path, store):
    store.propose(pending(0))
    with Store.open(path, read_only=True) as reader:
        for change in (lambda: reader.propose(pending(1)), lambda: reader.set_meta("data", "")):
            with pytest.raises(IbridError, match="opened for reading"):
                change()
    store.propose(pending(1))


def test_a_closed_store_says_so(store):
    store.close()
    with pytest.raises(IbridError, match="closed database; open it again"):
        store.pending()


# the disk is full


def test_a_full_disk_is_one_sentence_and_what_was_written_stays(path, store):
    connection = store._database._connection
    connection.execute("PRAGMA max_page_count = 40")
    with pytest.raises(IbridError, match=r"archive.sqlite: the disk is full; make room and resume"):
        fill(store)
    number = len(list(store.steps()))
    assert 10 < number < 60
    assert [one.number for one in store.steps()] == list(range(number))
    connection.execute("PRAGMA max_page_count = 4000")
    store.propose(pending(number))
    store.close()
    with Store.open(path) as again:
        assert [one.number for one in again.steps()] == list(range(number + 1))


LIMITED = """
import resource
from ibrid.errors import IbridError
store = Store.open(sys.argv[1])
resource.setrlimit(resource.RLIMIT_FSIZE, (300_000, 300_000))
try:
    for number in range(1000):
        store.propose(Step(number, reply="x" * 3000))
except IbridError as error:
    print(number, error)
"""


@pytest.mark.slow
def test_a_file_that_must_not_grow_is_one_sentence_and_what_was_written_stays(path):
    pytest.importorskip("resource")
    Store.create(path, {}).close()
    with child(LIMITED, path) as process:
        number, sentence = process.stdout.readline().split(" ", 1)
    assert "cannot be read or written" in sentence
    with Store.open(path) as store:
        assert [one.number for one in store.steps()] == list(range(int(number)))


# the file is not what it should be


def test_a_run_is_never_overwritten(path, store):
    store.propose(pending(0))
    store.close()
    with pytest.raises(IbridError, match="there is a run already; resume it"):
        Store.create(path, {})
    with Store.open(path) as again:
        assert len(list(again.steps())) == 1


def test_a_place_that_is_not_there_is_one_sentence(tmp_path):
    with pytest.raises(IbridError, match="there is no such archive"):
        Store.open(tmp_path / "archive.sqlite")
    with pytest.raises(IbridError, match="there is no such archive"):
        Store.open(tmp_path)
    with pytest.raises(IbridError, match="there is no folder"):
        Store.create(tmp_path / "nowhere" / "archive.sqlite", {})
    assert list(tmp_path.iterdir()) == []
    (tmp_path / "archive.sqlite").mkdir()
    with pytest.raises(IbridError, match="cannot be opened"):
        Store.create(tmp_path / "archive.sqlite", {})


@pytest.mark.parametrize("read_only", [True, False])
def test_an_empty_file_is_a_run_that_never_began_and_is_taken_over(path, read_only):
    path.touch()
    with pytest.raises(IbridError, match="ended before it began; start a new run"):
        Store.open(path, read_only=read_only)
    with Store.create(path, {}) as store:
        store.propose(pending(0))


def fill(store: Store, steps: int = 1000) -> None:
    for number in range(steps):
        store.propose(pending(number, reply="x" * 3000))


def spoilt(path: Path, change: str) -> None:
    with closing(sqlite3.connect(path)) as connection, connection:
        connection.execute(change)


@pytest.mark.parametrize("read_only", [True, False])
@pytest.mark.parametrize(
    ("change", "sentence"),
    [
        ("PRAGMA application_id = 5", "a database of something else"),
        ("PRAGMA user_version = 77", "must have schema version 1, found 77"),
    ],
)
def test_another_database_or_version_is_refused(path, store, change, sentence, read_only):
    store.close()
    spoilt(path, change)
    with pytest.raises(IbridError, match=sentence):
        Store.open(path, read_only=read_only)


@pytest.mark.parametrize("read_only", [True, False])
def test_a_file_that_is_no_database_is_refused(path, read_only):
    path.write_text("op,p,q,freq_hz\n" * 500)
    with pytest.raises(IbridError, match="not a database"):
        Store.open(path, read_only=read_only)


@pytest.mark.parametrize("damage", ["cut", "zeros", "noise"])
def test_a_damaged_file_is_refused_for_writing_and_one_sentence_for_readers(path, store, damage):
    fill(store, 100)
    store.close()
    data = path.read_bytes()
    middle = len(data) // 2
    noise = np.random.default_rng(0).bytes(40_000) if damage == "noise" else bytes(40_000)
    path.write_bytes(
        data[:middle] if damage == "cut" else data[:middle] + noise + data[middle + 40_000 :]
    )
    with pytest.raises(IbridError, match=r"archive.sqlite: the file is damaged"):
        Store.open(path)
    with pytest.raises(IbridError, match=r"damaged"), Store.open(path, read_only=True) as store:
        list(store.steps())


def test_text_that_is_no_text_is_damage_too(path, store):
    fill(store, 3)
    store.close()
    spoilt(path, "UPDATE steps SET program = CAST(X'FF' AS TEXT)")
    with (
        pytest.raises(IbridError, match=r"archive.sqlite: the file is damaged"),
        Store.open(path, read_only=True) as store,
    ):
        list(store.steps())


@pytest.mark.parametrize(
    ("change", "sentence"),
    [
        ("UPDATE steps SET status = 'splendid'", "a step is damaged .*splendid"),
        ("UPDATE steps SET usage = '{'", "a step is damaged"),
        ("UPDATE steps SET usage = NULL", "a step is damaged"),
    ],
)
def test_a_damaged_row_is_one_sentence(path, store, change, sentence):
    store.propose(pending(0))
    spoilt(path, change)
    with pytest.raises(IbridError, match=sentence):
        store.step(0)


@pytest.mark.slow
@pytest.mark.parametrize(
    "body", [b"no zlib", zlib.compress(b"no json"), 7, zlib.compress(b'{"schema": 1}')]
)
def test_a_damaged_record_is_one_sentence(path, store, body):
    store.propose(pending(0))
    store.conclude(0, status=Status.OK, record=record())
    with closing(sqlite3.connect(path)) as connection, connection:
        connection.execute("UPDATE evaluations SET record = ?", [body])
    with pytest.raises(IbridError, match=r"record of step 0 is damaged|a record has the schema"):
        store.record(0)


def test_a_record_of_a_textbook_diagram_still_predicts_after_the_store(store):
    fitted, frequency = record(), np.array([10.0, 1000.0])
    store.propose(pending(0))
    store.conclude(0, status=Status.OK, record=fitted)
    for op in fitted.parameters:
        np.testing.assert_array_equal(
            store.record(0).response(op, frequency), fitted.response(op, frequency)
        )
    assert ibrid.parse_program(store.record(0).program)


def test_a_record_that_unpacks_without_end_and_texts_that_are_none_are_damage(
    path, store, monkeypatch
):
    store.propose(pending(0))
    store.conclude(0, status=Status.OK, record=record())
    monkeypatch.setattr("ibrid_search.run.store.LONGEST_RECORD", 1000)
    with pytest.raises(IbridError, match="the record of step 0 is damaged"):
        store.record(0)
    store.close()
    shutil.copy(path, path.with_name("views.sqlite"))
    spoilt(path.with_name("views.sqlite"), "CREATE VIEW endless AS SELECT 1")
    with pytest.raises(IbridError, match="it has views or triggers"):
        Store.open(path.with_name("views.sqlite"), read_only=True)
    spoilt(path, "UPDATE meta SET value = zeroblob(10) WHERE key = 'data'")
    with (
        Store.open(path, read_only=True) as other,
        pytest.raises(IbridError, match="what is told of the run is damaged"),
    ):
        _ = other.meta
