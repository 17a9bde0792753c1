"""All of control practice: the effects that a gap may be named by, the families of moves that a
search tries.
"""

from collections.abc import Sequence

from ibrid.border import takes_kinds
from ibrid.modules.vocabulary import Vocabulary
from ibrid.parts.anywhere import blocks, wiring
from ibrid.parts.editing.practice import Effect, Family, Insertion
from ibrid.parts.editing.view import views_of
from ibrid.parts.frames import pll_filter, pll_static_error, sequence, synchronisation
from ibrid.parts.inner_loops import (
    current_measurement,
    current_voltage_loops,
    decoupling,
    feedforward,
    virtual_impedance,
    voltage_measurement,
)
from ibrid.parts.outer_loops import axis_loops, droops, power_filter, power_loops, references
from ibrid.parts.plant import at_the_pcc, command, converter, damping, delay_form, output_filter
from ibrid.structure.compiling.canonical import structure_hash
from ibrid.structure.compiling.check import violations
from ibrid.structure.diagrams.diagram import Diagram

Catalogue = tuple[Effect, ...]

#: What may be missing in a model or in the device it models.
CATALOGUE: Catalogue = (
    command.CONTROL_DELAY,
    synchronisation.PLL_MISSING,
    power_loops.POWER_LOOP_MISSING,
    power_loops.REACTIVE_LOOP_MISSING,
    current_voltage_loops.CURRENT_LOOP_MISSING,
    pll_filter.PLL_PREFILTER,
    power_filter.POWER_FILTER,
    current_measurement.CURRENT_FILTER,
    feedforward.VOLTAGE_FEEDFORWARD,
    feedforward.VOLTAGE_FEEDFORWARD_FILTER,
    decoupling.DECOUPLING,
    damping.ACTIVE_DAMPING,
    axis_loops.AC_VOLTAGE_LOOP,
    axis_loops.DC_LINK,
    droops.FREQUENCY_DROOP,
    droops.VOLTAGE_DROOP,
    virtual_impedance.VIRTUAL_IMPEDANCE,
    output_filter.SERIES_IMPEDANCE,
    at_the_pcc.SHUNT_CAPACITANCE,
    output_filter.CAPACITOR_DAMPING,
    output_filter.FILTER_CAPACITOR,
    power_filter.REFERENCE_FILTER,
    command.COMMAND_FILTER,
    current_measurement.MEASUREMENT_DELAY,
    power_loops.POWER_GAINS,
    voltage_measurement.VOLTAGE_SENSOR,
    current_measurement.CURRENT_SENSOR,
    at_the_pcc.FRAME_MISALIGNMENT,
    converter.DEAD_TIME,
    converter.DELAY_ANGLE,
    converter.ZERO_ORDER_HOLD,
    sequence.PLL_SEQUENCE_FILTER,
    sequence.FEEDFORWARD_BAND_PASS,
    sequence.RESONANT_CONTROL,
    sequence.NEGATIVE_SEQUENCE_CONTROL,
    references.POWER_REFERENCE,
    references.REFERENCE_FEEDFORWARD,
    references.MEASUREMENT_FILTER,
    output_filter.TRAP_FILTER,
    output_filter.CORE_SATURATION,
    pll_static_error.PLL_STATIC_ERROR,
    delay_form.DELAY_FORM,
)

#: What a search tries: sub-loops, then single blocks, then wires.
FAMILIES: tuple[Family, ...] = (
    *output_filter.FAMILIES,
    *synchronisation.FAMILIES,
    *current_voltage_loops.FAMILIES,
    *power_loops.FAMILIES,
    *axis_loops.FAMILIES,
    *droops.FAMILIES,
    *current_voltage_loops.LESS,
    *at_the_pcc.FAMILIES,
    *feedforward.FAMILIES,
    *decoupling.FAMILIES,
    *virtual_impedance.FAMILIES,
    *damping.FAMILIES,
    *command.FAMILIES,
    *pll_filter.FAMILIES,
    *power_filter.FAMILIES,
    *current_measurement.FAMILIES,
    *voltage_measurement.FAMILIES,
    *virtual_impedance.FEEDBACK,
    *droops.FREQUENCY,
    *blocks.FAMILIES,
    *wiring.FAMILIES,
    *converter.FAMILIES,
    *sequence.FAMILIES,
    *references.FAMILIES,
    *output_filter.TRAPS,
)


@takes_kinds
def insertions(
    diagram: Diagram, kinds: Vocabulary, catalogue: Sequence[Effect] = CATALOGUE
) -> tuple[Insertion, ...]:
    """All ways in which the effects of a catalogue change a legal diagram, in its order.

    Each is legal and each structure comes once; none is that of the diagram itself. Of two devices
    behind one PCC each is changed by itself. () where no plant has a command. kinds : the
    vocabulary that edits may use, such as `VOCABULARY`.
    catalogue : also with effects of one's own, `(*CATALOGUE, MINE)`.
    """
    views = views_of(diagram, kinds)
    distinct: list[Insertion] = []
    seen = {structure_hash(diagram, kinds)}
    for effect in catalogue:
        for insertion in (one for view in views for one in effect.insertions(view)):
            if (
                not violations(insertion.diagram, kinds)
                and (key := structure_hash(insertion.diagram, kinds)) not in seen
            ):
                seen.add(key)
                distinct.append(insertion)
    return tuple(distinct)
