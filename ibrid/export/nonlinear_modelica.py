"""Modelica of the nonlinear averaged model: one block per kind, the diagram wired, everything starting at rest."""

from collections.abc import Mapping
from typing import Any

from ibrid.analysis.linear_model import LinearModel, linear_model, with_point
from ibrid.assembly.signals_at_rest import Channel, channels_of, sources_of
from ibrid.evaluation.record import Record
from ibrid.export.formula import Formula, formula
from ibrid.export.modelica import INPUT, OUTPUT, documentation, identifiers, quoted
from ibrid.export.nonlinear_model import reference_names, rest_of_record
from ibrid.export.rest import Module, Rest, by_port
from ibrid.structure.diagram import TERMINAL_CURRENT, TERMINAL_VOLTAGE
from ibrid.structure.parameters import parameter_table
from ibrid.structure.wiring import Wiring

_OUTER = {TERMINAL_VOLTAGE: ("v_D", "v_Q"), TERMINAL_CURRENT: ("i_D", "i_Q")}


def nonlinear_modelica(record: Record, op: str | None = None) -> tuple[LinearModel, bytes]:
    """The linear model at the operating point, and the file: `package NonlinearInverter` with `block Inverter` in it.

    v_D, v_Q in and i_D, i_Q out are absolute, per unit. Parameters are those of the diagram; references (p*, q*) and
    what else keeps the inverter at its operating point are parameters called reference_.

    Raises as `nonlinear_model`.
    """
    model = linear_model(record, op)
    wiring, at, parameters, bound = _parts(record, model)
    blocks = {_block_name(module): module for module in at.modules}
    lines = [
        f"package NonlinearInverter {quoted(f'{model.name} at {model.op}, nonlinear and averaged, written by ibrid')}",
        *(f"  {line}" for name, module in blocks.items() for line in _block(name, module)),
        *(f"  {line}" for line in _inverter(wiring, at, parameters, bound, model)),
        f"  annotation(Documentation(info = {quoted(documentation(model))}));",
        "end NonlinearInverter;",
    ]
    return model, ("\n".join(lines) + "\n").encode()


def _parts(record: Record, model: LinearModel) -> tuple[Wiring, Rest, dict[str, float], dict[tuple[str, str], Any]]:
    """Wiring, operating point, the free parameters by identifier, and what each module's parameter is set to."""
    whole, name = with_point(record, model.op)
    wiring, at = rest_of_record(whole, name)
    table = parameter_table(wiring, "exact")
    words = dict(zip(table.names, identifiers(table.names), strict=True))
    parameters = {words[one]: float(whole.parameters[name][one]) for one in table.names}
    bound = {key: words[value] if isinstance(value, str) else value for key, value in table.bound.items()}
    return wiring, at, parameters, bound


def _block_name(module: Module) -> str:
    return module.kind.name if module.pade_order is None else f"{module.kind.name}{module.pade_order}"


def _block(name: str, module: Module) -> list[str]:
    """The declaration of a kind, from its law."""
    kind = module.kind
    arguments = {one: _symbol(one, value) for one, value in module.arguments.items()}
    x = [f"x_{state}" for state in module.states]
    inputs, outputs = _variables(kind.inputs), _variables(kind.outputs)
    rates, values = module.motion(
        [Formula(one) for one in x], by_port(kind, [Formula(one) for one in inputs]), arguments
    )
    words = [word for value in arguments.values() for word in (value if isinstance(value, tuple) else (value,))]
    told = {one: f"{box.meaning}, {box.unit}" for one, box in kind.parameters.items()}
    return [
        f"block {name} {quoted(kind.law)}",
        *(f"  parameter Real {word.text} {quoted(told.get(word.text, 'constant'))};" for word in words),
        *(f"  input Real {one};" for one in inputs),
        *(f"  output Real {one};" for one in outputs),
        *(f"  Real {one}(start = 0, fixed = true);" for one in x),
        "equation",
        *(f"  der({one}) = {formula(rate).text};" for one, rate in zip(x, rates, strict=True)),
        *(f"  {one} = {formula(value).text};" for one, value in zip(outputs, values, strict=True)),
        f"end {name};",
    ]


