"""What the answer of a cell shows in a kernel where nobody imported pyplot."""

from pathlib import Path

import nbformat
import pytest
from nbclient import NotebookClient

ROOT = Path(__file__).resolve().parents[2]
CELLS = (
    "import sys, ibrid; ibrid.as_sweep('paper_like').plot()",
    "'matplotlib.pyplot' in sys.modules",
    "record = ibrid.evaluate('gfl_pll_filter_exact', 'paper_like', restarts=0); record.plot()",
    "ibrid.stability(record, [1.5, 3.0]).plot()",
    """
from ibrid.plants.sweeping import plant_named
from ibrid.playback.recording import event_of, record_events
plant = plant_named("paper_like")
dip = [event_of("dip:0.8,at=0.1,for=0.1")]
events = record_events(plant, plant.operating_points[:1], dip)
events.plot()
""",
    "ibrid.inspect('paper_like')",
    "ibrid.inspect(events)",
    "events",
)
PICTURES, PAGES = (0, 2, 3, 4), (5, 6, 7)


@pytest.fixture(scope="module")
def shown() -> list[dict]:
    """What each cell answers, by MIME type."""
    cells = [nbformat.v4.new_code_cell(text) for text in CELLS]
    notebook = nbformat.v4.new_notebook(cells=cells)
    resources = {"metadata": {"path": str(ROOT)}}
    NotebookClient(notebook, timeout=300, kernel_name="python3", resources=resources).execute()
    results = [
        [one for one in cell.outputs if one.output_type == "execute_result"]
        for cell in notebook.cells
    ]
    return [dict(found[0].data) if found else {} for found in results]


@pytest.mark.slow
def test_every_figure_is_a_picture_without_pyplot(shown: list[dict]):
    assert [place for place, answer in enumerate(shown) if "image/png" in answer] == [*PICTURES]
    assert shown[1]["text/plain"] == "False"


@pytest.mark.slow
def test_inspections_and_events_have_a_short_text_and_a_page(shown: list[dict]):
    for answer in (shown[place] for place in PAGES):
        assert len(answer["text/plain"]) <= 200
        assert answer["text/html"].startswith('<div class="ibrid">')
