"""Modelica of the nonlinear averaged model: one block per kind, the diagram wired, everything
starting at rest.
"""

from collections.abc import Mapping
from typing import Any

from ibrid.analysis.models.linear_model import LinearModel, linear_model, whole_record, with_point
from ibrid.assembly.averaged import channel_names
from ibrid.assembly.module_motion import Module, by_port
from ibrid.assembly.rest import Rest
from ibrid.errors import IbridError
from ibrid.evaluation.record import Record
from ibrid.export.formula import Formula, formula
from ibrid.export.modelica import CONNECTORS, INPUT, OUTPUT, documentation, identifiers, quoted
from ibrid.export.names import MODELICA, written_in
from ibrid.export.nonlinear_model import ABSOLUTE, rest_of_record
from ibrid.modules.kind import ModuleKind
from ibrid.modules.large_signal import is_linear
from ibrid.signals import Signal
from ibrid.structure.diagrams.diagram import TERMINAL_CURRENT, TERMINAL_VOLTAGE
from ibrid.structure.reading.parameters import parameter_table
from ibrid.structure.reading.wiring import Channel, Wiring, channels_of, sources_of, split_port

_OUTER = {TERMINAL_VOLTAGE: ("v_D", "v_Q"), TERMINAL_CURRENT: ("i_D", "i_Q")}


def nonlinear_modelica(
    record: Record, op: str | None = None, name: str = "NonlinearInverter"
) -> tuple[LinearModel, bytes]:
    """The linear model at the operating point, and the file: a package of that name with `block
    Inverter` in it.

    v_D, v_Q in and i_D, i_Q out are absolute, per unit; vectors are (d, q). Parameters are those of
    the diagram; references (p*, q*) and what else keeps the inverter at its operating point are
    parameters called reference_.

    Raises as `nonlinear_model`.
    """
    model = linear_model(record, op)
    with whole_record():
        whole, point = with_point(record, model.op)
        wiring, at = rest_of_record(whole, point)
        values = whole.parameters[point]
    return model, _package(model, _Words(wiring, at), at, values, name)


@written_in(MODELICA)
def _package(
    model: LinearModel, words: "_Words", at: Rest, values: Mapping[str, float], title: str
) -> bytes:
    blocks = {words.blocks[module.name]: module for module in at.modules}
    lines = [
        f"package {title} "
        f"{quoted(f'{model.name} at {model.op}, nonlinear and averaged, written by ibrid')}",
        *CONNECTORS,
        *(f"  {line}" for name, module in blocks.items() for line in _block(name, module)),
        *(f"  {line}" for line in _inverter(words, at, values, model.op)),
        f"  annotation(Documentation(info = {documentation(model, ABSOLUTE)}));",
        f"end {title};",
    ]
    return ("\n".join(lines) + "\n").encode()


class _Words:
    """Identifiers of everything in the inverter, no two alike, so that no name hides another."""

    def __init__(self, wiring: Wiring, at: Rest) -> None:
        self.wiring = wiring
        self.table = parameter_table(wiring, "exact")
        outer = [word for pair in _OUTER.values() for word in pair]
        orders = {module.name: str(module.pade_order or "") for module in at.modules}
        titles = {module.name: f"{module.kind.name}{orders[module.name]}" for module in at.modules}
        kinds = tuple(dict.fromkeys(titles.values()))
        references = [f"reference_{one}" for one in channel_names(list(at.references), wiring)]
        unused = iter(
            identifiers(
                ["Inverter", *outer, *kinds, *wiring.kinds, *self.table.names, *references]
            )[5:]
        )
        block = dict(zip(kinds, unused, strict=False))
        self.blocks = {name: block[title] for name, title in titles.items()}
        self.instances = dict(zip(wiring.kinds, unused, strict=False))
        self.parameters = dict(zip(self.table.names, unused, strict=False))
        self.references = dict(zip(at.references, unused, strict=True))

    def parameter(self, instance: str, name: str, value: float) -> str:
        """What a module's parameter is set to: a parameter of the inverter, or a number."""
        bound = self.table.bound.get((instance, name), value)
        return self.parameters[bound] if isinstance(bound, str) else repr(float(bound))

    def port(self, channel: Channel) -> str:
        """A channel of a module, seen from outside, or of the terminals."""
        if channel[0] in _OUTER:
            return _OUTER[channel[0]][channel[1]]
        name, port = split_port(channel[0])
        kind = self.wiring.kinds[name]
        word = f"{self.instances[name]}.{port}"
        return (
            f"{word}[{channel[1] + 1}]"
            if {**kind.inputs, **kind.outputs}[port].width == 2
            else word
        )

    def arriving(self, channel: Channel) -> str:
        """What adds up at an input."""
        terms = [self.port(source) for source in sources_of(self.wiring, channel)]
        return (
            " + ".join(
                [*terms, *([self.references[channel]] if channel in self.references else [])]
            )
            or "0"
        )


