"""How the controller gets its frame: a PLL, a droop of the active power, or none."""

from collections.abc import Iterator

from ibrid.structure.drafting import Draft
from ibrid.structure.frames import put_into_frame, put_into_grid_frame
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
            put_into_frame(draft, roles.plant, f"{name}.delta_omega", f"{name}.delta")

        yield Move("synchronisation by a PLL, with the rotations into its frame", pll)
    if view.known("PQ_calc") and view.known("Integrator"):
        for filtered in (True, False):

            def droop(draft: Draft, filtered: bool = filtered) -> None:
                source = draft.negated(f"{power_module(draft, roles)}.p")
                if filtered:
                    source = after(draft, source, "LPF1", "droop_filter")
                frequency = after(draft, source, "Gain", "droop")
                angle = after(draft, frequency, "Integrator", "angle")
                put_into_frame(draft, roles.plant, frequency, angle)

            how = "a droop of the filtered active power" if filtered else "a droop of the active power"
            yield Move(f"synchronisation by {how} (grid-forming)", droop)


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


def _kind_of(view: View, name: str | None) -> str | None:
    return view.draft.instances[name].kind if name is not None else None
