"""The documentation keeps its word: pages made from the code are up to date, commands parse, Python
runs, the site builds.
"""

import argparse
import importlib.util
import json
import math
import re
import shlex
import subprocess
import sys
from pathlib import Path
from types import ModuleType
from typing import Any

import numpy as np
import pytest
from collecting import each_of
from sharing import shared

import ibrid
from ibrid.cli import parser
from ibrid.modules.kind import ModuleKind
from ibrid.modules.vocabulary import VOCABULARY
from ibrid.structure.diagrams.library import shipped_names
from ibrid.structure.reading.parameters import parameter_table
from ibrid.structure.reading.wiring import wire

ROOT = Path(__file__).resolve().parents[2]
DOCS = ROOT / "docs"
PAGES = {
    path.relative_to(DOCS).as_posix(): path.read_text(encoding="utf-8")
    for path in sorted([*DOCS.glob("*.md"), *DOCS.glob("api/*.md")])
}
API = [name for name in PAGES if name.startswith("api")]
#: Pages that write commands as a usage, with brackets, and none to type.
USAGES = ("stability.md", "command_line.md")
COMMANDS = sorted(
    {
        (name, line.strip())
        for name, text in PAGES.items()
        if name not in USAGES
        for line in re.findall(r"^    (ibrid .*)$", text, re.MULTILINE)
    }
)
#: A block that says no-run needs a file of the reader's, or minutes.
BLOCKS = {
    name: re.findall(r"```python( no-run)?\n(.*?)```", text, re.DOTALL)
    for name, text in PAGES.items()
}
#: The one page whose Python another test runs.
ELSEWHERE = ("effects.md",)
KINDS = [pytest.param(kind, id=kind.name) for kind in VOCABULARY if not kind.delay]


@shared
def making(name: str) -> ModuleType:
    """A program of docs/making, which is no package."""
    folder = str(DOCS / "making")
    sys.path.insert(0, folder)
    try:
        spec = importlib.util.spec_from_file_location(name, DOCS / "making" / f"{name}.py")
        assert spec is not None
        assert spec.loader is not None
        module = importlib.util.module_from_spec(spec)
        spec.loader.exec_module(module)
    finally:
        sys.path.remove(folder)
    return module


# --- pages made from the code
# ----------------------------------------------------------------------------------------------


MADE = [
    "modules.md",
    "diagrams.md",
    "command_line.md",
    "inverters.md",
    "images/architecture.svg",
    *API,
]


def test_no_page_is_left_of_what_is_made_no_more():
    assert set(making("write_pages").PAGES) == set(MADE)


@pytest.mark.slow
@pytest.mark.parametrize("name", MADE)
def test_a_page_made_from_the_code_is_up_to_date(name: str):
    """The picture of the floors is made from the imports: a circle among them is an error."""
    text = making("write_pages").PAGES[name]()
    assert (DOCS / name).read_text(encoding="utf-8") == text.rstrip() + "\n", (
        f"{name}: run docs/making/write_pages.py"
    )


@each_of("kind", KINDS)
def test_matrices_in_symbols_are_those_in_numbers(kind: ModuleKind):
    """Two ways: the symbols of the page filled with numbers, and the declaration called with
    them.
    """
    values = {name: box.low + 0.37 * (box.high - box.low) for name, box in kind.parameters.items()}
    ports = {
        port: (0.9 + 0.01 * k, -0.3 + 0.02 * k) for k, port in enumerate(kind.equilibrium_ports)
    }
    names: dict[str, Any] = {**values, "omega_0": 314.0, "cos_delta": 0.96, "sin_delta": 0.28}
    names |= {
        f"{port}_eq_{axis}": value
        for port, pair in ports.items()
        for axis, value in zip("dq", pair, strict=True)
    }
    shown = dict(matrix.split(" = ", 1) for matrix in making("modules_page").matrices(kind))
    for label, rows in zip(
        "ABCD", kind.state_space(**values, **kind.context(314.0, (0.96, 0.28), ports)), strict=True
    ):
        if len(rows) and len(rows[0]):
            expected = np.array([[float(entry) for entry in row] for row in rows])
            # other operations in another order: roundings of the sums' largest terms
            np.testing.assert_allclose(
                matrix_of(shown[label], names), expected, rtol=1e-11, atol=1e-12
            )


