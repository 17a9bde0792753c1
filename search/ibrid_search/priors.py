"""What every control engineer knows of inverters before any measurement: the cues of the paper, section V.B, in words.

Generic knowledge only: nothing here comes from a device, a data set or a finished diagram.
"""

from collections.abc import Mapping

PRIORS = """\
From slow to fast, a grid-following inverter usually has: outer control of active power (or DC voltage) and of reactive
power (or AC voltage), a few Hz to some tens of Hz; synchronisation (a PLL), tens of Hz; inner current control, some
hundred Hz to 1 kHz; the resonance of an LCL filter above it; the delay of sampling and modulation, whose phase shows from
some hundred Hz up. A grid-forming one synchronises by power instead and controls its voltage. Use where the error lies in
frequency to decide which of these layers is missing or wrong before you propose an edit:
- Error at low frequency: synchronisation and outer loops are missing, have a wrong sign, or lack a filter.
- Error at middle frequency: bandwidth and damping of the PLL and of the current control; filters of measured power,
  voltage or current; feedforward of the voltage; decoupling of the axes.
- Error at high frequency: the current loop, the physical filter (L or LCL) and the delay.
- Synchronisation shows first in the answer to v_q (entries dq, qq), power control in the answer to v_d (dd, qd), and
  whatever couples the axes (decoupling, frame, frequency) in dq and qd.
- Error that differs between operating points: something that depends on the operating point is missing, such as power
  control or the rotation into the controller's own frame.
- If an expected layer makes the fit worse, look at its feedback sign, the filtering of what it measures and the point
  where it is injected before you give it up.
- A parameter at its bound or a block that the data do not see says that the block does nothing there: remove it, move it
  or put another kind in its place. An unstable pole says that a sign is wrong or a loop is closed at the wrong place.
- Of two structures that fit alike the one with fewer modules and free parameters is better; residual modules come last."""

#: What is asked for at each scale of an edit.
SCALE_TEXTS: Mapping[str, str] = {
    "local": (
        "a LOCAL edit: change which parameters are shared, fixed or narrowed, or where signals are taken from and injected "
        "(bindings and g.connect lines); add and remove no module unless a sign needs one."
    ),
    "module": (
        "an edit of ONE MODULE: put one control component in, take one out, or replace one by another kind, with the "
        "connections that this needs."
    ),
    "structural": (
        "a STRUCTURAL edit: add, replace or remove an entire control sub-loop, or replace the physical plant, with "
        "everything that must be rewired for it."
    ),
}
