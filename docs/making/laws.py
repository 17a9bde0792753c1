"""The law of a kind or an effect as formulas, from its declaration: "out = omega_c/(s + omega_c)
in_ on each axis" and the like.

Names side by side are a product, which binds tighter than a quotient; a prime is a derivative
behind a state, else a transpose.
"""

import re
from collections.abc import Iterator
from itertools import groupby
from operator import itemgetter

from typesetting import bare, symbol

from ibrid.modules.kind import ModuleKind

_TOKEN = re.compile(r"[A-Za-z]+'s\b|a (?=[A-Za-z]{2})|L filter|[A-Za-z]\w*|\d+\.\d+|\w+|[-+]=|\S")
_SIGNS = frozenset([*"=+-*/^'()|,<[]", "+=", "-="])
#: What is a symbol in the law of an effect, which declares no names: letters alone or with indices,
#: gains.
_SYMBOL = re.compile(r"(?:[A-Za-z]|omega|delta|phi|k[PI])(?:_[A-Za-z0-9]+)*|delta_omega")
_OPENING = {
    "(": (")", r"\left(", r"\right)"),
    "[": ("]", "[", "]"),
    "|": ("|", r"\left|", r"\right|"),
}
_FUNCTIONS = ("exp", "cos", "sin", "sqrt")
#: Names that laws take for granted beside those of the kind.
_WORDS = (
    "omega_0 s J R I V0 w j r E T_d v_q v_dq u_r i_d i_g i_ti i_DQ P_in x_eq i_eq i_d_eq i_q_eq"
)
_KNOWN = frozenset(_WORDS.split())
#: A formula of more tokens stands on a line of its own, as does one that is a whole clause.
_LONG = 8


def law(kind: ModuleKind) -> str:
    """Markdown of the law: words, short formulas among them, long ones displayed."""
    stems = {re.sub("_[dq]$", "", name) for name in kind.states} | {*kind.states} & {*kind.outputs}
    states = {
        stem for stem in stems if len(stem.partition("_")[0]) == 1
    }  # those with a symbol in the law
    powers = {"p", "q"} if "p*" in kind.law else set()
    names = {*kind.parameters, *kind.inputs, *kind.outputs, *states, *powers, *_KNOWN}
    names |= {f"{name.rstrip('_')}_eq" for name in names}
    parts = [part for clause in kind.law.split("; ") for part in _clause(clause, names, states)]
    return "\n\n".join(
        _block(displayed, [text for _, text in group])
        for displayed, group in groupby(parts, itemgetter(0))
    )


def law_in_a_line(text: str) -> str:
    """Markdown of the law of an effect, its formulas among the words."""
    names = {token for token in _TOKEN.findall(text) if _SYMBOL.fullmatch(token)}
    return "; ".join(
        part
        for clause in text.split("; ")
        for _, part in _clause(clause, names, {"v_dc"}, long=len(text))
    )


def _block(displayed: bool, texts: list[str]) -> str:
    if not displayed:
        return "; ".join(texts)
    if len(texts) == 1:
        return f"```math\n{texts[0]}\n```"
    rows = [text.replace(" = ", " &= ", 1) for text in texts]
    return "```math\n\\begin{split}\n" + " \\\\\n".join(rows) + "\n\\end{split}\n```"


def _clause(
    text: str, names: set[str], states: set[str], long: int = _LONG
) -> Iterator[tuple[bool, str]]:
    """(displayed, Markdown) of the formulas and words of a clause; displayed are formulas of more
    tokens than `long`.
    """
    tokens = list(_TOKEN.finditer(text))
    words, position, first, displayed = "", 0, 0, False
    while first < len(tokens):
        last = _end(tokens, first, names)
        if last == first:
            first += 1
            continue
        before, after = text[position : tokens[first].start()], text[tokens[last - 1].end() :]
        formula = _Reader([token[0] for token in tokens[first:last]], states).whole()
        alone = not (words + before).strip(" ,")
        displayed = last - first > long or (
            long == _LONG and alone and "=" in formula and (displayed or not after)
        )
        if displayed:
            if said := _said(words + before):
                yield False, said
            yield True, formula
        words = "" if displayed else f"{words}{before}${formula}$"
        position, first = len(text) - len(after), last
    if said := _said(words + text[position:]):
        yield False, said


