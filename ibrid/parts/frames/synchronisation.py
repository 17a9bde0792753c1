"""How the controller gets its frame: a PLL, a droop of the active power, a virtual oscillator, a
blend of two, or none.
"""

from collections.abc import Iterator

from ibrid.modules.behaviour import ROTATIONS, Element
from ibrid.parts.editing.edit import Edit, Strength, cutoff, pi_gains
from ibrid.parts.editing.paths import (
    drive_axis,
    frequency_sources,
    grid_current,
    has_line,
    power_block,
)
from ibrid.parts.editing.practice import Effect, Family, where_missing, where_present
from ibrid.parts.editing.view import Move, View
from ibrid.structure.diagrams.diagram import TERMINAL_VOLTAGE
from ibrid.structure.editing.drafting import Draft
from ibrid.structure.editing.frames import put_into_frame, put_into_grid_frame
from ibrid.structure.reading.wiring import split_port

PLL_GAINS = {"kP_pll": Strength((20.0, 60.0, 200.0)), "kI_pll": Strength((150.0, 1500.0, 15000.0))}
#: Of a PLL that only shares in the frequency.
REGULATOR = pi_gains((5.0, 20.0, 100.0), (50.0, 400.0, 4000.0))
OSCILLATOR = {
    "eta": Strength((0.5, 1.5, 5.0)),
    "kappa": Strength((0.8, 1.2, 1.5)),
    "alpha": Strength((7.0, 20.0, 60.0)),
}


def _pll(draft: Edit, view: View, source: str) -> None:
    """A PLL on the q axis of the filter's voltage, or of the terminal voltage, with the rotations
    into its frame.
    """
    name = draft.add("SRF_PLL", "pll", **PLL_GAINS)
    turned = put_into_frame(draft, view.roles.plant, f"{name}.delta_omega", f"{name}.delta")
    e_q = source if source != TERMINAL_VOLTAGE else draft.after(turned, "SliceQ", "v_q")
    draft.connect(e_q, f"{name}.e_q")


def _pll_missing(view: View) -> Iterator[Move]:
    e_q = f"{view.roles.plant}.e_q"
    places = {e_q: e_q} | (
        {TERMINAL_VOLTAGE: "the q axis of the PCC voltage"} if has_line(view) else {}
    )
    for source, words in places.items() if view.roles.frequency is None else ():
        where = f"locked to {words}, with rotations at v_DQ and i_DQ"
        yield Move.at("add", where, lambda draft, source=source: _pll(draft, view, source))
    for pll in view.draft.having(Element.PLL):
        yield from _without_pll(pll)


def _without_pll(pll: str) -> Iterator[Move]:
    def nominal(draft: Edit) -> None:
        """What took the frequency takes zero, or goes."""
        for target in draft.targets(f"{pll}.delta_omega"):
            draft.disconnect(f"{pll}.delta_omega", target)
            if target.endswith(".delta_omega"):
                draft.connect(f"{draft.add('ConstZero', 'no_frequency')}.out", target)

    def in_the_grids_frame(draft: Edit) -> None:
        nominal(draft)
        put_into_grid_frame(draft)

    def at_a_constant_angle(draft: Edit) -> None:
        nominal(draft)
        draft.rewire(
            f"{pll}.delta",
            f"{draft.add('ConstZero', 'no_angle')}.out",
            *draft.targets(f"{pll}.delta"),
        )

    where = f"{pll} and the rotations, so that the controller works in the frame of the PCC voltage"
    yield Move.at("remove", where, in_the_grids_frame)
    where = f"{pll}, so that the rotations keep the angle at which the measured voltage lies on d"
    yield Move.at("remove", where, at_a_constant_angle)


