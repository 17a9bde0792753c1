"""A device that is none of the generic model is said to be none, whatever the fit ends at."""

from pathlib import Path

import numpy as np
import pytest

import ibrid
from ibrid.generic.answer import fit_generic_model


@pytest.mark.slow
def test_a_device_of_another_kind_is_said_and_no_interval_is_zero(tmp_path: Path):
    """A current that swings at 3 Hz after the dip, as no law of REGC_A and REEC_A does."""
    time = np.arange(0, 2, 0.01)
    v = np.where((time > 0.5) & (time < 0.7), 0.6, 1.0)
    swing = np.where(time > 0.7, 0.3 * np.sin(2 * np.pi * 3 * (time - 0.7)), 0.0)
    lines = [
        f"dip,{t:.2f},{u:.6f},0,{0.7 + s:.6f},0" for t, u, s in zip(time, v, swing, strict=True)
    ]
    file = tmp_path / "dip.csv"
    head = "# frame: phasor\n# window: none\n# f0_hz: 50\nrecord,t,v_mag,v_deg,i_mag,i_deg\n"
    file.write_text(head + "\n".join(lines) + "\n")
    answer = fit_generic_model(ibrid.read_events(file))
    assert any("do not rely on the values" in warning for warning in answer.warnings)
    assert all(deviation > 1e-9 for deviation in answer.fit.deviations.values())
    assert not set(answer.fit.at_bound) & set(answer.fit.deviations)
