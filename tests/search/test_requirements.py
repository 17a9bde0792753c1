"""What --require asks for: read from words, and held against closed forms."""

from dataclasses import replace

import numpy as np
import pytest
from collecting import each_of
from ibrid_search.requirements import Requirements, parse_requirements, passivity_index
from scripted_search import naive_record

from ibrid.errors import IbridError
from ibrid.evaluation.record import Record

OMEGA_0 = 2 * np.pi * 60


def inverter(
    inductance: float = 0.15, resistance: float = 0.005, gain: float = 0.0, **changes
) -> Record:
    """The naive diagram at given values: behind an L filter a voltage of `gain` times that of the
    grid.
    """
    values = {"plant.L_F": inductance, "plant.R_F": resistance, "gain.k": gain}
    return replace(
        naive_record(), parameters=dict.fromkeys(naive_record().parameters, values), **changes
    )


def conductance(turns: float, inductance: float = 0.15, resistance: float = 0.005) -> float:
    """Re 1 / (R + j turns L): of the filter, positive and negative sequence, with turns = omega /
    omega_0 + 1 and - 1.
    """
    return resistance / (resistance**2 + (turns * inductance) ** 2)


OP = next(iter(naive_record().parameters))


def test_the_index_of_a_passive_filter_is_its_least_conductance():
    # closed form: least at the highest frequency, in the sequence that turns the other way
    wanted = conductance(2 * np.pi * 2000 / OMEGA_0 + 1)
    assert passivity_index(inverter(), OP, 100, 2000) == pytest.approx(wanted, rel=1e-9)


def test_the_index_of_an_inverter_that_feeds_back_too_much_is_negative():
    # u_r = k v, so -Y = (1 - k) / Z: most negative next to the fundamental
    wanted = -0.5 * conductance(2 * np.pi * 100 / OMEGA_0 - 1)
    assert passivity_index(inverter(gain=1.5), OP, 100, 2000) == pytest.approx(wanted, rel=1e-9)


def test_a_narrow_band_is_looked_at_from_end_to_end():
    wanted = conductance(1001 / 60 + 1)
    assert passivity_index(inverter(), OP, 1000, 1001) == pytest.approx(wanted, rel=1e-9)


def test_nothing_asked_is_nothing_unmet():
    assert Requirements().unmet(inverter(gain=2.0, stable={OP: False})) == ""


def test_stability_is_asked_at_every_operating_point():
    asked = Requirements(stable=True)
    first, second = naive_record().stable
    assert asked.unmet(inverter(stable={first: True, second: True})) == ""
    told = asked.unmet(inverter(stable={first: True, second: False}))
    assert second in told
    assert first not in told
    assert "right half plane" in told


@pytest.mark.parametrize(("gain", "met"), [(0.9, True), (1.0, True), (1.1, False)])
def test_passivity_ends_where_the_feedback_overcomes_the_grid(gain, met):
    asked = Requirements(passive=((100.0, 2000.0),))
    told = asked.unmet(inverter(gain=gain))
    assert (told == "") is met
    if not met:
        assert "100 to 2000 Hz" in told


def test_each_band_is_asked():
    asked = Requirements(passive=((10.0, 50.0), (100.0, 2000.0)))
    assert asked.unmet(inverter(gain=0.5)) == ""
    assert "from 10 to 50 Hz" in asked.unmet(inverter(gain=1.5))


@pytest.mark.parametrize(
    ("text", "wanted"),
    [
        (None, Requirements()),
        ("", Requirements()),
        ("stable", Requirements(stable=True)),
        (" stable , passive:100-2000", Requirements(stable=True, passive=((100.0, 2000.0),))),
        ("passive:1e2-2e3,passive:5-50.5", Requirements(passive=((100.0, 2000.0), (5.0, 50.5)))),
    ],
)
def test_words_are_read(text, wanted):
    assert parse_requirements(text) == wanted


@each_of(
    ("text", "told"),
    [
        ("stabel", "did you mean stable"),
        ("passive", "such as passive:100-2000"),
        ("passive:100", "such as passive:100-2000"),
        ("passive:2000-100", "from a lower to a higher"),
        ("passive:0-100", "from a lower to a higher"),
        ("passive:1e-1e", "from a lower to a higher"),
        ("passive:1-1e99", "from a lower to a higher"),
        ("stable,-passive:1-2", "passive:LO-HI"),
        ("x" * 500, "found"),
    ],
)
def test_other_words_get_one_sentence(text, told):
    with pytest.raises(IbridError, match=told) as caught:
        parse_requirements(text)
    assert len(str(caught.value)) < 300