def _block(name: str, module: Module) -> list[str]:
    """The declaration of a kind, from its law."""
    kind = module.kind
    _require_own_words(kind, module.arguments)
    arguments = {
        one: (Formula(f"{one}[1]"), Formula(f"{one}[2]"))
        if isinstance(value, tuple)
        else Formula(one)
        for one, value in module.arguments.items()
    }
    x = [f"x_{state}" for state in module.states]
    inputs, outputs = _channels(kind.inputs), _channels(kind.outputs)
    symbols = by_port(kind, [Formula(one) for one in inputs])
    rates, values = module.motion([Formula(one) for one in x], symbols, arguments)
    meanings = {one: f"{box.meaning}, {box.unit}" for one, box in kind.parameters.items()}
    meanings["omega_0"] = "nominal angular frequency, rad/s"
    return [
        f"block {name} {quoted(kind.law if is_linear(kind) else f'{kind.name}, {kind.family}, absolute quantities')}",
        *(
            f"  parameter Real {_declared(one, value)} "
            f"{quoted(meanings.get(one, 'operating point, pu'))};"
            for one, value in module.arguments.items()
        ),
        *(f"  input Real {_declared(port, signal)};" for port, signal in kind.inputs.items()),
        *(f"  output Real {_declared(port, signal)};" for port, signal in kind.outputs.items()),
        *(f"  Real {one}(start = 0, fixed = true);" for one in x),
        "equation",
        *(f"  der({one}) = {formula(rate).text};" for one, rate in zip(x, rates, strict=True)),
        *(f"  {one} = {formula(value).text};" for one, value in zip(outputs, values, strict=True)),
        f"end {name};",
    ]


def _require_own_words(kind: ModuleKind, arguments: Mapping[str, Any]) -> None:
    """Ports and parameters are variables of one block, so their names must differ, also from
    Modelica's words.
    """
    names = [*kind.inputs, *kind.outputs, *arguments]
    for name in names:
        if names.count(name) > 1 or identifiers([name]) != (name,):
            raise IbridError(
                f"{kind.name} cannot be written in Modelica: {name} must name one port or one "
                "parameter and be no word "
                "of the language; rename it"
            )


def _inverter(words: _Words, at: Rest, values: Mapping[str, float], op: str) -> list[str]:
    """The block in which the modules are wired."""
    inputs = [one for module in at.modules for one in channels_of(module.name, module.kind.inputs)]
    return [
        f"block Inverter {quoted(op)}",
        *(
            f"  {INPUT} {word}(start = {at.outputs[TERMINAL_VOLTAGE, axis]!r}) "
            f"{quoted('terminal voltage, per unit')};"
            for axis, word in enumerate(_OUTER[TERMINAL_VOLTAGE])
        ),
        *(
            f"  {OUTPUT} {word} {quoted('current out of the inverter, per unit')};"
            for word in _OUTER[TERMINAL_CURRENT]
        ),
        *(
            f"  parameter Real {word} = {float(values[name])!r};"
            for name, word in words.parameters.items()
        ),
        *(
            f"  parameter Real {word} = {at.references[channel]!r} "
            f"{quoted('holds the operating point')};"
            for channel, word in words.references.items()
        ),
        *(f"  {_instance(words, module, at)}" for module in at.modules),
        "equation",
        *(f"  {words.port(channel)} = {words.arriving(channel)};" for channel in inputs),
        *(
            f"  {word} = {words.arriving((TERMINAL_CURRENT, axis))};"
            for axis, word in enumerate(_OUTER[TERMINAL_CURRENT])
        ),
        "end Inverter;",
    ]


def _instance(words: _Words, module: Module, at: Rest) -> str:
    """One module with its parameters and the values at which its states start."""
    changes = [
        f"{one} = {{{float(value[0])!r}, {float(value[1])!r}}}"
        if isinstance(value, tuple)
        else f"{one} = {words.parameter(module.name, one, value)}"
        for one, value in module.arguments.items()
    ]
    starts = zip(module.states, at.states[module.name], strict=True)
    changes += [f"x_{state}(start = {value!r})" for state, value in starts if value]
    changed = f"({', '.join(changes)})" if changes else ""
    return f"{words.blocks[module.name]} {words.instances[module.name]}{changed};"


def _declared(name: str, of: Signal | float | tuple[float, float]) -> str:
    """A scalar, or an array of the two axes."""
    return (
        f"{name}[2]"
        if isinstance(of, tuple) or (isinstance(of, Signal) and of.width == 2)
        else name
    )


def _channels(ports: Mapping[str, Signal]) -> list[str]:
    """The channels of some ports, seen from inside the block."""
    return [
        f"{port}[{k}]" if one.width == 2 else port
        for port, one in ports.items()
        for k in range(1, one.width + 1)
    ]
