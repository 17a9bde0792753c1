"""Cases with records of events: the device is simulated apart from the package, which must answer as it does."""

from pathlib import Path

import numpy as np
from ibrid_bench.events.__main__ import BEGIN, END, table_of
from ibrid_bench.events.cases import NAMES, draw
from ibrid_bench.ledger import Ledger

import ibrid
from ibrid.modules.vocabulary import VOCABULARY
from ibrid.playback.compare import EventModel, play


def test_the_true_diagram_explains_the_sweep_of_a_drawn_device_and_answers_its_records():
    case = draw("nothing", 1, None, swept=True)
    assert case.sweep is not None
    diagram = ibrid.textbook(case.textbook)
    assert ibrid.evaluate(diagram, case.sweep).nrmse < 1e-6  # the sweep's slopes are differences
    truth = {NAMES[name]: value for name, value in case.device.numbers.items() if NAMES.get(name) in case.values}
    played = play(EventModel(diagram, truth, (), VOCABULARY), case.events)
    assert all(one.nrmse is not None and one.nrmse < 1e-6 for one in played.records)
    again = draw("nothing", 1, None, swept=True)
    assert all(
        np.array_equal(one.i, other.i) for one, other in zip(case.events.records, again.events.records, strict=True)
    )


def test_the_page_shows_what_was_measured():
    docs = Path(__file__).resolve().parents[2] / "docs"
    assert f"{BEGIN}\n{table_of(Ledger(docs / 'measured' / 'events'))}\n{END}" in (docs / "events.md").read_text()
