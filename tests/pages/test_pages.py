"""What all pages have in common: one look, read without seeing, on paper, in the dark and on a
telephone, and their zoom.
"""

import json
import re
from dataclasses import replace
from html import unescape

import numpy as np
import pytest
from browser import NARROW, asked
from fitted import benchmark, evaluated
from ibrid_search.report.page import write_run_page
from made_gap import FITTED, made
from made_run import a_run, meta
from matplotlib.textpath import TextPath
from page_reader import Reader, self_contained
from sharing import shared

from ibrid.analysis import stability
from ibrid.analysis.grids.grid import ratios
from ibrid.report.figures.bode import SHARP, line_frequency
from ibrid.report.look.figure import inline_svg, inline_svgs
from ibrid.report.look.style import style_sheet
from ibrid.report.pages.gap_page import gap_page
from ibrid.report.pages.page import report_html
from ibrid.report.pages.stability_page import stability_page
from ibrid.report.texts.stability_text import case_cells

#: What stands below every page.
CONVENTIONS = (
    "Written by ibrid. Per unit on the inverter's base; current out of the inverter; q axis leads."
)
KINDS = ("evaluate", "search", "gap", "stability")


@pytest.fixture(scope="module")
def pages(tmp_path_factory) -> dict[str, str]:
    """One page of each kind, all about the benchmark's inverter."""
    record = evaluated("gfl_pll_filter_exact", restarts=0)
    gap = made("named")
    return {
        "evaluate": report_html(record, sweep=benchmark()),
        "search": write_run_page(a_run(tmp_path_factory.mktemp("runs") / "run", meta())).read_text(
            encoding="utf-8"
        ),
        "gap": gap_page(replace(gap, sweep=gap.sweep.only(FITTED[:1]), held_out=())),
        "stability": stability_page(
            stability(record, ratios("1:10:4"), op=["p=1,q=0.3"]), "fit.json"
        ),
    }


@pytest.fixture(params=KINDS)
def text(request, pages) -> str:
    return pages[request.param]


@pytest.fixture
def reader(text) -> Reader:
    return self_contained(text)


# --- one look
# ----------------------------------------------------------------------------------------------


@pytest.mark.nightly
def test_all_pages_have_the_same_style_sheet_and_no_other(pages):
    sheets = {
        kind: re.findall(r"<style.*?</style>", text, re.DOTALL) for kind, text in pages.items()
    }
    assert all(found == [f"<style>{style_sheet()}</style>"] for found in sheets.values())


@pytest.mark.slow
def test_a_page_says_its_language_and_its_title_and_can_be_skipped_into(text, reader):
    assert reader.all("html") == [{"lang": "en"}]
    assert re.search(r"<title>[^<]+ · ibrid</title>", text)
    assert len(reader.all("h1")) == 1
    reached = next(
        one for name, one in reader.tags if name in ("a", "button", "summary") or "tabindex" in one
    )
    assert reached == {"class": "skip", "href": "#main"}


@pytest.mark.slow
def test_a_page_begins_with_the_answer_and_ends_with_the_conventions(text, reader):
    landmarks = [tag for tag, _ in reader.tags if tag in ("header", "nav", "main", "footer")]
    assert landmarks == ["header", "nav", "main", "footer"]
    header = text.split("<header>")[1].split("</header>")[0]
    assert [
        one.get("class")
        for _, one in Reader(header).tags
        if one.get("class") in ("eyebrow", "verdict", "facts")
    ][:3] == [
        "eyebrow",
        "verdict",
        "facts",
    ]
    assert unescape(text.split("<footer>")[1]).startswith(CONVENTIONS)


@pytest.mark.slow
def test_every_section_has_a_heading_and_an_entry_in_the_navigation(text, reader):
    names = [one["id"] for one in reader.all("section")]
    assert len(names) > 4
    linked = re.findall(r'href="#([^"]+)"', text.split("<nav")[1].split("</nav>")[0])
    assert linked == names
    assert [one.get("aria-labelledby") for one in reader.all("section")] == [
        f"{name}-heading" for name in names
    ]


# --- read without seeing, by keyboard
# ----------------------------------------------------------------------------------------------


@pytest.mark.slow
def test_every_figure_has_words_that_say_what_it_shows(reader):
    figures = [one for one in reader.all("svg") if one.get("aria-hidden") != "true"]
    assert len(figures) >= 3
    for one in figures:
        assert one.get("role") == "img"
        assert len(str(one.get("aria-label"))) > 10


