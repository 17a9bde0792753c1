"""The outer loops of p and q: there or not, their filters, their gains."""

from collections.abc import Iterator

from ibrid.gap.axes import drive_axis, packs, power_block, regulates, regulator
from ibrid.gap.effect import Edit, Effect, Insertion, Model, Strength
from ibrid.gap.paths import path
from ibrid.gap.strengths import cutoff, pi_gains

AXES = {"p": "in_d", "q": "in_q"}
IDS = {"p": "power_loop_missing", "q": "reactive_loop_missing"}
#: What may regulate an axis in the place of p and q.
INSTEAD = {"p": ("dc", "the DC link's"), "q": ("voltage", "the AC-voltage")}


def _power_loop(model: Model, power: str) -> Iterator[Insertion]:
    axis, effect = AXES[power], IDS[power]
    found = regulator(model, axis)
    measured = regulates(model, found)
    instead, words = INSTEAD[power]
    if measured == power and found is not None:
        where = f"{found}, the loop of {power}"
        yield from model.edited(effect, "remove", where, lambda draft: draft.remove(found))
    if found is None or measured == instead:
        change = "add" if found is None else "replace"
        where = f"{power} to {axis} of the current reference" + (f" in place of {words} loop {found}" if found else "")
        yield from model.edited(
            effect, change, where, lambda draft: _with_loop(draft, model, power, vanishes=not found)
        )
        twin = regulator(model, AXES["q" if power == "p" else "p"])
        if twin is not None and model.draft.instances[twin].kind == "PI" and regulates(model, twin) in ("p", "q"):
            where += f", with the gains of {twin}"
            yield from model.edited(effect, change, where, lambda draft: _with_twin(draft, model, power, twin))


def _active_power_loop(model: Model) -> Iterator[Insertion]:
    return _power_loop(model, "p")


def _reactive_power_loop(model: Model) -> Iterator[Insertion]:
    return _power_loop(model, "q")


def _with_loop(draft: Edit, model: Model, power: str, *, vanishes: bool) -> dict[str, Strength]:
    name = _put(draft, model, power)
    return pi_gains(name, (0.005, 0.02, 0.1), (2.0, 20.0, 60.0), vanishes=vanishes)


def _with_twin(draft: Edit, model: Model, power: str, twin: str) -> None:
    bound = draft.instances[twin].bindings
    draft.bind(_put(draft, model, power), **{key: bound.get(key, f"{twin}.{key}") for key in ("kP", "kI")})


def _put(draft: Edit, model: Model, power: str) -> str:
    """A PI controller on minus p, or on q, that drives its axis; returns its name."""
    block = power_block(draft, model)
    name = draft.add("PI", f"{power}_loop")
    draft.connect(draft.negated(f"{block}.p") if power == "p" else f"{block}.q", f"{name}.in_")
    drive_axis(draft, f"{name}.out", model.roles.reference, AXES[power])
    return name


POWER_LOOP_MISSING = Effect(
    id="power_loop_missing",
    law="i_ref_d = (k_P + k_I/s)(p* - p)",
    places="on the d axis of the current reference: gains of its own, or those of the q loop",
    signature="below 50 Hz; dd, and the value towards 0 Hz: constant power turns the sign of the conductance",
    confused_with=("dc_link", "reactive_loop_missing"),
    told_apart_by="the admittance below 5 Hz at two powers: with loops of p and q it tends to [[p, -q], [-q, -p]]/v^2",
    insertions=_active_power_loop,
)

REACTIVE_LOOP_MISSING = Effect(
    id="reactive_loop_missing",
    law="i_ref_q = -(k_P + k_I/s)(q* - q)",
    places="on the q axis of the current reference: gains of its own, or those of the p loop",
    signature="below 50 Hz; qd, and the value towards 0 Hz",
    confused_with=("ac_voltage_loop", "power_loop_missing", "voltage_droop"),
    told_apart_by="the admittance below 5 Hz at two reactive powers",
    insertions=_reactive_power_loop,
)


def _power_filter(model: Model) -> Iterator[Insertion]:
    draft = model.draft
    for block in model.roles.power:
        used = [axis for axis in "pq" if draft.targets(f"{block}.{axis}")]
        present = {axis: _filter_of(model, block, axis) for axis in used}
        there = {axis: name for axis, name in present.items() if name is not None}
        if there:
            where = f"{' and '.join(there.values())} behind {block}"
            yield from model.edited("power_filter", "remove", where, _all_bypassed(tuple(there.values())))
            for axis, name in there.items() if len(there) > 1 else ():
                where = f"{name} behind {block}.{axis}, the other stays"
                yield from model.edited("power_filter", "remove", where, _all_bypassed((name,)))
        free = [axis for axis in used if axis not in there]
        for axes in dict.fromkeys((tuple(free), *((axis,) for axis in free))) if free else ():
            words = " and ".join(f"{block}.{axis}" for axis in axes)
            where = f"behind {words}" + (", one corner frequency" if len(axes) > 1 else "")
            yield from model.edited("power_filter", "add", where, _filtered(block, axes))


