"""How the controller gets its frame: a PLL, a droop of the active power, a virtual oscillator, a blend of two, or none."""

from collections.abc import Iterator

from ibrid.structure.drafting import Draft
from ibrid.structure.frames import put_into_frame, put_into_grid_frame
from ibrid.structure.wiring import split_port
from ibrid_search.proposers.moves.drawing import after, frequency_sources, power_module, to_axis
from ibrid_search.proposers.moves.family import Move, View


def synchronisation(view: View) -> Iterator[Move]:
    """A PLL, a droop of the active power or a virtual oscillator, each with the rotations into its frame."""
    roles = view.roles
    if not view.knows("Rot_v", "Rot_i"):
        return
    if not view.draft.named("SRF_PLL") and view.known("SRF_PLL"):

        def pll(draft: Draft) -> None:
            name = draft.add("SRF_PLL", "pll")
            draft.connect(f"{roles.plant}.e_q", f"{name}.e_q")
            put_into_frame(draft, roles.plant, f"{name}.delta_omega", f"{name}.delta")

        yield Move("synchronisation by a PLL, with the rotations into its frame", pll, 2.0)
    if not view.known("Integrator"):
        return
    for filtered in (True, False) if view.knows("PQ_calc", "Gain") else ():

        def droop(draft: Draft, filtered: bool = filtered) -> None:
            frequency = _droop(draft, view, filtered=filtered)
            put_into_frame(draft, roles.plant, frequency, after(draft, frequency, "Integrator", "angle"))

        usual = 1.0 if filtered else 0.5
        yield Move(f"synchronisation by {_words(filtered=filtered)} (grid-forming)", droop, usual)
    if view.known("dVOC") and not view.draft.named("dVOC"):

        def oscillator(draft: Draft) -> None:
            name = draft.add("dVOC", "oscillator")
            draft.chain(roles.voltage, f"{name}.v", f"{roles.plant}.i_g", f"{name}.i")
            to_axis(draft, f"{name}.E", f"{roles.voltage_loop}.in_" if roles.voltage_loop else roles.reference, "in_d")
            frequency = f"{name}.delta_omega"
            put_into_frame(draft, roles.plant, frequency, after(draft, frequency, "Integrator", "angle"))

        words = "synchronisation by a virtual oscillator, which also gives the voltage (grid-forming)"
        yield Move(words, oscillator, 0.5)


def _droop(draft: Draft, view: View, *, filtered: bool) -> str:
    """Minus the active power through a gain, and a low-pass, which makes it the swing equation of a virtual machine."""
    source = after(draft, draft.negated(f"{power_module(draft, view.roles)}.p"), "Gain", "droop")
    return after(draft, source, "LPF1", "droop_filter") if filtered else source


def _words(*, filtered: bool) -> str:
    return "a droop of the filtered active power" if filtered else "a droop of the active power"


def grid_forming(view: View) -> bool:
    """True when something other than a PLL makes the frequency."""
    return view.roles.frequency is not None and not view.draft.named("SRF_PLL")


def blend(view: View) -> Iterator[Move]:
    """PLL and droop add up to the frequency, the weight of each within its gains."""
    roles, draft = view.roles, view.draft
    if roles.frequency is None or not view.knows("PI", "Integrator"):
        return
    plls = draft.named("SRF_PLL")
    if plls and view.knows("PQ_calc", "Gain"):
        for filtered in (True, False):

            def droop_too(draft: Draft, filtered: bool = filtered, pll: str = plls[0]) -> None:
                entering = draft.sources(f"{pll}.e_q")
                droop = _droop(draft, view, filtered=filtered)
                regulator, angle = draft.add("PI", "pll_regulator"), draft.add("Integrator", "angle")
                for source in entering:
                    draft.connect(source, f"{regulator}.in_")
                for target in draft.targets(f"{pll}.delta"):
                    draft.connect(f"{angle}.out", target)
                for target in (*draft.targets(f"{pll}.delta_omega"), f"{angle}.in_"):
                    draft.chain(f"{regulator}.out", target, droop, target)
                draft.remove(pll)

            yield Move(f"{_words(filtered=filtered)} beside the PLL", droop_too)
    regulators = {split_port(target)[0] for target in draft.targets(f"{roles.plant}.e_q")}
    integrators = [name for name in draft.named("Integrator") if _turns_the_frame(draft, name)]
    if not plls and integrators and not any(draft.instances[name].kind == "PI" for name in regulators):

        def pll_too(draft: Draft) -> None:
            targets = [f"{one}.delta_omega" for one in draft.instances if "delta_omega" in draft.kind(one).inputs]
            regulator = after(draft, f"{roles.plant}.e_q", "PI", "pll_regulator")
            for target in (*targets, *(f"{name}.in_" for name in integrators)):
                draft.connect(regulator, target)

        yield Move("a PLL beside the droop", pll_too)


def _turns_the_frame(draft: Draft, integrator: str) -> bool:
    kinds = {draft.instances[split_port(one)[0]].kind for one in draft.targets(f"{integrator}.out") if "." in one}
    return bool(kinds & {"Rot_v", "Rot_i"})


def frequency_damping(view: View) -> Iterator[Move]:
    """The swing of a virtual machine damped by the frequency that a PLL measures, which enters its inertia beside the power."""
    draft = view.draft
    if not grid_forming(view) or not view.known("PLL_frequency") or draft.named("PLL_frequency"):
        return
    sources = frequency_sources(draft, view.roles)
    for inertia in {one: None for source in sources for one in _inertias(draft, split_port(source)[0])}:

        def damping(draft: Draft, inertia: str = inertia) -> None:
            pll = draft.add("PLL_frequency", "grid_frequency")
            draft.connect(view.roles.voltage, f"{pll}.v")
            for source in sources:
                draft.connect(source, f"{pll}.delta_omega")
            draft.connect(after(draft, f"{pll}.delta_omega_pll", "Gain", "frequency_damping"), f"{inertia}.in_")

        yield Move(f"the frequency of a PLL damps the swing at {inertia}", damping)


def _inertias(draft: Draft, name: str) -> list[str]:
    """The low-passes that make a signal, itself or behind gains and signs."""
    kind = draft.instances[name].kind
    if kind == "LPF1":
        return [name]
    if kind not in ("Gain", "Negate"):
        return []
    return [one for source in draft.sources(f"{name}.in_") for one in _inertias(draft, split_port(source)[0])]


def no_synchronisation(view: View) -> Iterator[Move]:
    """The rotations and what drives them taken away."""
    roles = view.roles
    if roles.frequency is None and not roles.rotated:
        return

    def fixed(draft: Draft) -> None:
        put_into_grid_frame(draft)
        for source in draft.sources(f"{roles.plant}.delta_omega"):
            draft.disconnect(source, f"{roles.plant}.delta_omega")

    yield Move("no synchronisation: the controller works in the grid's frame", fixed)
