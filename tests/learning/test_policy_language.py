"""The language of the policy says every diagram and every edit exactly, and its grammar lets
nothing else through.
"""

import json
from dataclasses import replace

import numpy as np
import pytest
import random_diagrams
from collecting import each_of
from ibrid_policy.diagram_words import diagram_words
from ibrid_policy.edit import NumberedEdit, difference, made
from ibrid_policy.edit_words import edit_words, read_edit
from ibrid_policy.grammar import LONGEST, Grammar
from ibrid_policy.numbering import numbered
from ibrid_policy.tokens import END, TOKENS, UNKNOWN, LanguageError
from ibrid_policy.weights_folder import shipped_folder
from ibrid_search.edits import apply_edit, edit_between
from random_diagrams import random_legal_diagram, renamed_and_reordered
from read_words import diagram_of

from ibrid.modules.vocabulary import PAPER_VOCABULARY, VOCABULARY
from ibrid.signals import Signal
from ibrid.structure.compiling.canonical import structure_hash
from ibrid.structure.compiling.check import violations
from ibrid.structure.diagrams.diagram import Diagram
from ibrid.structure.diagrams.library import textbook
from ibrid.structure.diagrams.program import parse_program, program_text
from ibrid.structure.editing.drafting import Draft

SINGLE = (
    "naive",
    "gfl",
    "gfl_exact",
    "gfl_pll_filter",
    "gfl_pll_filter_exact",
    "gfl_power_filter",
    "gfl_delay",
    "gfl_l_filter",
    "gfl_l_filter_delay",
    "gfl_dc_link",
    "gfm_droop",
    "gfm_vsm",
    "gfm_dvoc",
    "hybrid_gfl_gfm",
)


@pytest.fixture
def without_numbers(monkeypatch):
    """Random diagrams that share parameters, but fix and bound none: the language has no
    numbers.
    """
    drawn = random_diagrams._bindings

    def shared_alone(*arguments):
        return {key: value for key, value in drawn(*arguments).items() if isinstance(value, str)}

    monkeypatch.setattr(random_diagrams, "_bindings", shared_alone)


def said(diagram: Diagram) -> list[int]:
    return TOKENS.encode(diagram_words(numbered(diagram, VOCABULARY)))


def same(one: Diagram, other: Diagram) -> bool:
    return structure_hash(one) == structure_hash(other)


def there(parent: Diagram, child: Diagram) -> list[str]:
    """The words of the edit from one to the other, after a check that they say it exactly."""
    view = numbered(parent, VOCABULARY)
    edit = difference(view, child, VOCABULARY)
    words = edit_words(edit, view, VOCABULARY)
    assert TOKENS.decode(TOKENS.encode(words)) == words
    assert read_edit(words, view, VOCABULARY) == edit
    assert same(made(view, edit, VOCABULARY), child)
    return words


def test_no_word_stands_for_two_things():
    assert len(set(TOKENS.words)) == len(TOKENS)


def test_the_tokens_are_those_of_the_shipped_weights_whatever_the_vocabulary_has_become():
    frozen = (shipped_folder() / "vocabulary.json").read_text(encoding="utf-8")
    assert list(TOKENS.words) == json.loads(frozen)


def test_a_kind_without_a_word_is_read_as_unknown_and_its_words_are_never_offered():
    known = next(kind for kind in VOCABULARY if kind.name == "PQ_calc")
    mine = replace(
        known,
        name="MyPower",
        outputs={"active": Signal.SCALAR, "reactive": Signal.SCALAR},
        large_signal=None,
    )
    kinds = (*VOCABULARY, mine)
    text = program_text(textbook("gfl_exact")).replace('"PQ_calc"', '"MyPower"')
    view = numbered(
        parse_program(text.replace("power.p", "power.active").replace("power.q", "power.reactive")),
        kinds,
    )
    words = diagram_words(view)
    strange = [word for word in words if word not in TOKENS.ids]
    assert set(strange) == {"K:MyPower", ".active", ".reactive"}
    assert TOKENS.read(words).count(TOKENS.ids[UNKNOWN]) == len(strange)
    rng = np.random.default_rng(0)
    for _ in range(50):
        grammar = Grammar(view, VOCABULARY)
        while not grammar.ended and len(grammar.words) < 40:
            assert not {UNKNOWN, *strange} & set(grammar.allowed)
            grammar.take(str(rng.choice(grammar.allowed)))


@each_of("name", [*SINGLE, "parallel_gfl_gfm"])
def test_a_textbook_diagram_can_be_said_and_read_back(name):
    diagram = textbook(name)
    words = TOKENS.decode(said(diagram))
    assert same(diagram_of(words, VOCABULARY), diagram)


def test_words_of_a_diagram_follow_from_its_structure_alone(without_numbers):
    rng = np.random.default_rng(1)
    for _ in range(40):
        diagram = random_legal_diagram(rng)
        assert said(renamed_and_reordered(diagram, rng)) == said(diagram)


def test_random_diagrams_and_the_edits_between_them_are_said_exactly(without_numbers):
    rng = np.random.default_rng(0)
    before = textbook("naive")
    for _ in range(200):
        diagram = random_legal_diagram(rng)
        assert same(diagram_of(TOKENS.decode(said(diagram)), VOCABULARY), diagram)
        there(before, diagram)
        before = diagram


@each_of("name", SINGLE)
def test_the_edit_from_any_textbook_diagram_to_any_other_is_said_exactly(name):
    for other in SINGLE:
        if other != name:
            there(textbook(name), textbook(other))