PLL_MISSING = Effect(
    id="pll_missing",
    law="delta_omega = (kP_pll + kI_pll/s) e_q, delta = delta_omega/s, with rotations into and out "
    "of its frame",
    places="on the capacitor voltage, on the PCC voltage",
    signature="below the PLL's bandwidth, usually 5 to 50 Hz; qq most, in proportion to the "
    "current at rest",
    confused_with=("frequency_droop", "pll_prefilter", "pll_static_error"),
    told_apart_by="two operating points with different currents: the PLL's part scales with the "
    "current",
    moves=_pll_missing,
)


def synchronisation(view: View) -> Iterator[Move]:
    """A PLL, a droop of the active power or a virtual oscillator, each with the rotations into its
    frame.
    """
    roles = view.roles
    if not view.knows("Rot_v", "Rot_i"):
        return
    if not view.draft.having(Element.PLL) and view.known("SRF_PLL"):
        note = "synchronisation by a PLL, with the rotations into its frame"
        yield Move(note, lambda draft: _pll(draft, view, f"{roles.plant}.e_q"), 2.0)
    if not view.known("Integrator"):
        return
    for filtered in (True, False) if view.knows("PQ_calc", "Gain") else ():

        def droop(draft: Edit, filtered: bool = filtered) -> None:
            _turned_by(draft, view, _droop(draft, view, filtered=filtered))

        usual = 1.0 if filtered else 0.5
        yield Move(f"synchronisation by {_words(filtered=filtered)} (grid-forming)", droop, usual)
    if view.known("dVOC") and not view.draft.having(Element.OSCILLATOR):

        def oscillator(draft: Edit) -> None:
            name = draft.add("dVOC", "oscillator", **OSCILLATOR)
            draft.chain(roles.voltage, f"{name}.v", grid_current(view), f"{name}.i")
            target = f"{roles.voltage_loop}.in_" if roles.voltage_loop else roles.reference
            drive_axis(draft, f"{name}.E", target, "in_d")
            _turned_by(draft, view, f"{name}.delta_omega")

        words = (
            "synchronisation by a virtual oscillator, which also gives the voltage (grid-forming)"
        )
        yield Move(words, oscillator, 0.5)


def _turned_by(draft: Edit, view: View, frequency: str) -> None:
    put_into_frame(
        draft, view.roles.plant, frequency, draft.after(frequency, "Integrator", "angle")
    )


def _droop(draft: Edit, view: View, *, filtered: bool) -> str:
    """Minus the active power through a gain, and a low-pass, which makes it the swing equation of a
    virtual machine.
    """
    power = draft.negated(f"{power_block(draft, view)}.p")
    source = draft.after(power, "Gain", "droop", k=Strength((1.5, 5.0, 20.0)))
    return (
        draft.after(source, "LPF1", "droop_filter", omega_c=cutoff(30, 6, 1))
        if filtered
        else source
    )


def _words(*, filtered: bool) -> str:
    return f"a droop of the {'filtered ' * filtered}active power"


def grid_forming(view: View) -> bool:
    """True when something other than a PLL makes the frequency."""
    return view.roles.frequency is not None and not view.draft.having(Element.PLL)


def blend(view: View) -> Iterator[Move]:
    """PLL and droop add up to the frequency, the weight of each within its gains."""
    roles, draft = view.roles, view.draft
    if roles.frequency is None or not view.knows("PI", "Integrator"):
        return
    plls = draft.having(Element.PLL)
    if plls and view.knows("PQ_calc", "Gain"):
        for filtered in (True, False):

            def droop_too(draft: Edit, filtered: bool = filtered, pll: str = plls[0]) -> None:
                entering = draft.sources(f"{pll}.e_q")
                droop = _droop(draft, view, filtered=filtered)
                regulator, angle = (
                    draft.add("PI", "pll_regulator", **REGULATOR),
                    draft.add("Integrator", "angle"),
                )
                draft.gather(f"{regulator}.in_", *entering)
                draft.connect(f"{angle}.out", *draft.targets(f"{pll}.delta"))
                for target in (*draft.targets(f"{pll}.delta_omega"), f"{angle}.in_"):
                    draft.chain(f"{regulator}.out", target, droop, target)
                draft.remove(pll)

            yield Move(f"{_words(filtered=filtered)} beside the PLL", droop_too)
    regulators = {split_port(target)[0] for target in draft.targets(f"{roles.plant}.e_q")}
    integrators = [
        name for name in draft.having(Element.INTEGRATOR) if _turns_the_frame(draft, name)
    ]
    if (
        not plls
        and integrators
        and not any(view.element(name) is Element.PI for name in regulators)
    ):

        def pll_too(draft: Edit) -> None:
            targets = [
                f"{one}.delta_omega"
                for one in draft.instances
                if "delta_omega" in draft.kind(one).inputs
            ]
            regulator = draft.after(f"{roles.plant}.e_q", "PI", "pll_regulator", **REGULATOR)
            draft.connect(regulator, *targets, *(f"{name}.in_" for name in integrators))

        yield Move("a PLL beside the droop", pll_too)


