"""The small policy: sampling within the grammar, training that learns and resumes, the proposer,
the command.
"""

import subprocess
import sys

import numpy as np
import pytest
from ibrid_policy.asking import NOTHING_NEW
from ibrid_policy.experience.examples import BRIEF, draw_examples
from ibrid_policy.interface import Policy
from ibrid_search.edits import apply_edit
from ibrid_search.evaluation.judging import judge, verdict_of
from ibrid_search.proposal import Context, Evaluated, Proposer
from ibrid_search.proposers.first_look import LOOKED_AT, LOOKS, Look
from ibrid_search.screening.candidate_edits import CandidateEdit
from ibrid_search.screening.edit_screening import ScreeningFit
from ibrid_search.step import Status

from ibrid.cli import main
from ibrid.errors import IbridError
from ibrid.evaluation.evaluate import evaluate
from ibrid.measurement.read import read_sweep
from ibrid.modules.vocabulary import VOCABULARY
from ibrid.plants.benchmarks import benchmarks
from ibrid.structure.diagrams.library import textbook
from ibrid.structure.diagrams.program import parse_program, program_text
from ibrid.study import Study

torch = pytest.importorskip("torch", reason="needs torch: make setup-llm")
pytest.importorskip("transformers", reason="needs transformers: make setup-llm")

from ibrid_policy.lessons import Lesson, batches, lessons_of  # noqa: E402
from ibrid_policy.measuring import measured  # noqa: E402
from ibrid_policy.proposer import PolicyProposer  # noqa: E402
from ibrid_policy.small_policy import SmallPolicy  # noqa: E402
from ibrid_policy.tokens import TOKENS  # noqa: E402
from ibrid_policy.training import Trainer, TrainingSettings, answer_loss  # noqa: E402
from ibrid_policy.weights_folder import load_model, new_model, save_model, shipped_folder  # noqa: E402
from ibrid_search.proposers.choose import Proposers  # noqa: E402

TINY = {
    "hidden_size": 32,
    "intermediate_size": 64,
    "num_hidden_layers": 2,
    "num_attention_heads": 2,
}


@pytest.fixture(scope="module")
def context() -> Context:
    """The question that a search asks first."""
    sweep = read_sweep(benchmarks()["paper_like"])
    diagram = textbook("naive")
    record = evaluate(diagram, sweep, settings=BRIEF)
    return Context(Study(sweep), Evaluated(0, diagram, record))


@pytest.fixture(scope="module")
def policy() -> SmallPolicy:
    """One that has learnt nothing: only the grammar guides it."""
    return SmallPolicy(model=new_model(1, TINY))


@pytest.fixture(scope="module")
def examples():
    return list(draw_examples(11, 0))


@pytest.fixture(scope="module")
def lessons(examples) -> list[Lesson]:
    return lessons_of(examples)


def test_the_policy_is_one_in_the_sense_of_the_interface(policy):
    assert isinstance(policy, Policy)
    assert isinstance(PolicyProposer(policy=policy), Proposer)
    assert TOKENS.words[policy.end] == "<end>"


def test_sampling_repeats_with_its_seed_and_differs_with_another(policy, context):
    prompt = policy.prompt(context)
    one, again, other = (policy.sample([prompt], [context], 3, seed)[0] for seed in (5, 5, 6))
    assert one == again
    assert one != other


def test_log_probabilities_are_those_of_the_masked_model(policy, context):
    prompt = policy.prompt(context)
    for answer in policy.sample([prompt], [context], 4, 0)[0]:
        masks = torch.from_numpy(policy.masks(prompt, answer.tokens, context))
        with torch.no_grad():
            logits = policy.model()(torch.tensor([[*prompt, *answer.tokens]])).logits[
                0, len(prompt) - 1 : -1
            ]
        found = logits.double().masked_fill(~masks, -torch.inf).log_softmax(-1)
        own = found[torch.arange(len(answer.tokens)), torch.tensor(answer.tokens)]
        np.testing.assert_allclose(
            own.numpy(), answer.logprobs, atol=1e-4
        )  # float32, another order of sums


