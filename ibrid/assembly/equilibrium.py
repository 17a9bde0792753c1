"""The operating point at every port that needs one, and the angle of the controller frame.

`exact`: computed from p, q, v and the plant, carried through sums, static modules and the DC gain of filters and delays.
`paper`: (E0d, 0), (I0d, 0) and delta_eq, three free numbers at every operating point.
"""

from collections.abc import Mapping
from typing import Any

import casadi as ca

from ibrid.assembly.numbers import is_zero, square_root
from ibrid.assembly.operating_point import Pair, add, plant_equilibrium, rotate_quarter
from ibrid.errors import DiagramError
from ibrid.modules.kind import Matrices, ModuleKind
from ibrid.structure.diagram import TERMINAL_VOLTAGE
from ibrid.structure.wiring import PLANT, Wiring, split_port

Parameters = Mapping[str, Mapping[str, Any]]  # instance -> parameter -> float or symbol
Frame = tuple[Any, Any]  # cosine and sine of delta_eq

#: Scalar ports that carry a deviation of the frame; at rest it is zero.
FRAME_DEVIATIONS = ("delta", "delta_omega")


def equilibria(
    wiring: Wiring, parameters: Parameters, point: tuple[Any, Any, Any], power_node: str, omega_0: float
) -> tuple[Frame, dict[str, dict[str, Pair]]]:
    """Controller frame and equilibrium at the ports of every module, `exact` mode.

    Parameters
    ----------
    wiring : of a legal diagram. parameters : instance -> parameter -> value, per unit.
    point : (p, q, v) per unit. power_node : "capacitor" or "pcc". omega_0 : rad/s.

    Returns
    -------
    (cos, sin) of delta_eq, and instance -> port -> (d, q) for the ports that the kind's law asks for.

    Raises
    ------
    DiagramError : a module needs the operating point of a signal that does not follow from the plant.
    """
    plant = wiring.plant
    in_grid = plant_equilibrium(wiring.kinds[plant].name, parameters[plant], *point, power_node)
    frame = _frame(wiring, parameters, in_grid, omega_0)
    in_frame = {port: to_frame(frame, z) for port, z in in_grid.items()}
    tracer = _Steady(wiring, parameters, in_frame, omega_0, point=point, frame=frame)
    found: dict[str, dict[str, Pair]] = {}
    for name, kind in wiring.kinds.items():
        found[name] = {port: tracer.required(name, port) for port in kind.equilibrium_ports}
    return frame, found


def paper_equilibria(wiring: Wiring, parameters: Parameters) -> dict[str, tuple[Frame, dict[str, Pair]]]:
    """The same per module under `equilibrium="paper"`: instance -> (frame, port -> (d, q))."""
    found = {}
    for name, kind in wiring.kinds.items():
        own = parameters[name]
        frame = (ca.cos(own["delta_eq"]), ca.sin(own["delta_eq"])) if kind.uses_frame else (1.0, 0.0)
        ports = {port: (own.get(word, 1.0), 0.0) for port, word in kind.equilibrium.items()}
        found[name] = (frame, ports)
    return found


def to_frame(frame: Frame, z: Pair) -> Pair:
    """R(delta_eq) z."""
    cosine, sine = frame
    return cosine * z[0] + sine * z[1], cosine * z[1] - sine * z[0]


def _frame(wiring: Wiring, parameters: Parameters, in_grid: Mapping[str, Pair], omega_0: float) -> Frame:
    """The angle at which the q component that the controller drives to zero is zero."""
    if not wiring.named("Rot_v") and not wiring.named("Rot_i"):
        return 1.0, 0.0
    tracer = _Steady(wiring, parameters, in_grid, omega_0)
    z = tracer.aligned()
    if z is None:
        z = in_grid["e"]
    along = z[0] * in_grid["e"][0] + z[1] * in_grid["e"][1]
    turn = (1.0 if along >= 0 else -1.0) if isinstance(along, float | int) else ca.if_else(along >= 0, 1, -1)
    length = square_root(z[0] * z[0] + z[1] * z[1]) * turn
    return z[0] / length, z[1] / length


