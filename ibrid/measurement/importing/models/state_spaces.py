"""A state space as a table of its frequency response: C (s E - A)^-1 B + D on a grid.

Arrays A, B, C, D as MATLAB saves them of linmod, or of ss in a structure, and as `ibrid export`
writes them; of one operating point, or of several on a last axis.
"""

import re
from collections.abc import Mapping

import numpy as np

from ibrid.errors import SweepError, some
from ibrid.measurement.formats.frd import MODEL_GRID
from ibrid.measurement.formats.model_poles import model_words, poles_of
from ibrid.measurement.formats.response_labels import q_first, require_plain_responses
from ibrid.measurement.importing.foreign_table import ForeignTable
from ibrid.measurement.importing.models.matlab_objects import SAVING

_DISCRETE = ("Ts", "ts", "dt", "SampleTime")
#: Names of signals: the axis at the end, or right behind the letter where something follows, such
#: as a place; vdc is none.
_VOLTAGE, _CURRENT = (
    {
        axis: re.compile(rf"{begin}\w*?_?{axis}\b|(?<![a-z]){letter}_?{axis}(?!c)", re.IGNORECASE)
        for axis in "dq"
    }
    for begin, letter in (("(v|u|volt)", "v"), ("(i|curr)", "i"))
)
_NAMES = ("input_names", "InputName", "inputs"), ("output_names", "OutputName", "outputs")
#: Names of the coefficients of numerators and denominators.
_FRACTIONS = (("num", "den"), ("Numerator", "Denominator"))
#: How our own exports say what their numbers are counted in.
_OURS = "per unit on the inverter's base"
#: Half the rate of a sampled model is left out, and this part below it.
_BELOW_HALF = 0.98
#: Lowest frequency of a model, Hz, and frequencies a decade; a pole below this stands still.
_LOWEST, _A_DECADE, _STILL = 0.05, 20, 1e-6


def state_space_tables(
    arrays: Mapping[str, np.ndarray], where: str, stem: str, at: np.ndarray | None = None
) -> list[ForeignTable]:
    """The response of each operating point; empty where the arrays are no model.

    at : Hz at which it is sampled, where somebody says.

    Raises SweepError where matrices do not fit together, or inputs and outputs are not two each.
    """
    place = _place(arrays)
    if place is None:
        return _fraction_tables(arrays, where, stem, at)
    held = {
        name.removeprefix(place): value for name, value in arrays.items() if name.startswith(place)
    }
    held |= {name: value for name, value in arrays.items() if "." not in name and name not in held}
    op_names = _texts(held, ("op",))
    a, b, c, d = (np.asarray(held[_named(held, letter)], dtype=float) for letter in "ABCD")
    b = b[:, None] if b.ndim == 1 else b
    c = c[None] if c.ndim == 1 else c
    named_inputs, named_outputs = (_texts(held, names) for names in _NAMES)
    inputs = _two(named_inputs, b.shape[1], _VOLTAGE, "inputs, v_d and v_q", where)
    outputs = _two(named_outputs, c.shape[0], _CURRENT, "outputs, i_d and i_q", where)
    count = a.shape[2] if a.ndim == 3 else 1
    tables = []
    for k in range(count):
        matrices = [
            one[..., k] if one.ndim == 3 else one
            for one in (a, b[:, inputs], c[outputs], d[outputs][:, inputs])
        ]
        name = op_names[k] if len(op_names) == count else ""
        tables.append(_table(matrices, held, k if count > 1 else None, name, where, stem, at))
    return tables


def _fraction_tables(
    arrays: Mapping[str, np.ndarray], where: str, stem: str, at: np.ndarray | None
) -> list[ForeignTable]:
    """The response of 2 x 2 fractions, whose coefficients MATLAB saves of tf or tfdata in cells
    num and den, or in a structure.
    """
    fraction = _fraction_in(arrays)
    if fraction is None:
        return []
    place, top_name, bottom_name = fraction
    tops = _four(arrays, place + top_name)
    bottoms = _four(arrays, place + bottom_name)
    if not bottoms or not tops:
        keeping = SAVING["tf"].replace("(sys)", "(sys(1:2, 1:2))")
        raise SweepError(
            f"{where} must hold numerators and denominators as cells of 2 x 2, voltages to "
            f"currents of the terminals; found others, in MATLAB: {keeping}."
        )
    if not all(np.isfinite(one).all() for one in (*tops, *bottoms)) or not all(
        map(np.any, bottoms)
    ):
        raise SweepError(
            f"{where} must hold finite coefficients, not all of a denominator 0; found others, "
            "save the model again."
        )
    held = {name.removeprefix(place): value for name, value in arrays.items()}
    require_plain_responses(arrays, where)
    period = _period(held, where)
    denominators = {tuple(one.tolist()): np.roots(one) for one in bottoms}
    poles = np.concatenate([*denominators.values()])
    grid = _grid(poles, period, at, ours=False)
    s = np.exp(2j * np.pi * grid * period) if period else 2j * np.pi * grid
    fractions = zip(tops, bottoms, strict=True)
    response = [np.polyval(top, s) / np.polyval(bottom, s) for top, bottom in fractions]
    names = (f"Y({row},{column})" for row in (1, 2) for column in (1, 2))
    columns = {"f_dq": grid, **dict(zip(names, response, strict=True))}
    words = model_words(len(poles), poles, period, grid)
    lines = np.arange(1, len(grid) + 1)
    return [ForeignTable(where, stem, columns, lines, _notes(held, None), remarks=(words,))]


