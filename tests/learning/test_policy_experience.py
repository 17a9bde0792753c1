"""Experience for the policy: plausible inverters, taken apart step by step, each example a damaged
parent and its repair.
"""

import contextlib
import importlib.util
import itertools
import json
from pathlib import Path

import numpy as np
import pytest
from ibrid_bench.search.inverters import inverter, inverter_names, true_programs
from ibrid_policy.experience.barred import BARRED
from ibrid_policy.experience.choices import PARTS, apart, consistent, in_the_paper
from ibrid_policy.experience.damage import legal, merged, spoiled, taken_apart
from ibrid_policy.experience.drawn_diagram import drawn_diagram
from ibrid_policy.experience.examples import (
    BRIEF,
    SETTINGS,
    Example,
    draw_examples,
    held_out_family,
)
from ibrid_policy.experience.inverter import draw_inverter, drawn_choices
from ibrid_policy.experience.shards import (
    IN_A_SHARD,
    Processes,
    RayCluster,
    make_shards,
    read_shards,
    shard_path,
)
from ibrid_policy.lessons import batches, lesson_of, lessons_of, scale_of, weight_of
from ibrid_policy.record_words import residual_words, sector, size_level, total_level
from ibrid_policy.residual import ResidualMeans, residual_of
from ibrid_policy.tokens import TOKENS

from ibrid.errors import IbridError
from ibrid.evaluation.evaluate import evaluate
from ibrid.measurement.read import read_sweep
from ibrid.modules.vocabulary import PAPER_VOCABULARY, VOCABULARY
from ibrid.plants.benchmarks import benchmarks
from ibrid.structure.compiling.canonical import structure_hash
from ibrid.structure.diagrams.library import textbook
from ibrid.structure.diagrams.program import parse_program

BENCHMARK = {
    "filter": "LCL",
    "frame": "pll",
    "pll filter": "low-pass",
    "current": "converter",
    "p": "power",
    "q": "power",
    "same gains": "yes",
    "feedforward": "unit",
    "decoupling": "measured",
}


@pytest.fixture(scope="module")
def examples() -> list[Example]:
    """Of two inverters, one in each setting."""
    found: dict[str, list[Example]] = {}
    number = 0
    while len(found) < 2:
        drawn = list(draw_examples(11, number))
        found.setdefault(drawn[0].setting, drawn) if drawn else None
        number += 1
    return [one for group in found.values() for one in group]


def test_no_choice_at_all_is_the_naive_start():
    assert structure_hash(drawn_diagram({}, VOCABULARY)) == structure_hash(textbook("naive"))


def test_choices_draw_the_textbook_structures():
    assert structure_hash(drawn_diagram(BENCHMARK, VOCABULARY)) == structure_hash(
        textbook("gfl_pll_filter_exact")
    )
    printed = drawn_diagram(in_the_paper(BENCHMARK), PAPER_VOCABULARY)
    assert structure_hash(printed, "paper", equilibrium="paper") == structure_hash(
        textbook("gfl_pll_filter"), "paper", equilibrium="paper"
    )


def test_every_consistent_choice_is_a_legal_diagram_in_both_vocabularies():
    rng = np.random.default_rng(0)
    seen = set()
    for _ in range(150):
        drawn = {
            part: str(rng.choice(variants))
            for part, variants in PARTS.items()
            if rng.random() < 0.5
        }
        for setting in SETTINGS:
            chosen = in_the_paper(drawn) if setting.name == "paper" else consistent(drawn)
            diagram = drawn_diagram(chosen, setting.kinds)
            assert legal(diagram, setting.kinds, setting.equilibrium), chosen
            seen.add(structure_hash(diagram, setting.kinds, equilibrium=setting.equilibrium))
    assert len(seen) > 200


def test_drawn_inverters_are_stable_and_their_diagram_fits_their_sweep_exactly():
    rng = np.random.default_rng(3)
    inverter = None
    while inverter is None or inverter.sweep.points[0].sigma is not None:
        inverter = draw_inverter(rng, {**BENCHMARK, "delay": "command"})
    known = {point.op.name: inverter.values for point in inverter.sweep.points}
    record = evaluate(inverter.diagram, inverter.sweep, settings=BRIEF, warm=known)
    assert record.nrmse is not None
    assert (
        record.nrmse < 1e-6
    )  # the assembly that drew the sweep and the fit use the same exact delay
    assert all(record.stable.values())