def _filter_of(model: Model, block: str, axis: str) -> str | None:
    """The low-pass right behind p or q, if there is one that everything takes."""
    targets = model.draft.targets(f"{block}.{axis}")
    name = targets[0].split(".")[0]
    return name if len(targets) == 1 and model.draft.instances[name].kind == "LPF1" else None


def _all_bypassed(names: tuple[str, ...]):
    def edit(draft: Edit) -> None:
        for name in reversed(names):  # the first lends its parameters to the others
            draft.bypass(name)

    return edit


def _filtered(block: str, axes: tuple[str, ...]):
    def edit(draft: Edit) -> dict[str, Strength]:
        ports = [f"{block}.{axis}" for axis in axes]
        names = [
            draft.insert(port, draft.targets(port), "LPF1", f"{axis}_filter")
            for port, axis in zip(ports, axes, strict=True)
        ]
        shared = f"{names[0]}.omega_c"
        if len(names) > 1:
            shared = f"{draft.free_name('power_filter')}.omega_c"
            for name in names:
                draft.bind(name, omega_c=shared)
        return {shared: cutoff(100, 30, 8)}

    return edit


POWER_FILTER = Effect(
    id="power_filter",
    law="the loops take omega_c/(s + omega_c) of p and q, one corner frequency",
    places="behind p and q together, behind one of them",
    signature="below 100 Hz, around the corner frequency; all entries, in proportion to voltage and current at rest",
    confused_with=("power_gains", "reference_filter"),
    told_apart_by="nothing at the terminals when one filter serves both axes: ask for the firmware's block diagram, or "
    "step a reference",
    insertions=_power_filter,
)


def _reference_filter(model: Model) -> Iterator[Insertion]:
    draft, reference = model.draft, model.roles.reference
    for pack in packs(model):
        blocks = path(draft, f"{pack}.out", reference) or ()
        present = [name for name in blocks if draft.instances[name].kind == "LPF1_dq"]
        for name in present:
            where = f"{name} between {pack}.out and {reference}"
            yield from model.bypassed("reference_filter", "remove", where, name)
        if not present:

            def filtered(draft: Edit, pack: str = pack) -> dict[str, Strength]:
                port = f"{pack}.out"
                name = draft.insert(port, draft.targets(port), "LPF1_dq", "reference_filter")
                return {f"{name}.omega_c": cutoff(100, 30, 8)}

            yield from model.edited("reference_filter", "add", f"behind {pack}.out", filtered)


REFERENCE_FILTER = Effect(
    id="reference_filter",
    law="i_ref = omega_c/(s + omega_c) (the outer loops' output)",
    places="between the outer loops and the current loop",
    signature="as a filter of p and q with one corner frequency: the two commute with the loops",
    confused_with=("power_filter",),
    told_apart_by="a step of the current reference; at the terminals only loops that differ on the two axes",
    insertions=_reference_filter,
)


def _power_gains(model: Model) -> Iterator[Insertion]:
    p, q = regulator(model, "in_d"), regulator(model, "in_q")
    if p is None or q is None or model.draft.instances[p].kind != "PI" or model.draft.instances[q].kind != "PI":
        return
    bound = [model.draft.instances[name].bindings for name in (p, q)]
    own = [
        {key: one.get(key, f"{name}.{key}") for key in ("kP", "kI")} for name, one in zip((p, q), bound, strict=True)
    ]
    if own[0] != own[1] or not all(isinstance(value, str) for value in own[0].values()):
        return
    lender = next((name for name in (p, q) if str(own[0]["kP"]).split(".")[0] == name), p)
    other = q if lender == p else p

    def freed(draft: Edit) -> dict[str, Strength]:
        draft.unbind(other, "kP", "kI")
        return pi_gains(other, (0.01, 0.05, 0.002), (10.0, 50.0, 2.0), vanishes=False)

    yield from model.edited(
        "power_gains", "replace", f"gains of its own for {other}, which shares those of {lender}", freed
    )


POWER_GAINS = Effect(
    id="power_gains",
    law="the loops of p and q have gains of their own where the model gives them one pair",
    places="the second of the two loops",
    signature="below 50 Hz, in the entries of one axis",
    confused_with=("power_filter",),
    told_apart_by="points below 10 Hz, where each axis shows the corner of its own loop",
    insertions=_power_gains,
)
