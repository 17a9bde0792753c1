"""Reading frequency responses on a page: values under the cursor, units, impedance, and the grid of
logarithmic paper.
"""

import re
from dataclasses import replace

import numpy as np
import pytest
from browser import asked
from fitted import benchmark, changed, evaluated

from ibrid.measurement.recordings.events import EventRecord, Events
from ibrid.measurement.sweeps.sweep import OperatingPoint, PointSweep
from ibrid.playback.compare import model_of_record, play
from ibrid.report.facts.bases import admittance_base
from ibrid.report.figures.bode import Curves, impedance_of
from ibrid.report.look.figure import inline_svg
from ibrid.report.pages.page import report_html
from ibrid.report.pages.playback_page import playback_page

#: Moves the cursor of the first plot to its middle and two steps on, and tells what is read there.
READ = """
  const svg = document.querySelector("#response svg[data-axes]");
  const press = (key) => svg.dispatchEvent(new window.KeyboardEvent("keydown", { key, shiftKey: true, bubbles: true }));
  const told = () => [...document.querySelectorAll("#response .told")].map((one) => [...one.children].map((row) => row.textContent));
  const ends = JSON.parse(svg.dataset.axes)[0].x.ends;
  press("ArrowRight"); press("ArrowRight");
  const read = told().filter((one) => one.length);
  const lines = document.querySelectorAll("line.cursor").length;
  svg.dispatchEvent(new window.Event("pointerleave"));
  return { ends, read, lines, after: told().filter((one) => one.length).length };
"""  # noqa: E501
#: Chooses each unit in turn and tells the words at the axes that are seen, and a value.
UNITS = """
  const select = document.querySelector("#response .unitbar select"), found = {};
  for (const option of select.options) {
    select.value = option.value;
    select.dispatchEvent(new window.Event("change"));
    const svg = [...document.querySelectorAll("#response svg[data-axes]")].find((one) => one.checkVisibility());
    const words = [...svg.querySelectorAll('g[id*="axis_"] text')].filter((one) => one.checkVisibility()).map((one) => one.textContent);
    svg.dispatchEvent(new window.KeyboardEvent("keydown", { key: "ArrowRight", shiftKey: true, bubbles: true }));
    found[option.textContent] = { words, read: svg.closest("figure").querySelector(".told").textContent };
  }
  return found;
"""  # noqa: E501


def numbers_in(text: str) -> list[float]:
    """Numbers of a row, with the minus sign of pages."""
    return [float(one) for one in re.findall(r"-?\d+(?:\.\d+)?(?:e-?\d+)?", text.replace("−", "-"))]


@pytest.mark.slow
def test_the_cursor_reads_every_curve_of_all_four_entries(tmp_path):
    record = evaluated("gfl_pll_filter_exact", restarts=0)
    ((found),), console = asked([report_html(record)], READ, tmp_path)
    assert not console
    assert len(found["read"]) == 4
    assert found["lines"] == 8  # magnitude and phase of four entries
    assert found["after"] == 0
    low, high = np.log10(found["ends"])
    frequency = 10 ** ((low + high) / 2 + 0.02 * (high - low))
    for entry, (head, *rows) in zip(((0, 0), (0, 1), (1, 0), (1, 1)), found["read"], strict=True):
        assert head.endswith(" Hz")
        assert numbers_in(head)[0] == pytest.approx(frequency, rel=1e-3)  # four digits
        for op in record.parameters:
            (row,) = [row for row in rows if row.startswith(f"{op}: ")]
            size, angle = numbers_in(row.removeprefix(f"{op}: "))
            value = record.response(op, np.array([frequency]))[0][entry]
            assert size == pytest.approx(abs(value), rel=0.01)  # the drawing has two decimals
            turn = (angle - np.degrees(np.angle(value)) + 180) % 360 - 180
            assert turn == pytest.approx(0.0, abs=1.5)


@pytest.mark.slow
def test_units_are_switched_where_the_bases_are_known(tmp_path):
    record = evaluated("gfl_pll_filter_exact", restarts=0)
    known = replace(
        record, settings={**record.settings, "bases": {"s_base_va": 10e3, "v_base_v": 400.0}}
    )
    assert admittance_base(record) is None
    assert admittance_base(known) == pytest.approx(0.0625)
    (without, found), console = asked([report_html(record), report_html(known)], UNITS, tmp_path)
    assert not console
    assert list(without) == ["Y in pu", "Y in dB", "Z in pu", "Z in dB"]
    assert list(found) == ["Y in pu", "Y in dB", "Y in S", "Z in pu", "Z in dB", "Z in ohm"]
    for name, shown in found.items():
        unit = name.split()[-1]
        assert f"magnitude  ({unit})" in shown["words"], name
        assert "phase  (deg)" in shown["words"]
    read = {name: numbers_in(shown["read"].split(": ")[1])[0] for name, shown in found.items()}
    assert read["Y in S"] == pytest.approx(0.0625 * read["Y in pu"], rel=0.01)  # three digits
    assert read["Z in ohm"] == pytest.approx(16.0 * read["Z in pu"], rel=0.01)
    assert read["Y in dB"] == pytest.approx(20 * np.log10(read["Y in pu"]), abs=0.1)
    assert {"−40", "−20", "0"} <= set(found["Y in dB"]["words"])


