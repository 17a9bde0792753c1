"""The current reference without an outer loop, its own way to the command, and sensors that filter
all that is measured.
"""

from collections.abc import Iterable, Iterator, Sequence
from functools import partial

from ibrid.modules.behaviour import Element
from ibrid.parts.editing.edit import Edit, Strength, cutoff, pi_gains
from ibrid.parts.editing.paths import (
    current_path,
    drive_axis,
    grid_current,
    loops,
    measured_current,
    packs,
    path,
    power_block,
    regulates,
    regulator,
    row_before,
)
from ibrid.parts.editing.practice import Effect, Family, always, having, where_missing
from ibrid.parts.editing.view import Move, View, followers, of_circuit
from ibrid.parts.frames.sequence import (
    ELEMENTS,
    FILTERS,
    lock_to,
    locked_vector,
    own_q_axis,
    sequence_filters_of,
)
from ibrid.parts.inner_loops.current_measurement import in_control
from ibrid.signals import Signal

FILTERED = {"omega_c": cutoff(200, 50, 10, nothing=1e-9)}
CORNER = cutoff(200, 50, 10)
LOOP = pi_gains((0.01, 0.03, 0.1), (10.0, 30.0, 100.0))
#: Axis of the current reference, the power that its loop regulates, the slice that takes the axis.
AXES = (("in_d", "p", "SliceD"), ("in_q", "q", "SliceQ"))
SECOND = {"k": Strength((-0.1, -0.2, -0.4), 0.0)}
SENSOR = cutoff(4000, 1500, 500)


def _power_reference(view: View) -> Iterator[Move]:
    draft, loop = view.draft, view.roles.current_loop
    present = draft.having(Element.REFERENCE)
    for name in present:
        yield Move.at(
            "remove",
            f"{name} at {view.roles.reference}",
            lambda draft, name=name: draft.remove(name),
        )
    yield from _reference_voltage(view)
    yield from _loop_of_one_axis(view)
    if loop is None or present or not view.known("Ref_pq"):
        return
    yield from _reference_of_one_axis(view)
    driving = packs(view)
    for filtered in (True, False):

        def opened(draft: Edit, filtered: bool = filtered) -> None:
            draft.remove(*driving)
            voltage = view.roles.voltage
            if filtered:
                strengths = (
                    FILTERED if not driving else {"omega_c": Strength(FILTERED["omega_c"].bank)}
                )
                voltage = draft.after(voltage, "LPF1_dq", "reference_filter", **strengths)
            name = draft.add("Ref_pq", "references")
            draft.chain(
                voltage,
                f"{name}.v",
                measured_current(view),
                f"{name}.i",
                f"{name}.out",
                view.roles.reference,
            )

        words = f"references p*/|v| and -q*/|v|{' of the filtered voltage' * filtered}"
        where = f"at {view.roles.reference}{', behind a low-pass' * filtered}"
        yield Move(
            words + (" in place of the outer loops" if driving else ""),
            opened,
            change="replace" if driving else "add",
            where=where + (f", in place of {', '.join(driving)}" if driving else ""),
        )


def _reference_of_one_axis(view: View) -> Iterator[Move]:
    """One axis of the reference from its power, while the other keeps its loop."""
    loops_of = {axis: regulator(view, axis) for axis, *_ in AXES}
    if None in loops_of.values():
        return
    for axis, power, kind in AXES:
        name = loops_of[axis]
        if regulates(view, name) != power:
            continue

        def opened(draft: Edit, axis: str = axis, kind: str = kind) -> None:
            voltage = draft.after(
                view.roles.voltage, "LPF1_dq", "reference_filter", omega_c=Strength(CORNER.bank)
            )
            references = draft.add("Ref_pq", "references")
            draft.chain(voltage, f"{references}.v", measured_current(view), f"{references}.i")
            scalar = draft.after(f"{references}.out", kind, f"reference_{axis[-1]}")
            drive_axis(draft, scalar, view.roles.reference, axis)

        words = "p*/|v|" if power == "p" else "-q*/|v|"
        yield Move(
            f"the reference {words} of the filtered voltage in place of the {power} loop",
            opened,
            change="replace",
            where=f"{axis} of the current reference, behind a low-pass, in place of {name}",
        )


def _loop_of_one_axis(view: View) -> Iterator[Move]:
    """A loop of one power on its axis, while the other axis keeps its reference from power."""
    draft = view.draft
    for name in draft.having(Element.REFERENCE):
        targets = draft.targets(f"{name}.out")
        if view.roles.reference not in targets or packs(view):
            continue
        for closed, kept in (AXES, AXES[::-1]):

            def regulated(
                draft: Edit,
                name: str = name,
                targets: Sequence[str] = targets,
                closed: tuple[str, str, str] = closed,
                kept: tuple[str, str, str] = kept,
            ) -> None:
                pack = draft.add("PackDQ", "reference")
                draft.rewire(f"{name}.out", f"{pack}.out", *targets)
                scalar = draft.after(f"{name}.out", kept[2], f"reference_{kept[1]}")
                draft.connect(scalar, f"{pack}.{kept[0]}")
                power = f"{power_block(draft, view)}.{closed[1]}"
                measured = draft.negated(power) if closed[1] == "p" else power
                regulated = draft.after(measured, "PI", f"{closed[1]}_loop", **LOOP)
                draft.connect(regulated, f"{pack}.{closed[0]}")

            yield Move(
                f"PI control of {closed[1]} in place of its reference from {name}",
                regulated,
                change="replace",
                where=f"a loop of {closed[1]} on {closed[0]} in place of that axis of {name}",
            )


