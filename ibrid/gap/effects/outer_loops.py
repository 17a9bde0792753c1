"""What stands in the place of the loops of p and q, or acts on their references: DC link, AC voltage, droops."""

from collections.abc import Iterator

from ibrid.gap.axes import drive_axis, regulates, regulator
from ibrid.gap.effect import Edit, Effect, Insertion, Model, Strength
from ibrid.gap.paths import after, path
from ibrid.gap.strengths import cutoff, pi_gains


def _ac_voltage_loop(model: Model) -> Iterator[Insertion]:
    found = regulator(model, "in_q")
    measured = regulates(model, found)
    if measured == "voltage" and found is not None:
        where = f"{found}, the loop of the AC voltage"
        yield from model.edited("ac_voltage_loop", "remove", where, lambda draft: draft.remove(found))
    if found is None or measured == "q":

        def loop(draft: Edit) -> dict[str, Strength]:
            name = draft.add("PI", "ac_voltage")
            draft.connect(after(draft, model.roles.voltage, "Magnitude", "e_size"), f"{name}.in_")
            drive_axis(draft, f"{name}.out", model.roles.reference, "in_q")
            return pi_gains(name, (0.05, 0.2, 1.0), (5.0, 30.0, 150.0), vanishes=found is None)

        change = "add" if found is None else "replace"
        where = f"|{model.roles.voltage}| to in_q of the current reference" + (f" in place of {found}" if found else "")
        yield from model.edited("ac_voltage_loop", change, where, loop)


AC_VOLTAGE_LOOP = Effect(
    id="ac_voltage_loop",
    law="i_ref_q = -(k_P + k_I/s)(V* - |e|)",
    places="on the q axis of the current reference, in place of the q loop where there is one",
    signature="below 50 Hz; qd and qq; towards 0 Hz the voltage is stiff",
    confused_with=("reactive_loop_missing", "voltage_droop"),
    told_apart_by="points below 5 Hz, where a loop of the voltage makes its column large",
    insertions=_ac_voltage_loop,
)


def _dc_link(model: Model) -> Iterator[Insertion]:
    roles = model.roles
    found = regulator(model, "in_d")
    measured = regulates(model, found)
    if measured == "dc" and found is not None:
        where = f"{found}, the loop of the DC voltage, and the DC link"
        yield from model.edited("dc_link", "remove", where, lambda draft: draft.remove(found))
    if found is None or measured == "p":

        def link(draft: Edit) -> dict[str, Strength]:
            capacitor, name = draft.add("DC_link", "dc_link"), draft.add("PI", "dc_voltage")
            drive_axis(draft, f"{name}.out", roles.reference, "in_d")
            draft.chain(roles.current, f"{capacitor}.i", f"{capacitor}.v_dc", f"{name}.in_")
            for source in draft.sources(roles.command):
                draft.connect(source, f"{capacitor}.u")
            gains = pi_gains(name, (2.0, 1.5, 1.0), (80.0, 50.0, 20.0), vanishes=found is None)
            return {f"{capacitor}.C_dc": Strength((0.05, 0.02, 0.008)), **gains}

        change = "add" if found is None else "replace"
        where = "v_dc to in_d of the current reference" + (f" in place of {found}" if found else "")
        yield from model.edited("dc_link", change, where, link)


DC_LINK = Effect(
    id="dc_link",
    law="C_dc v_dc v_dc' = P_in - u_r' i_ti (C_dc in s), i_ref_d = (k_P + k_I/s)(v_dc - 1)",
    places="on the d axis of the current reference, in place of the p loop where there is one",
    signature="5 to 100 Hz; dd most (more than 80 %), less at low power",
    confused_with=("power_loop_missing",),
    told_apart_by="operating points with different powers, and points around the DC-voltage loop's bandwidth",
    insertions=_dc_link,
)


