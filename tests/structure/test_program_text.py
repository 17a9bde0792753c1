"""Program text: read, printed, read again; anything else is refused in one sentence, and nothing is
executed.
"""

import builtins
import os
from contextlib import contextmanager
from unittest.mock import patch

import numpy as np
import pytest
from collecting import each_of
from hypothesis import given, settings
from hypothesis import strategies as st
from random_diagrams import random_legal_diagram

from ibrid.errors import DiagramError, ProgramError
from ibrid.structure import (
    Diagram,
    parse_program,
    program_text,
    read_program,
    textbook_names,
    textbook_text,
    violations,
)
from ibrid.structure.diagrams.program import LONGEST_PROGRAM

HEAD = "def f(g):\n"


@contextmanager
def nothing_executed():
    """Fail when the body compiles, evaluates, imports or opens anything."""

    def refuse(*arguments, **_):
        raise AssertionError(f"called with {arguments!r:.100}")

    with (
        patch.object(builtins, "exec", refuse),
        patch.object(builtins, "eval", refuse),
        patch.object(builtins, "compile", refuse),
        patch.object(builtins, "__import__", refuse),
        patch.object(builtins, "open", refuse),
        patch.object(os, "system", refuse),
    ):
        yield


def read_safely(text: str) -> Diagram | str:
    """The diagram, or the one-line sentence of the ProgramError."""
    with nothing_executed():
        try:
            return parse_program(text, "p.py")
        except ProgramError as error:
            sentence = str(error)
    assert sentence.startswith("p.py")
    assert "\n" not in sentence
    assert len(sentence) < 600
    return sentence


def body(line: str) -> str:
    return f"{HEAD}    {line}\n"


@each_of("name", textbook_names())
def test_a_printed_textbook_program_reads_back_equal(name):
    diagram = parse_program(textbook_text(name))
    assert parse_program(program_text(diagram)) == diagram


@pytest.mark.slow
@settings(max_examples=60)
@given(st.integers(0, 2**32 - 1))
def test_a_printed_random_diagram_reads_back_equal(seed):
    diagram = random_legal_diagram(np.random.default_rng(seed))
    assert parse_program(program_text(diagram)) == diagram


finite = st.floats(allow_nan=False, allow_infinity=False)
words = st.from_regex(r"[A-Za-z_][A-Za-z0-9_]{0,20}", fullmatch=True).filter(
    lambda word: word != "line"
)
boxes = st.tuples(finite, finite).filter(lambda pair: pair[0] < pair[1])


@pytest.mark.slow
@settings(max_examples=200)
@given(words, words, st.dictionaries(words, finite | boxes | words, max_size=4))
def test_every_number_box_and_name_survives_printing(kind, name, bindings):
    diagram = Diagram("f")
    try:
        diagram.add(kind, name, **bindings)
    except DiagramError:
        return  # an outer port's name
    assert parse_program(program_text(diagram)) == diagram


def test_a_program_runs_as_python_with_a_diagram():
    text = textbook_text("gfl")
    scope: dict = {}
    exec(text, scope)
    diagram = Diagram("build_gfl")
    scope["build_gfl"](diagram)
    assert diagram == parse_program(text)


def test_modules_and_connections_know_their_line():
    diagram = parse_program(
        '\n# a comment\ndef f(g):\n    "a word"\n\n    g.add("PI", "a")\n    '
        'g.connect("a.out",\n"i_DQ")\n'
    )
    assert diagram.instances[0].line == 6
    assert diagram.connections[0].line == 7


@each_of(
    "text",
    [
        "\ufeffdef f(g):\n    g.add('PI', 'a', kP=0.5)\n",
        "def f(g):\r\n    g.add('PI', 'a', kP=0.5)\r\n",
        "def f(g):\n\tg.add('PI', 'a', kP=0.5)\n",
        "def f(g):\n    g.add('PI', 'a', kP=0.5,)",
        "def f(g):\n    g.add(  # comment\n  'PI',\n\n  'a',\n kP = +0.5)  # end\n# more\n",
        'def f(g):\n    """Words.\n\n    More # words.\n    """\n    g.add("PI", "a", kP=5e-1)\n',
        "def f(net):\n  # other indentation\n        # and more\n  net . add ( 'PI' , 'a' , kP = "
        ".5 )\n\n\n",
        "def f(g):\n    g.add('PI', \\\n 'a', kP=0_0.5_0)\n",
    ],
)
def test_spacing_comments_and_line_ends_do_not_matter(text):
    (instance,) = parse_program(text).instances
    assert (instance.kind, instance.name, instance.bindings) == ("PI", "a", {"kP": 0.5})


