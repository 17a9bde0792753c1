"""Candidates evaluated in this process and on Ray actors: the same answers, whatever a candidate
does to its worker.
"""

import importlib.util
import os
import signal
import socket
import subprocess
import sys
import threading
import time
import types
from collections.abc import Callable, Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest
from ibrid_search.evaluation import ray_session
from ibrid_search.evaluation.assess import Assessor
from ibrid_search.evaluation.job import Attempt, Evaluator, Job, Result, Turns
from ibrid_search.evaluation.local import LocalEvaluator
from ibrid_search.evaluation.processes import ProcessEvaluator
from ibrid_search.evaluation.ray_actors import RayEvaluator
from ibrid_search.evaluation.ray_session import RaySession, open_session, sweep_folders
from ibrid_search.fleet.running import fleet
from ibrid_search.running import search
from ibrid_search.settings import Workers
from ibrid_search.step import Status

import ibrid
from ibrid.errors import IbridError
from ibrid.fit.settings import FitSettings
from ibrid.measurement.read import read_sweep
from ibrid.modules.control import LPF1_DQ
from ibrid.modules.vocabulary import VOCABULARY
from ibrid.plants.benchmarks import benchmarks
from ibrid.study import Study

NAIVE = ibrid.program_text(ibrid.textbook("naive"))
#: Little effort: these tests are about who evaluates, not about the fit.
QUICK = FitSettings(
    starts=16, kept=2, kept_misfit=2, halving=((4, 2),), restarts=0, hops=0, ipopt_iterations=5
)
#: Read when Ray is imported, by whichever test does it first.
os.environ.setdefault("RAY_ENABLE_WINDOWS_OR_OSX_CLUSTER", "0")
#: Seconds that nothing takes: what waits longer than that would wait for ever.
GUARD = 600.0

#: What a user types in a notebook: low-pass filters whose law is harmless, or slow or hostile once
#: it is ARMED, which is after the kind was declared: a declaration is checked by asking for the
#: matrices.
CELLS = """
import ctypes, os, time
from pathlib import Path

ARMED = False

def law(omega_c):
    return [[-omega_c, 0], [0, -omega_c]], [[omega_c, 0], [0, omega_c]], [[1, 0], [0, 1]], [[0, 0], [0, 0]]

def asleep(omega_c):
    time.sleep(1000 * ARMED)
    return law(omega_c)

def blocked(omega_c):
    "A deadlock in native code that holds the interpreter, so that no Python signal handler ever runs."
    native, mutex = ctypes.PyDLL(None), ctypes.create_string_buffer(128)
    native.pthread_mutex_init(mutex, None)
    for _ in range(1 + ARMED):
        native.pthread_mutex_lock(mutex)
    return law(omega_c)

def dying(omega_c):
    if ARMED:
        os._exit(1)
    return law(omega_c)

def leaving(omega_c):
    if ARMED:
        raise SystemExit(3)
    return law(omega_c)

def broken(omega_c):
    if ARMED:
        raise KeyError("no such gain")
    return law(omega_c)

def late(omega_c):
    "Writes who it is and takes its time, the first time alone."
    file = Path(FOLDER) / "late"
    if ARMED and not file.exists():
        file.write_text(str(os.getpid()))
        time.sleep(1000)
    return law(omega_c)

def logged(omega_c):
    if not ARMED:
        return law(omega_c)
    begun = time.monotonic()
    time.sleep(0.02)
    with open(Path(FOLDER) / f"log{os.getpid()}", "a") as file:
        file.write(f"{begun} {time.monotonic()}\\n")
    return law(omega_c)

def together(omega_c):
    "As logged, once a second worker is at it too."
    if not ARMED:
        return law(omega_c)
    begun = time.monotonic()
    (Path(FOLDER) / f"here{os.getpid()}").touch()
    while len(list(Path(FOLDER).glob("here*"))) < 2:
        time.sleep(0.01)
    with open(Path(FOLDER) / f"log{os.getpid()}", "a") as file:
        file.write(f"{begun} {time.monotonic()}\\n")
    return law(omega_c)
"""
LAWS = ("law", "asleep", "blocked", "dying", "leaving", "broken", "late", "logged", "together")


