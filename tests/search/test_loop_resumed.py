"""The same run again: one that was killed, stopped, or lost a worker ends as it would have
without.
"""

import os
import signal
import subprocess
import sys
from contextlib import suppress
from dataclasses import replace
from pathlib import Path

import pytest
import scripted_search
from ibrid_search.evaluation.job import Result
from ibrid_search.recursion.keyboard import keyboard
from ibrid_search.recursion.loop import BUDGET, STOPPED, Loop
from ibrid_search.recursion.progress import Progress
from ibrid_search.run.store import Store
from ibrid_search.settings import SearchSettings
from ibrid_search.step import EVALUATED, Status, Step
from scripted_search import NAIVE, ScriptedEvaluator, ended, scripted, steps_of

from ibrid.errors import IbridError


@pytest.fixture
def path(tmp_path: Path) -> Path:
    return tmp_path / "archive.sqlite"


@pytest.mark.slow
def test_the_same_seed_gives_the_same_archive_and_another_seed_another(tmp_path):
    for name, seed in (("a", 1), ("b", 1), ("c", 2)):
        ended(tmp_path / f"{name}.sqlite", seed=seed, budget=20)
    first, again, other = (steps_of(tmp_path / f"{name}.sqlite") for name in "abc")
    assert first == again
    assert [step.hash for step in first] != [step.hash for step in other]


#: Courses of a run: to the end of the budget, to a target with its tidying, mostly tidying, other
#: windows, chance.
COURSES = {
    "budget": {"budget": 20},
    "target": {"budget": 40, "target": 0.45},
    "tidying": {"budget": 30, "settings": SearchSettings(final_pruning=0.8), "seed": 2},
    "one by one": {"budget": 14, "settings": SearchSettings(window=1)},
    "history": {"budget": 16, "settings": SearchSettings(history=3), "seed": 5},
    "required": {"budget": 16, "require": "stable"},
}


class Backwards(ScriptedEvaluator):
    """Workers of which the last to begin ends first."""

    def first_ended(self) -> int:
        return max(self.open)


@pytest.mark.slow
@pytest.mark.parametrize("course", ["budget", "tidying"])
def test_the_archive_does_not_depend_on_the_order_in_which_results_come(tmp_path, course):
    paths = [tmp_path / f"{name}.sqlite" for name in ("forwards", "backwards")]
    for path, evaluator in zip(paths, (ScriptedEvaluator(), Backwards()), strict=True):
        ended(path, evaluator=evaluator, **COURSES[course])
    assert steps_of(paths[0]) == steps_of(paths[1])


class Killed(Exception):
    """What a test does to a run in place of SIGKILL."""


class Mortal(Store):
    """A store whose process dies after so many writes."""

    writes = 0

    def propose(self, step: Step) -> None:
        super().propose(step)
        self._lived()

    def conclude(self, *args, **options) -> None:
        super().conclude(*args, **options)
        self._lived()

    def _lived(self) -> None:
        Mortal.writes -= 1
        if Mortal.writes < 0:
            raise Killed


@pytest.mark.nightly
@pytest.mark.parametrize(
    ("course", "evaluator"),
    [
        *((course, ScriptedEvaluator) for course in COURSES if course not in ("budget", "target")),
        *((course, Backwards) for course in ("budget", "target")),
    ],
)
def test_a_run_that_is_killed_after_every_single_write_ends_as_if_it_had_not_been(
    tmp_path, monkeypatch, course, evaluator
):
    whole, pieces, options = tmp_path / "whole.sqlite", tmp_path / "pieces.sqlite", COURSES[course]
    ending, _ = ended(whole, **options)
    monkeypatch.setattr(scripted_search, "Store", Mortal)
    kills = 0
    while True:
        Mortal.writes = 0
        try:
            assert ended(pieces, evaluator=evaluator(), **options)[0] == ending
            break
        except Killed:
            kills += 1
    assert kills >= len(steps_of(whole))
    assert steps_of(pieces) == steps_of(whole)