def _said(words: str) -> str:
    return words.strip(" ,").lstrip(": ")


def _end(tokens: list[re.Match[str]], first: int, names: set[str]) -> int:
    """Where the formula that begins at a token ends; the token itself where none does."""
    depth, bars, end, found = 0, 0, first, False
    for number in range(first, len(tokens)):
        token = tokens[number][0]
        known = token in names or token in _FUNCTIONS
        if not (known or token in _SIGNS or token[0].isdigit()) or (token == "," and depth == 0):
            break
        depth += (token in "([") - (token in ")]")
        bars ^= token == "|"
        if depth < 0 or (number == first and token in ",=+*/^')]<+="):
            break
        found = found or (token in names and token != "s")  # the s of rad/s is none
        if found and depth == 0 and not bars and (known or token[0].isdigit() or token in ")]|'*"):
            end = number + 1
    return end


class _Reader:
    """Reads a formula's tokens into LaTeX."""

    def __init__(self, tokens: list[str], states: set[str]):
        self.tokens, self.states, self.single = tokens, states, True

    def whole(self) -> str:
        """All of it."""
        text = self._until("")
        if self.tokens:
            raise ValueError(f"a law goes on with {self.tokens}")
        return text

    def _until(self, closing: str) -> str:
        text, product = "", []
        while self.tokens and self.tokens[0] != closing:
            token = self.tokens[0]
            if token in ("+=", "-="):
                self.tokens.pop(0)
                text += r"\,".join(product) + rf" \text{{ {token} }} "
                product = []
            elif token in "=+-,<":
                self.tokens.pop(0)
                text += r"\,".join(product)
                text += {",": ", "}.get(token, f" {token} ") if product else token
                product = []
            elif token == "/":
                self.tokens.pop(0)
                over, under = (
                    r"\,".join(map(bare, product) if len(product) == 1 else product),
                    bare(self._atom()),
                )
                product = [rf"\frac{{{over}}}{{{under}}}"]
            else:
                product.append(self._atom())
        self.single = not text and len(product) == 1
        return text + r"\,".join(product)

    def _atom(self) -> str:
        token = self.tokens.pop(0)
        if token in _OPENING:
            closing, left, right = _OPENING[token]
            inner = self._until(closing)
            self.tokens.pop(0)
            fraction = token == "(" and self.single and inner.startswith(r"\frac")
            base = (
                _vector(inner) if token == "[" else inner if fraction else f"{left}{inner}{right}"
            )
        elif token in _FUNCTIONS:
            inner = self._atom()
            short = bare(inner) if token == "sqrt" or self.single else inner
            base = rf"\sqrt{{{short}}}" if token == "sqrt" else rf"\{token}{short}"
        else:
            base = symbol(token) if token[0].isalpha() else token
        return self._marked(base, token)

    def _marked(self, base: str, token: str) -> str:
        above = ""
        while self.tokens and self.tokens[0] in "'*^":
            mark = self.tokens.pop(0)
            if mark == "'" and token in self.states:
                letter, _, index = base.partition("_")
                base = rf"\dot{{{letter}}}" + (f"_{index}" if index else "")
            else:
                above += {
                    "'": r"\prime" if token == "Y" else r"\top",
                    "*": "*",
                    "^": self.tokens.pop(0) if mark == "^" else "",
                }[mark]
        return f"{base}^{{{above}}}" if above else base


def _vector(inner: str) -> str:
    """A column; of rows in brackets a matrix."""
    rows = re.findall(r"\\begin{bmatrix} (.*?) \\end{bmatrix}", inner)
    cells = [row.replace(r" \\ ", " & ") for row in rows] or inner.split(", ")
    return r"\begin{bmatrix} " + r" \\ ".join(map(str.strip, cells)) + r" \end{bmatrix}"
