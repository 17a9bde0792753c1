"""One sentence in plain words: how well the model describes the measurement, where the error lies,
what is open.
"""

from ibrid.evaluation.grade import LEAST_UNKNOWN, ROUGH, Grade
from ibrid.evaluation.outcome import Outcome
from ibrid.evaluation.record import Record
from ibrid.report.facts.modes import slowest, unstable_points
from ibrid.report.look.numbers import error, percent

WORDS = {
    Grade.EXPLAINS: "The model explains the measurement",
    Grade.CLOSE: "The model follows the measurement closely and leaves a little more than its "
    "noise",
    Grade.ROUGH: "The model shows the rough shape of the measurement and misses something",
    Grade.FAILS: "The model does not describe the measurement",
}
#: NRMSE up to which a difference is rounding, in data of unknown noise.
ROUNDING, TO_ROUNDING = 1e-6, "The model reproduces the measurement to rounding"
BANDS_HZ = {
    "5-50": "below 50 Hz",
    "50-500": "from 50 to 500 Hz",
    "500-2000": "from 500 Hz to 2 kHz",
    "2000-5000": "from 2 kHz on",
}
#: Real part (1/s) above which a stable pole is in effect an integrator.
NEARLY_INTEGRATING = -1e-3

NO_FIT = {
    Outcome.INVALID: "The grammar refuses the program, so nothing was fitted",
    Outcome.FAILED: "No fit exists",
    Outcome.UNFINISHED: "The fit was ended before it was finished, so nothing is known of the "
    "diagram",
}


def verdict(record: Record) -> str:
    """The sentence by the record's grade, with the largest share of the error and the number of
    parameters that stay open.
    """
    if record.nrmse is None:
        return (
            f"{NO_FIT.get(Outcome(record.outcome), 'Nothing was fitted')}; the reasons are below."
        )
    grade = graded(record) or Grade.FAILS
    floor = (record.misfit or {}).get("floor", {"value": None, "from": "unknown"})
    known = floor["from"] != "unknown"
    noise = f", noise {error(floor['value'])}" if known else ""
    words = WORDS[grade]
    if grade is Grade.EXPLAINS and not known:
        words = (
            TO_ROUNDING if record.nrmse <= ROUNDING else f"{words} to {LEAST_UNKNOWN:g} of its size"
        )
    elif grade is Grade.EXPLAINS:
        words += " down to its noise"
    clauses = [f"{words} (NRMSE {error(record.nrmse)}{noise})"]
    if grade is not Grade.EXPLAINS:
        clauses += [where] if (where := largest_share(record)) else []
        clauses += [] if known else ["the noise of the data is not known"]
    if record.holdout:
        worst = max(record.holdout, key=lambda name: record.holdout[name])
        clauses.append(
            f"it predicts {worst}, which was held out, with {error(record.holdout[worst])}"
        )
    open_names = invisible(record)
    if open_names:
        count = len(record.boxes) or len(next(iter(record.parameters.values())))
        clauses.append(f"the data leave {len(open_names)} of {count} parameters open")
    return "; ".join(clauses) + "."


def graded(record: Record) -> Grade | None:
    """The grade of a fit; by its error alone where the record was put together without one.

    None without a fit.
    """
    if record.nrmse is None:
        return None
    return Grade(record.grade or (Grade.ROUGH if record.nrmse <= ROUGH else Grade.FAILS))


def work_of(record: Record) -> str:
    """The work that a fit took, in words; empty where nobody counted it."""
    evaluations = record.starts.get("evaluations")
    return "" if not evaluations else f"{evaluations:,} evaluations of the model"


def largest_share(record: Record) -> str:
    """Where most of the squared error lies, as a clause; "" where that is unknown."""
    shares = {band: share for band, share in record.share_by_band.items() if share is not None}
    if not shares:
        return ""
    band = max(shares, key=lambda name: shares[name])
    return (
        f"{percent(shares[band])} of the squared error lies {BANDS_HZ.get(band, f'in {band} Hz')}"
    )


def invisible(record: Record) -> list[str]:
    """Names of parameters without an interval at some operating point."""
    found = [
        name for one in record.intervals.values() for name, ends in one.items() if ends is None
    ]
    return list(dict.fromkeys(found))


def stability(record: Record) -> str:
    """Whether the model is stable, with a word on poles that are practically integrators; "unknown"
    without a fit.
    """
    if not record.stable:
        return "unknown"
    lost = unstable_points(record)
    if lost:
        return f"unstable at {', '.join(lost)}"
    edge = [name for name, poles in record.poles.items() if slowest(poles) > NEARLY_INTEGRATING]
    if edge:
        return (
            "stable, with a pole at zero for practical purposes (an integrator that the data do "
            "not need)"
        )
    return "stable at every operating point"
