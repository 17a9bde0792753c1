"""Weights of the policy that are missing or damaged end a search in one sentence before anything is
fitted.
"""

import importlib.util
import json
import shutil
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

if any(importlib.util.find_spec(one) is None for one in ("torch", "transformers")):
    pytest.skip("the policy needs torch and transformers; make setup-llm", allow_module_level=True)

import torch  # pyright: ignore[reportMissingImports]
from ibrid_policy import small_policy
from ibrid_policy.learning.choose import learning
from ibrid_policy.learning.settings import LearningSettings
from ibrid_policy.proposer import PolicyProposer
from ibrid_policy.small_policy import SmallPolicy
from ibrid_policy.weights_folder import CONFIG_FILE, VOCABULARY_FILE, WEIGHTS_FILE, shipped_folder
from ibrid_search.evaluation.local import LocalEvaluator
from ibrid_search.proposers.choose import Proposers
from safetensors.torch import load_file, save_file  # pyright: ignore[reportMissingImports]
from scripted_search import NAIVE, context_of, study

import ibrid
from ibrid import cli
from ibrid.errors import IbridError

pytestmark = pytest.mark.filterwarnings(
    "default"
)  # torch and transformers have warnings of their own
ONE = "model.layers.0.mlp.down_proj.weight"


def changed(folder: Path, change: Callable[[dict[str, Any]], None]) -> None:
    """The tensors of a folder after a change."""
    tensors = load_file(folder / WEIGHTS_FILE)
    change(tensors)
    save_file(tensors, folder / WEIGHTS_FILE, metadata={"format": "pt"})