def matrix_of(latex: str, names: dict[str, Any]) -> np.ndarray:
    """The matrix that LaTeX such as 0_{2 \\times 3} or \\begin{bmatrix} -\\omega_{c} & 0
    \\end{bmatrix} shows, in numbers.
    """
    if size := re.fullmatch(r"0_\{(\d+) \\times (\d+)\}", latex):
        return np.zeros((int(size[1]), int(size[2])))
    symbol = making("typesetting").symbol
    written = {
        symbol(name): f" {name} " for name in sorted(names, key=lambda name: -len(symbol(name)))
    }
    assert len(written) == len(names), "two names have one symbol"
    for letters, name in written.items():
        before = "" if letters.startswith("\\") else "(?<![A-Za-z_])"
        latex = re.sub(rf"{before}{re.escape(letters)}(?![A-Za-z_])", name, latex)
    latex = latex.removeprefix("\\begin{bmatrix}\n").removesuffix("\n\\end{bmatrix}")
    known = {**names, "sqrt": math.sqrt, "cos": math.cos, "sin": math.sin}
    return np.array(
        [[eval(_python(cell), {}, known) for cell in row.split("&")] for row in latex.split(r"\\")]
    )


def _python(latex: str) -> str:
    """LaTeX of fractions, roots, powers and products, innermost braces first, as Python."""
    latex = re.sub(r"\\left|\\right", "", latex).replace(r"\,", "*")
    latex = re.sub(r"\\(cos|sin) *(\w+)", r"\1(\2)", latex)
    rules = (
        (r"\\frac{([^{}]*)}{([^{}]*)}", r"((\1)/(\2))"),
        (r"\\sqrt{([^{}]*)}", r"sqrt(\1)"),
        (r"\^{(\w+)}", r"**\1"),
    )
    for _ in range(latex.count("{")):
        for shown, meant in rules:
            latex = re.sub(shown, meant, latex)
    return latex.strip()


def test_every_option_of_every_command_is_on_the_page():
    commands = next(one for one in parser()._actions if isinstance(one, argparse._SubParsersAction))
    for name, command in commands.choices.items():
        section = PAGES["command_line.md"].split(f"## ibrid {name}\n")[1].split("\n## ")[0]
        for action in command._actions[1:]:
            assert all(f"`{option}" in section for option in action.option_strings[-1:]), (
                name,
                action.dest,
            )


def test_every_public_name_is_on_the_page_about_python():
    import ibrid_search

    names = [f"ibrid.{name}" for name in ibrid.__all__] + [
        f"ibrid_search.{name}" for name in ibrid_search.__all__
    ]
    shown = "".join(PAGES[page] for page in API)
    lacking = [
        name for name in names if not re.search(rf":: {re.escape(name)}$", shown, re.MULTILINE)
    ]
    assert not lacking


# --- what readers type
# ----------------------------------------------------------------------------------------------


def test_there_are_commands_to_try():
    assert len(COMMANDS) > 25
    assert {"tutorial.md", "own_data.md", "searching.md", "gap.md", "predict.md", "exports.md"} <= {
        name for name, _ in COMMANDS
    }


@pytest.mark.slow
@each_of(("page", "line"), COMMANDS)
def test_a_quoted_command_parses(page: str, line: str):
    arguments = parser().parse_args(shlex.split(line, comments=True)[1:])
    assert arguments.run is not None


