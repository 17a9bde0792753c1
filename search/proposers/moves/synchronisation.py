"""How the controller gets its frame: a PLL, a droop of the active power, or none."""

from collections.abc import Iterator

from ibrid.structure.diagram import TERMINAL_CURRENT, TERMINAL_VOLTAGE
from ibrid.structure.drafting import Draft
from ibrid.structure.roles import Roles
from search.proposers.moves.drawing import after, power_module
from search.proposers.moves.family import Move, View


def synchronisation(view: View) -> Iterator[Move]:
    """A PLL, or a droop of the active power, each with the rotations into its frame."""
    roles, kind = view.roles, _kind_of(view, view.roles.frequency)
    if not view.known("Rot_v") or not view.known("Rot_i"):
        return
    if kind != "SRF_PLL" and view.known("SRF_PLL"):

        def pll(draft: Draft) -> None:
            name = draft.add("SRF_PLL", "pll")
            draft.connect(f"{roles.plant}.e_q", f"{name}.e_q")
            _synchronise(draft, roles, f"{name}.delta_omega", f"{name}.delta")

        yield Move("synchronisation by a PLL, with the rotations into its frame", pll)
    if view.known("PQ_calc") and view.known("Integrator"):
        for filtered in (True, False):

            def droop(draft: Draft, filtered: bool = filtered) -> None:
                source = draft.negated(f"{power_module(draft, roles)}.p")
                if filtered:
                    source = after(draft, source, "LPF1", "droop_filter")
                frequency = after(draft, source, "Gain", "droop")
                angle = after(draft, frequency, "Integrator", "angle")
                _synchronise(draft, roles, frequency, angle)

            how = "a droop of the filtered active power" if filtered else "a droop of the active power"
            yield Move(f"synchronisation by {how} (grid-forming)", droop)


def no_synchronisation(view: View) -> Iterator[Move]:
    """The rotations and what drives them taken away."""
    roles = view.roles
    if roles.frequency is None and not roles.rotated:
        return

    def fixed(draft: Draft) -> None:
        for name in draft.named("Rot_v"):
            for target in draft.targets(f"{name}.v_dq"):
                draft.connect(TERMINAL_VOLTAGE, target)
            draft.remove(name)
        for name in draft.named("Rot_i"):
            for source in draft.sources(f"{name}.i_dq"):
                draft.connect(source, TERMINAL_CURRENT)
            draft.remove(name)
        for source in draft.sources(f"{roles.plant}.delta_omega"):
            draft.disconnect(source, f"{roles.plant}.delta_omega")

    yield Move("no synchronisation: the controller works in the grid's frame", fixed)


def _synchronise(draft: Draft, roles: Roles, frequency: str, angle: str) -> None:
    """Let frequency and angle come from new sources; rotate the terminals if that is not done yet."""
    for rotation, port in (("Rot_v", "delta"), ("Rot_i", "delta")):
        for name in draft.named(rotation):
            for source in draft.sources(f"{name}.{port}"):
                draft.disconnect(source, f"{name}.{port}")
            draft.connect(angle, f"{name}.{port}")
    targets = [f"{roles.plant}.delta_omega"]
    targets += [f"{name}.delta_omega" for name in draft.named("JMul_omega")]
    for target in targets:
        for source in draft.sources(target):
            draft.disconnect(source, target)
        draft.connect(frequency, target)
    if not draft.named("Rot_v"):
        consumers = draft.targets(TERMINAL_VOLTAGE)
        name = draft.add("Rot_v", "park_v")
        for target in consumers:
            draft.disconnect(TERMINAL_VOLTAGE, target)
            draft.connect(f"{name}.v_dq", target)
        draft.chain(TERMINAL_VOLTAGE, f"{name}.v_DQ", angle, f"{name}.delta")
    if not draft.named("Rot_i"):
        sources = draft.sources(TERMINAL_CURRENT)
        name = draft.add("Rot_i", "park_i")
        for source in sources:
            draft.disconnect(source, TERMINAL_CURRENT)
            draft.connect(source, f"{name}.i_dq")
        draft.chain(f"{name}.i_DQ", TERMINAL_CURRENT, angle, f"{name}.delta")


def _kind_of(view: View, name: str | None) -> str | None:
    return view.draft.instances[name].kind if name is not None else None
