"""Page, text and figure of a gap: complete for every verdict, self-contained, true to the numbers,
safe with any name.
"""

import re
from dataclasses import replace
from math import pi

import numpy as np
import pytest
from fitted import GRID
from made_gap import ANGLE, CORNER, FITTED, HELD_OUT, TRUTH, VERDICTS, device, made
from page_reader import Reader, self_contained
from sharing import shared

from ibrid.errors import IbridError, OperatingPointError
from ibrid.evaluation.evaluate import record_at
from ibrid.gap.ports.missing_transfer import missing_transfer as missing
from ibrid.gap.ports.missing_transfer import port_curve
from ibrid.gap.ports.port_map import PortFit
from ibrid.gap.ports.ports import ports
from ibrid.gap.results.files import gap_json
from ibrid.gap.results.gap import Gap
from ibrid.measurement.conventions.labels import Convention
from ibrid.modules.vocabulary import VOCABULARY
from ibrid.parts.catalogue import insertions
from ibrid.report.block_diagrams.block_diagram import FAMILIES, block_diagram_svg
from ibrid.report.facts.gap_words import evidence_words, headline
from ibrid.report.figures.gap_curves import closed, point_views
from ibrid.report.pages.gap_page import gap_page
from ibrid.report.plotting import gap_figure
from ibrid.report.texts.gap_text import WIDTH, gap_text
from ibrid.structure.comparison.compare import difference
from ibrid.structure.diagrams.library import textbook

HOSTILE = '<script>alert("x")</script>&'
LINES = 40


@shared
def page(verdict: str) -> str:
    return gap_page(made(verdict))


def short(gap: Gap) -> Gap:
    """The same with one operating point, whose page is quicker to draw."""
    return replace(gap, sweep=gap.sweep.only(FITTED[:1]), held_out=())


# --- the page
# ----------------------------------------------------------------------------------------------


@pytest.mark.nightly
@pytest.mark.parametrize("verdict", VERDICTS)
def test_every_verdict_gives_a_well_formed_page_that_loads_nothing(verdict):
    self_contained(page(verdict))


@pytest.mark.nightly
@pytest.mark.parametrize("verdict", VERDICTS)
def test_the_verdict_and_its_sentence_stand_on_top(verdict):
    header = Reader(page(verdict).split("<header>")[1].split("</header>")[0])
    assert verdict in header.text
    assert made(verdict).sentence in header.text
    assert headline(made(verdict)) in header.text


@pytest.mark.nightly
@pytest.mark.parametrize("verdict", VERDICTS)
def test_figures_and_tables_can_be_read_without_seeing(verdict):
    reader = Reader(page(verdict))
    pictures = [one for one in reader.all("svg") if one.get("aria-hidden") != "true"]
    assert all(one.get("role") == "img" and one.get("aria-label") for one in pictures)
    assert len(pictures) >= 4 * len(made(verdict).sweep.points) + 1
    assert all(
        one.get("scope") in ("row", "col", "rowgroup", "colgroup") for one in reader.all("th")
    )
    regions = [one for one in reader.all("div") if one.get("class") == "scroll"]
    assert all(one.get("tabindex") == "0" and one.get("aria-label") for one in regions)
    assert len(reader.all("h1")) == 1
    assert not re.findall(r"#0[1-6]0[0-9][0-9a-f]{2}\b", page(verdict).split("</style>")[1])


@pytest.mark.nightly
@pytest.mark.parametrize("verdict", VERDICTS)
def test_errors_before_and_after_stand_in_the_page_with_all_their_digits(verdict):
    gap = made(verdict)
    shown = [float(one["value"] or "nan") for one in Reader(page(verdict)).all("data")]
    wanted = {*gap.before.values(), *gap.after.values(), gap.noise_floor} - {None}
    assert wanted <= set(shown)
    for record in (gap.baseline, gap.repaired):
        for value in (
            *record.nrmse_by_op.values(),
            *record.holdout.values(),
        ):  # summed in another order
            assert min(abs(one - value) for one in shown) <= 1e-9 * value + 1e-14