@pytest.mark.slow
@pytest.mark.parametrize(
    "page", [name for name, blocks in BLOCKS.items() if blocks and name not in ELSEWHERE]
)
def test_the_python_of_a_page_runs(page: str, tmp_path: Path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    names: dict[str, Any] = {"__name__": "__main__"}
    for skipped, block in BLOCKS[page]:
        code = compile(block, page, "exec")
        if not skipped:
            exec(code, names)


def test_the_nominal_values_of_the_page_about_gaps_are_understood():
    (text,) = re.findall(r"```json\n(.*?)```", PAGES["gap.md"], re.DOTALL)
    names = parameter_table(wire(ibrid.textbook("gfl"), VOCABULARY), "exact").names
    assert set(json.loads(text)) <= set(names)


@each_of("page", PAGES)
def test_links_between_pages_lead_somewhere(page: str):
    targets = re.findall(r"\]\(([^)#\s]+)(?:#[^)]*)?\)", PAGES[page])
    missing = [
        one for one in targets if "://" not in one and not ((DOCS / page).parent / one).exists()
    ]
    assert not missing


# --- docstrings
# ----------------------------------------------------------------------------------------------


def test_docstrings_become_lists_and_laws_mean_themselves():
    text = (
        "A law: x* = |a|_F in_.\n\nParameters\n----------\nsweep : the data. seed : of `rng`,\n    "
        "any.\n\n    code(1)\n"
    )
    found = making("house_docstrings").restructured(text.splitlines())
    assert found[0] == r"A law: x\* = \|a\|\_F in\_."
    assert "**Parameters**" in found
    assert "- ``sweep``: the data." in found
    assert "- ``seed``: of ``rng``, any." in found
    assert found[found.index("::") + 2] == "    code(1)"


# --- the site
# ----------------------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def site(tmp_path_factory) -> Path:
    """The built site; warnings, such as a broken link, are errors."""
    for name in ("sphinx", "myst_parser", "furo", "latex2mathml"):
        if importlib.util.find_spec(name) is None:
            pytest.skip(f"{name} is not installed: pip install 'ibrid[docs]'")
    folder = tmp_path_factory.mktemp("site")
    command = [
        sys.executable,
        "-m",
        "sphinx",
        "-W",
        "--keep-going",
        "-q",
        "-b",
        "html",
        "-d",
        str(folder / "cache"),
    ]
    done = subprocess.run(
        [*command, str(DOCS), str(folder / "html")], capture_output=True, text=True, check=False
    )
    assert done.returncode == 0, done.stderr
    return folder / "html"


@pytest.mark.nightly
def test_the_site_has_every_page_and_its_words(site: Path):
    for name in PAGES:
        assert (site / name).with_suffix(".html").is_file()
    assert "ibrid.evaluate" in (site / "api" / "evaluation.html").read_text(encoding="utf-8")
    assert (site / "searchindex.js").is_file()


@pytest.mark.nightly
def test_the_site_has_every_notebook_every_formula_and_every_picture(site: Path):
    for path in (ROOT / "notebooks").glob("*.ipynb"):
        assert f'href="notebooks/{path.stem}.html"' in (site / "index.html").read_text(
            encoding="utf-8"
        )
        assert 'class="highlight-python' in (site / "notebooks" / f"{path.stem}.html").read_text(
            encoding="utf-8"
        )
    modules, diagrams = (
        (site / name).read_text(encoding="utf-8") for name in ("modules.html", "diagrams.html")
    )
    assert modules.count('<svg class="diagram') == len(VOCABULARY)
    assert modules.count('<div class="formula"><math') == PAGES["modules.md"].count("```math")
    assert diagrams.count('<svg class="diagram') == len(shipped_names())
    assert not [
        page for page in site.rglob("*.html") if "<!-- diagram" in page.read_text(encoding="utf-8")
    ]


@pytest.mark.nightly
def test_the_site_needs_no_network(site: Path):
    loaded = re.compile(r"<(?:script|link|img|iframe)\b[^>]*\b(?:src|href)=\"(?:https?:)?//[^\"]*")
    found = [
        (path.name, hit[0])
        for path in site.rglob("*.html")
        for hit in loaded.finditer(path.read_text("utf-8"))
    ]
    assert not found
    styles = "".join(path.read_text("utf-8") for path in site.rglob("*.css"))
    assert not re.search(r"@import|url\([\"']?(?:https?:)?//", styles)
