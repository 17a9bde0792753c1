"""Kinds, effects and proposers of other distributions: known to the command line once installed,
never fatal when broken.
"""

import pickle
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from ibrid_search.proposal import Proposal
from ibrid_search.proposers.choose import Proposers

import ibrid
from ibrid import cli
from ibrid.errors import IbridError
from ibrid.modules.vocabulary import VOCABULARY
from ibrid.parts.catalogue import CATALOGUE
from ibrid.plugins import extended_catalogue, extended_vocabulary, listed_plugins, plugin_proposers

CODE = """
from dataclasses import replace

from ibrid.parts.catalogue import CATALOGUE
from ibrid.modules import find_kind
from ibrid.modules.vocabulary import VOCABULARY
from ibrid_search.proposal import Proposal


def lag(tau):
    return [[-1 / tau]], [[1 / tau]], [[1]], [[0]]


boxes = find_kind("Delay", VOCABULARY).parameters["T_d"]
LAG = replace(
    find_kind("LPF1", VOCABULARY), name="Lag", law="out = in_ / (1 + tau s)", parameters={"tau": boxes}, state_space=lag
)
PAIR = (replace(LAG, name="Lag_2"), replace(LAG, name="Lag_3"))
STICTION = replace(CATALOGUE[0], id="stiction")


class Idle:
    name, attempts, window = "idle", 1, None

    def propose(self, context, rng):
        return Proposal("", failure="no idea")


def dead():
    raise RuntimeError("no server\\nanywhere")
"""
ENTRIES = {
    "ibrid.kinds": {"lag": "LAG", "pair": "PAIR"},
    "ibrid.effects": {"stiction": "STICTION"},
    "ibrid.proposers": {"idle": "Idle", "dead": "dead", "rules": "dead"},
}


def install(folder: Path, name: str, entries: dict[str, dict[str, str]], code: str = CODE) -> None:
    """What pip leaves behind: a module, and the metadata of its distribution."""
    (folder / f"{name}.py").write_text(code, encoding="utf-8")
    metadata = folder / f"{name}-1.2.dist-info"
    metadata.mkdir()
    (metadata / "METADATA").write_text(
        f"Metadata-Version: 2.1\nName: {name}\nVersion: 1.2\n", encoding="utf-8"
    )
    lines = [
        f"[{group}]\n" + "".join(f"{key} = {name}:{value}\n" for key, value in found.items())
        for group, found in entries.items()
    ]
    (metadata / "entry_points.txt").write_text("\n".join(lines), encoding="utf-8")