def _frequency_droop(model: Model) -> Iterator[Insertion]:
    loop = regulator(model, "in_d")
    if model.roles.frequency is None or loop is None or regulates(model, loop) != "p":
        return
    (frequency, *_) = model.draft.sources(f"{model.roles.plant}.delta_omega")
    yield from _droop(model, "frequency_droop", frequency, loop, f"{frequency} to {loop}", _negated)


def _negated(draft: Edit, frequency: str) -> str:
    return draft.negated(frequency)


def _voltage_droop(model: Model) -> Iterator[Insertion]:
    loop = regulator(model, "in_q")
    if loop is None or regulates(model, loop) != "q":
        return
    size = next((f"{one}.out" for one in model.draft.named("Magnitude")), "")
    where = f"|{model.roles.voltage}| to {loop}"
    yield from _droop(model, "voltage_droop", size, loop, where, lambda draft, _: size or _size(draft, model))


def _size(draft: Edit, model: Model) -> str:
    return after(draft, model.roles.voltage, "Magnitude", "e_size")


#: Strengths of the two droops: k_f/omega_0 at 60 Hz for k_f of 2, 10, 40; k_v in per unit of q over per unit of voltage.
DROOPS = {"frequency_droop": (0.005, 0.026, 0.1), "voltage_droop": (0.5, 2.0, 8.0)}


def _droop(model: Model, effect: str, source: str, loop: str, where: str, signed) -> Iterator[Insertion]:
    """A path with a gain and maybe a filter from a source to the error of a loop; `signed` : (draft, source) -> port."""
    draft, target = model.draft, f"{loop}.in_"
    blocks = list((path(draft, source, target) if source else None) or ())
    if any(draft.instances[name].kind == "Gain" for name in blocks):

        def without(draft: Edit) -> None:
            draft.disconnect(f"{blocks[-1]}.out", target)

        yield from model.edited(effect, "remove", where, without)
        filters = [name for name in blocks if draft.instances[name].kind == "LPF1"]
        for name in filters:
            words = f"without the filter {name}"
            yield from model.bypassed(effect, "replace", f"{where}, {words}", name)
        if not filters:

            def filtered(draft: Edit) -> dict[str, Strength]:
                return {
                    f"{draft.insert_before(f'{blocks[0]}.in_', 'LPF1', 'droop_filter')}.omega_c": cutoff(100, 10, 2)
                }

            yield from model.edited(effect, "replace", f"{where}, behind a low-pass", filtered)
        return
    for low_pass in (False, True):

        def droop(draft: Edit, low_pass: bool = low_pass) -> dict[str, Strength]:
            port, strengths = signed(draft, source), {}
            if low_pass:
                port = after(draft, port, "LPF1", "droop_filter")
                strengths = {f"{port.split('.')[0]}.omega_c": Strength(cutoff(10, 5, 2).bank)}
            name = draft.add("Gain", effect)
            draft.chain(port, f"{name}.in_", f"{name}.out", target)
            return {f"{name}.k": Strength(DROOPS[effect], 0.0), **strengths}

        yield from model.edited(effect, "add", where + (", behind a low-pass" if low_pass else ""), droop)


FREQUENCY_DROOP = Effect(
    id="frequency_droop",
    law="p* -= k_f delta_omega/omega_0, with or without LPF1; the gain's k is k_f/omega_0",
    places="from the PLL's frequency to the error of the p loop",
    signature="below the PLL's bandwidth; the column of v_q in the d row",
    confused_with=("pll_missing",),
    told_apart_by="points between 1 and 10 Hz, where the PLL still follows and the p loop acts",
    insertions=_frequency_droop,
)

VOLTAGE_DROOP = Effect(
    id="voltage_droop",
    law="q* -= k_v (|e| - V*), with or without LPF1",
    places="from the magnitude of the measured voltage to the error of the q loop",
    signature="below 50 Hz; lifts qd, dd unchanged",
    confused_with=("ac_voltage_loop", "reactive_loop_missing"),
    told_apart_by="points below 5 Hz: with a droop qd settles at a slope, under voltage control it does not",
    insertions=_voltage_droop,
)