def test_answers_of_a_policy_that_knows_nothing_are_edits_all_the_same(policy, context):
    parent = program_text(context.parent.diagram)
    prompt = policy.prompt(context)
    ends = [
        judge(policy.proposal(one, context), parent, "", context.study, lambda _: None).status
        for one in policy.sample([prompt], [context], 20, 1)[0]
        if one.tokens[-1] == policy.end
    ]
    assert len(ends) > 5
    assert set(ends) <= {Status.PENDING, Status.ILLEGAL, Status.UNCHANGED, Status.IMPLAUSIBLE}


def test_an_answer_that_is_cut_or_no_edit_is_a_sentence(policy, context):
    from ibrid_policy.interface import Sampled

    cut = policy.proposal(Sampled((TOKENS.ids["ADD"],), (0.0,)), context)
    assert "did not end" in cut.failure
    wrong = policy.proposal(
        Sampled((TOKENS.ids["DEL"], TOKENS.ids["#60"], policy.end), (0.0,) * 3), context
    )
    assert "no edit of this parent" in wrong.failure


def test_an_answer_that_changes_nothing_counts_as_unchanged(policy, context):
    from ibrid_policy.interface import Sampled

    words = [
        "ADD",
        "#3",
        "K:LPF1",
        "AT",
        "#3",
        "+",
        "#2",
        "<end>",
    ]  # a filter that leads nowhere is tidied away
    proposal = policy.proposal(Sampled(tuple(TOKENS.encode(words)), (0.0,) * len(words)), context)
    from ibrid.structure.compiling.canonical import structure_hash

    own = structure_hash(context.parent.diagram)
    verdict = judge(
        proposal, program_text(context.parent.diagram), own, context.study, lambda _: None
    )
    assert verdict.status is Status.UNCHANGED


def test_kinds_of_one_s_own_are_left_alone_and_a_parent_with_one_is_edited(policy, context):
    from dataclasses import replace

    mine = replace(next(kind for kind in VOCABULARY if kind.name == "LPF1"), name="MyFilter")
    study = replace(context.study, vocabulary=(*VOCABULARY, mine))
    proposer = PolicyProposer(policy=policy)
    assert not proposer.propose(replace(context, study=study), np.random.default_rng(0)).failure
    diagram = parse_program(
        program_text(textbook("gfl_pll_filter_exact")).replace('"LPF1"', '"MyFilter"')
    )
    record = evaluate(diagram, study.sweep, settings=BRIEF, vocabulary=study.kinds)
    with_mine = replace(context, study=study, parent=Evaluated(1, diagram, record))
    assert not proposer.propose(with_mine, np.random.default_rng(0)).failure


def test_the_proposer_counts_its_answers_and_repeats_with_its_generator(policy, context):
    proposer = PolicyProposer(policy=policy, answers=3)
    one, again = (proposer.propose(context, np.random.default_rng(3)) for _ in range(2))
    assert one == again
    assert one.usage["samples"] == 3
    assert one.usage["known"] + one.usage["refused"] + one.usage.get(LOOKS, 0) <= 3


def test_the_proposer_passes_over_structures_that_are_known(policy, context):
    from dataclasses import replace

    proposer = PolicyProposer(policy=policy, answers=4)
    found = [
        proposer.propose(replace(context, seen=lambda _: True), np.random.default_rng(seed))
        for seed in range(8)
    ]
    assert max(one.usage["known"] for one in found) > 1
    # what is known is never looked at, and an answer that is refused is not passed over
    assert not any(LOOKS in one.usage for one in found)
    ends = [
        (one.usage["refused"] > 0, verdict_of(one, replace(context, seen=lambda _: True)).status)
        for one in found
    ]
    assert all(refused == (end not in NOTHING_NEW) for refused, end in ends)