def test_bindings_may_be_names_signed_numbers_and_boxes():
    diagram = parse_program(body('g.add("PI", "a", kP="b.c", kI=-2, x=(-1, 2.5e3), y=+.5)'))
    assert diagram.instances[0].bindings == {"kP": "b.c", "kI": -2.0, "x": (-1.0, 2500.0), "y": 0.5}


@pytest.mark.parametrize("key", ["kind", "name", "self", "source"])
def test_a_binding_may_have_any_name(key):
    (instance,) = parse_program(body(f'g.add("PI", "a", {key}=1)')).instances
    assert instance.bindings == {key: 1.0}


MALFORMED = {
    "": (1, "def"),
    "import os\n": (1, "import"),
    "x = 1\n": (1, "def NAME(g)"),
    "def f(g)\n": (1, "':'"),
    "def f(g): g.add('PI', 'a')\n": (1, "a line of its own"),
    "def f(g, h):\n": (1, "','"),
    "def f(g=1):\n": (1, "'='"),
    "def f(g) -> None:\n": (1, "'>'"),
    "def class(g):\n": (1, "Python"),
    "def f(lambda):\n    lambda.add('PI', 'a')\n": (1, "call the graph g"),
    "def " + "a" * 100 + "(g):\n": (1, "letters"),
    "@cached\ndef f(g):\n": (1, "@cached"),
    "def f(g):\ng.add('PI', 'a')\n": (2, "indented"),
    "def f(g):\n    g.add('PI', 'a')\n  g.add('PI', 'b')\n": (3, "indent all alike"),
    "def f(g):\n\tg.add('PI', 'a')\n        g.add('PI', 'b')\n": (3, "without tabs"),
    "def f(g):\n    g.add('PI', 'a')\ndef h(g):\n    g.add('PI', 'b')\n": (3, "one function"),
    "def f(g):\r    g.add('PI', 'a')\r": (1, "carriage return"),
    body("pass"): (2, "pass"),
    body("return g"): (2, "return"),
    body("for i in range(3): g.add('PI', 'a')"): (2, "for"),
    body("if True:"): (2, "if"),
    body("x = 1"): (2, "'x'"),
    body("'a'\n    'b'"): (3, "'b'"),
    body("f.add('PI', 'a')"): (2, "g.add or g.connect"),
    body("g.remove('a')"): (2, "only g.add and g.connect"),
    body("g.__class__('a', 'b')"): (2, "__class__"),
    body("g.add.__call__('a', 'b')"): (2, "'.'"),
    body("g.add"): (2, "'('"),
    body("g.add('PI', 'a'"): (3, "comma or ')'"),
    body("g.add('PI', 'a'))"): (2, "end of the line"),
    body("g.add('PI', 'a'); g.add('PI', 'b')"): (2, "';'"),
    body("g.add('PI', 'a').x"): (2, "end of the line"),
    body("g.add('PI', 'a')[0]"): (2, "[0]"),
    body("g.add('PI')"): (2, "a kind and a name"),
    body("g.add('PI', 'a', 'b')"): (2, "found 3"),
    body("g.connect('a.b')"): (2, "a source and a target"),
    body("g.connect('a.b', 'c.d', k=1)"): (2, "no bindings"),
    body("g.connect('a.b.c', 'c.d')"): (2, "NAME.port"),
    body("g.add('PI', kP=1, 'a')"): (2, "after bindings"),
    body("g.add('PI', 'a', kP=1, kP=2)"): (2, "twice"),
    body("g.add('PI', 'a', line=1)"): (2, "line"),
    body("g.add('PI' 'b', 'a')"): (2, "comma"),
    body("g.add('PI', 'a',, kP=1)"): (2, "','"),
    body("g.add(PI, 'a')"): (2, "'='"),
    body("g.add('PI', 'v_DQ')"): (2, "outer port"),
    body("g.add('PI', 'a b')"): (2, "letters"),
    body("g.add('PI', 'é')"): (2, "letters"),
    body("g.add('P\"I', 'a')"): (2, "kind"),
    body("g.add('PI', '')"): (2, "letters"),
    body("g.add('PI', 'a', kP='x.y.z')"): (2, "two words"),
    body("g.add('PI', 'a', kP=True)"): (2, "True"),
    body("g.add('PI', 'a', kP=None)"): (2, "None"),
    body("g.add('PI', 'a', kP=1+1)"): (2, "'+'"),
    body("g.add('PI', 'a', kP=--1)"): (2, "'-'"),
    body("g.add('PI', 'a', kP=2*3)"): (2, "*3"),
    body("g.add('PI', 'a', kP=1j)"): (2, "1j"),
    body("g.add('PI', 'a', kP=0x10)"): (2, "0x10"),
    body("g.add('PI', 'a', kP=1__0)"): (2, "not a number"),
    body("g.add('PI', 'a', kP=1e999)"): (2, "finite"),
    body("g.add('PI', 'a', kP=nan)"): (2, "nan"),
    body("g.add('PI', 'a', kP=(1, 2, 3))"): (2, "')'"),
    body("g.add('PI', 'a', kP=(1))"): (2, "','"),
    body("g.add('PI', 'a', kP=(2, 1))"): (2, "the smaller"),
    body("g.add('PI', 'a', kP=('x', 1))"): (2, "number"),
    body("g.add('PI', 'a', kP=[1, 2])"): (2, "[1,"),
    body("g.add('PI', 'a', kP={})"): (2, "{})"),
    body("g.add('PI', 'a', *x)"): (2, "*x"),
    body("g.add('PI', 'a', **{'kP': 1})"): (2, "**"),
    body("g.add(x := 'PI', 'a')"): (2, "':'"),
    body("g.add(f'PI', 'a')"): (2, "'='"),
    body("g.add(b'PI', 'a')"): (2, "'='"),
    body("g.add('''PI''', 'a')"): (2, "block of text"),
    body("g.add('P\\\\x49', 'a')"): (2, "backslash"),
    body("g.add('PI, 'a')"): (2, "the same mark"),
    body("g.add('PI\n', 'a')"): (2, "the same mark"),
    body("g.add((lambda: 'PI')(), 'a')"): (2, "'('"),
    body("g.add([k for k in 'PI'], 'a')"): (2, "[k"),
    body("__import__('os').system('true')"): (2, "__import__"),
    body("g.add('PI', 'a', kP=open('x'))"): (2, "open"),
    body("g.add('PI', 'a')\0"): (2, "U+0000"),
    body("g.add('PI', 'a')\u2028"): (2, "U+2028"),
    body("g.add(\u201cPI\u201d, 'a')"): (2, "\u201c"),
    '"""unterminated\n' + HEAD: (1, "def"),
}


