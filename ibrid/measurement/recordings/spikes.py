"""Single samples that stand out of a recording: a wrong cell, a lost sample, a slip of the decimal
mark.
"""

from collections.abc import Sequence

import numpy as np

from ibrid.measurement.sweeps.quantities import counted

#: A sample stands out that is so many times farther from both neighbours than they, and their own
#: neighbours, are from each other, than the recording usually moves, and than this, per unit.
_TIMES, _LEAST = 10.0, 0.02
#: A current may jump for one sample where the voltage moves by this, per unit: a capacitor at the
#: terminals answers.
_MOVES = 0.02
#: Factors of slips, what they mean, and how near they must be.
_SLIPS = {
    -1.0: "its sign is probably wrong",
    0.0: "a sample is probably missing there and written as 0",
    **{
        10.0**k: f"it is probably {10**k} times too large, a slip of the decimal mark or the unit"
        for k in (1, 2, 3)
    },
    **{
        10.0**-k: f"it is probably {10**k} times too small, a slip of the decimal mark or the unit"
        for k in (1, 2, 3)
    },
}
_NEAR = 0.1
#: Samples that are named one by one.
_NAMED = 3


def describe_spikes(
    time: np.ndarray,
    waves: tuple[np.ndarray, np.ndarray],
    channels: tuple[np.ndarray | Sequence[np.ndarray], np.ndarray | Sequence[np.ndarray]],
    bases: tuple[float, float],
) -> tuple[str, ...]:
    """Name the samples of voltage and current that stand out, with the likely mistake.

    Parameters
    ----------
    time : (n,) s.
    waves : v and i as d + j q, per unit, in which a recording at rest stands still.
    channels : the channels of v and of i as they were recorded, phases or d and q.
    bases : by how much these were divided.
    """
    voltage, _ = waves
    spike_texts = []
    for letter, wave, columns, base in zip("vi", waves, channels, bases, strict=True):
        places = _standing_out(wave)
        if letter == "i":
            places = [k for k in places if np.ptp(np.abs(voltage[k - 2 : k + 3])) < _MOVES]
        names = [f"{letter}_{axis}" for axis in ("dq" if len(columns) == 2 else "abc")]
        for k in places:
            spike_texts.append((k, _words(k, names, columns, base, float(time[k]))))
    spike_texts.sort()
    shown = [words for _, words in spike_texts[:_NAMED]]
    more = len(spike_texts) - len(shown)
    if more:
        shown.append(f"{counted(more, 'further sample')} stand out in the same way")
    return tuple(shown)


def _standing_out(wave: np.ndarray) -> list[int]:
    """Places of samples far from both neighbours, which lie near each other."""
    if len(wave) < 5:
        return []
    step = np.abs(np.diff(wave))
    apart = np.minimum(step[1:-2], step[2:-1])
    across = np.abs(wave[3:-1] - wave[1:-3])
    around = np.max([across, step[:-3], step[3:]], axis=0)
    usual = float(np.median(step))
    out = apart > np.maximum(_TIMES * np.maximum(around, usual), _LEAST)
    return (np.flatnonzero(out) + 2).tolist()


def _words(
    k: int, names: Sequence[str], columns: np.ndarray | Sequence[np.ndarray], base: float, at: float
) -> str:
    """The channel that is farthest from what its neighbours say there, and the factor between."""
    expected = np.array([_between(column, k) for column in columns])
    found = np.array([float(column[k]) for column in columns])
    worst = int(np.argmax(np.abs(found - expected)))
    value, usual = found[worst], expected[worst]
    ratio = value / usual if abs(usual) > _LEAST * base else np.nan
    slips = [words for factor, words in _SLIPS.items() if abs(ratio - factor) <= _near(factor)]
    likely = f": {slips[0]}" if slips else ""
    return (
        f"{names[worst]} stands out at {at:.6g} s from its neighbours, {value:.4g} where they lead "
        f"to {usual:.4g}{likely}; correct the cell, or cut the record there"
    )


def _near(factor: float) -> float:
    """How far a factor may be from what it is taken for; of 0 a small part of one."""
    return _NEAR * abs(factor) if factor else 1e-9


def _between(column: np.ndarray, k: int) -> float:
    """What a cubic through two samples on either side says of the one between."""
    return float(-column[k - 2] + 4 * column[k - 1] + 4 * column[k + 1] - column[k + 2]) / 6