def _reference_voltage(view: View) -> Iterator[Move]:
    """What filters the voltage by which references are computed."""
    draft, voltage = view.draft, view.roles.voltage
    for name in draft.having(Element.REFERENCE):
        row = row_before(draft, f"{name}.v")
        elements = {block: view.element(block) for block in row}
        entry = f"{row[-1]}.in_" if row else f"{name}.v"
        targets = {
            block: [f"{name}.v", *(f"{one}.in_" for one in row)][k] for k, block in enumerate(row)
        }
        for block in row:
            if elements[block] not in (Element.LOW_PASS, *ELEMENTS):
                continue

            def taken(draft: Edit, block: str = block, target: str = targets[block]) -> None:
                for source in draft.sources(f"{block}.in_"):
                    draft.connect(source, target)
                draft.disconnect(f"{block}.out", target)

            yield Move.at("remove", f"{block} on the way to {name}", taken)
        if Element.LOW_PASS not in elements.values():
            yield Move(
                f"a low-pass on the voltage of {name}",
                lambda draft, name=name: draft.insert_before(
                    f"{name}.v", "LPF1_dq", "reference_filter", omega_c=CORNER
                ),
                change="add",
                where=f"a low-pass before {name}",
            )
        if draft.sources(entry) == [voltage] and not {*elements.values()} & {*ELEMENTS}:
            yield from _positive_sequence(view, name, entry)


def _positive_sequence(view: View, name: str, entry: str) -> Iterator[Move]:
    """References by the positive sequence of the voltage that enters at an input."""
    draft, voltage = view.draft, view.roles.voltage
    if not view.known("DSOGI_dq"):
        return
    k = FILTERS["DSOGI_dq"]["k"]
    yield Move(
        f"{name} by the positive sequence of a DSOGI",
        lambda draft: draft.insert(voltage, [entry], "DSOGI_dq", "reference_sequence", k=k),
        change="add",
        where=f"DSOGI_dq on the voltage of {name}",
    )
    for pll in draft.having(Element.PLL):
        locked, filters = locked_vector(view, pll), sequence_filters_of(view, pll)
        if filters:
            yield Move(
                f"{name} by the positive sequence of {filters[0]}",
                lambda draft, filtered=f"{filters[0]}.out": draft.rewire(voltage, filtered, entry),
                change="add",
                where=f"the output of {filters[0]} at {name}",
            )
        elif locked:

            def both(draft: Edit, locked: tuple[str, str | None] = locked) -> None:
                sequence = draft.after(voltage, "DSOGI_dq", "sequence", k=k)
                draft.rewire(voltage, sequence, entry)
                lock_to(draft, sequence, locked)

            yield Move(
                f"one DSOGI for {pll} and {name}",
                both,
                change="add",
                where=f"DSOGI_dq on the voltage of {pll} and {name}",
            )


POWER_REFERENCE = Effect(
    id="power_reference",
    law="i_ref = (p*/|v_f|, -q*/|v_f|), v_f the measured voltage as it is, behind a low-pass or "
    "a DSOGI: no loop of p and q, or of one of them",
    places="at the reference of the current loop, in place of loops of p and q, on one axis; "
    "filters of the voltage before it",
    signature="below the filter's corner; the column of v_d in proportion to p and q, constant "
    "power towards 0 Hz",
    confused_with=("power_loop_missing", "reactive_loop_missing"),
    told_apart_by="points between 5 and 50 Hz at two powers: loops show their own corners there",
    moves=_power_reference,
)


def _reference_feedforward(view: View) -> Iterator[Move]:
    draft, loop, way = view.draft, view.roles.current_loop, current_path(view)
    if loop is None or not way:
        return
    measured = f"{way[-2]}.out" if len(way) > 1 else measured_current(view)
    references = [
        one
        for one in draft.sources(f"{loop}.in_")
        if one != measured and one not in draft.sources(measured)
    ]
    present = {
        name
        for one in references
        for name in path(draft, one, view.roles.command, without=loops(view)) or ()
        if view.element(name) is Element.GAIN
    }
    for name in sorted(present):
        yield Move.at(
            "remove",
            f"{name}, from the reference to the command",
            lambda draft, name=name: draft.remove(name),
        )
    if references and not present:

        def second(draft: Edit) -> None:
            name = draft.add("Gain_dq", "reference_feedforward", **SECOND)
            draft.gather(f"{name}.in_", *references)
            draft.connect(f"{name}.out", *draft.targets(f"{loop}.out"))

        where = f"{' and '.join(references)} past {loop}"
        yield Move(
            "two degrees of freedom of the current control", second, change="add", where=where
        )