def own_kinds(folder: Path) -> tuple[ibrid.ModuleKind, ...]:
    """The kinds as a notebook would have them: their functions belong to `__main__` and exist
    nowhere else.
    """
    cells: dict[str, Any] = {"__name__": "__main__", "FOLDER": str(folder)}
    exec(CELLS, cells)
    kinds = tuple(
        replace(LPF1_DQ, name=f"Mine_{law}", state_space=cells[law], extended=True) for law in LAWS
    )
    cells["ARMED"] = True
    return kinds


def program_with(law: str) -> str:
    """The naive program with one more filter, a user's own kind."""
    changed = NAIVE.replace('g.connect("gain.out", "plant.u_r")', "", 1)
    assert changed != NAIVE
    return (
        f'{changed}\n    g.add("Mine_{law}", "filter")\n'
        '    g.connect("gain.out", "filter.in_")\n    g.connect("filter.out", "plant.u_r")\n'
    )


def assessor(folder: Path, fit: FitSettings = QUICK) -> Assessor:
    sweep = ibrid.read_sweep(ibrid.benchmarks()["paper_like"])
    return Assessor(
        Study(sweep, vocabulary=(*VOCABULARY, *own_kinds(folder))), quick=fit, thorough=fit
    )


def with_kind(folder: Path, kind: ibrid.ModuleKind) -> Assessor:
    known = assessor(folder)
    return replace(known, study=replace(known.study, vocabulary=(*VOCABULARY, kind)))


def results(evaluator: Evaluator, programs: list[str]) -> list[Result]:
    for number, program in enumerate(programs):
        evaluator.submit(Job(number, program, promising=0.0))
    return [evaluator.collect(number) for number in range(len(programs))]


def answers(found: list[Result]) -> list[tuple]:
    """All of the results but times and workers."""
    return [
        (
            one.number,
            one.outcome,
            one.reason,
            one.attempts,
            {**one.record.to_json(), "seconds": 0} if one.record else None,
        )
        for one in found
    ]


PROGRAMS = [
    *(
        ibrid.program_text(ibrid.textbook(name))
        for name in ("naive", "gfl_l_filter", "gfl_exact", "gfl_delay")
    ),
    program_with("law"),
    program_with("broken"),
    program_with("leaving"),
    NAIVE.replace('g.connect("plant.i_g", "i_DQ")', ""),
    "not a program",
]


# ---------------------------------------------------------------- in this process


@pytest.mark.slow
def test_every_program_has_an_outcome_and_a_sentence(tmp_path: Path):
    with LocalEvaluator(assessor(tmp_path)) as local:
        found = results(local, PROGRAMS)
    assert [one.outcome for one in found] == [Status.OK] * 5 + [Status.FAILED] * 2 + [
        Status.ILLEGAL,
        Status.FAILED,
    ]
    assert found[0].record is not None
    assert found[0].record.program.strip() == NAIVE.strip()
    assert "KeyError: 'no such gain'" in found[5].reason
    assert "SystemExit: 3" in found[6].reason
    assert "i_DQ" in found[7].reason
    assert found[7].record is not None
    assert found[8].record is None
    assert all(bool(one.reason) == (one.outcome is not Status.OK) for one in found)
    assert all(one.attempts == 1 and one.seconds > 0 for one in found)


@pytest.mark.slow
def test_results_are_collected_by_number_in_any_order(tmp_path: Path):
    with LocalEvaluator(assessor(tmp_path)) as local:
        for number in (7, 3, 5):
            local.submit(Job(number, NAIVE))
        assert local.collect(3).number == 3
        assert [local.collect(number).number for number in (5, 7)] == [5, 7]


def test_a_number_is_used_once_at_a_time_and_collected_once(tmp_path: Path):
    local = LocalEvaluator(assessor(tmp_path))
    local.submit(Job(1, NAIVE))
    with pytest.raises(IbridError, match="two jobs must not have the number 1"):
        local.submit(Job(1, NAIVE))
    with pytest.raises(IbridError, match=r"job 2 was not submitted.*open jobs: 1"):
        local.collect(2)
    local.collect(1)
    with pytest.raises(IbridError, match="collected before; open jobs: none"):
        local.collect(1)
    local.close()
    with pytest.raises(IbridError, match="after the evaluator was closed"):
        local.submit(Job(3, NAIVE))


def test_a_mistake_of_ours_is_not_the_candidates_fault(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
):
    def mistaken(*_, **__):
        raise KeyError("ours")

    monkeypatch.setattr("ibrid_search.evaluation.assess.evaluate", mistaken)
    with LocalEvaluator(assessor(tmp_path)) as local:
        (found,) = results(local, [NAIVE])
    assert found.outcome is Status.LOST
    assert found.reason.startswith(
        "a mistake in ibrid, please report it: the evaluation broke off with KeyError"
    )