@pytest.mark.slow
@pytest.mark.parametrize("writes", [2, 17])
def test_a_run_that_is_killed_once_ends_as_if_it_had_not_been(tmp_path, monkeypatch, writes):
    whole, pieces, options = (
        tmp_path / "whole.sqlite",
        tmp_path / "pieces.sqlite",
        COURSES["tidying"],
    )
    ended(whole, **options)
    Mortal.writes = writes
    with monkeypatch.context() as patched:
        patched.setattr(scripted_search, "Store", Mortal)
        with pytest.raises(Killed):
            ended(pieces, **options)
    assert len(steps_of(pieces)) < len(steps_of(whole))
    ended(pieces, **options)
    assert steps_of(pieces) == steps_of(whole)


class Losing(ScriptedEvaluator):
    """Workers that die on the candidate of some step."""

    def __init__(self, number: int) -> None:
        super().__init__()
        self.number = number

    def collect(self, number: int) -> Result:
        found = super().collect(number)
        return (
            replace(
                found, outcome=Status.LOST, record=None, reason="3 workers died on it", attempts=3
            )
            if (number == self.number)
            else found
        )


@pytest.mark.slow
def test_a_lost_candidate_is_evaluated_again_when_the_run_goes_on_and_ends_as_if_no_worker_had_died(
    tmp_path,
):
    whole, path = tmp_path / "whole.sqlite", tmp_path / "lost.sqlite"
    ended(whole, budget=24)
    lost = next(
        step.number for step in steps_of(whole) if step.number > 4 and step.status is Status.OK
    )

    def stop(loop: Loop, step: Step) -> None:
        loop.stop_asked = step.number == lost

    assert ended(path, evaluator=Losing(lost), budget=24, watch=stop)[0] == STOPPED
    assert steps_of(path)[lost].status is Status.LOST
    ending, loop = ended(path, budget=24)
    assert (ending, loop.evaluations) == (BUDGET, 24)
    assert steps_of(path) == steps_of(whole)


@pytest.mark.slow
def test_a_candidate_that_was_lost_long_ago_takes_its_place_in_the_archive(path):
    _, before = ended(path, evaluator=Losing(3), budget=30)
    steps = steps_of(path)
    assert steps[3].status is Status.LOST
    _, after = ended(path, budget=30)
    again = steps_of(path)
    assert again[3].status in (Status.OK, Status.FAILED)
    assert [*again[:3], *again[4:]] == [*steps[:3], *steps[4:]]
    assert after.evaluations == before.evaluations  # it was paid for already
    assert (3 in {entry.step for entry in after.archive.entries}) == (again[3].status is Status.OK)


@pytest.mark.slow
@pytest.mark.parametrize("writes", [9, 30])
def test_a_candidate_that_always_kills_its_workers_ends_a_killed_run_no_differently(
    tmp_path, monkeypatch, writes
):
    whole, pieces = tmp_path / "whole.sqlite", tmp_path / "pieces.sqlite"
    ended(whole, evaluator=Losing(3), budget=24)
    Mortal.writes = writes
    with monkeypatch.context() as patched:
        patched.setattr(scripted_search, "Store", Mortal)
        with pytest.raises(Killed):
            ended(pieces, evaluator=Losing(3), budget=24)
    ended(pieces, evaluator=Losing(3), budget=24)
    assert steps_of(pieces) == steps_of(whole)


#: A run in a process of its own, which forks once for each moment at which it is to die.
CHILD = """
import os, signal, sys
from pathlib import Path
import scripted_search
from scripted_search import NAIVE, ScriptedEvaluator, naive_record, scripted
folder, moments = Path(sys.argv[1]), [int(word) for word in sys.argv[2:]]
naive_record()

class Dying(ScriptedEvaluator):
    left = 0
    def collect(self, number):
        self.left -= 1
        if self.left < 0:
            os.kill(os.getpid(), signal.SIGKILL)
        return super().collect(number)

for moment in moments:
    child = os.fork()
    if child == 0:
        evaluator = Dying()
        evaluator.left = moment
        with scripted(folder / f"{moment}.sqlite", evaluator=evaluator, budget=24) as loop:
            loop.run(NAIVE)
        os._exit(0)
    _, status = os.waitpid(child, 0)
    assert os.WIFSIGNALED(status) and os.WTERMSIG(status) == signal.SIGKILL, status
"""