def test_an_inverter_is_taken_apart_down_to_nothing_one_part_after_the_other():
    rng = np.random.default_rng(4)
    for _ in range(30):
        whole = drawn_choices(rng)
        chain = taken_apart(rng, whole, paper=False)
        assert chain[0] == whole
        assert chain[-1] == {}
        for before, after in itertools.pairwise(chain):
            assert apart(before, after)
            # what is gone but for one part hung on that part
            lost = [part for part in apart(before, after) if part not in after]
            assert (
                len(lost) <= 1
                or consistent({p: v for p, v in before.items() if p != lost[0]}) != before
            )


def test_a_slip_changes_a_diagram_and_leaves_it_legal():
    rng = np.random.default_rng(5)
    diagram = drawn_diagram(BENCHMARK, VOCABULARY)
    for _ in range(20):
        slip = spoiled(rng, diagram, VOCABULARY, "exact")
        if slip is not None:
            assert legal(slip, VOCABULARY, "exact")


def test_a_slip_can_be_carried_over_to_a_repaired_diagram():
    base, better = (
        drawn_diagram({"filter": "LCL"}, VOCABULARY),
        drawn_diagram({"filter": "LCL", "shunt": "RC"}, VOCABULARY),
    )
    slip = parse_program(
        'def build(g):\n    g.add("LCL", "plant")\n    g.add("Gain_dq", "gain")\n    '
        'g.add("Negate_dq", "turned")\n'
        '    g.add("ConstZero", "no_frequency")\n    g.connect("v_DQ", "plant.v_in")\n    '
        'g.connect("v_DQ", "gain.in_")\n'
        '    g.connect("gain.out", "turned.in_")\n    g.connect("turned.out", "plant.u_r")\n'
        '    g.connect("no_frequency.out", "plant.delta_omega")\n    g.connect("plant.i_g", '
        '"i_DQ")\n'
    )
    both = merged(base, slip, better)
    assert both is not None
    assert {one.kind for one in both.instances} == {
        "LCL",
        "Gain_dq",
        "Negate_dq",
        "ConstZero",
        "Shunt_RC",
    }
    assert legal(both, VOCABULARY, "exact")


def test_the_structures_of_all_benchmark_inverters_are_kept_from_training():
    diagrams = [textbook("gfl_pll_filter"), *map(parse_program, true_programs())]
    found = {
        structure_hash(one, setting.kinds, equilibrium=setting.equilibrium)
        for one in diagrams
        for setting in SETTINGS
        if legal(one, setting.kinds, setting.equilibrium)
    }
    assert found == BARRED, (
        "BARRED in search/policy/ibrid_policy/experience/barred.py lacks or has too many"
    )
    for name in inverter_names():
        assert structure_hash(inverter(name).truth, VOCABULARY, equilibrium="exact") in BARRED, name
    printed = textbook("gfl_pll_filter")
    for one in (textbook("gfl_pll_filter_exact"), printed):
        assert structure_hash(one, VOCABULARY, equilibrium="exact") in BARRED
    assert structure_hash(printed, PAPER_VOCABULARY, equilibrium="paper") in BARRED
    assert structure_hash(textbook("naive"), VOCABULARY, equilibrium="exact") not in BARRED


def test_examples_repeat_and_none_has_a_benchmark_s_structure(examples):
    first = examples[0]
    again = next(draw_examples(11, first.inverter))
    assert (again.parent, again.child, again.error) == (first.parent, first.child, first.error)
    for one in examples:
        setting = next(each for each in SETTINGS if each.name == one.setting)
        for text in (one.parent, one.child):
            diagram = parse_program(text)
            assert legal(diagram, setting.kinds, setting.equilibrium)
            assert (
                structure_hash(diagram, setting.kinds, equilibrium=setting.equilibrium)
                not in BARRED
            )
        assert held_out_family({}) == one.family