def _turns_the_frame(draft: Draft, integrator: str) -> bool:
    turned = (split_port(one)[0] for one in draft.targets(f"{integrator}.out") if "." in one)
    return any(draft.kind(name).element in ROTATIONS for name in turned)


def frequency_damping(view: View) -> Iterator[Move]:
    """The swing of a virtual machine damped by the frequency that a PLL measures, which enters its
    inertia beside the power.
    """
    draft = view.draft
    if (
        not grid_forming(view)
        or not view.known("PLL_frequency")
        or draft.having(Element.FREQUENCY_METER)
    ):
        return
    sources = frequency_sources(draft, view)
    for inertia in {
        one: None for source in sources for one in _inertias(draft, split_port(source)[0])
    }:

        def damping(draft: Edit, inertia: str = inertia) -> None:
            pll = draft.add("PLL_frequency", "grid_frequency", **PLL_GAINS)
            draft.connect(view.roles.voltage, f"{pll}.v")
            draft.gather(f"{pll}.delta_omega", *sources)
            share = {"k": Strength((0.3, 0.6, 0.95))}
            draft.connect(
                draft.after(f"{pll}.delta_omega_pll", "Gain", "frequency_damping", **share),
                f"{inertia}.in_",
            )

        yield Move(f"the frequency of a PLL damps the swing at {inertia}", damping)


def _inertias(draft: Draft, name: str) -> list[str]:
    """The low-passes that make a signal, itself or behind gains and signs."""
    element = draft.kind(name).element
    if element is Element.LOW_PASS:
        return [name]
    if element not in (Element.GAIN, Element.SIGN):
        return []
    return [
        one
        for source in draft.sources(f"{name}.in_")
        for one in _inertias(draft, split_port(source)[0])
    ]


def no_synchronisation(view: View) -> Iterator[Move]:
    """The rotations and what drives them taken away."""
    roles = view.roles
    if roles.frequency is None and not roles.rotated:
        return

    def fixed(draft: Edit) -> None:
        put_into_grid_frame(draft)
        draft.drive(f"{roles.plant}.delta_omega")

    yield Move("no synchronisation: the controller works in the grid's frame", fixed)


def _synchronised(view: View) -> bool:
    return view.roles.frequency is not None


_SLOW = (1.0, 1.0, 0.5, 0.1)

FAMILIES = (
    Family(
        "synchronisation",
        "structural",
        (1.0, 1.0, 0.5, 0.3),
        9.0,
        where_missing(synchronisation, _synchronised),
        True,
    ),
    Family(
        "other synchronisation",
        "structural",
        _SLOW,
        0.5,
        where_present(synchronisation, _synchronised),
        if_gross=2.0,
    ),
    Family("PLL and droop together", "structural", _SLOW, 0.2, blend, if_gross=0.7),
    Family("damping of the swing", "structural", _SLOW, 3.0, frequency_damping),
    Family("no synchronisation", "structural", (0.5, 0.5, 0.2, 0.1), 0.1, no_synchronisation),
)
