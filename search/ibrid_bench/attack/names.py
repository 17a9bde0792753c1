"""Names that try to get out of where they are written: comments, strings, attributes, lines,
paths.
"""

import random

#: Declares and runs a function when the source is compiled and loaded; it leaves a file behind.
RUNS = (
    "int creat(const char *, unsigned); __attribute__((constructor)) static void evil{n}(void) {{ "
    'creat("{marker}", 384); }}'
)

#: What ends a comment, a string, an attribute or a line in some language.
CLOSERS = (
    "*/",
    "*\\",
    "*\\/",
    "* /",
    "**/",
    "*\\\n/",
    "*??/\n/",
    "/*",
    "//",
    "\\",
    "??/",
    "??/\n",
    "\\\n",
    "*/ \\",
    '"',
    '\\"',
    '\\\\"',
    "'",
    "'''",
    '"""',
    "]]>",
    "-->",
    "<!--",
    "</script><script>",
    '"><script>',
    "</html>",
    "&lt;",
    "&#0;",
    "%",
    "%%",
    "%n%s",
    "%{",
    "%}",
    "\r",
    "\n",
    "\r\n",
    "\u2028",
    "\u2029",
    "\x85",
    "\x0b",
    "\x0c",
    "\x00",
    "\x1b[2J",
    "\x1b]52;c;ZXZpbA==\x07",
    "\x7f",
    "\u202e",
    "\u2066",
    "\u200b",
    "\ufeff",
    "\ud800",
    "\ufffe",
    "\U000e0001",
    "=cmd|' /C calc'!A0",
    "@",
    "{{7*7}}",
    "${x}",
    "$(x)",
    "`x`",
    "#",
    "]\n[evil]\nx = 1",
    '"\nevil = 1\n#',
    ";",
    "end LinearInverter;",
    "../../evil",
    "x" * 5_000,
    "é" * 300,
    "😀",
)


def payloads(marker: str, seed: int = 0, count: int = 40) -> list[str]:
    """Hostile names: each closer before code of C, and mixtures of closers that a seed draws."""
    names = [
        f"{one} {RUNS.format(n=n, marker=marker)} /{'*' * (n % 2 + 1)}"
        for n, one in enumerate(CLOSERS)
    ]
    names += [
        f"{one}\n{RUNS.format(n=n, marker=marker)}\n{one}"
        for n, one in enumerate(CLOSERS, len(names))
    ]
    rng = random.Random(seed)
    for n in range(len(names), len(names) + count):
        drawn = "".join(
            rng.choice((*CLOSERS, "*", "/", "\\", "?", " ", "a")) for _ in range(rng.randint(1, 12))
        )
        names.append(f"{drawn}{RUNS.format(n=n, marker=marker)}{rng.choice(CLOSERS)}")
    return names


def reachable(name: str) -> bool:
    """Whether a measurement file may call an operating point so."""
    return bool(name) and name == name.strip() and name.isprintable() and name[0] != "#"