def _inverter(
    wiring: Wiring, at: Rest, parameters: Mapping[str, float], bound: Mapping[tuple[str, str], Any], model: LinearModel
) -> list[str]:
    """The block in which the modules are wired."""
    names = dict(zip(wiring.kinds, identifiers(wiring.kinds), strict=True))
    references = dict(
        zip(at.references, identifiers(f"reference_{one}" for one in reference_names(list(at.references), wiring)))
    )
    rest_voltage = [at.outputs[TERMINAL_VOLTAGE, axis] for axis in (0, 1)]

    def arriving(channel: Channel) -> str:
        terms = [_port(names, wiring, source) for source in sources_of(wiring, channel)]
        return " + ".join([*terms, *([references[channel]] if channel in references else [])]) or "0"

    return [
        f"block Inverter {quoted(model.op)}",
        *(
            f"  {INPUT} {one}(start = {value!r}) {quoted('terminal voltage, per unit')};"
            for one, value in zip(_OUTER[TERMINAL_VOLTAGE], rest_voltage, strict=True)
        ),
        *(f"  {OUTPUT} {one} {quoted('current out of the inverter, per unit')};" for one in _OUTER[TERMINAL_CURRENT]),
        *(f"  parameter Real {name} = {value!r};" for name, value in parameters.items()),
        *(
            f"  parameter Real {references[channel]} = {value!r} {quoted('holds the operating point')};"
            for channel, value in at.references.items()
        ),
        *(f"  {_instance(names, module, at, bound)}" for module in at.modules),
        "equation",
        *(
            f"  {_port(names, wiring, channel)} = {arriving(channel)};"
            for module in at.modules
            for channel in channels_of(module.name, module.kind.inputs)
        ),
        *(f"  {_OUTER[TERMINAL_CURRENT][axis]} = {arriving((TERMINAL_CURRENT, axis))};" for axis in (0, 1)),
        "end Inverter;",
    ]


def _instance(names: Mapping[str, str], module: Module, at: Rest, bound: Mapping[tuple[str, str], Any]) -> str:
    """One module with its parameters and the values at which its states start."""
    changes = []
    for one, value in module.arguments.items():
        if isinstance(value, tuple):
            changes += [f"{one}_{axis} = {float(part)!r}" for axis, part in zip("dq", value, strict=True)]
        else:
            given = bound.get((module.name, one), value)
            changes.append(f"{one} = {given if isinstance(given, str) else repr(float(given))}")
    starts = zip(module.states, at.states[module.name], strict=True)
    changes += [f"x_{state}(start = {value!r})" for state, value in starts if value]
    changed = f"({', '.join(changes)})" if changes else ""
    return f"{_block_name(module)} {names[module.name]}{changed};"


def _symbol(name: str, value: Any) -> Any:
    return (Formula(f"{name}_d"), Formula(f"{name}_q")) if isinstance(value, tuple) else Formula(name)


def _variables(ports: Mapping[str, Any]) -> list[str]:
    """A scalar variable for each channel of some ports."""
    return [
        f"{port}_{axis}" if signal.width == 2 else port
        for port, signal in ports.items()
        for axis in "dq"[: signal.width]
    ]


def _port(names: Mapping[str, str], wiring: Wiring, channel: Channel) -> str:
    """A channel of a module, seen from outside, or of the terminals."""
    if channel[0] in _OUTER:
        return _OUTER[channel[0]][channel[1]]
    name, _, port = channel[0].rpartition(".")
    kind = wiring.kinds[name]
    signal = {**kind.inputs, **kind.outputs}[port]
    return f"{names[name]}.{port}_{'dq'[channel[1]]}" if signal.width == 2 else f"{names[name]}.{port}"
