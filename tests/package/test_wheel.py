"""What `pip install` puts on a user's machine: built, looked into, installed in a fresh environment
and used.
"""

import ast
import importlib.util
import re
import subprocess
import sys
import venv
import zipfile
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]
#: Nodes of the syntax trees in the wheel of ibrid, which line breaks do not change: more than that
#: is asked what it is for. The last 36,000: generic models of planning programs (13,000), a model
#: file that is opened (8,000), forms of files, arguments by name or path, what a measured model
#: reads. Then 24,000: what names, numbers and words of foreign tables may mean (14,000), gap with
#: one step a line (7,000). Then 2,000: further forms of files, residuals, the commands as a tool of
#: agents, what a page is evidence of. Then 6,000: gap written out, a step a line. Then 16,000:
#: pages (8,000: trials and several runs on the live page, impedances, what is not explained,
#: references in diagrams), forms of files, generic models fitted to events. Then 5,000: what
#: recorders and laboratories write (5,300), descents along curved valleys, on some frequencies
#: (1,600), clashes of files that change while they are read; 3,300 were taken out. Then 400: a
#: controller of the negative sequence, arguments that are named where they are wrong or missing.
#: Then 9,000: files as instruments save them (6,900), sums of sweeps, reprs of models. Then 11,600:
#: frequencies that fits take at once (4,500), matrices in lists of lists (2,100), plots of diagrams
#: and inspections (1,800), what pages say of units, bands and hashes, words of four languages. Then
#: 3,000: dual current control, references of one axis, parts exchanged for what they are confused
#: with (2,800).
NODES = 775_000
#: What a script of the user's may be called without being in the way.
SHADOW = "raise RuntimeError('a file of the user was imported in place of a package')\n"


@pytest.fixture(scope="module")
def wheels(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Path]:
    """Distribution -> its wheel."""
    if importlib.util.find_spec("hatchling") is None:
        pytest.skip("hatchling is not installed: pip install 'ibrid[dev]'")
    out = tmp_path_factory.mktemp("wheels")
    for source in (ROOT, ROOT / "search" / "policy"):
        command = [sys.executable, "-m", "hatchling", "build", "-t", "wheel", "-d", str(out)]
        subprocess.run(command, cwd=source, capture_output=True, check=True)
    return {path.name.split("-")[0]: path for path in out.glob("*.whl")}


@pytest.mark.slow
def test_the_wheel_of_ibrid_has_what_it_needs_and_nothing_else(wheels: dict[str, Path]):
    with zipfile.ZipFile(wheels["ibrid"]) as wheel:
        names = wheel.namelist()
        trees = [ast.parse(wheel.read(name)) for name in names if name.endswith(".py")]
        nodes = sum(1 for tree in trees for _ in ast.walk(tree))
    assert {name.split("/")[0] for name in names} == {
        "ibrid",
        "ibrid_search",
        "ibrid-0.1.0.dist-info",
    }
    needed = (
        "ibrid/py.typed",
        "ibrid_search/py.typed",
        "ibrid/data/paper_like.csv",
        "ibrid/structure/programs/naive.py",
        "ibrid/export/sources/fmi2.c",
        "ibrid/report/page.css",
        "ibrid-0.1.0.dist-info/licenses/LICENSE",
    )
    assert [name for name in needed if name not in names] == []
    unwanted = re.compile(
        r"(^|/)(tests?|bench\w*|search|policy|learning|hidden|LOG\.md|test_\w*\.py|conftest\.py)(/|$)"
    )
    assert [name for name in names if unwanted.search(name)] == []
    assert nodes <= NODES, f"{nodes} nodes: take out what nothing needs, or say why there are more"


@pytest.mark.slow
def test_every_file_beside_the_code_is_in_the_wheel(wheels: dict[str, Path]):
    """Programs, templates, sources and pictures: what is read at run time and no import would
    miss.
    """
    listed = subprocess.run(
        ["git", "ls-files", "ibrid", "search/ibrid_search", "data"],
        cwd=ROOT,
        capture_output=True,
        text=True,
    )
    if listed.returncode:
        pytest.skip("not a clone")
    kept = {
        re.sub("^data/", "ibrid/data/", name.removeprefix("search/"))
        for name in listed.stdout.split()
    }
    with zipfile.ZipFile(wheels["ibrid"]) as wheel:
        assert kept <= set(wheel.namelist())


@pytest.mark.slow
def test_the_wheel_of_the_policy_has_its_weights(wheels: dict[str, Path]):
    with zipfile.ZipFile(wheels["ibrid_policy"]) as wheel:
        names = wheel.namelist()
    assert {name.split("/")[0] for name in names} == {
        "ibrid_policy",
        "ibrid_policy-0.1.0.dist-info",
    }
    assert {"ibrid_policy/py.typed", "ibrid_policy/weights/model.safetensors"} <= set(names)
    assert any(name.endswith("licenses/LICENSE") for name in names)


@pytest.fixture(scope="module")
def ibrid(wheels: dict[str, Path], tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The `ibrid` command of a fresh environment that has the wheel, and everything else from
    here.
    """
    folder = tmp_path_factory.mktemp("fresh")
    venv.create(folder, with_pip=False, symlinks=True)
    python = folder / "bin" / "python"
    asked = [python, "-c", "import sysconfig; print(sysconfig.get_path('purelib'))"]
    packages = Path(
        subprocess.run(asked, capture_output=True, text=True, check=True).stdout.strip()
    )
    others = [
        entry for entry in sys.path if Path(entry).name == "site-packages"
    ]  # without what their .pth files add
    (packages / "others.pth").write_text("\n".join(others) + "\n", encoding="utf-8")
    install = [
        sys.executable,
        "-m",
        "pip",
        "--python",
        str(python),
        "install",
        "--quiet",
        "--no-deps",
        "--no-index",
    ]
    done = subprocess.run(
        [*install, str(wheels["ibrid"])], capture_output=True, text=True, check=False
    )
    assert done.returncode == 0, done.stderr
    return folder / "bin" / "ibrid"


@pytest.fixture
def desk(tmp_path: Path) -> Path:
    """A folder of the user's with files that are called like packages and modules."""
    for name in ("search.py", "policy.py", "plugins.py", "data.py"):
        (tmp_path / name).write_text(SHADOW, encoding="utf-8")
    return tmp_path


@pytest.mark.nightly
def test_an_installed_ibrid_lists_and_evaluates(ibrid: Path, desk: Path):
    where = "import ibrid, ibrid_search; print(ibrid.__file__, ibrid_search.__file__)"
    home = said([str(ibrid.with_name("python")), "-c", where], desk)
    assert home.count(str(ibrid.parents[1])) == 2, "the wheel's own code"
    assert "SRF_PLL" in said([str(ibrid), "modules"], desk)
    assert "NRMSE" in said([str(ibrid), "evaluate", "naive", "paper_like", "--restarts", "0"], desk)


@pytest.mark.nightly
def test_an_installed_ibrid_searches_beside_a_file_called_search(ibrid: Path, desk: Path):
    python = [
        str(ibrid.with_name("python")),
        "-m",
        "ibrid",
    ]  # puts the folder itself first in the path
    shown = said(
        [*python, "search", "paper_like", "--out", "run", "--budget", "3", "--workers", "1"], desk
    )
    assert "best.json" in shown
    assert (desk / "run" / "report.html").is_file()


def said(command: list[str], folder: Path) -> str:
    """What a command prints that succeeds in a folder."""
    done = subprocess.run(
        command, cwd=folder, capture_output=True, text=True, timeout=600, check=False
    )
    assert done.returncode == 0, done.stderr
    return done.stdout
