"""The angle of the controller frame: the one at which the q component that the controller holds is where it holds it.

What that component is follows from structure: the input of the PLL (or of whatever integrates into the angle); without
one, the q axis of the voltage loop; without that, of the converter voltage less what is known in it. It is held at zero
but where the kind of that input says another value, as a PLL without integral action does beside its own frequency.
"""

from collections.abc import Mapping
from typing import Any

import casadi as ca

from ibrid.assembly.numbers import is_zero
from ibrid.assembly.signals_at_rest import (
    Carried,
    Channel,
    Frame,
    Pair,
    Parameters,
    signals_at_rest,
    sources_of,
    to_frame,
)
from ibrid.modules.behaviour import ROTATIONS, Element
from ibrid.modules.kind import ModuleKind
from ibrid.modules.large_signal import square_root
from ibrid.structure.diagrams.diagram import TERMINAL_VOLTAGE
from ibrid.structure.reading.wiring import PLANT, Wiring, split_port

#: Squared gain from a vector in the frame to the component that is driven to zero, below which it decides nothing.
NOTHING = 1e-20
#: Cosine of the angle between e and the d axis that still counts as zero: then d, not -d, is chosen.
PERPENDICULAR = 1e-9


def controller_frame(
    wiring: Wiring,
    flow: Carried,
    parameters: Parameters,
    in_grid: Mapping[str, Pair],
    omega_0: float,
    deviation: Any = 0.0,
) -> Frame:
    """(cos, sin) of delta_eq, on the side where e has a positive d component.

    Every signal is affine in (cos, sin), so its values in three frames give k0 + k1 cos + k2 sin = 0; k0 is what comes
    from v_DQ without a rotation, less the value at which the component is held. Where nothing is held the capacitor voltage is
    on the d axis; without rotations the frame is that of the grid. Not numbers where the voltage is too small to be held there.

    deviation : of the grid's frequency from the nominal one, rad/s.
    """
    if not wiring.having(*ROTATIONS):
        return 1.0, 0.0
    target, e = aligned_channel(wiring, flow), in_grid["e"]
    if target is None:
        return _unit(e)
    name, _ = split_port(target[0])
    held = wiring.kinds[name].arriving_at_rest(parameters[name], deviation)

    def driven_to_zero(frame: Frame) -> Any:
        value = signals_at_rest(wiring, flow, parameters, in_grid, omega_0, frame, [target])[target] - held
        on_u_r = target[0] == f"{wiring.plant}.u_r"  # its reference on d is what the known signals leave of it
        return to_frame(frame, in_grid["u_r"])[1] - value if on_u_r else value

    east, north, west = driven_to_zero((1.0, 0.0)), driven_to_zero((0.0, 1.0)), driven_to_zero((-1.0, 0.0))
    k0, k1, k2 = (east + west) / 2, (east - west) / 2, north - (east + west) / 2
    decided = k1 * k1 + k2 * k2 > NOTHING
    z = _choose(decided, -k2, e[0]), _choose(decided, k1, e[1])
    square = z[0] * z[0] + z[1] * z[1]
    along = z[0] * e[0] + z[1] * e[1]
    side = _choose(along >= -PERPENDICULAR * square_root(square * (e[0] * e[0] + e[1] * e[1])), 1.0, -1.0)
    if is_zero(k0):
        length = square_root(square) * side
        return z[0] / length, z[1] / length
    rest = _choose(decided, k0, 0.0)
    reach = square_root(square - rest * rest) * side
    return (z[0] * reach - rest * z[1]) / square, (z[1] * reach + rest * z[0]) / square


def aligned_channel(wiring: Wiring, flow: Carried) -> Channel | None:
    """The input channel whose value at rest sets the controller frame, mostly zero there; None where that cannot be decided."""
    loops = _angle_loops(wiring)
    locked = [name for name in loops if wiring.kinds[name].element is Element.PLL]
    if locked:
        channel = (f"{locked[0]}.e_q", 0)
        return channel if flow.follows(wiring, channel) else None
    for name in loops:
        (port,) = wiring.kinds[name].inputs
        channel = (f"{name}.{port}", 0)
        if flow.follows(wiring, channel) and not flow.reached.isdisjoint(sources_of(wiring, channel)):
            return channel
    if not loops:
        return None
    for name, kind in wiring.kinds.items():
        if _integrates(kind, 2):
            (port,) = kind.inputs
            channel = (f"{name}.{port}", 1)
            if flow.follows(wiring, channel) and _sees_voltage(wiring, channel[0]):
                return channel
    channel = (f"{wiring.plant}.u_r", 1)
    return channel if flow.follows(wiring, channel) else None


def _angle_loops(wiring: Wiring) -> list[str]:
    """Modules that integrate one scalar into the angle of the frame, the nearest to the rotations first."""
    front = [f"{name}.delta" for name in (*wiring.having(Element.ROTATION_IN), *wiring.having(Element.ROTATION_OUT))]
    integrators: list[str] = []
    seen: set[str] = set()
    for port in front:  # breadth first; grows while it is walked
        for source in wiring.sources[port]:
            name, _ = split_port(source)
            if source == TERMINAL_VOLTAGE or name in seen:
                continue
            seen.add(name)
            kind = wiring.kinds[name]
            if kind.family == PLANT or kind.bilinear:
                continue
            if _integrates(kind, 1):
                integrators.append(name)
            front += [f"{name}.{one}" for one in kind.inputs]
    return integrators


def _integrates(kind: ModuleKind, width: int) -> bool:
    """True for a controller with one input of that width whose value at rest its integrator makes zero."""
    return kind.integrates and [signal.width for signal in kind.inputs.values()] == [width]


def _sees_voltage(wiring: Wiring, port: str) -> bool:
    """True when the capacitor or the terminal voltage comes to a port without an integrator in between."""
    front, seen = [port], set[str]()
    for one in front:  # grows while it is walked
        for source in wiring.sources[one]:
            name, output = split_port(source)
            if source in seen:
                continue
            seen.add(source)
            if source == TERMINAL_VOLTAGE:
                return True
            kind = wiring.kinds[name]
            if kind.family == PLANT:
                if output in ("e", "e_q"):
                    return True
            elif not kind.bilinear and (kind.static or kind.dc_gain is not None):
                front += [f"{name}.{entering}" for entering in kind.inputs]
    return False


def _unit(z: Pair) -> Frame:
    length = square_root(z[0] * z[0] + z[1] * z[1])
    return z[0] / length, z[1] / length


def _choose(condition: Any, yes: Any, no: Any) -> Any:
    """One of two values, by a truth value or a symbol."""
    return ca.if_else(condition, yes, no) if isinstance(condition, ca.SX) else (yes if condition else no)