@each_of("text", MALFORMED, ids=lambda text: repr(text)[:40])
def test_malformed_text_is_refused_with_its_line_and_what_was_found(text):
    line, word = MALFORMED[text]
    sentence = read_safely(text)
    assert isinstance(sentence, str), sentence
    assert sentence.startswith(f"p.py, line {line}: ")
    assert word in sentence


HOSTILE = {
    "opening brackets": body("g.add(" + "(" * 100_000),
    "nested calls": body("g.add(" * 30_000),
    "attribute chain": body("g" + ".add" * 45_000 + "('PI', 'a')"),
    "signs": body("g.add('PI', 'a', kP=" + "-" * 150_000 + "1)"),
    "megabyte of signs": "-" * 1_000_000,
    "megabyte of names": "a" * 1_000_000,
    "long name": body("g.add('PI', '" + "a" * 150_000 + "')"),
    "long number": body("g.add('PI', 'a', kP=" + "1" * 150_000 + ")"),
    "long number that ends in a letter": body("g.add('PI', 'a', kP=" + "1" * 150_000 + "x)"),
    "underscored number": body("g.add('PI', 'a', kP=" + "1_" * 75_000 + ")"),
    "exponent": body("g.add('PI', 'a', kP=1e" + "9" * 150_000 + ")"),
    "points": body("g.add('PI', 'a', kP=" + "1." * 75_000 + ")"),
    "quotes": body('"' * 150_000),
    "unterminated block": body("'''" + "a'" * 75_000),
    "escaped block": body('"""' + "\\" * 150_000),
    "continued lines": HEAD + "\\\n" * 90_000,
    "empty lines": HEAD + "\n" * 190_000 + "x",
    "spaces": HEAD + " " * 190_000 + "x",
    "carriage returns": HEAD + "\r" * 190_000,
    "zero bytes": "\0" * 190_000,
    "comments": HEAD + "#\n" * 90_000 + "x",
    "one comment": "#" * 199_000,
    "commas": body("g.add(" + "," * 150_000),
    "strings": body("g.add(" + "'a'," * 45_000 + ")"),
    "closing brackets": body(")" * 150_000),
    "brackets across lines": HEAD + "(\n" * 60_000 + ")\n" * 30_000,
    "emoji": body("\U0001f600" * 100_000),
}