#: Enlarges a record, reads it at the cursor, and tells the words at its axes and in its legend.
RECORD = """
  const svg = document.querySelector("svg[data-axes]");
  const press = (key, shiftKey = false) => svg.dispatchEvent(new window.KeyboardEvent("keydown", { key, shiftKey, bubbles: true }));
  const seen = (selector) => [...svg.querySelectorAll(selector)].filter((one) => getComputedStyle(one).visibility !== "hidden" && one.checkVisibility()).map((one) => one.textContent);
  const before = seen('g[id*="axis_"] text');
  for (let k = 0; k < 3; k++) press("+");
  const after = seen('g[id*="axis_"] text');
  press("ArrowRight", true);
  return { before, after, legend: seen('g[id*="legend_"] text'), read: [...svg.closest("figure").querySelectorAll(".told > *")].map((one) => one.textContent) };
"""  # noqa: E501


@pytest.mark.slow
def test_a_record_of_an_event_has_units_and_is_enlarged_and_read(tmp_path):
    time = np.arange(2000) / 5000
    v = np.where((time > 0.05) & (time < 0.2), 0.6, 1.0)[:, None] * [1.0, 0.0]
    i = np.full((2000, 2), [0.8, -0.1])
    events = Events((EventRecord(OperatingPoint("dip", 0.8, 0.1, 1.0), time, v, i, 0.04),))
    model = model_of_record(evaluated("gfl_pll_filter_exact", restarts=0))
    page = playback_page(play(model, events), "it")
    ((found),), console = asked([page], RECORD, tmp_path)
    assert not console
    for words in ("time  (s)", "|v|  (pu)", "i_d  (pu)", "i_q  (pu)", "p  (pu)", "q  (pu)"):
        assert words in found["before"]
        assert words in found["after"]
    assert found["legend"] == ["measured", "model"]
    assert found["before"] != found["after"]  # other ticks
    head, measured, modelled = found["read"]
    assert head.endswith(" s")
    moment = numbers_in(head)[0]
    assert 0.1 < moment < 0.3
    depth = 0.6 if moment < 0.2 else 1.0
    assert f"|v| {depth:g} pu" in measured
    assert "i_d 0.8 pu" in measured
    assert modelled.startswith("model: i_d ")


def test_an_impedance_is_the_inverse_and_so_are_its_deviations():
    point = replace(benchmark().points[0], sigma=np.full((16, 2, 2), 1e-6))
    shown = impedance_of(Curves("p", 0, point, point.frequency, point.admittance))
    assert shown is not None
    assert shown.measured is not None
    assert shown.measured.sigma is not None
    product = shown.model @ point.admittance
    np.testing.assert_allclose(product, np.tile(np.eye(2), (16, 1, 1)), atol=1e-9)
    # the same by drawing: 4000 noisy admittances, inverted; 5 deviations of a deviation
    rng = np.random.default_rng(1)
    noise = 1e-6 * (
        rng.standard_normal((4000, 16, 2, 2)) + 1j * rng.standard_normal((4000, 16, 2, 2))
    )
    drawn = np.linalg.inv(point.admittance + noise).real.std(axis=0)
    np.testing.assert_allclose(shown.measured.sigma, drawn, rtol=5 / np.sqrt(2 * 4000))


def test_where_an_admittance_is_singular_no_impedance_is_drawn():
    sweep = changed(benchmark())
    point = sweep.points[0]
    singular = np.ones_like(point.admittance)
    flat = PointSweep(point.op, point.frequency, singular)
    assert impedance_of(Curves("p", 0, flat, None, None)) is None
    singular[3:] = point.admittance[3:]
    some = impedance_of(Curves("p", 0, PointSweep(point.op, point.frequency, singular), None, None))
    assert some is not None
    assert some.measured is not None
    assert list(some.measured.frequency) == list(point.frequency[3:])


def test_decades_are_divided_as_on_logarithmic_paper():
    def drawn(low: float, high: float) -> int:
        def draw(axes):
            axes[0].set(xscale="log", xlim=(low, high), ylim=(0, 1))

        svg = inline_svg(draw, name="t", label="t", size=(5.0, 3.0))
        (path,) = re.findall(
            r'<path d="([^"]*)" clip-path="[^"]*" style="[^"]*opacity: 0.55', svg
        ) or [""]
        return path.count("L")

    assert drawn(10.0, 1000.0) == 16  # 2 to 9 of two decades
    assert drawn(1e-6, 1e6) == 24  # 2 and 5 of twelve
    assert drawn(1e-15, 1e15) == 0