def test_an_edit_of_two_devices_behind_one_pcc_is_said_exactly():
    parent = textbook("parallel_gfl_gfm")
    draft = Draft(parent, VOCABULARY)
    draft.bypass(draft.named("LPF1")[0])
    there(parent, draft.diagram())


def test_a_filter_put_in_takes_few_words():
    before, after = textbook("gfl_exact"), textbook("gfl_pll_filter_exact")
    assert (
        len(there(before, after)) == 16
    )  # ADD number kind, AT input + output port, AT input - output port + output, end


def test_the_edit_as_blocks_of_text_leads_to_the_same_structure():
    parent, child = textbook("gfl"), textbook("gfm_droop")
    view = numbered(parent, VOCABULARY)
    found = made(view, difference(view, child, VOCABULARY), VOCABULARY)
    blocks = edit_between(program_text(parent), program_text(found))
    assert same(parse_program(apply_edit(blocks, program_text(parent))), child)


def test_sharing_is_part_of_an_edit():
    text = program_text(textbook("gfl"))
    freed = parse_program(text.replace(', kP="power.kP", kI="power.kI"', ""))
    assert there(textbook("gfl"), freed)[0] == "OWN"
    assert there(freed, textbook("gfl"))[0] == "SAME"
    half = parse_program(text.replace(', kI="power.kI"', ""))
    assert there(freed, half)[0] == "TIE"
    assert there(half, freed)[0] == "OWN"


def test_modules_with_fixed_numbers_stay_as_they_are():
    text = 'def build(g):\n    g.add("LFilter", "plant", L_F=0.2)\n' + "\n".join(
        program_text(textbook("naive")).splitlines()[2:]
    )
    fixed = parse_program(text + "\n")
    assert "FIXED" in diagram_words(numbered(fixed, VOCABULARY))
    view = numbered(fixed, VOCABULARY)
    words = [
        "ADD",
        "#3",
        "K:LPF1_dq",
        "AT",
        "#3",
        "+",
        "v_DQ",
        "AT",
        "#1",
        "-",
        "v_DQ",
        "+",
        "#3",
        END,
    ]
    child = made(view, read_edit(words, view, VOCABULARY), VOCABULARY)
    assert [one.bindings for one in child.instances if one.name == "plant"] == [{"L_F": 0.2}]
    with pytest.raises(LanguageError, match="no fixed numbers"):
        difference(numbered(textbook("naive"), VOCABULARY), fixed, VOCABULARY)


def walked(view, kinds, rng: np.random.Generator) -> NumberedEdit | None:
    """An edit drawn by chance from the grammar; None when it comes to no end."""
    grammar = Grammar(view, kinds)
    for _ in range(LONGEST):
        words = grammar.allowed
        word = END if END in words and rng.random() < 0.5 else words[int(rng.integers(len(words)))]
        grammar.take(word)
        if grammar.ended:
            return grammar.edit
    return None


@pytest.mark.parametrize("kinds", [PAPER_VOCABULARY, VOCABULARY], ids=["paper", "extended"])
def test_whatever_the_grammar_allows_is_wired_and_typed_as_it_should_be(kinds):
    rng = np.random.default_rng(2)
    equilibrium = "paper" if kinds is PAPER_VOCABULARY else "exact"
    found = 0
    for name in ("naive", "gfl_pll_filter"):
        view = numbered(textbook(name), kinds, equilibrium=equilibrium)
        for _ in range(80):
            edit = walked(view, kinds, rng)
            if edit is None:
                continue
            found += 1
            child = made(view, edit, kinds)
            reasons = {one.reason for one in violations(child, kinds, equilibrium=equilibrium)}
            # what a mask would have to solve the diagram for
            assert reasons <= {"algebraic_loop", "equilibrium", "shared_box"}
    assert found > 120


def test_the_paper_s_vocabulary_masks_the_kinds_beyond_it():
    view = numbered(textbook("gfl"), PAPER_VOCABULARY, equilibrium="paper")
    grammar = Grammar(view, PAPER_VOCABULARY)
    grammar.take("ADD")
    grammar.take(f"#{len(view.kinds)}")
    assert "K:LPF1" in grammar.allowed
    assert not {"K:Delay", "K:JMul_omega"} & set(grammar.allowed)


def test_an_answer_may_not_end_while_an_input_is_undriven_or_a_rotation_alone():
    view = numbered(textbook("naive"), VOCABULARY)
    grammar = Grammar(view, VOCABULARY)
    for word in ("ADD", "#3", "K:Rot_v"):
        grammar.take(word)
    assert grammar.allowed == ["ADD"]
    for word in ("ADD", "#4", "K:Rot_i"):
        grammar.take(word)
    assert END not in grammar.allowed
    with pytest.raises(LanguageError, match="may not follow"):
        grammar.take(END)


def test_only_outputs_of_the_right_signal_may_be_wired():
    view = numbered(textbook("gfl"), VOCABULARY)
    grammar = Grammar(view, VOCABULARY)
    pll = next(f"#{number}" for number, kind in enumerate(view.kinds) if kind.name == "SRF_PLL")
    for word in ("AT", pll, "+"):
        grammar.take(word)
    scalar = {
        f"#{number}"
        for number, kind in enumerate(view.kinds)
        if "scalar" in map(str, kind.outputs.values())
    }
    assert set(grammar.allowed) <= scalar


def test_the_end_is_not_allowed_before_anything_has_changed():
    assert END not in Grammar(numbered(textbook("gfl"), VOCABULARY), VOCABULARY).allowed
