"""From the device's terminals to what was measured: the operating point inwards, the linear system
outwards.

Complex numbers are pairs, floats or CasADi symbols. Per unit, v = (v, 0) at the PCC, current out of
the device: series v_in = v + (R + L J) i + L/omega_0 i'; shunt i = i_in - i_s, v = v_c + R i_s,
C/omega_0 v_c' = i_s - C J v_c; transformer: its R and L on the side of the PCC, then v_in = v /
ratio, i = i_in / ratio (a phase shift turns the device with its frame, which no admittance sees). A
device at an angle to the PCC has its admittance turned by that angle.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from ibrid.assembly.joined import Interconnected
from ibrid.assembly.numbers import is_zero, weighted_sum
from ibrid.assembly.operating_point import Pair, add
from ibrid.assembly.signals_at_rest import Parameters
from ibrid.errors import DiagramError
from ibrid.modules.large_signal import cosine, dot, length, reactive, sine, square_root
from ibrid.structure.network.outside import LABEL, PORT, Outside

Point = tuple[Any, Any, Any]
Row = dict[tuple[str, int], Any]
#: Least resistance (pu) in series with a capacitor at the port: without it there is no state space
#: at a stiff grid.
LEAST_RESISTANCE = 1e-4
_ZERO, _ONE = (0.0, 0.0), (1.0, 0.0)


@dataclass(frozen=True)
class Inner:
    """The operating point of the device behind its terminals: (p, q, v), the node where its p and q
    are, (cos, sin) of the angle of its voltage before that of the PCC; and the current at the PCC
    in the grid frame, None without a port.
    """

    point: Point
    power_node: str
    turn: Pair = _ONE
    current: Pair | None = None


def behind_terminals(
    outside: Outside, plant: str, parameters: Parameters, point: Point, power_node: str
) -> Inner:
    """The device's own operating point, behind port and labels, from the measured p, q, v.

    With p and q measured outside they go through the elements one by one. Measured inside, at a
    node that the chain v = d v_n - b i_n leads to: |d|^2 E^4 - (v^2 + 2 Re(d b* S)) E^2 + |b|^2
    |S|^2 = 0, the larger root; not a number where there
    is none. plant : its name; R_g and L_g of it lie between the terminals and the capacitor where p
    and q are.
    parameters : instance -> parameter -> value.
    """
    p, q, v = point
    labels = parameters.get(LABEL, {})
    p, q = (_over(one, labels.get("power_scale")) for one in (p, q))
    v = _over(v, labels.get("voltage_scale"))
    if not outside.elements:
        return Inner((p, q, v), power_node)
    elements = [
        (element.kind, parameters[f"{PORT}.{k}"])
        for k, element in enumerate(outside.elements, start=1)
    ]
    if not outside.inside:
        z, i = (v, 0.0), (p / v, -q / v)
        for kind, values in elements:
            z, i = inwards(kind, values, z, i)
        size = length(z)
        seen = (dot(z, i), reactive(z, i), size)
        return Inner(seen, "pcc", _part(z, size), (p / v, -q / v))
    own = parameters[plant]
    line = (own["R_g"], own["L_g"]) if "L_g" in own else _ZERO
    (a, b), (c, d) = _chain(elements)
    whole = add(b, _times(d, line)) if power_node == "capacitor" else b
    product = _times(d, _conjugate(whole))
    twice = v * v + 2 * (product[0] * p - product[1] * q)
    square = dot(d, d)
    rest = dot(whole, whole) * (p * p + q * q)
    node = square_root((twice + square_root(twice * twice - 4 * square * rest)) / (2 * square))
    i = (p / node, -q / node)
    drop = _times(line, i) if power_node == "capacitor" else _ZERO
    inner = (node - drop[0], -drop[1])
    outer = add(_times(d, inner), _negative(_times(b, i)))
    size = length(inner)
    turn = _times(inner, _conjugate(outer))
    current = _times(add(_times(a, i), _negative(_times(c, inner))), _conjugate(outer))
    return Inner((p, q, size), power_node, _part(turn, size * v), _part(current, v))


def _part(z: Pair, whole: Any) -> Pair:
    return z[0] / whole, z[1] / whole


def _over(value: Any, scale: Any) -> Any:
    return value if scale is None else value / scale


def inwards(kind: str, values: Mapping[str, Any], v: Pair, i: Pair) -> tuple[Pair, Pair]:
    """Voltage and current at the inner side of an element from those at the outer one."""
    if kind == "shunt":
        return v, add(i, _times(_branch(values), v))
    v = add(v, _times((values["R"], values["L"]), i))
    if kind == "transformer":
        ratio = values["ratio"]
        return (v[0] / ratio, v[1] / ratio), (i[0] * ratio, i[1] * ratio)
    return v, i


def _branch(values: Mapping[str, Any]) -> Pair:
    """Admittance jC / (1 + j R C) of a series R, C."""
    x = resistance_of(values) * values["C"]
    scale = values["C"] / (1 + x * x)
    return scale * x, scale


def resistance_of(values: Mapping[str, Any]) -> Any:
    """Resistance of a shunt, which is never without."""
    return LEAST_RESISTANCE if is_zero(values["R"]) else values["R"]


def _chain(
    elements: list[tuple[str, Mapping[str, Any]]],
) -> tuple[tuple[Pair, Pair], tuple[Pair, Pair]]:
    """v_in = a v + b i, i_in = c v + d i, as ((a, b), (c, d)): what happens to a unit voltage and
    to a unit current.
    """
    (a, c), (b, d) = (_ONE, _ZERO), (_ZERO, _ONE)
    for kind, values in elements:
        (a, c), (b, d) = inwards(kind, values, a, c), inwards(kind, values, b, d)
    return (a, b), (c, d)


def _times(x: Pair, y: Pair) -> Pair:
    return x[0] * y[0] - x[1] * y[1], x[0] * y[1] + x[1] * y[0]


def _negative(x: Pair) -> Pair:
    return -x[0], -x[1]


def _conjugate(x: Pair) -> Pair:
    return x[0], -x[1]


# --- the linear system
# ----------------------------------------------------------------------------------------------


def at_terminals(
    joined: Interconnected, outside: Outside, parameters: Parameters, turn: Pair, omega_0: float
) -> Interconnected:
    """The device seen from where it was measured: the port's states come behind its own,
    "port.1.v_C_d" and so on.
    """
    if not outside:
        return joined
    system = _Seen(joined)
    if outside.elements:
        system.turn(turn)
    for k, element in reversed(list(enumerate(outside.elements, start=1))):
        name = f"{PORT}.{k}"
        values = parameters[name]
        if element.kind == "shunt":
            system.shunt(name, resistance_of(values), values["C"], omega_0)
            continue
        if element.kind == "transformer":
            system.scale(1 / values["ratio"], 1 / values["ratio"])
        system.series(name, values["R"], values["L"], omega_0)
    labels = parameters.get(LABEL, {})
    for name in ("frame_misalignment", "frame_rotation"):
        if name in labels:
            system.turn((cosine(labels[name]), -1.0 * sine(labels[name])))
    if "base_impedance" in labels:
        system.scale(1.0, labels["base_impedance"])
    return system.joined()


class _Seen:
    """Rows of a linear system, their columns named ("x", k), ("d", k) and ("v", axis), while it is
    put behind elements.
    """

    def __init__(self, joined: Interconnected) -> None:
        n, m = len(joined.states), len(joined.delayed)
        names = [*(("x", k) for k in range(n)), *(("d", k) for k in range(m)), ("v", 0), ("v", 1)]
        rows = [{names[column]: value for column, value in row.items()} for row in joined.rows]
        self.states, self.delayed = list(joined.states), joined.delayed
        self.x, self.d, self.y = rows[:n], rows[n : n + m], rows[n + m :]

    def joined(self) -> Interconnected:
        n, m = len(self.x), len(self.d)
        first = {"x": 0, "d": n, "v": n + m}
        rows = [
            {first[word] + k: value for (word, k), value in row.items()}
            for row in (*self.x, *self.d, *self.y)
        ]
        return Interconnected(tuple(rows), tuple(self.states), self.delayed)

    def turn(self, angle: Pair) -> None:
        """Let the device's own frame lead by an angle, given by (cos, sin)."""
        c, s = angle
        self.drive([{("v", 0): c, ("v", 1): s}, {("v", 0): -1.0 * s, ("v", 1): c}])
        d, q = self.y
        self.y = [_sum((c, d), (-1.0 * s, q)), _sum((s, d), (c, q))]

    def scale(self, voltage: Any, current: Any) -> None:
        """v_in = voltage v, i = current i_in."""
        self.drive([{("v", axis): voltage} for axis in (0, 1)])
        self.y = [_sum((current, row)) for row in self.y]

    def drive(self, v_in: list[Row]) -> None:
        """Let the voltage that drives all rows be these rows."""
        for rows in (self.x, self.d, self.y):
            rows[:] = [_driven(row, v_in) for row in rows]

    def shunt(self, name: str, R: Any, C: Any, omega_0: float) -> None:
        """A series R, C to neutral."""
        k = len(self.x)
        self.states += [f"{name}.v_C_d", f"{name}.v_C_q"]
        current = [{("v", axis): 1 / R, ("x", k + axis): -1 / R} for axis in (0, 1)]
        self.x += [
            _sum((omega_0 / C, current[0]), (omega_0, {("x", k + 1): 1.0})),
            _sum((omega_0 / C, current[1]), (-omega_0, {("x", k): 1.0})),
        ]
        self.y = [_sum((1.0, row), (-1.0, current[axis])) for axis, row in enumerate(self.y)]

    def series(self, name: str, R: Any, L: Any, omega_0: float) -> None:
        """A series R, L. Its current is one of the device's states, or that of a state of its own
        where a shunt is behind it.

        A current without a direct term has i' = C x', which the voltage v_in drives in turn: (1 -
        L/omega_0 C B) v_in = v + (R + L J) C x + L/omega_0 C A x. With one, i = C x + D v_in gives
        v_in, and i is a state.
        """
        d, q = self.y
        outer: list[Row] = [{("v", axis): 1.0} for axis in (0, 1)]
        if is_zero(L) and is_zero(R):
            return
        direct = [[row.get(("v", axis), 0.0) for axis in (0, 1)] for row in self.y]
        if is_zero(L):
            left = [[(1.0 if a == b else 0.0) - R * direct[a][b] for b in (0, 1)] for a in (0, 1)]
            right = [_sum((1.0, outer[a]), (R, _without_voltage(self.y[a]))) for a in (0, 1)]
            self.drive(_solved(left, right))
            return
        if all(is_zero(value) for row in direct for value in row):
            if any(word != "x" for row in self.y for word, _ in row):
                raise DiagramError(
                    "the current of the diagram does not flow through an inductor, so that nothing "
                    "can be in series with it; "
                    "wire a filter's i_g to i_DQ"
                )
            rate = [_sum(*((value, self.x[k]) for (_, k), value in row.items())) for row in self.y]
            slope = [[rate[a].get(("v", b), 0.0) for b in (0, 1)] for a in (0, 1)]
            left = [
                [(1.0 if a == b else 0.0) - L / omega_0 * slope[a][b] for b in (0, 1)]
                for a in (0, 1)
            ]
            coupled = [_sum((-1.0, q)), d]
            right = [
                _sum(
                    (1.0, outer[a]),
                    (R, self.y[a]),
                    (L, coupled[a]),
                    (L / omega_0, _without_voltage(rate[a])),
                )
                for a in (0, 1)
            ]
            self.drive(_solved(left, right))
            return
        k = len(self.x)
        own = [{("x", k + axis): 1.0} for axis in (0, 1)]
        v_in = _solved(
            direct, [_sum((1.0, own[a]), (-1.0, _without_voltage(self.y[a]))) for a in (0, 1)]
        )
        self.drive(v_in)
        w = omega_0 / L
        self.states += [f"{name}.i_d", f"{name}.i_q"]
        self.x += [
            _sum((w, v_in[0]), (-w, outer[0]), (-w * R, own[0]), (omega_0, own[1])),
            _sum((w, v_in[1]), (-w, outer[1]), (-w * R, own[1]), (-omega_0, own[0])),
        ]
        self.y = own


def _sum(*terms: tuple[Any, Row]) -> Row:
    columns = dict.fromkeys(column for _, row in terms for column in row)
    total = {
        column: weighted_sum((gain, row.get(column, 0.0)) for gain, row in terms)
        for column in columns
    }
    return {column: value for column, value in total.items() if not is_zero(value)}


def _without_voltage(row: Row) -> Row:
    return {column: value for column, value in row.items() if column[0] != "v"}


def _driven(row: Row, v_in: list[Row]) -> Row:
    return _sum(
        (1.0, _without_voltage(row)),
        *((row[column], v_in[column[1]]) for column in row if column[0] == "v"),
    )


def _solved(matrix: list[list[Any]], right: list[Row]) -> list[Row]:
    """Rows z with matrix z = right, 2 x 2."""
    (a, b), (c, d) = matrix
    determinant = a * d - b * c
    return [
        _sum((d / determinant, right[0]), (-1.0 * b / determinant, right[1])),
        _sum((-1.0 * c / determinant, right[0]), (a / determinant, right[1])),
    ]