@pytest.mark.slow
def test_the_parts_of_the_error_are_those_of_the_records():
    gap = made("named")
    shown = np.array([float(one["value"] or "nan") for one in Reader(page("named")).all("data")])
    for record in (gap.baseline, gap.repaired):
        for bands in record.nrmse_by_part.values():
            for entries in bands.values():
                for value in entries.values():
                    assert value is not None
                    assert np.nanmin(np.abs(shown - value)) <= 1e-9 * value


@pytest.mark.slow
def test_a_named_effect_comes_with_law_interval_rivals_and_evidence():
    words = self_contained(page("named")).text
    assert "omega_c/(s + omega_c) e_q" in words
    assert "± 1 %" in words
    assert "cannot tell it from voltage_sensor" in words
    assert "p value of the fit, before < 1e-12" in words
    assert "12.1 → 1.02" in words
    assert "Missing in the model: LPF1 before pll.e_q" in words


@pytest.mark.slow
def test_an_effect_of_the_users_own_needs_no_place_in_the_catalogue():
    gap = short(made("named"))
    own = replace(
        gap.effects[0], id="flux_capacitor", evidence={"jigawatts": 1.21, "nothing": None}
    )
    words = self_contained(gap_page(replace(gap, effects=(own,)))).text
    assert "flux_capacitor" in words
    assert "jigawatts 1.21" in words
    assert "Law:" not in words


@pytest.mark.slow
def test_a_turned_measuring_frame_is_said_to_lie_in_the_measurement():
    words = Reader(page("data-convention")).text
    assert "In the measurement, not in the device" in words
    assert f"{np.degrees(ANGLE):.2f} deg" in words
    assert "The program stays as it was given" in words


@pytest.mark.slow
def test_nominal_values_without_an_operating_point_leave_a_dash_and_a_page():
    gap = made("named")
    nowhere = {name: np.full_like(response, np.nan) for name, response in gap.nominal.items()}
    assert nowhere
    text = gap_page(replace(gap, nominal=nowhere, before={**gap.before, "nominal": None}))
    assert not re.search(r"\bnan\b", text.lower())
    self_contained(text)


@pytest.mark.slow
def test_data_without_known_noise_make_no_claim_below_the_least_that_is_believed():
    words = Reader(page("no-gap")).text
    assert "not known" in words
    assert "below which nothing is claimed" in words
    assert "what noise alone leaves there" not in words
    assert "LineCollection" not in page("no-gap")  # no error bars
    assert "LineCollection" in page("named")


@pytest.mark.nightly
def test_what_differs_is_framed_in_both_diagrams_and_shown_as_lines():
    assert page("named").count(" framed") == 1
    assert "The repaired model" in page("named")
    assert "The repaired model" not in page("unexplained")
    lines = difference(made("named").given, made("named").program)
    assert '+    g.connect("plant.e_q", "pll_filter.in_")' in lines
    assert '-    g.connect("plant.e_q", "pll.e_q")' in lines
    assert difference("a\nb\n", "a\nb\n") == ()


@pytest.mark.slow
def test_hostile_names_are_shown_and_never_become_markup():
    gap = short(made("named"))
    own = replace(
        gap.effects[0],
        id=HOSTILE,
        where=HOSTILE,
        parameters={HOSTILE: (1.0, None, None)},
        evidence={HOSTILE: HOSTILE},
        indistinguishable_from=(HOSTILE,),
    )
    port = replace(gap.ports[0], port=replace(gap.ports[0].port, name=HOSTILE, words=HOSTILE))
    hostile = replace(
        gap,
        sentence=HOSTILE,
        effects=(own,),
        ports=(port, *gap.ports[1:]),
        moved=(replace(gap.moved[0], name=HOSTILE),),
        located=(replace(gap.located[0], op=HOSTILE),),
        candidates=(replace(gap.candidates[0], id=HOSTILE, where=HOSTILE, reason=HOSTILE),),
        could_not_have_seen=(
            replace(gap.could_not_have_seen[0], id=HOSTILE, where=HOSTILE, sweep=HOSTILE),
        ),
        steps=(HOSTILE,),
        noise=HOSTILE,
        null_space=(HOSTILE,),
    )
    text = gap_page(hostile)
    assert HOSTILE not in text
    assert self_contained(text).text.count(HOSTILE) > 12