@pytest.mark.nightly
@each_of("name", HOSTILE)
def test_hostile_text_is_refused(name):
    result = read_safely(HOSTILE[name])
    assert isinstance(result, str) or not result.instances


@pytest.mark.slow
def test_a_program_at_the_size_limit_is_read_and_refused_by_the_grammar():
    line = "    g.add('PI', 'a')\n"
    diagram = parse_program(HEAD + line * ((LONGEST_PROGRAM - len(HEAD)) // len(line)))
    assert [one.reason for one in violations(diagram)] == ["size"]


MARKS = r"""( ) : , . = + - [ ] { } ; @ * ** := -> % # \ ' " ''' <= == != ~ ^ & | ! ? $ ` é"""
WORDS = """def f g g.add g.connect 'PI' "a" 'a.out' 'i_DQ' kP= 1 0.5 1e 0x1 1_0 nan inf ... True None f"{x}" b'x'
    lambda: import exec( eval( __import__( os.system( open( class while for in if else return yield pass
    await async with try: except: global del assert raise"""
BREAKS = ["\n", "\n    ", "    ", "\t", "\r", "\r\n", "\f", "\0", "\ufeff", "\u202e", " "]
LINES = [HEAD, "    g.add('PI', 'a')\n", '"""']
pieces = st.sampled_from([*MARKS.split(), *WORDS.split(), *BREAKS, *LINES])


@pytest.mark.slow
@settings(max_examples=1500)
@given(st.lists(pieces, max_size=40), st.booleans())
def test_random_pieces_of_python_are_read_or_refused(parts, begun):
    read_safely((HEAD + "    " if begun else "") + "".join(parts))


@pytest.mark.slow
@settings(max_examples=500)
@given(st.text(max_size=200), st.booleans())
def test_random_text_is_read_or_refused(text, begun):
    read_safely((HEAD + "    g.add(" if begun else "") + text)


@pytest.mark.nightly
@settings(max_examples=1500)
@given(st.integers(0, 2000), st.integers(0, 30), st.lists(pieces, max_size=3))
def test_a_damaged_program_is_read_or_refused_and_never_breaks_the_grammar_check(
    start, length, inserted
):
    text = textbook_text("gfl")
    result = read_safely(text[:start] + "".join(inserted) + text[start + length :])
    if isinstance(result, Diagram):
        for one in violations(result):
            assert one.message
            assert one.reason


def test_a_program_file_may_begin_with_a_byte_order_mark(tmp_path):
    path = tmp_path / "p.py"
    path.write_bytes(b"\xef\xbb\xbfdef f(g):\n    g.add('PI', 'a')\n")
    assert [one.name for one in read_program(path).instances] == ["a"]


def test_a_missing_file_a_folder_and_binary_data_are_one_sentence(tmp_path):
    binary = tmp_path / "b.py"
    binary.write_bytes(bytes(range(256)))
    for path, word in (
        (tmp_path / "none.py", "cannot be read"),
        (tmp_path, "cannot be read"),
        (binary, "UTF-8"),
    ):
        with pytest.raises(ProgramError, match=word):
            read_program(path)


def test_a_long_file_is_refused_even_if_its_beginning_is_a_program(tmp_path):
    path = tmp_path / "p.py"
    path.write_text(
        HEAD + "    g.add('PI', 'a')\n" + "# \u00e9\u00e9\u00e9\u00e9\n" * 60_000, encoding="utf-8"
    )
    with pytest.raises(ProgramError, match="longer than"):
        read_program(path)


@each_of(
    "value", [10**400, float("nan"), float("inf"), None, [1, 2], (1, 2, 3), (2, 1), True, "a b", ""]
)
def test_a_diagram_in_python_refuses_a_binding_without_meaning(value):
    with pytest.raises(DiagramError, match=r"a\.kP"):
        Diagram().add("PI", "a", kP=value)


@pytest.mark.parametrize("name", ["", "a b", "class", "f(g):\n    import os", 3])
def test_a_diagram_in_python_refuses_a_name_that_no_program_could_have(name):
    with pytest.raises(DiagramError, match="name"):
        Diagram(name)