def test_every_other_time_the_first_look_chooses_among_the_answers(policy, context, monkeypatch):
    looked = []

    def look(diagram, context, rng):
        looked.append(program_text(diagram))
        return Look(float(-len(looked)))

    monkeypatch.setattr("ibrid_policy.asking.first_look", look)
    best = 0
    for seed in range(24):
        looked.clear()
        proposal = PolicyProposer(policy=policy, looked_at=1.0).propose(
            context, np.random.default_rng(seed)
        )
        assert proposal.usage.get(LOOKS, 0) == len(looked) == len(set(looked))  # twins share a look
        if looked:  # the last one looks best
            assert parse_program(
                apply_edit(proposal.edit, program_text(context.parent.diagram))
            ) == parse_program(looked[-1])
            best += len(looked) > 1
        blind = PolicyProposer(policy=policy, looked_at=0.0).propose(
            context, np.random.default_rng(seed)
        )
        assert LOOKS not in blind.usage
        if looked and not blind.usage["refused"]:
            assert parse_program(
                apply_edit(blind.edit, program_text(context.parent.diagram))
            ) == parse_program(looked[0])
    assert best > 8
    halves = [
        PolicyProposer(policy=policy).propose(context, np.random.default_rng(seed))
        for seed in range(60)
    ]
    assert sum(LOOKS in one.usage for one in halves) / 60 == pytest.approx(LOOKED_AT, abs=0.26)


def test_the_best_edit_of_the_diagnosis_stands_among_the_answers_when_looks_choose(
    policy, context, monkeypatch
):
    monkeypatch.setattr("ibrid_policy.asking.first_look", lambda *_: Look(0.0))
    other = textbook("gfl_delay")

    def proposed(worth: float, seed: int, **settings):
        best = ScreeningFit(CandidateEdit(other, "a delay", "control_delay", {}), 0.5, 5, worth)
        monkeypatch.setattr(Context, "lacks", lambda *_: [best])
        return PolicyProposer(policy=policy, **settings).propose(
            context, np.random.default_rng(seed)
        )

    seed = next(
        k for k in range(20) if LOOKS in proposed(1.0, k, looked_at=1.0, informed=False).usage
    )
    own, better = (proposed(worth, seed, looked_at=1.0) for worth in (1.0, -1.0))
    assert own.edit != better.edit
    assert own == proposed(-1.0, seed, looked_at=1.0, informed=False)
    assert apply_edit(better.edit, program_text(context.parent.diagram)) == program_text(other)
    assert (better.note, better.usage["family"], better.usage["samples"]) == (
        "a delay",
        "control_delay",
        8,
    )
    unseen = proposed(-1.0, seed, looked_at=0.0)
    assert unseen.note != "a delay"


def test_the_loss_is_the_mean_over_answer_tokens_by_weight_as_if_each_answer_stood_alone(lessons):
    model = new_model(0, TINY)
    several = [one for one in lessons if len(one.answers) > 1][:3]
    assert several
    (batch,) = batches(several, 3, np.random.default_rng(0), blurred=False)
    total = weight = 0.0
    for lesson in several:
        question = lesson.question.copy()
        question[-2] = TOKENS.ids[f"scale:{lesson.answers[0].scale}"]
        for answer in lesson.answers:
            tokens = torch.tensor([*question, *answer.tokens])
            with torch.no_grad():
                logits = model(tokens[None]).logits[0, len(question) - 1 : -1].double()
            for row, allowed in zip(logits, answer.allowed, strict=True):
                row[np.setdiff1d(np.arange(len(TOKENS)), allowed)] = -torch.inf
            found = logits.log_softmax(-1).numpy()[np.arange(len(answer.tokens)), answer.tokens]
            total -= answer.weight * found.sum()
            weight += answer.weight * len(found)
    assert float(answer_loss(model, batch).detach()) == pytest.approx(
        total / weight, rel=1e-4
    )  # float32


def test_a_few_lessons_are_learnt_by_heart(lessons, examples, tmp_path):
    few = lessons[:4]
    trainer = Trainer(
        new_model(0, TINY),
        few,
        TrainingSettings(steps=150, batch=6, rate=1e-2, warm_up=10),
        tmp_path,
    )
    trainer.run()
    assert trainer.losses[-1] < 0.1 * trainer.losses[0]
    found = measured(trainer.model, examples[:4], tries=2)
    assert found.valid > 0.7