# --- what the figures show
# ----------------------------------------------------------------------------------------------


@pytest.mark.slow
def test_the_repaired_line_lies_in_the_frame_of_the_measurement():
    for view in point_views(made("data-convention")):
        away = {
            line.name: np.abs(line.at_data - view.point.admittance) / view.noise
            for line in view.lines
        }
        assert away["repaired"].max() < 4.0  # 64 numbers of a Rayleigh law with mean square 1
        assert away["refitted"].max() > 4.0


@pytest.mark.slow
@pytest.mark.parametrize(
    "convention",
    [
        Convention(sign=-1),
        Convention(q=-1, sign=-1),
        Convention(factor=2.5),
        Convention(labels=(FITTED,)),
    ],  # type: ignore[arg-type]
    ids=["current in", "q lags", "base", "labels"],
)
def test_the_repaired_line_is_drawn_as_the_data_are_written(convention):
    right = made("parameters-only")
    mirror = np.diag([1.0, float(convention.q)])
    exchanged = {**dict(convention.labels), **{b: a for a, b in convention.labels}}
    points = []
    for point in right.sweep.points:
        seen = right.sweep.point(exchanged.get(point.op.name, point.op.name))
        values = convention.sign * convention.factor * mirror @ seen.admittance @ mirror
        points.append(
            replace(
                seen,
                op=point.op,
                admittance=values,
                sigma=convention.factor * np.asarray(seen.sigma),
            )
        )
    written = replace(right.sweep, points=tuple(points))
    gap = replace(
        right,
        verdict="data-convention",
        sweep=written,
        convention=convention,
        repaired=replace(right.repaired),
    )
    for view in point_views(gap):
        away = {
            line.name: np.abs(line.at_data - view.point.admittance) / view.noise
            for line in view.lines
        }
        assert away["repaired"].max() < 4.0
        assert away["refitted"].max() > 10.0 or view.held_out


@pytest.mark.slow
def test_a_convention_that_nobody_told_has_no_line():
    gap = made("data-convention")
    (line, *others) = [
        line for line in point_views(replace(gap, angle=0.0))[0].lines if line.name != "as given"
    ]
    assert (line.name, others) == ("refitted", [])
    assert "no line beside these data" in Reader(gap_page(replace(short(gap), angle=0.0))).text


@pytest.mark.slow
def test_held_out_points_are_shown_and_marked():
    views = {view.name: view for view in point_views(made("named"))}
    assert set(views) == set(device().names)
    assert [name for name, view in views.items() if view.held_out] == list(HELD_OUT)
    assert "p=0.6,q=0.1, held out: predicted, never fitted" in Reader(page("named")).text


def test_the_gap_that_is_closed_counts_from_the_refitted_model_to_the_noise():
    assert closed(0.11, 0.06, 0.01) == "50 %"
    assert closed(0.11, 0.005, 0.01) == "100 %"
    assert closed(0.01, 0.005, 0.01) == "-"
    assert closed(0.1, 0.1, None) == "0 %"
    assert closed(None, 0.1, None) == "-"


def at_port(
    effect: str, change: str, words: str, place: str, given: str = "gfl_exact", **new: float
) -> tuple[bool, np.ndarray | None]:
    """Whether a port of a textbook diagram lies in a signal, and what an insertion of the catalogue
    does there.
    """
    diagram = textbook(given)
    (edit,) = [
        one
        for one in insertions(diagram, VOCABULARY)
        if (one.effect, one.change) == (effect, change) and words in one.where
    ]
    (port,) = [one for one in ports(diagram, VOCABULARY) if one.name == place]
    values = TRUTH | {"delay.T_d": 2e-4} | new
    nothing = np.zeros(GRID.size)
    fit = PortFit(port, 1.0, 1.0, 1.0, 0.5, True, GRID, nothing + 0j, nothing, values)
    return port.series, port_curve(fit, record_at(edit.diagram, device(), values), device(), GRID)


