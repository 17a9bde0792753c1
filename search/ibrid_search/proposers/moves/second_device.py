"""A second device behind the same PCC, put in without a controller yet, or taken away again."""

from collections.abc import Iterator

from ibrid.structure.diagram import TERMINAL_CURRENT, TERMINAL_VOLTAGE
from ibrid.structure.drafting import Draft
from ibrid_search.proposers.moves.family import Move, View


def second_device(view: View) -> Iterator[Move]:
    """An L filter behind a gain in parallel to a device that is alone; of p and q it delivers a share."""
    if not view.alone or not view.knows("Share", "LFilter", "Gain_dq"):
        return

    def beside(draft: Draft) -> None:
        share, plant = draft.add("Share", "share"), draft.add("LFilter", "plant")
        gain = draft.add("Gain_dq", "gain")
        draft.chain(TERMINAL_VOLTAGE, f"{share}.v_DQ", f"{share}.v", f"{plant}.v_in", f"{share}.v", f"{gain}.in_")
        draft.chain(f"{gain}.out", f"{plant}.u_r", f"{plant}.i_g", TERMINAL_CURRENT)

    yield Move("a second device in parallel, without a controller yet", beside)


def no_second_device(view: View) -> Iterator[Move]:
    """A device that has no controller taken away; the other delivers everything."""
    if view.alone or view.roles.missing_layers < 3:
        return

    def gone(draft: Draft) -> None:
        for name in list(draft.instances):
            draft.remove(name)

    yield Move(f"without the device of {view.roles.plant}", gone)
