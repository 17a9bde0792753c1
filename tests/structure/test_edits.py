"""SEARCH/REPLACE edits: what applies, what is refused and why, and that an edit made is the edit
read.
"""

import pickle

import pytest
from collecting import each_of
from counting import lines_run
from hypothesis import given, settings
from hypothesis import strategies as st
from ibrid_search.edits import EditError, apply_edit, edit_between, strip_thinking
from ibrid_search.step import Status

import ibrid
from ibrid.errors import IbridError
from ibrid.structure import program_text, textbook_names, textbook_text

PROGRAM = """\
def build(g):
    g.add("LFilter", "plant")
    g.add("Gain_dq", "gain", k=0.5)  # conductance

    g.connect("v_DQ", "plant.v_in")
    g.connect("v_DQ", "gain.in_")
    g.connect("gain.out", "plant.u_r")
    g.connect("plant.i_g", "i_DQ")
"""
PROGRAMS = [PROGRAM]
for name in textbook_names():
    PROGRAMS += [textbook_text(name), program_text(ibrid.textbook(name))]


def block(search: str, replace: str) -> str:
    return f"<<<<<<< SEARCH\n{search}\n=======\n{replace}\n>>>>>>> REPLACE\n"


def refusal(edit: str, program: str = PROGRAM) -> EditError:
    with pytest.raises(EditError) as found:
        apply_edit(edit, program)
    return found.value


GAIN = '    g.connect("v_DQ", "gain.in_")'
ERROR = '    g.connect("plant.e", "gain.in_")'
EXPECTED = PROGRAM.replace(GAIN, ERROR)


@each_of(
    "edit",
    [
        block(GAIN, ERROR),
        "I would measure the voltage elsewhere.\n\n" + block(GAIN, ERROR) + "\nThat is all.",
        "```python\n" + block(GAIN, ERROR) + "```\n",
        f"<<<<<<< SEARCH\n```python\n{GAIN}\n```\n=======\n```python\n{ERROR}\n```\n>>>>>>> "
        "REPLACE",
        block(GAIN, ERROR).replace("\n", "\r\n"),
        block(GAIN + "   ", ERROR),
        block(GAIN.strip(), ERROR.strip()),
        block("\t\t" + GAIN.strip(), "\t\t" + ERROR.strip()),
        block(GAIN, ERROR.strip()),
        block(f"\n\n{GAIN}\n\n", f"\n{ERROR}\n\n"),
        block(GAIN.replace('"', "'"), ERROR),
        block(GAIN.replace(", ", ","), ERROR),
        block(GAIN.replace(", ", " ,  "), ERROR),
        block(GAIN + "  # the voltage at the terminals", ERROR),
        "\n".join("  " + line for line in block(GAIN, ERROR).split("\n")),
        f"<<<<< SEARCH\n{GAIN}\n=====\n{ERROR}\n>>>>> REPLACE",
        f"<<<<<<<<< search\n{GAIN}\n=========\n{ERROR}\n>>>>>>>>>",
    ],
)
def test_spacing_quotes_fences_and_markers_of_other_lengths_are_overlooked(edit):
    assert apply_edit(edit, PROGRAM) == EXPECTED


def test_a_line_is_found_without_its_comment_and_blank_lines_between():
    search = '    g.add("Gain_dq", "gain", k=0.5)\n    g.connect("v_DQ", "plant.v_in")'
    edited = apply_edit(block(search, '    g.connect("v_DQ", "plant.v_in")'), PROGRAM)
    assert edited == PROGRAM.replace('    g.add("Gain_dq", "gain", k=0.5)  # conductance\n\n', "")


def test_a_statement_at_the_margin_takes_the_indentation_of_its_place():
    edited = apply_edit(
        block(GAIN, 'g.add("PI_dq", "current")\ng.connect("plant.i_g", "current.in_")'), PROGRAM
    )
    assert '    g.add("PI_dq", "current")\n    g.connect("plant.i_g", "current.in_")\n' in edited
    ibrid.parse_program(edited)