def test_a_training_that_is_stopped_goes_on_as_if_it_had_not_been(lessons, tmp_path):
    settings = TrainingSettings(steps=8, batch=4, checkpoint=3)
    whole = Trainer(new_model(0, TINY), lessons, settings, tmp_path / "whole")
    whole.run()

    class Stop(Exception):
        pass

    def stop(one: Trainer) -> None:
        if one.step == 5:
            raise Stop

    broken = Trainer(new_model(0, TINY), lessons, settings, tmp_path / "broken")
    with pytest.raises(Stop):
        broken.run(stop)
    again = Trainer(new_model(5, TINY), lessons, settings, tmp_path / "broken")
    assert again.resume()
    assert again.step == 3
    again.run()
    assert again.losses == whole.losses
    other = Trainer(
        new_model(0, TINY), lessons, TrainingSettings(steps=9, batch=4), tmp_path / "broken"
    )
    with pytest.raises(IbridError, match="other settings"):
        other.resume()


@pytest.mark.parametrize("damage", ["cut", "garbage", "no table", "a weight too few"])
def test_a_damaged_training_is_one_sentence(lessons, tmp_path, damage):
    trainer = Trainer(new_model(0, TINY), lessons, TrainingSettings(steps=1), tmp_path)
    trainer.save()
    path = tmp_path / "checkpoint.pt"
    if damage in ("cut", "garbage"):
        path.write_bytes(path.read_bytes()[:1000] if damage == "cut" else b"garbage")
    elif damage == "no table":
        torch.save([1], path)
    else:
        state = torch.load(path, weights_only=True)
        state["model"].popitem()
        torch.save(state, path)
    with pytest.raises(
        IbridError,
        match=r"checkpoint.pt: (cannot be read|does not fit) .*; delete it, and run again",
    ) as told:
        trainer.resume()
    assert "\n" not in str(told.value)


def test_weights_that_are_written_are_read_back(tmp_path):
    model = new_model(2, TINY)
    save_model(model, tmp_path, "# card\n")
    again = load_model(tmp_path)
    for name, value in again.state_dict().items():
        assert value.dtype == torch.float32
        torch.testing.assert_close(
            value, model.state_dict()[name], atol=1e-3, rtol=1e-3
        )  # kept as 16-bit numbers
    (tmp_path / "vocabulary.json").write_text('["other"]')
    with pytest.raises(IbridError, match="other tokens"):
        load_model(tmp_path)
    (tmp_path / "model.safetensors").write_bytes(b"x" * 100)
    with pytest.raises(IbridError, match=r"other tokens|cannot be loaded"):
        load_model(tmp_path)
    with pytest.raises(IbridError, match="holds no policy"):
        SmallPolicy(tmp_path / "nothing")


def test_the_shipped_weights_speak_this_version_s_language_and_are_small(context):
    folder = shipped_folder()
    policy = SmallPolicy()
    assert sum(path.stat().st_size for path in folder.iterdir()) < 8_000_000
    assert "never trained on" in (folder / "MODEL_CARD.md").read_text(encoding="utf-8")
    prompt = policy.prompt(context)
    parent = program_text(context.parent.diagram)
    answers = policy.sample([prompt], [context], 40, 0)[0]
    ends = [
        judge(policy.proposal(one, context), parent, "", context.study, lambda _: None).status
        for one in answers
    ]
    assert ends.count(Status.PENDING) >= 0.8 * len(ends)


def test_policies_are_chosen_by_name_and_mixed():
    ((policy, one), (rules, other)) = Proposers("policy:0.5,rules:0.5").weighted()
    assert (policy.name, rules.name) == ("policy", "rules")
    assert one == other == 0.5


