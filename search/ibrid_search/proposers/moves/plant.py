"""The other filter between converter and grid."""

from collections.abc import Callable, Iterator

from ibrid.structure.drafting import Draft
from ibrid.structure.roles import Roles
from ibrid.structure.wiring import split_port
from ibrid_search.proposers.moves.family import Move, View


def plants(view: View) -> Iterator[Move]:
    """The other filter; with an LCL the controller measures the converter's or the grid's current."""
    roles = view.roles
    if not roles.lcl and view.known("LCL"):

        def converter_side(draft: Draft) -> None:
            plant = _other_plant(draft, roles, "LCL")
            _to_converter_current(draft, plant, lambda kind: kind not in ("Rot_i", "PQ_calc", "dVOC"))

        def grid_side(draft: Draft) -> None:
            plant = _other_plant(draft, roles, "LCL")
            _to_converter_current(draft, plant, lambda kind: kind == "DC_link")

        yield Move("LCL filter instead of the L filter, control of the converter current", converter_side)
        yield Move("LCL filter instead of the L filter, control of the grid current", grid_side)
    if roles.lcl and view.known("LFilter"):

        def single(draft: Draft) -> None:
            for target in list(draft.targets(f"{roles.plant}.i_ti")):
                draft.connect(f"{roles.plant}.i_g", target)
            _other_plant(draft, roles, "LFilter")

        yield Move("L filter instead of the LCL filter", single)


def _to_converter_current(draft: Draft, plant: str, moved: Callable[[str], bool]) -> None:
    """Let the kinds that are `moved` see the converter's current in place of the grid's."""
    for target in draft.targets(f"{plant}.i_g"):
        name = split_port(target)[0]
        if name and moved(draft.instances[name].kind):
            draft.disconnect(f"{plant}.i_g", target)
            draft.connect(f"{plant}.i_ti", target)


def _other_plant(draft: Draft, roles: Roles, kind: str) -> str:
    """Exchange the plant under its old name, so that the program keeps reading well."""
    draft.rename(draft.replace(roles.plant, kind, "filter_to_be"), roles.plant)
    return roles.plant
