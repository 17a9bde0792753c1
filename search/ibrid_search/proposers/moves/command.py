"""What follows the converter's command: the DC link is loaded by the voltage that the converter makes, whatever drives it."""

from ibrid.structure.drafting import Draft
from ibrid.structure.wiring import split_port

#: Inputs that take what drives the plant's u_r, by kind: physics, so an edit of the command is one of these too.
COMMANDED = {"DC_link": "u"}
#: Kinds and ports that take a signal of the power circuit as it is, where a controller could not measure another.
CIRCUIT_KINDS, CIRCUIT_PORTS = ("DC_link", "Shunt_RC"), ("v_in", "v_DQ", "i_dq")


def command_of(draft: Draft) -> str | None:
    """The input that the controller drives; None where there is no plant."""
    return next((f"{name}.u_r" for name in draft.instances if "u_r" in draft.kind(name).inputs), None)


def followers(draft: Draft) -> frozenset[str]:
    """Inputs of `COMMANDED` kinds that take the same sources as the command."""
    command = command_of(draft)
    if command is None:
        return frozenset()
    ports = (f"{name}.{COMMANDED[one.kind]}" for name, one in draft.instances.items() if one.kind in COMMANDED)
    return frozenset(port for port in ports if set(draft.sources(port)) == set(draft.sources(command)))


def follow_command(draft: Draft, bound: frozenset[str]) -> None:
    """Let inputs that follow the command take what drives it now; `bound` : those that did before the edit.

    A kind put in by the edit itself follows from the beginning.
    """
    command = command_of(draft)
    if command is None:
        return
    ports = {f"{name}.{COMMANDED[one.kind]}" for name, one in draft.instances.items() if one.kind in COMMANDED}
    for port in ports:
        if port not in bound and draft.sources(port):
            continue  # it stood for itself before
        for source in draft.sources(port):
            draft.disconnect(source, port)
        for source in draft.sources(command):
            draft.connect(source, port)


def of_circuit(draft: Draft, target: str) -> bool:
    """True for an input that belongs to the power circuit, and for an outer port."""
    name, port = split_port(target)
    return not name or port in CIRCUIT_PORTS or draft.instances[name].kind in CIRCUIT_KINDS