def test_training_from_the_command_line_refuses_what_cannot_be(tmp_path, capsys):
    assert main(["policy"]) == 2
    assert "train" in capsys.readouterr().err
    assert main(["policy", "learn", "--out", str(tmp_path / "new")]) == 2
    assert "invalid choice" in capsys.readouterr().err
    assert main(["policy", "train", "--out", str(tmp_path / "new"), "--inverters", "3"]) == 2
    assert "40 inverters or more" in capsys.readouterr().err
    (tmp_path / "file").write_text("")
    assert main(["policy", "train", "--out", str(tmp_path)]) == 2
    assert "holds something already" in capsys.readouterr().err
    assert main(["policy", "train", "--out", str(tmp_path / "new"), "--resume"]) == 2
    assert "no training to resume" in capsys.readouterr().err
    assert main(["policy", "train", "--out", str(tmp_path / "new"), "--size", "huge"]) == 2
    assert "the size of a policy is small or large, found 'huge'" in capsys.readouterr().err
    assert main(["policy", "train", "--out", str(tmp_path / "new"), "--workers", "0"]) == 2
    assert "--workers" in capsys.readouterr().err
    assert not (tmp_path / "new").exists()


def test_a_whole_training_writes_a_policy_that_the_search_can_use(tmp_path, monkeypatch, examples):
    from dataclasses import replace

    from ibrid_policy import making
    from ibrid_policy.experience import shards

    def few(seed, number, families=None):
        del seed
        return [
            replace(one, inverter=number, family=families[0] if families else "")
            for one in examples[:3]
        ]

    monkeypatch.setattr(shards, "draw_examples", few)
    monkeypatch.setattr(making, "SIZES", {"small": TINY, "large": {**TINY, "num_hidden_layers": 3}})
    order = making.Order(40, 0, TrainingSettings(steps=3, batch=8))
    found = making.train_policy(tmp_path / "made", order, show="silent")
    assert found["other inverters"].questions > 0
    card = (tmp_path / "made" / "MODEL_CARD.md").read_text(encoding="utf-8")
    assert "| other inverters |" in card
    assert SmallPolicy(tmp_path / "made").model().config.hidden_size == TINY["hidden_size"]
    again = making.train_policy(tmp_path / "made", order, resume=True, show="silent")
    assert again == found
    with pytest.raises(IbridError, match="begun with other sizes"):
        making.train_policy(tmp_path / "made", replace(order, size="large"), resume=True)
    with pytest.raises(IbridError, match="begun with other training"):
        making.train_policy(
            tmp_path / "made", replace(order, training=TrainingSettings(steps=4)), resume=True
        )


def test_a_larger_policy_is_trained_by_its_size_and_its_card_says_so(
    tmp_path, monkeypatch, examples, capsys
):
    from ibrid_policy import making
    from ibrid_policy.experience import shards

    from ibrid.cli import main

    monkeypatch.setattr(shards, "draw_examples", lambda seed, number, families: iter(examples[:1]))
    monkeypatch.setattr(making, "MOST_QUESTIONS", 1)
    asked = ["--inverters", "40", "--steps", "1", "--size", "large", "--workers", "1"]
    assert main(["policy", "train", "--out", str(tmp_path / "made"), *asked]) == 0
    capsys.readouterr()
    card = (tmp_path / "made" / "MODEL_CARD.md").read_text(encoding="utf-8")
    assert "`ibrid policy train --inverters 40 --steps 1 --seed 0 --size large`" in card
    # 798 tokens x 256, in each of 6 layers 4 x 256^2 + 3 x 256 x 704 + 512, 256 at the end
    assert "5,024,512 parameters, hidden_size 256" in card
    assert SmallPolicy(tmp_path / "made").model().config.hidden_size == 256


def test_no_other_command_imports_torch():
    code = (
        "import sys; from ibrid_search.proposers.choose import Proposers;"
        "import ibrid_policy.interface, ibrid_policy.lessons;"
        "import ibrid.cli; ibrid.cli.parser(); Proposers('rules').weighted(); assert 'torch' not "
        "in sys.modules"
    )
    subprocess.run([sys.executable, "-c", code], check=True)