def test_blocks_apply_in_order_to_what_the_one_before_left():
    edit = block(GAIN, '    g.add("Negate_dq", "minus")') + block(
        '    g.add("Negate_dq", "minus")', ERROR
    )
    assert apply_edit(edit, PROGRAM) == EXPECTED


def test_a_block_that_fails_undoes_the_ones_before():
    error = refusal(block(GAIN, ERROR) + block('    g.add("PLL", "pll")', ""))
    assert error.status is Status.NO_MATCH
    assert str(error).startswith("block 2: ")


def test_an_empty_search_appends_at_the_end():
    assert (
        apply_edit(block("", 'g.add("ConstZero", "zero")'), PROGRAM)
        == PROGRAM + '    g.add("ConstZero", "zero")\n'
    )


def test_an_empty_replace_removes_the_lines():
    assert apply_edit(
        f"<<<<<<< SEARCH\n{GAIN}\n=======\n>>>>>>> REPLACE", PROGRAM
    ) == PROGRAM.replace(GAIN + "\n", "")


def test_what_does_not_match_is_named_with_the_nearest_line_of_the_program():
    error = refusal(block('    g.connect("gain.out", "plant.u")', ""))
    assert error.status is Status.NO_MATCH
    assert '`g.connect("gain.out", "plant.u")` is not in the program' in str(error)
    assert 'line 7 of the program, `g.connect("gain.out", "plant.u_r")`, is the nearest' in str(
        error
    )


def test_lines_that_are_there_but_apart_are_named_as_such():
    error = refusal(block(f"{GAIN}\n    g.connect('plant.i_g', 'i_DQ')", ""))
    assert error.status is Status.NO_MATCH
    assert "not one after another" in str(error)
    assert "line 6" in str(error)


def test_a_text_that_is_there_twice_is_refused_with_its_lines():
    error = refusal(block(GAIN, ERROR), PROGRAM + GAIN + "\n")
    assert error.status is Status.AMBIGUOUS
    assert "at lines 6, 9" in str(error)


@each_of(
    ("edit", "says"),
    [
        ("", "found none"),
        ("Replace the gain by a current loop.", "found none"),
        (f"<<<<<<< SEARCH\n{GAIN}\n", "needs a line ======= next, but the answer ends there"),
        (
            f"<<<<<<< SEARCH\n{GAIN}\n=======\n{ERROR}\n",
            "needs a line >>>>>>> REPLACE next, but the answer ends there",
        ),
        (block(GAIN, ERROR) + "<<<<<<< SEARCH\n", "begins in line 6"),
        (
            f"<<<<<<< SEARCH\n{GAIN}\n<<<<<<< SEARCH\n{GAIN}\n=======\n",
            "line 3 is `<<<<<<< SEARCH`",
        ),
        (block(GAIN, f"{ERROR}\n======="), "line 5 is `=======`"),
        (block(GAIN, ERROR) * 101, "found 101"),
    ],
)
def test_an_answer_without_a_whole_block_says_what_is_missing(edit, says):
    error = refusal(edit)
    assert error.status is Status.NO_EDIT
    assert says in str(error)


@pytest.mark.slow
@each_of(
    "edit",
    [
        "x" * 10_000_000,
        "<" * 10_000_000,
        "<<<<<<< SEARCH\n" * 6_000,
        " \n" * 49_000,
        "=" * 99_000,
        block("a\n" * 40_000, "b"),
        block("\n".join('g.add("LFilter", "plant")' for _ in range(3_000)), "b"),
        block("    " * 24_000, "") + "<<<<<<< SEARCH",
        "<<<<<<< SEARCH " * 6_000,
    ],
)
def test_the_work_to_refuse_a_hostile_answer_grows_with_its_lines_alone(edit):
    refused = []
    work = lines_run(lambda: refused.append(refusal(edit)))
    assert work < 30 * (
        edit.count("\n") + 10
    )  # each line is scanned, and looked for in the program, by some 20 of ours
    assert len(str(refused[0])) < 500