@pytest.mark.slow
def test_tables_have_headings_and_what_scrolls_can_be_reached_and_is_named(text, reader):
    assert all(one.get("aria-label") for one in reader.all("table"))
    assert all(
        one.get("scope") in ("row", "col", "rowgroup", "colgroup") for one in reader.all("th")
    )
    scrolled = [one for one in reader.all("div") if one.get("class") == "scroll"]
    assert scrolled
    assert all(
        one.get("tabindex") == "0" and one.get("role") == "region" and one.get("aria-label")
        for one in scrolled
    )
    assert text.count("<table") == len(re.findall(r'<div class="scroll"[^>]*><table', text))


@pytest.mark.slow
def test_what_is_folded_says_what_it_holds(text, reader):
    assert len(reader.all("details")) == len(
        re.findall(r"<details><summary>.{5,}?</summary>", text)
    )


# --- colours and paper
# ----------------------------------------------------------------------------------------------


def luminance(colour: str) -> float:
    """Relative luminance of #rrggbb, WCAG 2."""
    parts = [int(colour[k : k + 2], 16) / 255 for k in (1, 3, 5)]
    linear = [one / 12.92 if one <= 0.04045 else ((one + 0.055) / 1.055) ** 2.4 for one in parts]
    return 0.2126 * linear[0] + 0.7152 * linear[1] + 0.0722 * linear[2]


def contrast(one: str, other: str) -> float:
    low, high = sorted((luminance(one), luminance(other)))
    return (high + 0.05) / (low + 0.05)


def over(colour: tuple[int, ...], alpha: float, ground: str) -> str:
    """A translucent colour on an opaque one."""
    below = [int(ground[k : k + 2], 16) for k in (1, 3, 5)]
    return "#" + "".join(
        f"{round(alpha * a + (1 - alpha) * b):02x}" for a, b in zip(colour, below, strict=True)
    )


@pytest.mark.parametrize("place", [0, 1], ids=["light", "dark"])
def test_words_and_lines_stand_out_from_what_is_behind_them(place):
    variables = dict(
        re.findall(
            r"--([\w-]+):(#[0-9a-f]{6})", re.findall(r":root\{(.*?)\}", style_sheet())[place]
        )
    )
    for ground in ("page", "panel"):
        for word in ("ink", "muted", "danger", "good", "link"):
            assert contrast(variables[word], variables[ground]) >= 4.5, (
                word,
                ground,
            )  # WCAG AA for words
    for block in ("plant", "control", "sync", "frame", "static", "branch", "residual", "unknown"):
        assert contrast(variables["ink"], variables[block]) >= 4.5, block
    for number in range(6):
        assert contrast(variables[f"series-{number}"], variables["page"]) >= 3.0, (
            number
        )  # and for lines
    assert (
        contrast(variables["ink"], over((214, 84, 32), 0.6, variables["page"])) >= 4.5
    )  # the largest error's cell


@pytest.mark.slow
def test_no_colour_is_left_that_does_not_follow_the_reader(text):
    assert "@media screen and (prefers-color-scheme:dark)" in text
    assert '<meta name="color-scheme" content="light dark">' in text
    drawn = text.split("</style>")[1].split("<script>")[0]
    colours = set(re.findall(r'(?:fill|stroke|color|background)(?::\s*|=")([^;"]+)', drawn))
    assert {
        one for one in colours if not re.match(r"none$|var\(--|url\(#|rgba\(214,84,32,", one)
    } == set()


@pytest.mark.slow
def test_paper_gets_rules_of_its_own_and_what_is_folded(text):
    paper = text.split("@media print{")[1]
    assert "@page{size:A4" in paper
    assert "details::details-content{content-visibility:visible" in paper
    assert "nav,.skip,.hint,.told,figure>button{display:none}" in paper
    # what the buttons of a diagram wrote into its style does not cut it off on paper
    whole = "svg.diagram{width:100%!important;min-width:0!important;max-width:100%!important}"
    assert whole in paper


# --- zoom
# ----------------------------------------------------------------------------------------------


@shared
def a_drawing() -> str:
    def draw(axes):
        above, below = axes
        above.loglog([5.0, 5000.0], [1e-3, 100.0])
        below.plot([5.0, 5000.0], [-90.0, 90.0])
        above.set_xlim(2.0, 8000.0)
        above.set_ylim(1e-4, 1e3)
        below.set_ylim(-100.0, 120.0)
        above.set_ylabel("magnitude  (pu)")
        below.set_xlabel("frequency  (Hz)")

    return inline_svg(
        draw, name="d", label="A drawing to look at.", size=(5.0, 4.0), rows=2, zoom=True
    )