REFERENCE_FEEDFORWARD = Effect(
    id="reference_feedforward",
    law="u_r += k i_ref beside the current loop: two degrees of freedom, the reference has another "
    "proportional gain, kP + k, "
    "than the measured current",
    places="from the current reference to the command",
    signature="between the outer loops' bandwidth and the current loop's; what the outer loops "
    "feel, rows of both axes",
    confused_with=("power_gains",),
    told_apart_by="points around the current loop's bandwidth at an operating point with large "
    "powers",
    moves=_reference_feedforward,
)


def _shared_filters(view: View) -> list[str]:
    """Low-passes of one cutoff right behind the voltage and a current, or that through which alone
    the voltage is taken.
    """
    roles, draft, by_cutoff = view.roles, view.draft, dict[str, list[str]]()
    for signal in dict.fromkeys((roles.voltage, roles.current, grid_current(view))):
        for name in draft.having(Element.LOW_PASS, signal=Signal.DQ_VEC):
            if draft.sources(f"{name}.in_") == [signal]:
                by_cutoff.setdefault(str([*view.bound(name).values()]), []).append(name)
    takers = [
        one
        for one in draft.targets(roles.voltage)
        if one not in followers(draft) and not of_circuit(draft, one)
    ]
    filtered = [name for names in by_cutoff.values() for name in names if takers == [f"{name}.in_"]]
    lone = [] if draft.targets(f"{roles.plant}.e_q") else filtered
    several = len(draft.targets(f"{lone[0]}.out")) > 1 if lone else False
    return next((names for names in by_cutoff.values() if len(names) > 1), lone if several else [])


def _measurement_filter(view: View) -> Iterator[Move]:
    draft, roles = view.draft, view.roles
    present = _shared_filters(view)
    if present:

        def without(draft: Edit) -> None:
            for name in present:
                draft.bypass(name)
            own_q_axis(draft, view)

        words = (
            f"{', '.join(present)}, which share one cutoff"
            if len(present) > 1
            else f"{present[0]} behind {roles.voltage}"
        )
        yield Move.at("remove", words, without)
        return
    bound = followers(draft)
    own = f"{roles.plant}.e_q"
    signals = {
        signal: [
            one for one in draft.targets(signal) if one not in bound and not of_circuit(draft, one)
        ]
        for signal in dict.fromkeys((roles.voltage, roles.current, grid_current(view)))
    }
    scalars = draft.targets(own)
    if not in_control(draft, roles.current) or not (signals[roles.voltage] or scalars):
        return

    def shared(draft: Edit, measured: Iterable[str]) -> None:
        first = ""
        for signal in measured:
            targets = signals[signal]
            if not targets and not (signal == roles.voltage and scalars):
                continue
            name = draft.add(
                "LPF1_dq",
                "sensor",
                **({"omega_c": f"{first}.omega_c"} if first else {"omega_c": SENSOR}),
            )
            first = first or name
            draft.connect(signal, f"{name}.in_")
            draft.rewire(signal, f"{name}.out", *targets)
            if signal == roles.voltage and scalars:
                draft.rewire(own, draft.after(f"{name}.out", "SliceQ", "e_q"), *scalars)

    every = [one for one, targets in signals.items() if targets]
    draw = partial(shared, measured=signals)
    yield Move(
        "one low-pass on all that is measured",
        draw,
        change="add",
        where=f"behind {', '.join(every)}",
    )
    if len(every) > 1 and roles.voltage in every:
        draw = partial(shared, measured=[roles.voltage])
        words = "one low-pass on the measured voltage, for all that takes it"
        yield Move(words, draw, change="add", where=f"behind {roles.voltage}, currents unfiltered")


MEASUREMENT_FILTER = Effect(
    id="measurement_filter",
    law="omega_c/(s + omega_c), one cutoff, on every voltage and current that the controller "
    "measures, or on the voltage alone",
    places="behind all sensors at once, behind that of the voltage",
    signature="above 100 Hz; all entries alike, the same at every operating point",
    confused_with=("control_delay", "current_filter", "voltage_feedforward_filter"),
    told_apart_by="the resonance, where a filter of the current alone leaves the feedforward "
    "prompt",
    moves=_measurement_filter,
)


FAMILIES = (
    Family(
        "power reference",
        "structural",
        (1.0, 1.0, 0.3, 0.1),
        3.0,
        where_missing(_power_reference, having(Element.REFERENCE)),
        if_gross=4.0,
    ),
    Family("loop of one axis", "module", (1.0, 1.0, 0.3, 0.1), 2.0, always(_loop_of_one_axis)),
    Family("reference voltage", "module", (0.7, 1.0, 0.3, 0.1), 1.0, always(_reference_voltage)),
    Family(
        "two degrees of freedom",
        "module",
        (0.3, 1.0, 0.7, 0.1),
        1.0,
        always(_reference_feedforward),
    ),
    Family("measurement filter", "module", (0.0, 0.3, 1.0, 1.0), 1.0, always(_measurement_filter)),
)