@pytest.mark.nightly
@pytest.mark.skipif(
    not hasattr(os, "fork"), reason="this system has no fork, which the child process uses"
)
def test_a_process_that_sigkill_ended_loses_nothing_and_its_run_ends_as_it_would_have(tmp_path):
    moments = (0, 1, 8, 20)
    done = subprocess.run(
        [sys.executable, "-c", CHILD, str(tmp_path), *map(str, moments)],
        env={
            **os.environ,
            "PYTHONPATH": str(Path(scripted_search.__file__).parent),
            "OMP_NUM_THREADS": "1",
        },
        cwd=Path(__file__).resolve().parents[2],
        capture_output=True,
        text=True,
        timeout=600,
    )
    assert done.returncode == 0, done.stderr
    ended(tmp_path / "whole.sqlite", budget=24)
    whole = steps_of(tmp_path / "whole.sqlite")
    for moment in moments:
        path = tmp_path / f"{moment}.sqlite"
        assert sum(step.status in EVALUATED for step in steps_of(path)) == moment
        ended(path, budget=24)
        assert steps_of(path) == whole


@pytest.mark.slow
def test_a_finished_run_has_nothing_left_to_do_and_goes_on_with_a_larger_budget(path):
    ended(path, budget=10)
    before = steps_of(path)
    assert ended(path, budget=10)[0] == BUDGET
    assert steps_of(path) == before
    _, loop = ended(path, budget=20)
    assert loop.evaluations == 20
    assert steps_of(path)[: len(before)] == before


# the keyboard


@pytest.mark.slow
def test_asked_to_stop_the_loop_finishes_what_is_under_way_and_goes_on_later(tmp_path):
    def stop(loop: Loop, step: Step) -> None:
        loop.stop_asked = step.number == 6

    whole, path = tmp_path / "whole.sqlite", tmp_path / "stopped.sqlite"
    ended(whole, budget=24)
    ending, loop = ended(path, budget=24, watch=stop)
    steps = steps_of(path)
    assert ending == STOPPED
    assert not any(step.status is Status.PENDING for step in steps)
    assert loop.absorbed == len(steps) < 24
    ended(path, budget=24)
    assert steps_of(path) == steps_of(whole)


def test_asked_to_halt_the_loop_records_no_result_of_what_was_interrupted(path):
    class Interrupted(ScriptedEvaluator):
        def collect(self, number: int) -> Result:
            if number == 5:
                for _ in range(2):
                    with suppress(
                        KeyboardInterrupt
                    ):  # as compiled code does, which makes a failure of the second
                        signal.raise_signal(signal.SIGINT)
                return Result(number, Status.FAILED, None, "the evaluation broke off", 0.0, 1)
            return super().collect(number)

    def interrupted() -> None:
        with (
            scripted(path, evaluator=Interrupted(), budget=24) as loop,
            keyboard(loop, Progress("silent")),
        ):
            loop.run(NAIVE)

    with pytest.raises(KeyboardInterrupt):
        interrupted()
    assert steps_of(path)[5].status is Status.PENDING


def test_what_breaks_off_at_the_second_ctrl_c_is_the_keyboards_doing(path):
    def broken(times: int) -> None:
        with scripted(path, budget=24) as loop, keyboard(loop, Progress("silent")):
            for _ in range(times):
                with suppress(
                    KeyboardInterrupt
                ):  # as compiled code does, before an error of its own
                    signal.raise_signal(signal.SIGINT)
            raise IbridError("the evaluation broke off")

    with pytest.raises(IbridError):
        broken(1)
    with pytest.raises(KeyboardInterrupt):
        broken(2)
