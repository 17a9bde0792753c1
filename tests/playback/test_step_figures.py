"""Figures of a step: of a first and a second order against their closed forms."""

import numpy as np
import pytest

import ibrid
from ibrid.plants.sweeping import operating_point, plant_named
from ibrid.playback.compare import model_of_program, play
from ibrid.playback.recording import event_of, record_events
from ibrid.playback.step_figures import figures_of, step_figures

TIME = np.arange(-0.5, 2.0, 1e-4)


def test_a_first_order_has_the_times_of_its_exponential():
    constant = 0.05
    value = 0.6 - 0.2 * np.where(TIME > 0, 1.0 - np.exp(-np.maximum(TIME, 0.0) / constant), 0.0)
    figures = figures_of(TIME, value, 0.0)
    assert figures is not None
    assert figures.reaction_s == pytest.approx(constant * np.log(1.0 / 0.9), abs=2e-4)
    assert figures.rise_s == pytest.approx(constant * np.log(9.0), abs=2e-4)
    assert figures.settling_s == pytest.approx(constant * np.log(20.0), abs=2e-4)
    assert figures.overshoot == pytest.approx(0.0, abs=1e-9)


def test_a_second_order_overshoots_by_its_damping():
    damping, speed = 0.4, 20.0
    fast = speed * np.sqrt(1.0 - damping**2)
    since = np.maximum(TIME, 0.0)
    decay = np.exp(-damping * speed * since)
    value = np.where(
        TIME > 0,
        1.0 - decay * (np.cos(fast * since) + damping * speed / fast * np.sin(fast * since)),
        0.0,
    )
    figures = figures_of(TIME, value, 0.0)
    assert figures is not None
    assert figures.overshoot == pytest.approx(
        np.exp(-np.pi * damping / np.sqrt(1.0 - damping**2)), abs=1e-4
    )


def test_what_is_not_reached_or_does_not_change_has_no_figures():
    assert figures_of(TIME, np.full(len(TIME), 0.8), 0.0) is None
    step = np.where(TIME > 0, 1.0, 0.0)
    assert figures_of(TIME, step, TIME[0]) is None
    assert figures_of(TIME, step, TIME[-1] + 0.1) is None
    rising = figures_of(TIME, 0.8 + 0.1 * np.maximum(TIME, 0.0), 0.0)
    assert rising is not None
    assert rising.settling_s is None


def test_the_right_model_follows_a_set_point_as_the_device_does():
    plant = plant_named("gfl_l_filter")
    step = event_of("p_ref:0.8,at=0.1")
    events = record_events(plant, [operating_point("p=0.6,q=0.1")], [step], length=1.0)
    playback = play(
        model_of_program(ibrid.parse_program(plant.program), plant.diagram_values), events
    )
    figures = step_figures(playback.records[0])
    assert figures is not None
    assert figures["set_point"] == "p_ref"
    assert figures["model"]["rise_s"] == pytest.approx(figures["measured"]["rise_s"], abs=1e-3)
    dip = record_events(plant, [operating_point("p=0.6,q=0.1")], [event_of("dip:0.9")])
    model = playback.model
    assert step_figures(play(model, dip).records[0]) is None