S = 2j * pi * GRID


@pytest.mark.slow
def test_a_low_pass_in_a_signal_is_that_low_pass_at_its_port():
    series, found = at_port("pll_prefilter", "add", "LPF1 before", "pll.e_q")
    assert series
    assert found is not None
    corner = TRUTH[CORNER]
    np.testing.assert_allclose(1.0 + found, corner / (S + corner), rtol=1e-8)


@pytest.mark.slow
def test_a_filter_of_both_powers_is_one_transfer_of_both():
    _, found = at_port(
        "power_filter", "add", "one corner", "power.p and power.q", **{"power_filter.omega_c": 80.0}
    )
    assert found is not None
    np.testing.assert_allclose(1.0 + found, 80.0 / (S + 80.0), rtol=1e-8)


@pytest.mark.slow
def test_a_delay_that_is_taken_out_is_the_inverse_of_the_delay():
    _, found = at_port("control_delay", "remove", "delay", "plant.u_r", given="gfl_delay")
    assert found is not None
    np.testing.assert_allclose(1.0 + found, np.exp(2e-4 * S), rtol=1e-8)


@pytest.mark.slow
def test_a_path_of_its_own_is_its_gain_whichever_currents_it_is_made_of():
    series, found = at_port(
        "active_damping",
        "add",
        "high-passed",
        "plant.i_C -> plant.u_r",
        **{"active_damping.k": 0.3, "damping_filter.omega_c": 900.0},
    )
    assert not series
    assert found is not None
    np.testing.assert_allclose(found, -0.3 * S / (S + 900.0), rtol=1e-8)


@pytest.mark.slow
def test_an_effect_elsewhere_is_no_transfer_of_a_port():
    assert at_port("pll_prefilter", "add", "LPF1 before", "plant.u_r")[1] is None
    assert (
        at_port("power_filter", "add", "one corner", "pll.e_q", **{"power_filter.omega_c": 80.0})[1]
        is None
    )


def test_the_measured_transfer_follows_the_named_block_within_its_errors():
    found = missing(made("named"))
    assert found is not None
    assert found.fit.port.name == "pll.e_q"
    law = TRUTH[CORNER] / (S + TRUTH[CORNER])
    away = np.abs(found.value - law) / found.deviation
    assert found.seen.sum() >= 10
    assert away.max() < 4.5  # 16 numbers of a Rayleigh law with mean square 2
    assert found.deviation[found.seen].min() < 0.01


@pytest.mark.nightly
def test_two_named_effects_are_said_to_have_no_curve_at_one_place():
    one = made("named")
    (effect,) = one.effects
    two = gap_page(replace(one, effects=(effect, replace(effect, id="control_delay")), ports=()))
    assert (
        "for pll_prefilter and control_delay: at each frequency the data tell one transfer at one "
        "place" in two
    )
    assert "these act at 2 places at once" in two
    assert "No curve of the" not in page("named")
    assert "No curve of the" not in page("located-unnamed")


@pytest.mark.slow
def test_a_verdict_that_places_nothing_shows_no_transfer():
    assert missing(made("unexplained")) is None
    assert missing(made("no-gap")) is None
    found = missing(made("located-unnamed"))
    assert found is not None
    assert found.line is None


# --- figure and text
# ----------------------------------------------------------------------------------------------


@pytest.mark.slow
@pytest.mark.parametrize("verdict", ["named", "no-gap", "unexplained"])
def test_a_notebook_gets_one_figure_in_plain_colours(verdict):
    figure = made(verdict).plot()
    assert len(figure.axes) == 12 + bool(made(verdict).ports) + 2 * (verdict == "named")
    from matplotlib.colors import to_hex

    lines = {to_hex(line.get_color()) for plane in figure.axes for line in plane.get_lines()}
    assert "#0064b4" in lines
    assert not [one for one in lines if one.startswith("#0506")]


