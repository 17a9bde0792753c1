"""Every notebook carries what it shows, and runs from top to bottom; each ends by asserting the
numbers that its text states.
"""

import re
from importlib import import_module
from pathlib import Path

import nbformat
import pytest
from nbclient import NotebookClient

from ibrid.measurement.hardware import VARIABLE, hardware_sweeps

ROOT = Path(__file__).resolve().parents[2]
NOTEBOOKS = sorted((ROOT / "notebooks").glob("*.ipynb"))
#: Runs on measured data where they are, else on a simulated stand-in.
HARDWARE = "04_missing_effect_on_hardware"


def run(path: Path) -> nbformat.NotebookNode:
    """A notebook after all its cells have run, in its own folder."""
    notebook = nbformat.read(path, as_version=4)
    assert "assert" in notebook.cells[-1].source, f"{path.name} must end by asserting its numbers"
    NotebookClient(
        notebook, timeout=600, kernel_name="python3", resources={"metadata": {"path": path.parent}}
    ).execute()
    return notebook


def printed(notebook: nbformat.NotebookNode) -> str:
    outputs = [
        output for cell in notebook.cells if cell.cell_type == "code" for output in cell.outputs
    ]
    return "".join(one.text for one in outputs if one.output_type == "stream")


def test_there_are_notebooks():
    assert NOTEBOOKS
    assert HARDWARE in [path.stem for path in NOTEBOOKS]


def test_notebooks_carry_the_outputs_of_their_code(monkeypatch: pytest.MonkeyPatch):
    monkeypatch.syspath_prepend(ROOT / "docs" / "making")
    pages = import_module("notebook_pages")
    for path in NOTEBOOKS:
        assert pages.is_current(nbformat.read(path, as_version=4)), (
            f"{path.name} changed since it was run: make notebooks"
        )


def test_no_notebook_shows_an_error_or_a_folder_of_this_machine():
    for path in NOTEBOOKS:
        for cell in nbformat.read(path, as_version=4).cells:
            for output in cell.get("outputs", []):
                assert output.output_type != "error", path.name
                assert not re.search(r"/(?:home|root|work|tmp)/", str(output)), path.name


def test_notebooks_need_what_is_installed_alone():
    for path in NOTEBOOKS:
        code = "\n".join(
            cell.source
            for cell in nbformat.read(path, as_version=4).cells
            if cell.cell_type == "code"
        )
        assert "ibrid_bench" not in code, path.name


def test_outputs_of_notebooks_stay_small():
    for path in NOTEBOOKS:
        assert path.stat().st_size < 600_000, path.name


@pytest.mark.nightly
@pytest.mark.filterwarnings("ignore")  # of the kernel's own machinery
@pytest.mark.parametrize(
    "path", [one for one in NOTEBOOKS if one.stem != HARDWARE], ids=lambda path: path.stem
)
def test_a_notebook_runs_and_its_numbers_hold(path: Path):
    run(path)


@pytest.mark.nightly
@pytest.mark.filterwarnings("ignore")
@pytest.mark.parametrize("there", [True, False], ids=["hardware", "stand-in"])
def test_the_hardware_notebook_runs_with_the_measured_data_and_without(
    there: bool, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
):
    if there and "gti_pq" not in hardware_sweeps():
        pytest.skip(
            f"the hardware sweep gti_pq.csv is not here; set {VARIABLE} to its folder, see "
            "data/README.md"
        )
    if not there:
        monkeypatch.setenv(VARIABLE, str(tmp_path))
    (path,) = (one for one in NOTEBOOKS if one.stem == HARDWARE)
    assert ("stand-in is used" in printed(run(path))) is not there