@pytest.fixture
def installed(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    install(tmp_path, "lagging", ENTRIES)
    monkeypatch.syspath_prepend(tmp_path)
    monkeypatch.delitem(sys.modules, "lagging", raising=False)
    return tmp_path


def test_kinds_and_effects_join_what_ships(installed: Path):
    assert [kind.name for kind in extended_vocabulary()] == [
        *(kind.name for kind in VOCABULARY),
        "Lag",
        "Lag_2",
        "Lag_3",
    ]
    assert [effect.id for effect in extended_catalogue()] == [
        *(effect.id for effect in CATALOGUE),
        "stiction",
    ]


def test_nothing_is_loaded_before_it_is_asked_for(installed: Path):
    assert {"idle", "dead"} <= set(plugin_proposers())
    assert {
        "lagging 1.2: kinds lag",
        "lagging 1.2: effects stiction",
        "lagging 1.2: proposer idle",
    } <= set(listed_plugins())
    assert "lagging" not in sys.modules


def test_modules_lists_them(installed: Path, capsys: pytest.CaptureFixture):
    assert cli.main(["modules"]) == 0
    shown = capsys.readouterr().out
    assert "Lag_2" in shown
    assert "Plug-in lagging 1.2: proposer idle" in shown
    assert cli.main(["modules", "lag"]) == 0
    assert "out = in_ / (1 + tau s)" in capsys.readouterr().out


@pytest.mark.slow
def test_a_program_with_a_kind_of_a_plug_in_goes_through_the_commands(
    installed: Path, capsys: pytest.CaptureFixture, monkeypatch: pytest.MonkeyPatch
):
    monkeypatch.chdir(installed)
    text = ibrid.program_text(ibrid.textbook("gfl_pll_filter_exact")).replace('"LPF1"', '"Lag"')
    Path("mine.txt").write_text(text, encoding="utf-8")
    assert cli.main(["check", "mine.txt"]) == 0
    assert cli.main(["check", "mine.txt", "--vocabulary", "paper"]) == 2
    assert cli.main(["compare", "mine.txt", "gfl_pll_filter_exact"]) == 0
    assert (
        cli.main(["evaluate", "mine.txt", "paper_like", "--restarts", "0", "--json", "record.json"])
        == 0
    )
    assert (
        cli.main(
            [
                "predict",
                "record.json",
                "--op",
                "p=0.5,q=0",
                "--freq",
                "5:5000:4",
                "--out",
                "answer.csv",
            ]
        )
        == 0
    )
    assert (
        cli.main(
            ["export", "record.json", "--op", "p=1,q=0.3", "--format", "npz", "--out", "model.npz"]
        )
        == 0
    )
    assert cli.main(["report", "record.json"]) == 0
    capsys.readouterr()
    assert (
        ibrid.read_record("record.json", extended_vocabulary()).settings["vocabulary"]
        == "extended + Lag + Lag_2 + Lag_3"
    )


def test_a_proposer_is_chosen_by_its_name_and_mixed(installed: Path):
    (idle, weight), (rules, _) = Proposers("idle:0.2,rules").weighted()
    assert (idle.name, weight) == ("idle", 0.2)
    assert rules.name == "rules"  # a plug-in takes no shipped name
    assert isinstance(idle.propose(None, np.random.default_rng(0)), Proposal)  # type: ignore[arg-type]


def test_a_proposer_that_cannot_be_made_is_one_sentence(installed: Path):
    with pytest.raises(
        IbridError,
        match=r"plug-in dead of lagging 1\.2 is left out, RuntimeError: no server anywhere",
    ):
        Proposers("dead").weighted()


def test_an_unknown_proposer_is_answered_with_those_of_plug_ins(installed: Path):
    with pytest.raises(IbridError, match="did you mean idle"):
        Proposers("idel").weighted()


def test_a_broken_plug_in_is_one_sentence_and_the_others_work(
    installed: Path, capsys: pytest.CaptureFixture
):
    wrong = {
        "ibrid.kinds": {"a": "ABSENT", "b": "boxes", "c": "LAG"},
        "ibrid.effects": {"d": "LAG"},
    }
    install(installed, "wrong", wrong)
    said: list[str] = []
    assert [kind.name for kind in extended_vocabulary(said.append)][-3:] == [
        "Lag",
        "Lag_2",
        "Lag_3",
    ]
    assert [sentence.split(" is left out, ")[0] for sentence in said] == [
        f"the plug-in {a} of wrong 1.2" for a in "abc"
    ]
    assert "AttributeError" in said[0]
    assert "must be ModuleKind or a tuple of them, found Range" in said[1]
    assert "lagging 1.2 has Lag already" in said[2]
    with pytest.warns(UserWarning, match=r"d of wrong 1\.2 .* must be Effect"):
        extended_catalogue()
    assert cli.main(["modules"]) == 0
    assert capsys.readouterr().err.count("wrong 1.2") == 3


@pytest.mark.slow
def test_kinds_and_effects_of_a_plug_in_reach_a_fresh_process(installed: Path):
    """By plain pickle, as workers on this machine and Ray actors with the plug-in installed get
    them.
    """
    cargo = pickle.dumps((extended_vocabulary()[-1], extended_catalogue()[-1]))
    script = (
        "import pickle, sys; kind, effect = pickle.load(sys.stdin.buffer); print(kind.name, "
        "effect.id)"
    )
    done = subprocess.run(
        [sys.executable, "-c", script], input=cargo, capture_output=True, cwd=installed, check=True
    )
    assert done.stdout.decode().split() == ["Lag_3", "stiction"]