def test_held_out_families_are_drawn_only_when_asked_for():
    assert held_out_family({"frame": "hybrid"}) == "hybrid"
    assert held_out_family({"p": "dc link", "q": "magnitude"}) == "dc link with voltage control"
    assert held_out_family(BENCHMARK) == ""
    (first, *_) = draw_examples(0, 0, families=("oscillator",))
    assert first.family == "oscillator"


def test_examples_become_lessons_whose_answer_is_the_repair(examples):
    lessons = lessons_of(examples)
    assert sum(len(one.answers) for one in lessons) > 0.8 * len(examples)
    for example in examples[:20]:
        lesson = lesson_of(example)
        if lesson is None:  # an answer that is too long
            continue
        assert TOKENS.words[lesson.question[-1]] == "<edit>"
        (answer,) = lesson.answers
        assert TOKENS.words[lesson.question[-2]] == f"scale:{answer.scale}"
        assert TOKENS.words[answer.tokens[-1]] == "<end>"
        assert 0 <= weight_of(example) <= 1


def test_what_gains_nothing_counts_little():
    base = {
        "parent": "",
        "child": "",
        "residual": None,
        "setting": "paper",
        "error": 1.0,
        "inverter": 0,
        "family": "",
    }
    useless = Example(**base, what="part", gain=0.0)
    useful = Example(**base, what="part", gain=1.0)
    assert weight_of(useless) == pytest.approx(0.05)
    assert weight_of(useful) > 0.95


def test_a_batch_asks_for_the_tokens_of_the_answers_alone(examples):
    lessons = [one for one in lessons_of(examples) if len(one.answers) > 1][:4]
    (batch,) = batches(lessons, 8, np.random.default_rng(0), blurred=False)
    wanted = sorted(
        tuple(token for answer in one.answers for token in answer.tokens) for one in lessons
    )
    assert sorted(tuple(row[row >= 0]) for row in batch.target) == wanted


def test_answers_to_one_question_do_not_see_each_other(examples):
    lesson = next(one for one in lessons_of(examples) if len(one.answers) > 1)
    (batch,) = batches([lesson], 1, np.random.default_rng(0), blurred=False)
    asked = len(lesson.question) - 1
    for number in range(1, len(lesson.answers) + 1):
        rows = np.nonzero(batch.part[0] == number)[0]
        assert (batch.position[0, rows] == asked + np.arange(len(rows))).all()
        for row in rows:
            seen = np.nonzero(batch.sees[0, 0, row])[0]
            assert set(batch.part[0, seen]) == {0, number}
            assert len(seen) == batch.position[0, row] + 1


def test_blurred_batches_repeat_with_their_seed(examples):
    lessons = lessons_of(examples)
    one, other = (list(batches(lessons, 8, np.random.default_rng(7))) for _ in range(2))
    assert all((a.tokens == b.tokens).all() for a, b in zip(one, other, strict=True))


def test_a_residual_survives_json_and_says_the_same_words():
    sweep = read_sweep(benchmarks()["paper_like"])
    residual = residual_of(evaluate(textbook("naive"), sweep, settings=BRIEF), sweep)
    again = ResidualMeans.from_json(json.loads(json.dumps(residual.to_json())))
    assert residual_words(again) == residual_words(residual)
    TOKENS.encode(residual_words(residual))


def test_a_model_of_half_the_size_has_a_residual_opposite_to_the_measurement():
    sweep = read_sweep(benchmarks()["paper_like"])
    record = evaluate(textbook("naive"), sweep, settings=BRIEF)
    residual = residual_of(record, sweep)
    assert residual.total == record.nrmse
    # the naive start explains nearly nothing: the residual is nearly minus the measurement where
    # that is large
    place = np.unravel_index(np.nanargmax(residual.size), residual.size.shape)
    assert sector(residual.turn[place]) == 4
    assert residual.error[place] == pytest.approx(record.nrmse_by_entry["dd"], abs=0.2)


def test_levels_grow_with_what_they_count():
    assert total_level(1e-9) == 0
    assert total_level(0.978) == 19  # 5 log10(0.978) = -0.05
    assert [size_level(one) for one in (1e-3, 1.0, 100.0)] == [0, 6, 10]
    assert [sector(one) for one in (1, 1j, -1, -1j)] == [0, 2, 4, 6]