class _Steady:
    """Signals at rest, carried from the plant; None where one does not follow from it.

    With `point` None the vectors are in the grid frame, before the controller frame is known: then only laws that do
    not care about the frame carry a vector on, and a scalar is known as the vector whose q component it is.
    """

    def __init__(
        self,
        wiring: Wiring,
        parameters: Parameters,
        plant: Mapping[str, Pair],
        omega_0: float,
        *,
        point: tuple[Any, Any, Any] | None = None,
        frame: Frame = (1.0, 0.0),
    ) -> None:
        self.wiring, self.parameters, self.plant_signals, self.omega_0 = wiring, parameters, plant, omega_0
        self.point, self.frame = point, frame
        self.v_in_grid = plant["v_in"] if point is None else (point[2], 0.0)
        self.found: dict[str, Pair | None] = {}

    def required(self, name: str, port: str) -> Pair:
        kind = self.wiring.kinds[name]
        if kind.family == PLANT:
            return self.plant_signals[port]
        if kind.name == "Rot_v":
            return self.v_in_grid
        value = self.at_input(f"{name}.{port}")
        if value is None:
            raise DiagramError(
                f"{name} ({kind.name}) needs the operating point at {name}.{port}, which does not follow from the plant; "
                "wire that port to a plant signal, a sum of them, or such a signal behind filters and gains"
            )
        return value

    def at_input(self, port: str) -> Pair | None:
        total: Pair = (0.0, 0.0)
        for source in self.wiring.sources[port]:
            value = self.at_output(source)
            if value is None:
                return None
            total = add(total, value)
        return total

    def at_output(self, port: str) -> Pair | None:
        if port not in self.found:
            self.found[port] = None  # a cycle does not follow from the plant
            self.found[port] = self._compute(port)
        return self.found[port]

    def _compute(self, port: str) -> Pair | None:
        name, output = split_port(port)
        if port == TERMINAL_VOLTAGE:
            return self.v_in_grid
        kind = self.wiring.kinds[name]
        if kind.family == PLANT:
            return self.plant_signals["e"] if output == "e_q" else self.plant_signals.get(output)
        if kind.static and not kind.bilinear:
            return self._static(name, kind, output)
        if kind.dc_gain is None or len(kind.inputs) != 1:
            return None
        entering = self.at_input(f"{name}.{next(iter(kind.inputs))}")
        return None if entering is None else (kind.dc_gain * entering[0], kind.dc_gain * entering[1])

    def _static(self, name: str, kind: ModuleKind, output: str) -> Pair | None:
        """y = D u, with a scalar s carried as a vector whose q component is s: [a b] z is the q component of b z + a J z."""
        frame = (1.0, 0.0) if self.point is None else self.frame
        _, _, _, d = matrices_of(kind, self.parameters[name], self.omega_0, frame, {})
        first = sum(signal.width for signal in list(kind.outputs.values())[: list(kind.outputs).index(output)])
        rows = d[first : first + kind.outputs[output].width]
        total: Pair = (0.0, 0.0)
        column = 0
        for port, signal in kind.inputs.items():
            block = [row[column : column + signal.width] for row in rows]
            column += signal.width
            if port in FRAME_DEVIATIONS or all(is_zero(entry) for row in block for entry in row):
                continue
            entering = self.at_input(f"{name}.{port}")
            if entering is None:
                return None
            if signal.width == 2 and len(rows) == 1:
                (a, b), turned = block[0], rotate_quarter(entering)
                total = add(total, (b * entering[0] + a * turned[0], b * entering[1] + a * turned[1]))
            elif signal.width == 1 and len(rows) == 1:
                total = add(total, (block[0][0] * entering[0], block[0][0] * entering[1]))
            elif signal.width == 2:
                total = add(total, tuple(row[0] * entering[0] + row[1] * entering[1] for row in block))  # type: ignore[arg-type]
            elif self.point is None:
                return None  # a vector packed from scalars depends on the frame
            else:
                total = add(total, (block[0][0] * entering[1], block[1][0] * entering[1]))
        return total

    def aligned(self) -> Pair | None:
        """The vector that the controller keeps on its d axis, in the grid frame; None when it cannot be decided."""
        rotations = [*self.wiring.named("Rot_v"), *self.wiring.named("Rot_i")]
        sources = {source for name in rotations for source in self.wiring.sources[f"{name}.delta"]}
        loops = [split_port(source)[0] for source in sources if source != TERMINAL_VOLTAGE]
        locked = sorted(name for name in loops if self.wiring.kinds[name].name == "SRF_PLL")
        if locked:
            return self.at_input(f"{locked[0]}.e_q")
        if not any(self.wiring.kinds[name].name == "Integrator" for name in loops):
            return None
        return self._voltage_reference()

    def _voltage_reference(self) -> Pair | None:
        for name, kind in self.wiring.kinds.items():
            integrating = bool(kind.states) and kind.dc_gain is None and "in_" in kind.inputs
            if integrating and kind.inputs["in_"].width == 2 and self._follows_voltage(f"{name}.in_"):
                known, _ = self._known_part(f"{name}.in_")
                return known
        known, others = self._known_part(f"{self.wiring.plant}.u_r")
        if any(self.wiring.kinds[split_port(port)[0]].states for port in others):
            return None
        u_r = self.plant_signals["u_r"]
        return u_r[0] - known[0], u_r[1] - known[1]

    def _known_part(self, port: str) -> tuple[Pair, list[str]]:
        total, others = (0.0, 0.0), []
        for source in self.wiring.sources[port]:
            value = self.at_output(source)
            if value is None:
                others.append(source)
            else:
                total = add(total, value)
        return total, others

    def _follows_voltage(self, port: str) -> bool:
        """True when the signal is the capacitor voltage, plus known signals, compared with a reference on d."""
        _, others = self._known_part(port)
        on_d = all(self.wiring.kinds[split_port(one)[0]].name == "PackDQ" for one in others)
        return on_d and f"{self.wiring.plant}.e" in self._origins(port, set())

    def _origins(self, port: str, seen: set[str]) -> set[str]:
        for source in self.wiring.sources[port]:
            if source in seen or source == TERMINAL_VOLTAGE:
                continue
            seen.add(source)
            name, _ = split_port(source)
            kind = self.wiring.kinds[name]
            if kind.family != PLANT and (kind.static or kind.dc_gain is not None):
                for one in kind.inputs:
                    self._origins(f"{name}.{one}", seen)
        return seen


def matrices_of(
    kind: ModuleKind, parameters: Mapping[str, Any], omega_0: float, frame: Frame, ports: Mapping[str, Pair]
) -> Matrices:
    """State-space matrices of a kind at given parameters and equilibrium."""
    own = {name: parameters[name] for name in kind.parameters}
    return kind.state_space(**own, **kind.context(omega_0, frame, ports))
