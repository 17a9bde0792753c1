"""One sentence in plain words: how well the model describes the measurement, where the error lies, what is open."""

from ibrid.evaluation.outcome import Outcome
from ibrid.evaluation.record import Record
from ibrid.report.modes import slowest, unstable_points
from ibrid.report.numbers import error, percent

#: Mean NRMSE up to which a sentence holds.
LEVELS = (
    (1e-6, "The model reproduces the measurement to rounding"),
    (1e-3, "The model reproduces the measurement within 0.1 %"),
    (0.02, "The model follows the measurement closely"),
    (0.1, "The model follows the measurement, but misses something"),
    (0.5, "The model shows the rough shape and misses a good part of the measurement"),
    (float("inf"), "The model does not describe the measurement"),
)
BANDS_HZ = {
    "5-50": "below 50 Hz",
    "50-500": "from 50 to 500 Hz",
    "500-2000": "from 500 Hz to 2 kHz",
    "2000-5000": "above 2 kHz",
}
#: An error up to this multiple of what noise alone gives is noise (a few of its standard deviations for short sweeps).
NOISE_MARGIN = 1.2
#: Real part (1/s) above which a stable pole is in effect an integrator.
NEARLY_INTEGRATING = -1e-3

NO_FIT = {
    Outcome.INVALID: "The grammar refuses the program, so nothing was fitted",
    Outcome.FAILED: "No fit exists",
    Outcome.TIMEOUT: "The fit was stopped at its time limit",
}


def verdict(record: Record) -> str:
    """The sentence, with the largest share of the error and the number of parameters that stay open.

    Data with known noise tell an error that is noise from one that is not.
    """
    if record.nrmse is None:
        return f"{NO_FIT.get(Outcome(record.outcome), 'Nothing was fitted')}; the reasons are below."
    words = next(text for limit, text in LEVELS if record.nrmse <= limit)
    noise = record.noise_floor
    if noise is not None and record.nrmse <= NOISE_MARGIN * noise:
        clauses = [
            f"The model explains the measurement down to its noise (NRMSE {error(record.nrmse)}, noise {error(noise)})"
        ]
    else:
        clauses = [f"{words} (NRMSE {error(record.nrmse)})"]
        clauses += [f"noise alone would give {error(noise)}"] if noise is not None else []
        clauses += [where] if record.nrmse > 1e-6 and (where := largest_share(record)) else []
    if record.holdout:
        worst = max(record.holdout, key=lambda name: record.holdout[name])
        clauses.append(f"it predicts {worst}, which was held out, with {error(record.holdout[worst])}")
    open_names = invisible(record)
    if open_names:
        count = len(record.boxes) or len(next(iter(record.parameters.values())))
        clauses.append(f"the data leave {len(open_names)} of {count} parameters open")
    return "; ".join(clauses) + "."


def largest_share(record: Record) -> str:
    """Where most of the squared error lies, as a clause; "" where that is unknown."""
    shares = {band: share for band, share in record.share_by_band.items() if share is not None}
    if not shares:
        return ""
    band = max(shares, key=lambda name: shares[name])
    return f"{percent(shares[band])} of the squared error lies {BANDS_HZ.get(band, f'in {band} Hz')}"


def invisible(record: Record) -> list[str]:
    """Names of parameters without an interval at some operating point."""
    found = [name for one in record.intervals.values() for name, ends in one.items() if ends is None]
    return list(dict.fromkeys(found))


def stability(record: Record) -> str:
    """Whether the model is stable, with a word on poles that are practically integrators; "unknown" without a fit."""
    if not record.stable:
        return "unknown"
    lost = unstable_points(record)
    if lost:
        return f"unstable at {', '.join(lost)}"
    edge = [name for name, poles in record.poles.items() if slowest(poles) > NEARLY_INTEGRATING]
    if edge:
        return "stable, with a pole at zero for practical purposes (an integrator that the data do not need)"
    return "stable at every operating point"
