"""Draw the picture of the README: a model fitted to another project's controller, at a held-out
point.

The device is motulator's power synchronisation, measured by injection (data/devices). Run:

python docs/making/foreign_answer.py
"""

import sys
from pathlib import Path

import matplotlib

matplotlib.use("Agg")

import matplotlib.pyplot as plt
import numpy as np
from matplotlib.figure import Figure

import ibrid
from ibrid.evaluation import Record
from ibrid.measurement import Sweep

ROOT = Path(__file__).resolve().parents[2]
SWEEP = ROOT / "data" / "devices" / "motulator_gfm_psc.csv"
PICTURE = ROOT / "docs" / "images" / "foreign.png"
HELD_OUT = "absorbing"
#: Designs of motulator 0.5, per unit on 12.8 ohm and 50 Hz (notebook 09 derives them).
DESIGN = {
    "L_F": ("filter inductance", 0.2454, "pu"),
    "R_a": ("active resistance", 0.1250, "pu"),
    "k_sync": ("synchronisation gain", 39.27, "rad/s"),
    "omega_c": ("cutoff of the slow current", 31.42, "rad/s"),
}


def fitted_values(record: Record) -> dict[str, float]:
    """Return the identified values under the names of ``DESIGN``."""
    values = record.parameters["half"]
    return {
        "L_F": values["plant.L_F"],
        "R_a": values["plant.R_F"] - values["active_resistance.k"],
        "k_sync": -values["sync_gain.k"],
        "omega_c": values["slow_q.omega_c"],
    }


def draw(sweep: Sweep, record: Record) -> Figure:
    """Draw |Y| measured and predicted at the held-out point, and the table of parameters."""
    point = sweep.point(HELD_OUT)
    frequency = np.geomspace(point.frequency.min(), point.frequency.max(), 300)
    predicted = ibrid.predict(
        record, f"p={point.op.p:g},q={point.op.q:g},v={point.op.v:g}", frequency
    )
    figure = plt.figure(figsize=(10, 4.2), layout="constrained")
    left, right = figure.subfigures(1, 2, width_ratios=(1.35, 1))
    axes = left.subplots(2, 2, sharex=True)
    for axis, (row, column) in zip(axes.flat, np.ndindex(2, 2), strict=True):
        axis.loglog(frequency, abs(predicted.admittance[:, row, column]), color="#1f5fa8")
        axis.loglog(
            point.frequency, abs(point.admittance[:, row, column]), "o", color="#16202c", ms=3.5
        )
        axis.set_title(rf"$|Y_{{{'dq'[row]}{'dq'[column]}}}|$ (pu)", fontsize=10, loc="left")
        axis.grid(alpha=0.3)
    for axis in axes[1]:
        axis.set_xlabel("frequency (Hz)")
    error = record.holdout[HELD_OUT]
    left.suptitle(
        f"Operating point kept out of the fit: NRMSE {error:.4f}\ndots measured, lines predicted",
        fontsize=10,
    )
    _draw_table(right, fitted_values(record))
    return figure


def _draw_table(panel: Figure, values: dict[str, float]) -> None:
    axis = panel.subplots()
    axis.axis("off")
    axis.set_title(
        "Identified from the admittance alone,\nand the design in its source code", fontsize=10
    )
    rows = [
        [meaning, f"{values[name]:.4g}", f"{design:.4g}", unit]
        for name, (meaning, design, unit) in DESIGN.items()
    ]
    table = axis.table(
        rows, colLabels=["", "identified", "design", "unit"], loc="center", edges="horizontal"
    )
    table.auto_set_font_size(False)
    table.set_fontsize(9)
    table.auto_set_column_width([0, 1, 2, 3])
    table.scale(1, 1.7)


if __name__ == "__main__":
    sweep = ibrid.read_sweep(SWEEP)
    record = ibrid.evaluate(
        ibrid.textbook("gfm_reference_feedforward"), sweep, holdout_op=HELD_OUT, restarts=1
    )
    draw(sweep, record).savefig(sys.argv[1] if len(sys.argv) > 1 else PICTURE, dpi=110)
