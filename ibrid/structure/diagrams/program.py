"""Program text <-> diagram. The text is read by a scanner of its own and never executed.

    def NAME(g):
        "an optional docstring"
        g.add(KIND, NAME, parameter=binding, ...)
        g.connect(SOURCE, TARGET)

Nothing else is part of the language: no imports, loops, expressions or other calls.
"""

import re
from collections.abc import Iterator
from keyword import iskeyword
from pathlib import Path
from typing import NamedTuple

from ibrid.border import takes_kinds
from ibrid.errors import DiagramError, ProgramError
from ibrid.structure.diagrams.diagram import Binding, Diagram

LONGEST_PROGRAM = 200_000

_TOKEN = re.compile(
    r"""
    (?P<comment>\#[^\n]*)
  | (?P<newline>\r?\n)
  | (?P<space>[ \t\f]+|\\\r?\n)
  | (?P<string>\"\"\"(?:[^\\]|\\.)*?\"\"\" | '''(?:[^\\]|\\.)*?''' | "[^"\\\n]*" | '[^'\\\n]*')
  | (?P<number>(?:\d[\d_]*+\.?+[\d_]*+|\.\d[\d_]*+)(?:[eE][+-]?\d++)?+(?![A-Za-z0-9_]))
  | (?P<name>[A-Za-z_]\w*)
  | (?P<mark>[():,.=+-])
    """,
    re.VERBOSE | re.DOTALL | re.ASCII,
)

_ALLOWED = (
    "a program holds one `def NAME(g):` with g.add(...) and g.connect(...) lines, and nothing else"
)


class _Token(NamedTuple):
    kind: str
    text: str
    line: int
    column: int


@takes_kinds
def parse_program(text: str, source: str = "program") -> Diagram:
    """Read program text into a Diagram, each module and connection with its line.

    Raises ProgramError, one sentence with `source` and line, for anything that is not the language.
    """
    return _Parser(text, source).program()


@takes_kinds
def read_program(path: str | Path) -> Diagram:
    """Read a program file; ProgramError when it cannot be read."""
    path = Path(path)
    try:
        with path.open("rb") as file:
            raw = file.read(4 * LONGEST_PROGRAM + 4)  # UTF-8 has at most four bytes a character
        text = raw.decode("utf-8-sig")
    except OSError as error:
        raise ProgramError(
            f"{path}: cannot be read ({error.strerror}); give the path of a program file"
        ) from None
    except UnicodeDecodeError:
        raise ProgramError(f"{path}: is not UTF-8 text; a program is a text file") from None
    except ValueError:  # a name that no file can have
        raise ProgramError(
            f"{str(path)!r:.60}: is no name of a file; give the path of a program file"
        ) from None
    return parse_program(text, str(path))


@takes_kinds
def program_text(diagram: Diagram) -> str:
    """Print a diagram as a program; reading it back gives an equal diagram."""
    lines = [f"def {diagram.name}(g):"]
    for instance in diagram.instances:
        bindings = "".join(
            f", {key}={_binding_text(value)}" for key, value in instance.bindings.items()
        )
        lines.append(f'    g.add("{instance.kind}", "{instance.name}"{bindings})')
    lines += [f'    g.connect("{one.source}", "{one.target}")' for one in diagram.connections]
    return "\n".join(lines) + "\n"


def _binding_text(value: Binding) -> str:
    if isinstance(value, tuple):
        return f"({value[0]!r}, {value[1]!r})"
    return f'"{value}"' if isinstance(value, str) else repr(value)