def test_scales_follow_from_what_an_edit_touches(examples):
    from ibrid_policy.edit import NumberedEdit
    from ibrid_policy.numbering import numbered

    view = numbered(textbook("gfl"), VOCABULARY)
    assert scale_of(NumberedEdit(), view) == "local"
    assert scale_of(NumberedEdit(added=("LPF1",)), view) == "module"
    plant = next(number for number, kind in enumerate(view.kinds) if kind.name == "LCL")
    assert scale_of(NumberedEdit(swapped=((plant, "LFilter"),)), view) == "structural"


def test_shards_are_made_once_and_read_back(tmp_path, monkeypatch, examples):
    from ibrid_policy.experience import shards

    monkeypatch.setattr(shards, "draw_examples", lambda seed, number, families: iter(examples[:2]))
    assert list(make_shards(tmp_path, 0, range(2), Processes(1))) == [
        (0, 2 * IN_A_SHARD),
        (1, 2 * IN_A_SHARD),
    ]
    assert list(make_shards(tmp_path, 0, range(3), Processes(1))) == [(2, 2 * IN_A_SHARD)]
    with pytest.raises(
        IbridError, match=r"shard_00007.jsonl: is missing; run ibrid policy train again"
    ):
        list(read_shards(tmp_path, [0, 7]))
    (tmp_path / "shard_00007.jsonl").write_bytes(b"\xff\xfe")
    with pytest.raises(IbridError, match=r"shard_00007.jsonl: cannot be read; delete it"):
        list(read_shards(tmp_path, [7]))
    back = list(read_shards(tmp_path, [0]))
    assert [one.parent for one in back[:2]] == [one.parent for one in examples[:2]]


class Elsewhere:
    """A crew whose processes have a disk of their own: there the path of a folder means another
    place.
    """

    def __init__(self, place):
        self.place = place

    def work(self, task, arguments):
        for one in arguments:
            with contextlib.chdir(self.place):
                done = task(*one)
            yield one, done


def test_shards_made_on_other_machines_are_written_on_this_one(tmp_path, monkeypatch, examples):
    from ibrid_policy.experience import shards

    monkeypatch.setattr(shards, "draw_examples", lambda seed, number, families: iter(examples[:2]))
    here, there = tmp_path / "here", tmp_path / "there"
    for one in (here, there):
        one.mkdir()
    monkeypatch.chdir(here)
    folder = Path("experience")
    assert list(make_shards(folder, 0, range(2), Elsewhere(there))) == [
        (0, 2 * IN_A_SHARD),
        (1, 2 * IN_A_SHARD),
    ]
    assert len(list(read_shards(folder, range(2)))) == 4 * IN_A_SHARD
    assert not list(there.iterdir())
    made = [shard_path(folder, one).read_bytes() for one in range(2)]
    list(make_shards(Path("again"), 0, range(2), Processes(1)))
    assert made == [shard_path(Path("again"), one).read_bytes() for one in range(2)]


def test_a_ray_cluster_sends_its_shards_back_here(tmp_path, monkeypatch, examples):
    if importlib.util.find_spec("ray") is None:
        pytest.skip("Ray is not installed (pip install 'ibrid[ray]')")
    from ibrid_policy.experience import shards
    from ibrid_search.evaluation.ray_session import open_session

    few = [one.to_json() for one in examples[:2]]
    monkeypatch.setattr(
        shards, "draw_examples", lambda seed, number, families: map(Example.from_json, few)
    )
    monkeypatch.chdir(tmp_path)
    session = open_session(1)
    try:
        session.ray.cloudpickle.register_pickle_by_value(shards)  # workers draw these two as well
        assert list(make_shards(Path("experience"), 0, range(2), RayCluster())) == [
            (0, 20),
            (1, 20),
        ]
    finally:
        session.ray.cloudpickle.unregister_pickle_by_value(shards)
        session.close()
    list(make_shards(Path("again"), 0, range(2), Processes(1)))
    for shard in range(2):
        assert (
            shard_path(Path("experience"), shard).read_bytes()
            == shard_path(Path("again"), shard).read_bytes()
        )
