"""The compiled loop around a library: power stage, sensors, one call a sample.

Law: the states of the power stage go from the last sample to this one, the sensors see them, the
library is called with what they show, and what it answers is the bridge's voltage from now on, so
many samples later as the computation takes.
"""

import numpy as np

from ibrid.devices.cigre_library import ERROR, TIME
from ibrid.fit.just_in_time import njit
from ibrid.fit.kernel import OPTIONS


@njit(**OPTIONS)
def _write(views, kind, place, value):
    """A number into a structure; whole ones are rounded."""
    if kind == 0:
        views[0][place] = value
    elif kind == 1:
        views[1][place] = value
    elif kind == 2:
        views[2][place] = round(value)
    elif kind == 3:
        views[3][place] = round(value)
    elif kind == 4:
        views[4][place] = round(value)
    elif kind == 5:
        views[5][place] = round(value)
    elif kind == 6:
        views[6][place] = round(value)
    elif kind == 7:
        views[7][place] = round(value)


@njit(**OPTIONS)
def _read(views, kind, place):
    """A number of a structure."""
    if kind == 0:
        return float(views[0][place])
    if kind == 1:
        return float(views[1][place])
    if kind == 2:
        return float(views[2][place])
    if kind == 3:
        return float(views[3][place])
    if kind == 4:
        return float(views[4][place])
    if kind == 5:
        return float(views[5][place])
    if kind == 6:
        return float(views[6][place])
    return float(views[7][place])


@njit(**OPTIONS)
def run_library(
    outputs, address, memory, first, step_s, v, i, inputs, answers, wired_in, wired_out, laws, kept
):
    """Fill i (n, 3) from v (n, 3), sample by sample; the sample at which the library answered an
    error, -1 for none.

    outputs : the library's function, called with the address of its instance. memory : that
    instance, in which `TIME` is set.
    inputs, answers : views of its structures, one for each type. wired_in, wired_out, laws, kept :
    as `LibraryWires` and the motion of a power stage have them.
    """
    kind_in, place_in, source_in, gain_in = wired_in
    kind_out, place_out, gain_out = wired_out
    a, b, sensed, through, (share, limit, has_stage) = laws[0], laws[1], laws[2], laws[3], laws[4]
    x, u, v_last, shown, begun = kept
    now = np.empty((4, 3))
    moved = np.empty(x.shape[0])
    terminal = np.empty(3)
    for sample in range(v.shape[0]):
        for phase in range(3):
            terminal[phase] = v[sample, phase]
        if has_stage > 0:
            terminal -= (terminal[0] + terminal[1] + terminal[2]) / 3
        applied = u.shape[0] - 1
        for phase in range(3):
            if begun[0] > 0:
                for row in range(x.shape[0]):
                    moved[row] = (
                        b[row, 0] * u[applied, phase]
                        + b[row, 1] * v_last[phase]
                        + b[row, 2] * terminal[phase]
                    )
                    for column in range(x.shape[0]):
                        moved[row] += a[row, column] * x[column, phase]
                for row in range(x.shape[0]):
                    x[row, phase] = moved[row]
            v_last[phase] = terminal[phase]
            for row in range(4):
                now[row, phase] = (
                    through[row, 0] * u[applied, phase] + through[row, 1] * terminal[phase]
                )
                for column in range(x.shape[0]):
                    now[row, phase] += sensed[row, column] * x[column, phase]
                if begun[0] > 0:
                    shown[row, phase] += share * (now[row, phase] - shown[row, phase])
                else:
                    shown[row, phase] = now[row, phase]
            if has_stage == 0:
                shown[0, phase] = terminal[phase]
        begun[0] = 1.0
        for wire in range(kind_in.size):
            value = gain_in[wire] * shown[source_in[wire] // 3, source_in[wire] % 3]
            _write(inputs, kind_in[wire], place_in[wire], value)
        memory[TIME] = (first + sample) * step_s
        if outputs(address) >= ERROR:
            return sample
        for row in range(u.shape[0] - 1, 0, -1):
            for phase in range(3):
                u[row, phase] = u[row - 1, phase]
        for phase in range(3):
            answer = gain_out[phase] * _read(answers, kind_out[phase], place_out[phase])
            if has_stage > 0:
                u[0, phase] = min(max(answer, -limit), limit)
                i[sample, phase] = now[2, phase]
            else:
                i[sample, phase] = answer
        if has_stage > 0:
            middle = (u[0, 0] + u[0, 1] + u[0, 2]) / 3
            for phase in range(3):
                u[0, phase] -= middle
    return -1