@pytest.mark.slow
def test_drawings_that_share_axes_look_as_those_with_axes_of_their_own():
    def of(number):
        def draw(axes):
            above, below = axes
            above.errorbar([5.0, 50.0, 5000.0], [1e-3, number, 100.0], yerr=[1e-4, 0.1, 10.0])
            (above.set_yscale if number > 1 else below.set_xscale)("log")
            below.fill_between([5.0, 5000.0], [-90.0, number], 95.0)
            below.text(0.5, 0.5, f"number {number}", transform=below.transAxes)

        return draw

    drawings = {f"n{number}": (f"number {number}", of(number)) for number in (3, 1, 2)}
    alone = [
        inline_svg(draw, name=name, label=label, size=(5.0, 4.0), rows=2)
        for name, (label, draw) in drawings.items()
    ]
    assert inline_svgs(drawings, size=(5.0, 4.0), rows=2) == alone


def test_a_drawing_says_where_its_axes_lie_and_what_they_show():
    (svg,) = Reader(a_drawing()).all("svg")
    above, below = json.loads(str(svg["data-axes"]))
    assert svg["data-link"] == "yes"
    assert above["x"] == below["x"] == {"scale": "log", "ends": [2.0, 8000.0], "unit": "Hz"}
    assert above["y"] == {"scale": "log", "ends": [1e-4, 1e3], "unit": "pu"}
    assert below["y"] == {"scale": "linear", "ends": [-100.0, 120.0], "unit": ""}
    frames = re.findall(r'<g id="d-patch_\d+">\s*<path d="M ([^"]*)z', a_drawing())[
        1:
    ]  # the first is the whole figure
    for one, frame in zip((above, below), frames, strict=True):
        corners = np.array(re.findall(r"[\d.]+", frame), dtype=float).reshape(-1, 2)
        left, top, width, height = one["box"]
        np.testing.assert_allclose(
            corners.min(axis=0), [left, top], atol=0.011
        )  # written with two decimals
        np.testing.assert_allclose(np.ptp(corners, axis=0), [width, height], atol=0.011)


@pytest.mark.slow
def test_every_page_has_bode_plots_or_loci_that_can_be_enlarged(reader):
    zoomed = [one for one in reader.all("svg") if "data-axes" in one]
    assert len(zoomed) >= 2
    assert all(
        one["scale"] != "fixed"
        for svg in zoomed
        for one in [json.loads(str(svg["data-axes"]))[0]["x"]]
    )


def test_ticks_are_plain_numbers_and_never_missing():
    for low, high, wanted in (
        (1e-4, 1e3, {"1e-4", "100"}),
        (20.0, 90.0, {"20", "50"}),
        (40.0, 70.0, {"40", "50", "60"}),
    ):
        svg = inline_svg(
            lambda axes, ends=(low, high): axes[0].set(yscale="log", ylim=ends),
            name="t",
            label="t",
            size=(5, 3),
        )
        assert wanted <= set(re.findall(r">([^<>\n]+)</text>", svg))
        assert "\\mathdefault" not in svg


@pytest.mark.slow
def test_words_beside_an_axis_begin_within_the_drawing(text):
    for drawing in re.findall(r"<svg.*?</svg>", text, re.DOTALL):
        starts = [
            float(found)
            for found in re.findall(
                r'<text [^>]*transform="translate\(([-\d.]+) [-\d.]+\)"', drawing
            )
        ]
        for size, end, words in re.findall(
            r'<text style="font-size: ([\d.]+)px; text-anchor: end;[^>]* x="([-\d.]+)"[^>]*>([^<]+)</text>',
            drawing,
        ):
            starts.append(
                float(end) - TextPath((0, 0), unescape(words), size=float(size)).get_extents().width
            )
        assert min(starts, default=0.0) >= -0.5


def test_a_model_line_reaches_the_top_of_a_sharp_resonance():
    record = evaluated("gfl_pll_filter_exact", restarts=0)
    op = "p=1,q=0.3"
    sharp = [
        np.hypot(*pole) / (2 * np.pi)
        for pole in record.poles[op]
        if 0 < -pole[0] < SHARP * abs(pole[1])
    ]
    assert sharp
    coarse = line_frequency(record, op, (5.0, 5000.0), None, 60)
    fine = np.union1d(
        np.geomspace(5.0, 5000.0, 60), np.geomspace(0.9 * min(sharp), 1.1 * max(sharp), 20000)
    )
    top = [np.abs(record.response(op, frequency)).max() for frequency in (coarse, fine)]
    assert top[0] == pytest.approx(top[1], rel=0.02)  # without its own points it is missed by half
    assert coarse[0] == 5.0
    assert coarse[-1] == 5000.0
    assert (np.diff(coarse) > 0).all()


# --- in a browser
# ----------------------------------------------------------------------------------------------