def test_a_refusal_is_an_error_of_ibrid_and_survives_pickling():
    error = pickle.loads(pickle.dumps(refusal("")))
    assert (error.status, str(error)) == (Status.NO_EDIT, str(refusal("")))
    assert isinstance(error, IbridError)


def test_an_edit_made_of_a_program_that_looks_like_an_edit_is_refused():
    with pytest.raises(EditError, match="reads as a marker"):
        edit_between(PROGRAM, PROGRAM.replace(GAIN, "======="))


LINES = st.sampled_from(
    sorted({line for text in PROGRAMS for line in text.splitlines()} | {"", "    # a comment"})
)
MUTATIONS = st.lists(
    st.tuples(
        st.sampled_from(["insert", "delete", "replace", "double", "swap"]),
        st.integers(0, 60),
        LINES,
    ),
    max_size=8,
)


def mutated(text: str, mutations: list[tuple[str, int, str]]) -> str:
    lines = text.splitlines()
    for word, place, line in mutations:
        at = place % len(lines)
        other = (place * 7 + 3) % len(lines)
        if word == "swap":
            lines[at], lines[other] = lines[other], lines[at]
        elif word == "delete" and len(lines) > 1:
            del lines[at]
        else:
            new = {"insert": [line, lines[at]], "double": [lines[at]] * 2, "replace": [line]}.get(
                word, [lines[at]]
            )
            lines[at : at + 1] = new
    return "\n".join(lines) + "\n"


@pytest.mark.slow
@settings(max_examples=300)
@given(st.sampled_from(PROGRAMS), MUTATIONS, st.sampled_from([*PROGRAMS, None]), MUTATIONS)
def test_an_edit_between_two_programs_turns_the_first_into_the_second(
    first, changes, other, further
):
    before = mutated(first, changes)
    after = mutated(other if other is not None else before, further)
    edit = edit_between(before, after)
    assert (edit == "") == (before == after)
    if edit:
        assert apply_edit(edit, before) == after


def test_an_edit_is_small():
    edit = edit_between(PROGRAM, EXPECTED)
    assert edit == block(GAIN, ERROR)


def test_the_work_to_make_an_edit_grows_with_the_lines_of_the_program():
    before, after = (
        program_text(ibrid.textbook(name)) for name in ("gfl_exact", "gfl_pll_filter_exact")
    )
    work = lines_run(lambda: edit_between(before, after))
    comments = "    # nothing\n" * 1_000
    longer = lines_run(lambda: edit_between(comments + before, comments + after))
    assert work < 50 * before.count("\n")  # some 25 a line, most of it in difflib
    assert (
        longer - work < 20 * 1_000
    )  # what is equal at the beginning is passed over, by some 8 a line


@each_of(
    ("answer", "thinking", "rest"),
    [
        ("no tags", "", "no tags"),
        ("<think>why</think>edit", "<think>why</think>", "edit"),
        ("why</think>edit", "why</think>", "edit"),
        ("<think>a</think>b<think>c</think>d", "<think>a</think>b<think>c</think>", "d"),
        ("<think>never ends", "<think>never ends", ""),
        ("a</think>b<think>c", "a</think>b<think>c", ""),
        ("<thinking>a</thinking>b", "<thinking>a</thinking>", "b"),
        ("", "", ""),
    ],
)
def test_thinking_is_set_apart_from_the_answer(answer, thinking, rest):
    assert strip_thinking(answer) == (thinking, rest)


def test_an_edit_within_the_thinking_is_never_applied():
    _, rest = strip_thinking("<think>\n" + block(GAIN, ERROR) + "</think>\nI am not sure.")
    assert refusal(rest).status is Status.NO_EDIT