def _fraction_in(arrays: Mapping[str, np.ndarray]) -> tuple[str, str, str] | None:
    """What stands before the names of numerators and denominators, and these names; None where no
    numerators stand beside denominators.
    """
    names = dict.fromkeys(re.sub(r"\{\d+\}$", "", name) for name in arrays)
    for top, bottom in _FRACTIONS:
        for name in names:
            place, _, last = name.rpartition(".")
            place = f"{place}." if place else ""
            if last == top and place + bottom in names:
                return place, top, bottom
    return None


def _four(arrays: Mapping[str, np.ndarray], name: str) -> list[np.ndarray]:
    """The coefficients of the entries 11, 12, 21, 22 in a cell array, or of one denominator of
    all; none of another shape.
    """
    whole = arrays.get(name)
    if whole is None:
        cells = [arrays.get(f"{name}{{{k}}}", np.zeros(0)).ravel() for k in (1, 3, 2, 4)]
        more = f"{name}{{5}}" in arrays
        return cells if all(cell.size for cell in cells) and not more else []
    if whole.shape[:2] == (2, 2) and whole.ndim == 3:
        return [*whole.reshape(4, -1)]
    return [whole.ravel()] * 4 if name.endswith(("den", "Denominator")) else []


def _place(arrays: Mapping[str, np.ndarray]) -> str | None:
    """What stands before the names of the matrices: "" or that of a structure; None where no square
    A stands with B, C and D.
    """
    for name, value in arrays.items():
        head, _, last = name.rpartition(".")
        if last not in ("A", "a") or value.ndim not in (2, 3) or value.shape[0] != value.shape[1]:
            continue
        prefix = f"{head}." if head else ""
        if all(
            f"{prefix}{letter}" in arrays or f"{prefix}{letter.lower()}" in arrays
            for letter in "BCD"
        ):
            return prefix
    return None


def _named(held: Mapping[str, np.ndarray], letter: str) -> str:
    return letter if letter in held else letter.lower()


def _texts(held: Mapping[str, np.ndarray], names: tuple[str, ...]) -> list[str]:
    """The texts of the first of some names, one by one as cell arrays have them too."""
    for name in names:
        if name in held and held[name].dtype.kind == "U":
            return [str(one).strip() for one in held[name].ravel()]
        cells = [
            value
            for key, value in held.items()
            if re.fullmatch(rf"{re.escape(name)}\{{\d+\}}", key)
        ]
        if cells:
            return [str(one.ravel()[0]).strip() if one.size else "" for one in cells]
    return []


def _two(
    names: list[str], count: int, patterns: Mapping[str, re.Pattern[str]], wanted: str, where: str
) -> list[int]:
    """Places of the d and the q signal: by their names, else the two that there are."""
    if len(names) == count:
        places_of = [
            [k for k, name in enumerate(names) if pattern.search(name)]
            for pattern in patterns.values()
        ]
        if all(len(places) == 1 for places in places_of):
            return [places[0] for places in places_of]
    if count == 2:
        return [1, 0] if q_first(names) else [0, 1]
    shown = f" ({some(names, 6)})" if names else ""
    raise SweepError(
        f"{where} must be a model with two {wanted}; found {count}{shown}, in MATLAB keep those of "
        "the terminals: "
        "B = B(:, [1 2]); C = C([1 2], :); D = D([1 2], [1 2])."
    )