# ---------------------------------------------------------------- whose turn it is


def attempts(*numbers: int) -> list[Attempt]:
    return [Attempt(Job(number, NAIVE)) for number in numbers]


def test_jobs_begin_in_the_order_of_their_coming():
    turns = Turns()
    for one in attempts(4, 2, 9):
        turns.add(one)
    begun = [turns.begin() for _ in range(4)]
    assert [one and one.job.number for one in begun] == [4, 2, 9, None]
    assert turns.running == {4, 2, 9}


def test_a_job_whose_worker_was_lost_comes_before_those_that_have_not_begun():
    turns = Turns()
    first, second = attempts(1, 2)
    turns.add(first)
    turns.add(second)
    turns.begin()
    turns.end(first)
    turns.add(replace(first, losses=1))
    again = turns.begin()
    assert again is not None
    assert (again.job.number, again.number) == (1, 2)


# ---------------------------------------------------------------- which Ray


@pytest.mark.parametrize(
    "address",
    ["ray://127.0.0.1:10001", "http://127.0.0.1:8265", "head", "head:", "127.0.0.1:99999"],
)
def test_an_address_that_names_no_head_is_refused(address: str):
    with pytest.raises(IbridError, match="HOST:PORT of its head"):
        open_session(1, address)


def test_an_address_where_nothing_listens_is_refused_before_ray_is_asked(
    monkeypatch: pytest.MonkeyPatch,
):
    monkeypatch.setattr(
        ray_session, "_import_ray", lambda **_: pytest.fail("Ray was imported")
    )  # it tries for minutes
    with socket.socket() as silent:
        silent.bind(("127.0.0.1", 0))  # taken, so that nobody else listens there
        address = f"127.0.0.1:{silent.getsockname()[1]}"
        with pytest.raises(IbridError, match=f"no Ray cluster at {address} can be used"):
            open_session(1, address)


def test_a_search_and_a_fleet_refuse_an_address_before_they_begin(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
):
    monkeypatch.setattr("ibrid_search.running.Study", None)  # nothing is looked at
    with pytest.raises(IbridError, match="HOST:PORT of its head"):
        search(read_sweep(benchmarks()["paper_like"]), tmp_path / "run", workers=Workers(1, "head"))
    with pytest.raises(IbridError, match="HOST:PORT of its head"):
        fleet(tmp_path / "none", tmp_path / "fleet", workers=Workers(1, "head"))
    assert not [*tmp_path.iterdir()]


def test_auto_is_the_address_of_a_cluster_job_or_what_ray_start_left(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
):
    monkeypatch.setenv("RAY_TMPDIR", str(tmp_path))
    monkeypatch.delenv("RAY_ADDRESS", raising=False)
    with pytest.raises(IbridError, match="no Ray cluster runs on this machine"):
        open_session(1, "auto")
    (tmp_path / "ray").mkdir()
    (tmp_path / "ray" / "ray_current_cluster").write_text("left by ray start")
    with pytest.raises(IbridError, match="found 'left by ray start'"):
        open_session(1, "auto")
    monkeypatch.setenv("RAY_ADDRESS", "of a job")
    with pytest.raises(IbridError, match="found 'of a job'"):
        open_session(1, "auto")


@pytest.mark.slow
def test_something_that_is_no_cluster_is_given_up_in_time(monkeypatch: pytest.MonkeyPatch):
    if importlib.util.find_spec("ray") is None:
        pytest.skip("Ray is not installed (pip install 'ibrid[ray]')")
    monkeypatch.setattr(ray_session, "ANSWER", 2.0)
    with socket.create_server(("127.0.0.1", 0)) as silent:
        address = f"127.0.0.1:{silent.getsockname()[1]}"
        with pytest.raises(
            IbridError, match=f"no Ray cluster at {address} can be used.*no answer within 2 s"
        ):
            open_session(1, address)


# ---------------------------------------------------------------- on Ray actors


def until(condition: Callable[[], bool]) -> None:
    """Wait for something that takes a second or two, or longer beside other work."""
    deadline = time.monotonic() + GUARD
    while not condition():
        assert time.monotonic() < deadline
        time.sleep(0.02)


