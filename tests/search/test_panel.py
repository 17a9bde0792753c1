"""The loop and its proposers know each other by an interface alone, which anybody's proposer may
have.
"""

import ast
from pathlib import Path

import pytest
from floors import imported_modules
from ibrid_search.proposal import Origin, TakesPart
from ibrid_search.proposers.rules import Rules
from ibrid_search.recursion import loop as loop_module
from ibrid_search.recursion.loop import SPENT
from ibrid_search.step import Step
from scripted_search import NAIVE, PLAIN, ScriptedProposer, ended, numbered, scripted, steps_of

LOOP = Path(loop_module.__file__)


def test_the_loop_imports_no_proposer_and_asks_for_no_type():
    assert [name for _, name in imported_modules(LOOP) if "proposers" in name] == []
    called = [
        node.func
        for node in ast.walk(ast.parse(LOOP.read_text("utf-8")))
        if isinstance(node, ast.Call)
    ]
    assert not any(
        isinstance(one, ast.Name) and one.id in ("isinstance", "type", "getattr") for one in called
    )


@pytest.fixture
def path(tmp_path: Path) -> Path:
    return tmp_path / "archive.sqlite"


class Pairs(TakesPart, ScriptedProposer):
    """Asks every question twice, sees no result within a pair, and has enough after `most`
    answers.
    """

    def __init__(self, most: int) -> None:
        super().__init__(numbered)
        self.most = most
        self.noted: list[int] = []
        self.mine: list[int] = []
        self.seen: list[int] = []
        self.begun: list[Path] = []

    def begin(self, store, folder: Path) -> None:
        self.begun.append(folder)

    def note(self, step: Step) -> None:
        self.noted.append(step.number)
        if step.proposer == self.name:
            self.mine.append(step.number)

    def horizon(self) -> int:
        return self.noted[-1 - len(self.mine) % 2]

    def origin(self, number: int) -> Origin:
        return Origin(len(self.mine) // 2, self.mine[-1] if len(self.mine) % 2 else None)

    def learn(self, steps, context) -> None:
        self.seen.append(sum(step.nrmse is not None for step in steps))
        if self.mine:
            assert context(steps[self.mine[-1]]).parent.step == steps[self.mine[-1]].parent

    @property
    def exhausted(self) -> bool:
        return len(self.mine) >= self.most


def test_a_proposer_that_takes_part_hears_of_every_step_and_says_what_its_questions_are(path):
    pairs = Pairs(6)
    ending, _ = ended(path, proposers=((pairs, 1.0),), settings=PLAIN)
    steps = steps_of(path)
    asked = [step for step in steps if step.proposer == "scripted"]
    assert ending == SPENT
    assert pairs.noted == [step.number for step in steps]
    assert [step.number for step in asked] == pairs.mine == [1, 2, 3, 4, 5, 6]
    for one, other in zip(asked[::2], asked[1::2], strict=True):
        assert (one.parent, one.island, one.scale) == (other.parent, other.island, other.scale)
    assert len({step.island for step in asked}) == 3  # a new pair, the next island


def test_no_result_of_a_pair_is_seen_within_it(path):
    pairs = Pairs(6)
    ended(path, proposers=((pairs, 1.0),), settings=PLAIN)
    usable = [step.nrmse is not None for step in steps_of(path)]
    assert pairs.seen[:6] == [sum(usable[: 1 + made // 2 * 2]) for made in range(6)]


def test_one_that_goes_on_beside_it_keeps_the_run_alive(path):
    ended(path, proposers=((Pairs(2), 0.5), (Rules(looks=1), 0.5)), settings=PLAIN, budget=12)
    assert sum(step.proposer == "rules" for step in steps_of(path)) > 3


def test_a_run_tells_where_it_lives_and_an_undisturbed_proposer_is_known(path):
    pairs = Pairs(1)
    with scripted(path, proposers=((pairs, 1.0),)) as loop:
        loop.panel.begin(loop.store, path.parent)
        assert not loop.panel.undisturbed
        pairs.undisturbed = True
        assert loop.panel.undisturbed
        loop.run(NAIVE)
    assert pairs.begun == [path.parent]