def _table(
    matrices: list[np.ndarray],
    held: Mapping[str, np.ndarray],
    k: int | None,
    name: str,
    where: str,
    stem: str,
    at: np.ndarray | None,
) -> ForeignTable:
    a, b, c, d = matrices
    order = len(a)
    if (
        a.shape != (order, order)
        or b.shape != (order, 2)
        or c.shape != (2, order)
        or d.shape != (2, 2)
    ):
        raise SweepError(
            f"{where}: A, B, C and D must fit together; found shapes "
            f"{', '.join(str(one.shape) for one in matrices)}, save all "
            "four of one model."
        )
    if not all(np.isfinite(one).all() for one in matrices):
        raise SweepError(
            f"{where}: A, B, C and D must be finite numbers; found others, export the model again."
        )
    mass = _mass(held, k, order, where)
    period = _period(held, where)
    poles = poles_of(a, mass, where)
    grid = _grid(poles, period, at, ours=_is_ours(held))
    if not len(grid):
        raise SweepError(
            f"{where}: a model sampled every {period:g} s says nothing above {0.5 / period:g} "
            "Hz; sample it faster."
        )
    s = np.exp(2j * np.pi * grid * period) if period else 2j * np.pi * grid
    try:
        response = c @ np.linalg.solve(s[:, None, None] * mass - a, b + 0j) + d
    except np.linalg.LinAlgError:
        raise SweepError(
            f"{where}: the model must have a finite response; one of its poles lies on the "
            "imaginary axis at a frequency of the grid, take out what is not damped."
        ) from None
    columns = {"f_dq": grid} | {
        f"Y({r + 1},{c + 1})": response[:, r, c] for r, c in np.ndindex(2, 2)
    }
    return ForeignTable(
        where,
        stem,
        columns,
        np.arange(1, len(grid) + 1),
        _notes(held, k),
        op=name,
        remarks=(model_words(order, poles, period, grid),),
    )


def _mass(held: Mapping[str, np.ndarray], k: int | None, order: int, where: str) -> np.ndarray:
    """E of E dx/dt = A x + B u; the identity where none is given or it is empty.

    SweepError for one that does not fit to A.
    """
    e = held.get("E", held.get("e"))
    if e is None or not e.size or e.dtype.kind not in "biuf":
        return np.eye(order)
    mass = np.asarray(e, dtype=float)
    mass = mass[..., k] if mass.ndim == 3 and k is not None else mass
    if mass.shape != (order, order) or not np.isfinite(mass).all():
        raise SweepError(
            f"{where}: E must be {order} x {order} finite numbers, as A; found shape {mass.shape}, "
            "save all matrices of one model."
        )
    return mass


def _grid(poles: np.ndarray, period: float, at: np.ndarray | None, *, ours: bool) -> np.ndarray:
    """Hz at which a model is sampled: as said, our own as a sweep of ours, others from a fifth of
    the slowest pole on; of a sampled model those below half its rate.
    """
    if at is not None:
        return at[at * period < 0.5 * _BELOW_HALF] if period else at
    if ours:
        return MODEL_GRID
    sizes = np.abs(np.log(poles[poles != 0] + 0j) / period if period else poles) / (2 * np.pi)
    slowest = float(min(sizes[sizes > _STILL], default=MODEL_GRID[0]))
    low = min(max(slowest / 5, _LOWEST), MODEL_GRID[0])
    count = max(len(MODEL_GRID), int(np.ceil(_A_DECADE * np.log10(MODEL_GRID[-1] / low))))
    grid = np.array([float(f"{hertz:.12g}") for hertz in np.geomspace(low, MODEL_GRID[-1], count)])
    return grid[grid * period < 0.5 * _BELOW_HALF] if period else grid


def _is_ours(held: Mapping[str, np.ndarray]) -> bool:
    return any(_OURS in text for text in _texts(held, ("units",)))


def _period(held: Mapping[str, np.ndarray], where: str) -> float:
    """s between the samples of a discrete model; 0 of a continuous one.

    SweepError where a discrete one does not say it.
    """
    for name in _DISCRETE:
        if name in held and held[name].size == 1 and held[name].dtype.kind in "iuf":
            period = float(held[name].ravel()[0])
            if period < 0:
                raise SweepError(
                    f"{where}: a sampled model must know its sampling period; found {name} = "
                    f"{period:g}, give it in seconds."
                )
            return period
    return 0.0


def _notes(held: Mapping[str, np.ndarray], k: int | None) -> tuple[str, ...]:
    """What stands beside the matrices, as lines `key: value`; of our own exports also what they
    mean.
    """
    notes = []
    for name, value in held.items():
        if name in "ABCDEabcde" or value.dtype.kind not in "iufU":
            continue
        if value.size == 1 and not (value.dtype.kind == "f" and np.isnan(value).all()):
            notes.append(f"{name}: {value.ravel()[0]}")
        elif k is not None and name in ("p", "q", "v") and value.size > k:
            notes.append(f"{name}: {value.ravel()[k]}")
    if any(_OURS in note for note in notes):
        notes = [
            note
            for note in notes
            if not note.startswith(("name:", "units:", "omega_0:", "p_pcc:", "q_pcc:", "op:"))
        ]
        notes += ["unit: pu", "current: out", "q_axis: leads", "voltage_axis: d"]
    return tuple(notes)