class _Parser:
    """Recursive-free reader: one pass over the tokens, so that neither depth nor size can exhaust
    it.
    """

    def __init__(self, text: str, source: str) -> None:
        self.source = source
        text = text.removeprefix("\ufeff")
        if len(text) > LONGEST_PROGRAM:
            raise ProgramError(
                f"{source}: longer than {LONGEST_PROGRAM} characters; a program lists modules and "
                "connections only"
            )
        self.tokens = list(self._scan(text))
        self.position = 0

    def fail(self, line: int, message: str) -> ProgramError:
        return ProgramError(f"{self.source}, line {line}: {message}")

    def _scan(self, text: str) -> Iterator[_Token]:
        line, start, position, depth = 1, 0, 0, 0
        while position < len(text):
            match = _TOKEN.match(text, position)
            if match is None:
                raise self.fail(line, f"unexpected {_unread(text, position)}; {_ALLOWED}")
            kind, lexeme, column = str(match.lastgroup), match.group(), position - start
            position = match.end()
            if kind == "mark" and lexeme in "()":
                depth += 1 if lexeme == "(" else -1
            if kind not in ("comment", "space") and not (kind == "newline" and depth > 0):
                yield _Token(kind, lexeme, line, column)
            if "\n" in lexeme:
                line += lexeme.count("\n")
                start = match.start() + lexeme.rindex("\n") + 1
        yield _Token("newline", "", line, 0)
        yield _Token("end", "", line, 0)

    @property
    def next(self) -> _Token:
        return self.tokens[self.position]

    def take(self) -> _Token:
        token = self.next
        if token.kind != "end":
            self.position += 1
        return token

    def expect(self, text: str) -> _Token:
        token = self.take()
        if token.text != text:
            raise self.fail(token.line, f"expected {text!r}, found {_shown(token)}; {_ALLOWED}")
        return token

    def expect_kind(self, kind: str, what: str) -> _Token:
        token = self.take()
        if token.kind != kind:
            raise self.fail(token.line, f"expected {what}, found {_shown(token)}; {_ALLOWED}")
        return token

    def skip_blank(self) -> None:
        while self.next.kind == "newline":
            self.take()

    def program(self) -> Diagram:
        self.skip_blank()
        self.expect("def")
        name = self.expect_kind("name", "the name of the function")
        self.expect("(")
        graph = self.expect_kind("name", "the name of the graph, usually g").text
        if iskeyword(graph):
            raise self.fail(name.line, f"{graph!r} is a word of Python; call the graph g")
        self.expect(")")
        self.expect(":")
        try:
            diagram = Diagram(name.text)
        except DiagramError as error:
            raise self.fail(name.line, str(error)) from None
        if self.next.kind != "newline":
            raise self.fail(
                self.next.line,
                f"found {_shown(self.next)} after the colon; begin the body on a line of its own",
            )
        self.skip_blank()
        indent = self.next.column
        if indent == 0 and self.next.kind != "end":
            raise self.fail(self.next.line, "the lines of the function must be indented")
        if self.next.kind == "string":
            self.take()
            self.expect_kind("newline", "the end of the docstring's line")
        self.skip_blank()
        while self.next.kind != "end":
            if self.next.column != indent:
                raise self.fail(self.next.line, self._indentation(indent))
            self.statement(diagram, graph)
            self.skip_blank()
        return diagram

    def _indentation(self, indent: int) -> str:
        if self.next.text == "def":
            return "found a second 'def'; put one function into a program"
        found = self.next.column
        return (
            f"found {found} characters of indentation where the first line has {indent}; indent "
            "all alike, without tabs"
        )

    def statement(self, diagram: Diagram, graph: str) -> None:
        first = self.take()
        if first.text == "pass" and first.kind == "name":
            raise self.fail(first.line, f"found 'pass'; {_ALLOWED}")
        if first.text != graph:
            raise self.fail(
                first.line,
                f"expected {graph}.add or {graph}.connect, found {_shown(first)}; {_ALLOWED}",
            )
        self.expect(".")
        method = self.expect_kind("name", "add or connect")
        if method.text not in ("add", "connect"):
            raise self.fail(
                method.line,
                f"{graph}.{method.text} does not exist; only {graph}.add and {graph}.connect do",
            )
        self.expect("(")
        words, bindings = self.arguments()
        if self.next.kind != "newline":
            raise self.fail(
                self.next.line,
                f"expected the end of the line, found {_shown(self.next)}; {_ALLOWED}",
            )
        if len(words) != 2:
            wanted = "a kind and a name" if method.text == "add" else "a source and a target"
            raise self.fail(
                first.line,
                f"{graph}.{method.text} takes {wanted} before any bindings, found {len(words)} "
                "strings",
            )
        try:
            if method.text == "add":
                diagram.add(words[0], words[1], line=first.line, **bindings)
            elif bindings:
                raise DiagramError(
                    f"{graph}.connect takes no bindings, found {next(iter(bindings))}"
                )
            else:
                diagram.connect(words[0], words[1], line=first.line)
        except DiagramError as error:
            raise self.fail(first.line, str(error)) from None

    def arguments(self) -> tuple[list[str], dict[str, Binding]]:
        words: list[str] = []
        bindings: dict[str, Binding] = {}
        while self.next.text != ")":
            token = self.next
            if token.kind == "name":
                key = self.take().text
                if key in bindings:
                    raise self.fail(token.line, f"the binding {key} is given twice")
                if key == "line":
                    raise self.fail(token.line, "no module has a parameter called line")
                self.expect("=")
                bindings[key] = self.value()
            elif bindings:
                raise self.fail(
                    token.line,
                    f"a positional argument after bindings, {_shown(token)}; bindings are written "
                    "parameter=value",
                )
            else:
                words.append(self.word())
            if self.next.text != ",":
                break
            self.take()
        if self.next.text != ")":
            raise self.fail(
                self.next.line, f"expected a comma or ')', found {_shown(self.next)}; {_ALLOWED}"
            )
        self.take()
        return words, bindings

    def word(self) -> str:
        token = self.expect_kind("string", "a string")
        if token.text.startswith(('"""', "'''")):
            raise self.fail(token.line, 'a name is written "name", not as a block of text')
        return token.text[1:-1]

    def value(self) -> Binding:
        if self.next.kind == "string":
            return self.word()
        if self.next.text == "(":
            self.take()
            low = self.number()
            self.expect(",")
            high = self.number()
            if self.next.text == ",":
                self.take()
            self.expect(")")
            return low, high
        return self.number()

    def number(self) -> float:
        sign = self.take().text if self.next.text in ("+", "-") else ""
        token = self.expect_kind(
            "number", "a shared name in quotes, a number or a pair (low, high)"
        )
        try:
            return float(sign + token.text)
        except ValueError:
            raise self.fail(
                token.line, f"{token.text[:40]!r} is not a number; write it like 0.15 or 1e-3"
            ) from None


def _unread(text: str, position: int) -> str:
    """What stands where no token begins, and why when that is plain."""
    character = text[position]
    if character in "\"'":
        return (
            f"{character} without the same mark at the end of a string on this line (a string has "
            "no backslashes)"
        )
    if character == "\r":
        return "carriage return without a line feed (end lines with a line feed)"
    if character.isprintable():
        return repr(re.split(r"\s", text[position : position + 12])[0])
    return f"character U+{ord(character):04X}"


def _shown(token: _Token) -> str:
    if token.kind in ("newline", "end"):
        return "the end of the line" if token.kind == "newline" else "the end of the text"
    return repr(token.text[:40])