@pytest.mark.slow
def test_a_figure_of_an_unknown_operating_point_is_refused_with_the_near_names():
    with pytest.raises(OperatingPointError, match="is not in the sweep"):
        gap_figure(made("named"), "p=1,q=0.4")
    assert gap_figure(made("named"), HELD_OUT[0]).axes


def overfull() -> Gap:
    """More of everything than a terminal can show."""
    gap = made("named")
    long = "a very long way to say where something is " * 4
    effect = replace(
        gap.effects[0], where=long, parameters={f"pll.k{n}": (1.0, 0.5, 2.0) for n in range(9)}
    )
    return replace(
        gap,
        sentence=long * 5,
        effects=(effect,) * 3,
        located=gap.located * 9,
        moved=tuple(replace(one, sigmas=7.0) for one in gap.moved * 4),
        ports=tuple(replace(one, adequate=True) for one in gap.ports),
        could_not_have_seen=tuple(
            replace(gap.could_not_have_seen[0], id=f"effect_{n}") for n in range(60)
        ),
        noise=long,
    )


@pytest.mark.parametrize("gap", [*map(made, VERDICTS), overfull()], ids=[*VERDICTS, "overfull"])
def test_the_text_fits_a_terminal(gap):
    lines = gap_text(gap, "results/gap").splitlines()
    assert len(lines) <= LINES
    assert max(map(len, lines)) <= WIDTH
    assert lines[0].startswith(f"{gap.verdict}: {gap.sentence[:30]}")
    assert "results/gap: report.html" in lines[-1]


def test_the_text_names_the_effect_its_parameter_and_what_it_is_mistaken_for():
    words = " ".join(gap_text(made("named")).split())
    assert "pll_prefilter, missing in the model: LPF1 before pll.e_q" in words
    assert "pll_filter.omega_c = 3142 rad/s (500 Hz), 95 %: +- 1 %" in words
    assert "these data cannot tell it from voltage_sensor" in words
    assert "report.html" not in words


def test_the_text_says_which_parameters_moved_far():
    words = " ".join(gap_text(made("parameters-only")).split())
    assert "power.kP 0.012 -> 0.02" in words
    assert "(+6.1 sigma)" in words
    assert "plant.L_F 0" not in words


def test_evidence_without_words_of_its_own_stands_as_it_is():
    assert list(evidence_words({"some_number": 2.5, "none": None, "p_after": 0.0})) == [
        ("some number", "2.5"),
        ("p value of the fit, after", "< 1e-12"),
    ]


def test_every_family_of_kinds_has_a_colour_and_a_word():
    assert {kind.family for kind in VOCABULARY} <= set(FAMILIES)
    diagram = textbook("naive")
    diagram.add("Shunt_RC", "shunt")
    svg = block_diagram_svg(diagram, VOCABULARY, framed=("shunt",))
    assert 'class="node family-physical-branch framed"' in svg


@pytest.mark.slow
def test_before_and_after_are_drawn_on_axes_of_ones_own():
    figure = pytest.importorskip("matplotlib.figure")
    own = figure.Figure().subplots(2, sharex=True)
    assert made("named").plot(ax=own, entry="qq") is own
    assert len(own[0].lines) >= 3  # the measurement, before and after
    with pytest.raises(IbridError, match="two axes"):
        made("named").plot(ax=own[0])


@pytest.mark.slow
def test_gap_json_carries_the_transfer_that_the_page_draws():
    (told,) = gap_json(made("named"))["missing_transfer"]
    drawn = made("named").missing_transfer
    assert drawn is not None
    assert told["port"] == drawn.fit.port.name
    assert [complex(*pair) for pair in told["value"]] == pytest.approx(drawn.value.tolist())
    assert told["sigma"] == pytest.approx(drawn.deviation.tolist())
    assert gap_json(made("no-gap"))["missing_transfer"] == []