@pytest.fixture(scope="module")
def session() -> Iterator[RaySession]:
    """One local Ray for all tests: it takes seconds to start."""
    if importlib.util.find_spec("ray") is None:
        pytest.skip("Ray is not installed (pip install 'ibrid[ray]')")
    opened = open_session(4)
    yield opened
    opened.close()


#: Who evaluates beside this process: processes of this machine, or actors of Ray.
CREWS = {"processes": ProcessEvaluator, "Ray": RayEvaluator}


@pytest.fixture(scope="module", params=CREWS)
def crew(
    request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory
) -> Iterator[ProcessEvaluator | RayEvaluator]:
    """Two workers; a job is lost after two of them."""
    if request.param == "Ray":
        request.getfixturevalue("session")
    with CREWS[request.param](assessor(tmp_path_factory.mktemp("crew")), 2, lost=2) as evaluator:
        yield evaluator


@pytest.mark.slow
def test_the_answers_do_not_depend_on_who_evaluates(session: RaySession, tmp_path: Path):
    with LocalEvaluator(assessor(tmp_path)) as local:
        expected = answers(results(local, PROGRAMS))
    for workers in (1, 2, 4):
        with RayEvaluator(assessor(tmp_path), workers) as evaluator:
            assert evaluator.capacity == workers
            assert answers(results(evaluator, PROGRAMS)) == expected


@pytest.mark.nightly
def test_processes_without_ray_give_the_same_answers(tmp_path: Path):
    with LocalEvaluator(assessor(tmp_path)) as local:
        expected = answers(results(local, PROGRAMS))
    with ProcessEvaluator(assessor(tmp_path), 2) as evaluator:
        assert answers(results(evaluator, PROGRAMS)) == expected


def test_a_record_from_a_worker_can_be_used_with_the_users_own_kinds(
    crew: ProcessEvaluator | RayEvaluator,
):
    (found,) = results(crew, [program_with("law")])
    assert found.record is not None
    assert found.record.vocabulary == crew.assessor.study.kinds
    op = crew.assessor.study.sweep.names[0]
    assert any(label.startswith("filter.") for label in found.record.state_space(op).state_labels)


def test_code_that_never_ends_is_ended_and_unfinished(session: RaySession, tmp_path: Path):
    with RayEvaluator(assessor(tmp_path), 2, look=0.2, still=20) as brief:
        asleep, blocked, *others = results(
            brief, [program_with("asleep"), program_with("blocked"), NAIVE, NAIVE]
        )
    for one in (asleep, blocked):
        assert (one.outcome, one.attempts, one.record) == (Status.UNFINISHED, 1, None)
        assert one.reason == asleep.reason
    assert [one.outcome for one in others] == [Status.OK] * 2


def test_a_killed_worker_does_not_count_against_its_candidate(
    crew: ProcessEvaluator | RayEvaluator,
):
    note = Path(crew.assessor.study.kinds[-1].state_space.__globals__["FOLDER"]) / "late"
    crew.submit(Job(0, program_with("late")))
    until(lambda: note.exists() and note.read_text() != "")
    os.kill(int(note.read_text()), signal.SIGKILL)
    found = crew.collect(0)
    assert (found.outcome, found.attempts) == (Status.OK, 2)


def test_a_candidate_that_kills_its_workers_is_lost_and_harms_no_other(
    crew: ProcessEvaluator | RayEvaluator,
):
    dying, *others = results(crew, [program_with("dying"), NAIVE, program_with("law")])
    assert (dying.outcome, dying.attempts, dying.record) == (Status.LOST, 2, None)
    assert dying.reason.startswith("2 workers died on it")
    assert [(one.outcome, one.attempts) for one in others] == [(Status.OK, 1)] * 2


def test_no_more_jobs_run_than_there_are_workers(crew: ProcessEvaluator | RayEvaluator):
    folder = Path(crew.assessor.study.kinds[-1].state_space.__globals__["FOLDER"])
    until(lambda: len(crew.workers) == crew.capacity)  # one may have died in another test
    results(crew, [program_with("together")] * 8)
    intervals = []
    for log in folder.glob("log*"):
        intervals += [tuple(map(float, line.split())) for line in log.read_text().splitlines()]
    assert len(intervals) >= 8
    beside = [sum(begun <= begin < ended for begun, ended in intervals) for begin, _ in intervals]
    assert max(beside) == crew.capacity  # both work, and never a third