WIDTHS = """
  document.querySelectorAll("details").forEach((one) => (one.open = true));
  const root = document.documentElement;
  return [root.clientWidth, root.scrollWidth];
"""
ZOOMED = """
  const first = document.querySelector("svg[data-axes]");
  const ofFrequency = (axis) => axis.id.match(/axis_(\\d+)/)[1] % 2 === 1;  // those of sizes and phases are even
  const axes = [...first.querySelectorAll('g[id*="axis_"]')].filter(ofFrequency);
  const texts = () => axes.flatMap((axis) => [...axis.querySelectorAll("text")]).filter((one) => one.checkVisibility());
  const curves = () => [...first.querySelectorAll("path[clip-path]")].map((one) => one.getAttribute("d")).join();
  const press = (key) => first.dispatchEvent(new window.KeyboardEvent("keydown", { key, bubbles: true }));
  const before = curves(), wide = texts().map((one) => one.textContent);
  for (let k = 0; k < 6; k++) press("+");
  const narrow = texts().map((one) => one.textContent), during = curves();
  const buttons = [...document.querySelectorAll("figure > button")].filter((one) => one.checkVisibility()).length;
  press("0");
  return { wide, narrow, moved: before !== during, buttons, back: texts().map((one) => one.textContent).join() === wide.join() };
"""


CUT = """
  document.querySelectorAll("details").forEach((one) => (one.open = true));
  const cut = [];
  for (const drawing of document.querySelectorAll("main svg")) {
    const room = drawing.getBoundingClientRect();
    for (const one of drawing.querySelectorAll("text")) {
      const box = one.getBoundingClientRect();
      if (box.width && (box.left < room.left - 1 || box.right > room.right + 1)) cut.push(one.textContent);
    }
  }
  return [document.querySelectorAll("main svg text").length, cut];
"""


@pytest.mark.slow
def test_no_drawing_cuts_off_words(pages, tmp_path):
    answers, _ = asked(list(pages.values()), CUT, tmp_path)
    for kind, (number, cut) in zip(pages, answers, strict=True):
        assert number > 20
        assert cut == [], kind


@pytest.mark.slow
def test_no_page_is_wider_than_a_telephone_or_complains(pages, tmp_path):
    widths, console = asked(list(pages.values()), WIDTHS, tmp_path)
    assert not console
    for kind, (room, width) in zip(pages, widths, strict=True):
        assert room <= NARROW
        assert width <= room, kind


@pytest.mark.slow
def test_a_page_that_is_too_wide_or_runs_a_foreign_script_is_found_out(pages, tmp_path):
    body = '<div style="width:900px">wide</div><script>document.title = "taken over"</script>'
    (found,), console = asked(
        [pages["stability"].replace("</main>", f"{body}</main>")], WIDTHS, tmp_path
    )
    assert found[1] > found[0]
    assert any("Content Security Policy" in line for line in console)


@pytest.mark.slow
def test_keys_enlarge_all_plots_over_frequency_and_show_all_again(pages, tmp_path):
    (found,), console = asked([pages["evaluate"]], ZOOMED, tmp_path)
    assert not console
    assert found["moved"]
    assert found["back"]
    assert found["buttons"] == 4  # the four entries follow each other
    assert {"10", "100", "1000"} <= set(found["wide"])
    decade = float(np.log10(5000 / 5))
    seen = [float(one) for one in found["narrow"] if re.fullmatch(r"[\d.]+", one)]
    middle = [one for one in seen if 100 < one < 250]  # 0.6^6 of three decades around 158 Hz
    assert len(middle) >= 2
    assert np.log10(max(middle) / min(middle)) < 1.1 * 0.6**6 * decade


@pytest.mark.nightly
def test_stability_has_a_grade_and_says_what_is_beyond_the_data(pages):
    head = pages["stability"].split("<header>")[1].split("</header>")[0]
    assert re.search(
        r"<dt>grade at p=1,q=0.3</dt><dd>[^/]*(UNSTABLE|barely stable|stable)</span>", head
    )
    (case,) = (
        stability(evaluated("gfl_pll_filter_exact", restarts=0), [2.0], op=["p=1,q=0.3"])
        .points[0]
        .cases
    )
    nearest = case.nyquist.vector_margin_hz
    assert case_cells(case, 0.9 * nearest)[4].endswith(", beyond the data")
    assert "beyond" not in case_cells(case, 1.1 * nearest)[4]


@pytest.mark.slow
@pytest.mark.parametrize("kind", ["evaluate", "search"])
def test_what_few_ask_for_is_folded_and_its_link_opens_it(pages, kind, tmp_path):
    question = """
      const folded = [...document.querySelectorAll("section > details")];
      const closed = folded.every((one) => !one.open), error = document.querySelector("#error > details");
      window.location.hash = "#error";
      window.dispatchEvent(new HashChangeEvent("hashchange"));
      return [closed, error.open, folded.map((one) => one.parentElement.id)];
    """
    ((closed, opened, folded),), _ = asked([pages[kind]], question, tmp_path)
    assert closed
    assert opened
    assert {"error", "settings" if kind == "evaluate" else "statistics"} <= set(folded)
