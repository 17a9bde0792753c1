"""The catalogue of effects that may be missing in a model or in the device it models, and all edits of one model."""

from collections.abc import Sequence

from ibrid.gap.devices import models_of
from ibrid.gap.effect import Effect, Insertion
from ibrid.gap.effects.command import COMMAND_FILTER, CONTROL_DELAY, MEASUREMENT_DELAY
from ibrid.gap.effects.current_control import CURRENT_FILTER, CURRENT_LOOP_MISSING, DECOUPLING
from ibrid.gap.effects.feedback import ACTIVE_DAMPING
from ibrid.gap.effects.feedforward import VOLTAGE_FEEDFORWARD, VOLTAGE_FEEDFORWARD_FILTER
from ibrid.gap.effects.outer_loops import AC_VOLTAGE_LOOP, DC_LINK, FREQUENCY_DROOP, VOLTAGE_DROOP
from ibrid.gap.effects.power_circuit import (
    CAPACITOR_DAMPING,
    FILTER_CAPACITOR,
    FRAME_MISALIGNMENT,
    SERIES_IMPEDANCE,
    SHUNT_CAPACITANCE,
)
from ibrid.gap.effects.power_control import (
    POWER_FILTER,
    POWER_GAINS,
    POWER_LOOP_MISSING,
    REACTIVE_LOOP_MISSING,
    REFERENCE_FILTER,
)
from ibrid.gap.effects.sensors import CURRENT_SENSOR, VOLTAGE_SENSOR
from ibrid.gap.effects.synchronisation import PLL_MISSING, PLL_PREFILTER
from ibrid.gap.effects.virtual_impedance import VIRTUAL_IMPEDANCE
from ibrid.modules.vocabulary import Vocabulary
from ibrid.structure.canonical import structure_hash
from ibrid.structure.check import violations
from ibrid.structure.diagram import Diagram

Catalogue = tuple[Effect, ...]

CATALOGUE: Catalogue = (
    CONTROL_DELAY,
    PLL_MISSING,
    POWER_LOOP_MISSING,
    REACTIVE_LOOP_MISSING,
    CURRENT_LOOP_MISSING,
    PLL_PREFILTER,
    POWER_FILTER,
    CURRENT_FILTER,
    VOLTAGE_FEEDFORWARD,
    VOLTAGE_FEEDFORWARD_FILTER,
    DECOUPLING,
    ACTIVE_DAMPING,
    AC_VOLTAGE_LOOP,
    DC_LINK,
    FREQUENCY_DROOP,
    VOLTAGE_DROOP,
    VIRTUAL_IMPEDANCE,
    SERIES_IMPEDANCE,
    SHUNT_CAPACITANCE,
    CAPACITOR_DAMPING,
    FILTER_CAPACITOR,
    REFERENCE_FILTER,
    COMMAND_FILTER,
    MEASUREMENT_DELAY,
    POWER_GAINS,
    VOLTAGE_SENSOR,
    CURRENT_SENSOR,
    FRAME_MISALIGNMENT,
)


def insertions(diagram: Diagram, kinds: Vocabulary, catalogue: Sequence[Effect] = CATALOGUE) -> tuple[Insertion, ...]:
    """All ways in which the effects of a catalogue change a legal diagram, in its order.

    Each is legal and each structure comes once; none is that of the diagram itself. Of two devices behind one PCC each is
    changed by itself. () where no plant has a command. kinds : the vocabulary that edits may use, such as `VOCABULARY`.
    catalogue : also with effects of one's own, `(*CATALOGUE, MINE)`.
    """
    models = models_of(diagram, kinds)
    found: list[Insertion] = []
    seen = {structure_hash(diagram, kinds)}
    for effect in catalogue:
        for one in (one for model in models for one in effect.insertions(model)):
            if not violations(one.diagram, kinds) and (key := structure_hash(one.diagram, kinds)) not in seen:
                seen.add(key)
                found.append(one)
    return tuple(found)