@pytest.mark.parametrize("who", CREWS)
def test_kinds_that_cannot_travel_are_refused_in_a_sentence(
    who: str, session: RaySession, tmp_path: Path
):
    lock = threading.Lock()

    def law(omega_c):
        with lock:
            return LPF1_DQ.state_space(omega_c)

    kind = replace(LPF1_DQ, name="Locked", state_space=law)
    with pytest.raises(
        IbridError, match=r"must be picklable to travel to workers, found TypeError.*lock"
    ):
        CREWS[who](with_kind(tmp_path, kind), 1)


@pytest.mark.parametrize("who", CREWS)
def test_kinds_that_workers_cannot_import_end_the_search_in_a_sentence(
    who: str, session: RaySession, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
):
    module = types.ModuleType("only_here")
    monkeypatch.setitem(sys.modules, "only_here", module)
    exec(CELLS, module.__dict__)
    kind = replace(LPF1_DQ, name="Elsewhere", state_space=module.__dict__["law"])
    with CREWS[who](with_kind(tmp_path, kind), 1) as evaluator:
        evaluator.submit(Job(0, NAIVE))
        with pytest.raises(IbridError, match=r"could not load the data and the kinds.*only_here"):
            evaluator.collect(0)


def test_without_a_free_core_the_search_ends_in_a_sentence(
    session: RaySession, crew: RayEvaluator, tmp_path: Path
):
    with RayEvaluator(assessor(tmp_path), 2) as second:  # with the crew, all four cores are taken
        results(second, [NAIVE] * 4)
        until(lambda: len(second.workers) == 2)
        with RayEvaluator(assessor(tmp_path), 1, patience=0.5) as third:
            third.submit(Job(0, NAIVE))
            with pytest.raises(IbridError, match=r"no worker was ready for 0\.5 s"):
                third.collect(0)


def test_a_closed_evaluator_leaves_the_ray_that_it_found(session: RaySession, tmp_path: Path):
    evaluator = RayEvaluator(assessor(tmp_path), 1)
    evaluator.submit(Job(0, program_with("asleep")))
    evaluator.close()
    evaluator.close()
    assert session.ray.is_initialized()
    with pytest.raises(IbridError, match="after the evaluator was closed"):
        evaluator.submit(Job(1, NAIVE))


def test_another_cluster_beside_the_connected_one_is_refused(session: RaySession):
    with socket.create_server(("127.0.0.1", 0)) as other:
        address = f"127.0.0.1:{other.getsockname()[1]}"
        with pytest.raises(IbridError, match=f"cannot use {address} beside it"):
            open_session(1, address)


