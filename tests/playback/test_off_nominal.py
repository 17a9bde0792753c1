"""A grid that rests beside its nominal frequency: the model rests there too, its reactances and
frequencies with it.
"""

import pytest

from ibrid.measurement.recordings.event_rest import record_from_rest
from ibrid.measurement.recordings.events import Events
from ibrid.measurement.sweeps.sweep import OperatingPoint
from ibrid.plants.sweeping import plant_named
from ibrid.playback.compare import model_of_program, play
from ibrid.playback.recording import event_of, record_events
from ibrid.structure.diagrams.program import parse_program


@pytest.mark.slow
@pytest.mark.parametrize("name", ["paper_like", "gfm_droop"])
def test_a_dip_at_another_frequency_is_answered_as_by_the_inverter(
    name: str, monkeypatch: pytest.MonkeyPatch
):
    """The inverter, whose frame turns at the nominal frequency, runs half a hertz faster for a
    second before the dip.
    """
    plant, faster = plant_named(name), event_of("frequency:0.5,at=0.05,ramp=20")
    dip = event_of("dip:0.7,at=1.6,for=0.06")
    voltage = type(dip).voltage
    monkeypatch.setattr(
        type(dip),
        "voltage",
        lambda one, time, v: voltage(one, time, v) * voltage(faster, time, 1.0),
    )
    point = OperatingPoint("it", 0.8, 0.1)
    whole = record_events(plant, [point], [dip], length=1.75).records[0]
    late = whole.time >= 1.5
    v, i = (value[late] @ [1, 1j] for value in (whole.v, whole.i))
    record = record_from_rest("it", whole.time[late], v, i, plant.f0_hz)
    assert record.offset_hz == pytest.approx(0.5, abs=1e-6)
    model = model_of_program(parse_program(plant.program), dict(plant.diagram_values))
    error = play(model, Events((record,), f0_hz=plant.f0_hz)).nrmse
    assert error is not None
    assert (
        error < 2e-6
    )  # splines of a record that begins late; at the nominal frequency's reactances it is 1e-2
