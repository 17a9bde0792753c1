"""What a recorder writes of a voltage and a current that are known between its samples: filter,
instants, noise, bits, phases.

Nothing is shared with the package but the reading of the file that is written.
"""

import tempfile
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from scipy.interpolate import CubicSpline
from scipy.signal import butter, sosfilt, sosfilt_zi

from ibrid.measurement.read_events import read_events
from ibrid.measurement.recordings.events import Events

#: Largest values that a recorder's channels take, per unit: voltage, current.
RANGE = (2.0, 4.0)
#: Order of the low-pass of each channel, and its corner over the rate.
ORDER, CORNER = 4, 0.35


@dataclass(frozen=True)
class Recorder:
    """`rate` : samples per s. `frame` : dq or abc. `bits` : of each channel; None: all digits.
    `filtered` : a low-pass in front.
    `noise_db` : of each component of voltage and current below the rms of what happens in it; None:
    clean. `offset`,
    `unbalance` : of channels, per unit and relative. `program` : no recorder, but what a program of
    fixed steps writes at each.
    """

    rate: float
    frame: str = "dq"
    bits: int | None = None
    filtered: bool = False
    noise_db: float | None = None
    offset: float = 0.0
    unbalance: float = 0.0
    program: bool = False


def recorded(
    recorder: Recorder,
    waves: Mapping[str, tuple[np.ndarray, np.ndarray, np.ndarray]],
    f0_hz: float,
    rng: np.random.Generator,
) -> Events:
    """The events that a recorder's file holds.

    waves : name -> time (n,), v and i (n,) d + j q between the samples.
    """
    names = ["d", "q"] if recorder.frame == "dq" else ["a", "b", "c"]
    lines = [f"# f0_hz: {f0_hz:g}", f"# frame: {recorder.frame}", "# power_node: pcc"]
    lines.append(
        ",".join(
            ["record", "t", *(f"v_{name}" for name in names), *(f"i_{name}" for name in names)]
        )
    )
    for name, (time, v, i) in waves.items():
        columns = _channels(recorder, time, v, i, f0_hz, rng)
        lines += [f"{name}," + ",".join(f"{number:.9g}" for number in row) for row in columns]
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "events.csv"
        path.write_text("\n".join(lines) + "\n", encoding="utf-8")
        return read_events(path)


def _channels(
    recorder: Recorder,
    time: np.ndarray,
    v: np.ndarray,
    i: np.ndarray,
    f0_hz: float,
    rng: np.random.Generator,
) -> np.ndarray:
    """(N, 1 + channels) time and the channels of voltage and current."""
    turn = np.exp(2j * np.pi * f0_hz * time)
    if recorder.filtered:
        v, i = (_filtered(wave * turn, time, recorder.rate) / turn for wave in (v, i))
    count = int((time[-1] - time[0]) * recorder.rate)
    at = time[0] + (rng.uniform() * (not recorder.program) + np.arange(count)) / recorder.rate
    at = at[at <= time[-1]]
    columns = [at - at[0]]
    share = 0.0 if recorder.noise_db is None else 10 ** (-recorder.noise_db / 20)
    for wave, largest in zip((v, i), RANGE, strict=True):
        noise = share * float(np.sqrt(np.mean(np.abs(wave - wave[0]) ** 2) / 2))
        seen = CubicSpline(time, wave)(at)
        if recorder.frame == "dq":
            channels = np.stack([seen.real, seen.imag])
        else:
            axes = np.exp(-2j * np.pi / 3 * np.arange(3))[:, None]
            channels = np.real(axes * seen * np.exp(2j * np.pi * f0_hz * (at - at[0])))
            noise *= np.sqrt(1.5)  # d and q are two thirds of the sum of three
        gains = 1 + recorder.unbalance * rng.standard_normal((len(channels), 1))
        offsets = recorder.offset * rng.standard_normal((len(channels), 1))
        channels = gains * channels + offsets + noise * rng.standard_normal(channels.shape)
        if recorder.bits is not None:
            step = 2 * largest / 2**recorder.bits
            channels = step * np.round(np.clip(channels, -largest, largest - step) / step)
        columns += list(channels)
    return np.stack(columns, axis=1)


def _filtered(wave: np.ndarray, time: np.ndarray, rate: float) -> np.ndarray:
    """Low-passed as a channel does it, from what it is at rest: a wave of the frequency of the
    grid.
    """
    step = time[1] - time[0]
    sections = butter(ORDER, CORNER * rate, fs=1 / step, output="sos")
    before = int(0.02 / step)
    swing = wave[1] / wave[0]  # of the rest, from sample to sample
    whole = np.concatenate([wave[0] * swing ** np.arange(-before, 0), wave])
    start = sosfilt_zi(sections) * whole[0]
    return sosfilt(sections, whole, zi=start)[0][before:]