def shortened(folder: Path) -> None:
    content = (folder / WEIGHTS_FILE).read_bytes()
    (folder / WEIGHTS_FILE).write_bytes(content[: len(content) // 2])


def reconfigured(name: str, value: Any) -> Callable[[Path], None]:
    def change(folder: Path) -> None:
        plain = json.loads((folder / CONFIG_FILE).read_text(encoding="utf-8"))
        (folder / CONFIG_FILE).write_text(json.dumps({**plain, name: value}), encoding="utf-8")

    return change


def spoil(tensors: dict[str, Any]) -> None:
    tensors[ONE] = tensors[ONE] * torch.nan


BROKEN: dict[str, tuple[Callable[[Path], Any], str]] = {
    "missing": (
        lambda folder: (folder / WEIGHTS_FILE).unlink(),
        "holds no policy; make one with ibrid policy train",
    ),
    "empty": (lambda folder: (folder / WEIGHTS_FILE).write_bytes(b""), "cannot be loaded"),
    "cut": (shortened, "cannot be loaded"),
    "a tensor too few": (
        lambda folder: changed(folder, lambda one: one.pop(ONE)),
        f"{ONE} must be .* found none",
    ),
    "no numbers": (
        lambda folder: changed(folder, spoil),
        f"must be finite numbers, {ONE} has others",
    ),
    "more layers": (reconfigured("num_hidden_layers", 7), "as config.json says, found none"),
    "another size": (
        reconfigured("hidden_size", 64),
        r"must be \[\d+, 64\] numbers as config.json says, found \[\d+, 128\]",
    ),
    "a word for a number": (
        reconfigured("hidden_size", "wide"),
        "cannot be loaded .*expected int, got str",
    ),
    "no heads": (reconfigured("num_attention_heads", 0), "cannot be loaded"),
    "no keys": (reconfigured("num_key_value_heads", 0), "cannot be loaded"),
    "numbers of no kind": (reconfigured("dtype", "x"), "cannot be loaded"),
    "no config": (lambda folder: (folder / CONFIG_FILE).write_text("[]"), "cannot be loaded"),
    "other tokens": (
        lambda folder: (folder / VOCABULARY_FILE).write_text('["a"]'),
        "other tokens than this version's",
    ),
}


@pytest.fixture
def folder(tmp_path) -> Path:
    """A copy of the weights that ship."""
    return Path(shutil.copytree(shipped_folder(), tmp_path / "weights"))


def test_the_weights_that_ship_are_whole(folder):
    assert SmallPolicy(folder).model().config.hidden_size == 128


@pytest.mark.parametrize("name", BROKEN)
def test_damaged_weights_are_told_when_the_policy_is_made(folder, capfd, name):
    change, sentence = BROKEN[name]
    change(folder)
    with pytest.raises(IbridError, match=sentence) as told:
        SmallPolicy(folder)
    assert str(folder) in str(told.value)
    assert "\n" not in str(told.value)
    assert capfd.readouterr().err == ""  # transformers has its own reports of such things


def test_a_search_with_damaged_weights_ends_before_the_start_is_fitted(
    folder, tmp_path, capsys, monkeypatch
):
    shortened(folder)
    monkeypatch.setattr(LocalEvaluator, "submit", lambda *_: pytest.fail("nothing is to be fitted"))
    for more in (["--policy", str(folder)], ["--policy", str(folder), "--learn"]):
        run = tmp_path / "run"
        assert (
            cli.main(
                [
                    "search",
                    "paper_like",
                    "--out",
                    str(run),
                    "--proposer",
                    "policy",
                    "--workers",
                    "1",
                    *more,
                ]
            )
            == 2
        )
        assert capsys.readouterr().err.count("\n") == 1
        assert not run.exists()


def test_a_search_asks_the_weights_that_it_is_given(folder, tmp_path):
    changed(
        folder, lambda tensors: tensors.update({name: value * 0 for name, value in tensors.items()})
    )
    sweep = ibrid.read_sweep(ibrid.benchmarks()["paper_like"])
    given = Proposers("policy", policy=folder)
    mine = ibrid.search(
        sweep, tmp_path / "mine", start=ibrid.textbook("naive"), proposer=given, budget=6
    )
    shipped = ibrid.search(
        sweep, tmp_path / "shipped", start=ibrid.textbook("naive"), proposer="policy", budget=6
    )
    assert mine.trajectory != shipped.trajectory
    assert f'policy = "{folder}"' in (mine.folder / "run.toml").read_text(encoding="utf-8")
    with pytest.raises(IbridError, match="policy"):
        ibrid.search(sweep, mine.folder, proposer="policy", budget=8, resume=True)


def test_a_run_goes_on_with_the_weights_that_it_was_made_with_alone(folder, tmp_path):
    sweep = ibrid.read_sweep(ibrid.benchmarks()["paper_like"])
    options = {"proposer": Proposers("policy", policy=folder), "budget": 1}
    ibrid.search(sweep, tmp_path / "run", **options)
    changed(folder, lambda tensors: tensors.update({ONE: tensors[ONE] * 2}))
    with pytest.raises(
        IbridError, match="the run was made with policy of other content; resume with the same"
    ):
        ibrid.search(sweep, tmp_path / "run", resume=True, **options)


def test_weights_that_nobody_reads_are_told(folder, tmp_path):
    sweep = ibrid.read_sweep(ibrid.benchmarks()["paper_like"])
    with pytest.raises(
        IbridError, match="--policy belongs to the proposer policy, found random, rules alone"
    ):
        ibrid.search(sweep, tmp_path / "run", proposer=Proposers("rules,random", policy=folder))
    with pytest.raises(IbridError, match="found proposers of your own alone"):
        ibrid.search(sweep, tmp_path / "run", proposer=Proposers(PolicyProposer(), policy=folder))


class Absent:
    """A policy whose model is not to be had."""

    name, end = "policy", 0

    def __init__(self, reason: str = "the folder cannot be loaded") -> None:
        self.reason = reason

    def model(self) -> Any:
        raise IbridError(self.reason)


def test_a_model_that_is_to_learn_is_loaded_before_the_start_is_fitted(tmp_path, monkeypatch):
    monkeypatch.setattr(LocalEvaluator, "submit", lambda *_: pytest.fail("nothing is to be fitted"))
    sweep = ibrid.read_sweep(ibrid.benchmarks()["paper_like"])
    absent = PolicyProposer(policy=Absent())  # type: ignore[arg-type]
    with pytest.raises(IbridError, match="the folder cannot be loaded"):
        ibrid.search(sweep, tmp_path / "run", proposer=Proposers(absent, learn=True))
    assert not (tmp_path / "run").exists()


@pytest.mark.parametrize("number", [1, 2])
def test_the_small_policy_draws_its_answers_with_the_threads_of_learning(
    tmp_path, monkeypatch, number
):
    given = SmallPolicy()
    settings = LearningSettings(contexts=1, group=2, threads=number)
    ((mine, _),) = learning(
        [(PolicyProposer(policy=given), 1.0)],
        settings,
        seed=0,
        window=8,
        study=study(),
        start=NAIVE,
        folder=tmp_path,
    )
    used: list[int] = []
    draw = small_policy.draw_answers
    monkeypatch.setattr(
        small_policy,
        "draw_answers",
        lambda *one: used.append(torch.get_num_threads()) or draw(*one),
    )
    before = torch.get_num_threads()
    mine.propose(context_of(ibrid.textbook("naive")), np.random.default_rng(0))
    assert set(used) == {number}
    assert (torch.get_num_threads(), given.threads) == (before, 1)


def test_adapters_without_peft_are_told_at_once_with_the_extra_that_has_it(monkeypatch, tmp_path):
    monkeypatch.setitem(__import__("sys").modules, "peft", None)
    proposers = [(PolicyProposer(policy=Absent("the model was asked for")), 1.0)]  # type: ignore[arg-type]
    with pytest.raises(IbridError, match=r"pip install 'ibrid\[lora\]'"):
        learning(
            proposers,
            LearningSettings(lora=4),
            seed=0,
            window=8,
            study=study(),
            start=NAIVE,
            folder=tmp_path,
        )