def test_without_ray_the_sentence_says_what_to_install(monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setitem(sys.modules, "ray", None)
    with pytest.raises(IbridError, match=r"pip install 'ibrid\[ray\]'"):
        open_session(2)


#: A search with a Ray of its own, whose terminal gets Ctrl-C in the middle of a job, and one of
#: whose workers dies.
INTERRUPTED = """
import os, signal, sys, time
from pathlib import Path
sys.path.insert(0, sys.argv[1])
import test_evaluators as cases
from ibrid_search.evaluation.job import Job
from ibrid_search.evaluation.ray_actors import RayEvaluator

asked = []
signal.signal(signal.SIGINT, lambda *_: asked.append(True))
signal.signal(signal.SIGTERM, lambda *_: asked.append(False))
mine = signal.getsignal(signal.SIGTERM)
with RayEvaluator(cases.assessor(Path(sys.argv[2])), 1, lost=1) as evaluator:
    assert signal.getsignal(signal.SIGTERM) is mine
    evaluator.submit(Job(0, cases.program_with("logged")))
    while not evaluator.running:
        time.sleep(0.001)
    os.killpg(0, signal.SIGINT)
    found = evaluator.collect(0)
    evaluator.submit(Job(1, cases.program_with("dying")))
    evaluator.submit(Job(2, cases.NAIVE))
    assert evaluator.collect(1).outcome == "lost"
    assert evaluator.collect(2).outcome == "ok"
    node = evaluator._session.ray._private.worker._global_node
    assert node.node_ip_address == "127.0.0.1", node.node_ip_address
    folder = node.get_session_dir_path()
print(found.outcome.value, found.attempts, asked, folder)
"""


@pytest.mark.nightly
def test_a_ray_of_ones_own_hears_no_ctrl_c_says_nothing_and_leaves_nothing(tmp_path: Path):
    if importlib.util.find_spec("ray") is None:
        pytest.skip("Ray is not installed (pip install 'ibrid[ray]')")
    script = tmp_path / "interrupted.py"
    script.write_text(INTERRUPTED, encoding="utf-8")
    done = subprocess.run(
        [sys.executable, str(script), str(Path(__file__).parent), str(tmp_path)],
        stdin=subprocess.DEVNULL,
        capture_output=True,
        text=True,
        timeout=600,
        start_new_session=True,
        env={name: value for name, value in os.environ.items() if not name.startswith("RAY_")},
        cwd=tmp_path,
    )
    assert done.returncode == 0, done.stderr
    assert done.stderr == ""
    assert len(done.stdout.splitlines()) == 1
    assert done.stdout.startswith("ok 1 [True] ")
    folder = Path(done.stdout.split()[-1])
    assert "ibrid-ray-" in folder.parts[-2]
    assert not folder.parent.exists()
    assert not processes_that_mention(str(folder.parent))


#: A search with a Ray of its own that says what Ray's node is.
BEREFT = """
import sys, time
from pathlib import Path
sys.path.insert(0, sys.argv[1])
import test_evaluators as cases
from ibrid_search.evaluation.job import Job
from ibrid_search.evaluation.ray_actors import RayEvaluator

with RayEvaluator(cases.assessor(Path(sys.argv[2])), 1, lost=1) as evaluator:
    evaluator.submit(Job(0, cases.NAIVE))
    evaluator.collect(0)
    node = evaluator._session.ray._private.worker._global_node
    print([one.process.pid for one in node.all_processes["raylet"]][0], flush=True)
    sys.stdin.read()
    for number in range(1, 1000):  # Ray notices within seconds
        evaluator.submit(Job(number, cases.NAIVE))
        evaluator.collect(number)
        time.sleep(0.1)
"""


@pytest.mark.slow
def test_a_search_whose_ray_node_dies_ends_with_a_sentence_that_says_how_to_go_on(tmp_path: Path):
    if importlib.util.find_spec("ray") is None:
        pytest.skip("Ray is not installed (pip install 'ibrid[ray]')")
    script = tmp_path / "bereft.py"
    script.write_text(BEREFT, encoding="utf-8")
    process = subprocess.Popen(
        [sys.executable, str(script), str(Path(__file__).parent), str(tmp_path)],
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        start_new_session=True,
        env={name: value for name, value in os.environ.items() if not name.startswith("RAY_")},
        cwd=tmp_path,
    )
    assert process.stdout is not None
    os.kill(int(process.stdout.readline()), signal.SIGKILL)
    _, told = process.communicate("", timeout=600)
    assert process.returncode
    assert "--resume" in told.splitlines()[-1]


def processes_that_mention(text: str) -> list[str]:
    """Command lines with that text; on a system without /proc there is nothing to read."""
    found = []
    for path in Path("/proc").glob("[0-9]*/cmdline"):
        try:
            line = path.read_bytes().replace(b"\0", b" ").decode(errors="replace")
        except OSError:
            continue
        if text in line:
            found.append(line)
    return found


@pytest.mark.nightly
@pytest.mark.skipif(sys.platform == "win32", reason="locks of POSIX")
def test_folders_that_a_killed_search_left_are_swept_and_no_others(tmp_path):
    hold = (
        "import fcntl, sys; file = open(sys.argv[1], 'ab'); fcntl.flock(file, fcntl.LOCK_EX); "
        "print(flush=True); input()"
    )
    for name in ("ibrid-ray-left", "ibrid-ray-held", "ibrid-ray-new", "other"):
        (tmp_path / name).mkdir()
        if name != "ibrid-ray-new":  # begun by another search a moment ago
            (tmp_path / name / "lock").touch()
    (tmp_path / "ibrid-ray-link").symlink_to(tmp_path / "other")
    command = [sys.executable, "-c", hold, str(tmp_path / "ibrid-ray-held" / "lock")]
    with subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE) as holder:
        assert holder.stdout is not None
        holder.stdout.readline()
        sweep_folders(tmp_path)
        kept = {path.name for path in tmp_path.iterdir()}
        assert kept == {"ibrid-ray-held", "ibrid-ray-new", "ibrid-ray-link", "other"}
        holder.kill()
    sweep_folders(tmp_path)
    assert {path.name for path in tmp_path.iterdir()} == {
        "ibrid-ray-new",
        "ibrid-ray-link",
        "other",
    }
