"""Located, but unnamed: the block of low order that comes nearest to the unknown transfer, and is flagged as just that."""

from collections.abc import Sequence

from ibrid.gap.effect import Edit, NotInVocabulary
from ibrid.gap.port_map import PortFit
from ibrid.gap.ports import PORT_KINDS
from ibrid.gap.result import ResidualBlock
from ibrid.gap.trial import Model, Workshop
from ibrid.signals import Signal
from ibrid.structure.check import violations
from ibrid.structure.program import program_text

#: Kinds of low order, by the signal they shape.
SHAPES = {Signal.SCALAR: ("Gain", "LPF1", "Notch", "Pade1"), Signal.DQ_VEC: ("Gain_dq", "LPF1_dq", "Delay", "Pade1_dq")}
NAME = "residual_block"


def residual_block(shop: Workshop, model: Model, ports: Sequence[PortFit]) -> ResidualBlock | None:
    """The best block of low order at the best adequate port; None where no port is adequate or no block helps."""
    adequate = [one for one in ports if one.adequate]
    if not adequate:
        return None
    best = min(adequate, key=lambda one: one.chi2_per_dof)
    refitter, found = shop.refitter(model.convention), []
    signal = Edit(best.port.diagram, (*shop.kinds, *PORT_KINDS)).signal(f"{best.port.block}.in_")
    for kind in SHAPES.get(signal, ()):
        draft = Edit(best.port.diagram, (*shop.kinds, *PORT_KINDS))
        try:
            draft.replace(best.port.block, kind, NAME)
        except NotInVocabulary:
            continue
        diagram = draft.diagram()
        if violations(diagram, shop.kinds):
            continue
        refit = refitter.refit(diagram, [best.values, model.refit.values, {}], draws=24)
        if refit is not None and refit.cost < model.refit.cost:
            per_dof = refit.chi2 / refit.dof
            before = model.refit.chi2 / model.refit.dof
            found.append(ResidualBlock(best.port.name, kind, program_text(diagram), per_dof, before))
    return min(found, key=lambda one: one.chi2_per_dof, default=None)
