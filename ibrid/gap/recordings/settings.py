"""The numbers of the screening of limits and edits on recordings, and where they come from."""

from dataclasses import dataclass

from ibrid.gap.recordings.successive_halving import HalvingRung


@dataclass(frozen=True)
class EventScreeningSettings:
    """Numbers of the successive halving over missing limits and over edits of the program.

    Counts unless stated otherwise. Factors and parts are ratios of costs (chi2 plus prior penalty).
    Values without a source are choices of this project. `*_effort` : rounds of a descent, and
    Levenberg-Marquardt steps in each.

    Limits
        `limit_starts_first_origin`, `limit_starts` : starts of a limit that are followed, about the
        first set of values for the rest of the model and about each other one. `most_grid_starts` :
        starts beyond which the last parameter of a limit is tried only near the best of the others,
        and `kept_grid_starts` of them. `limit_rungs` : rungs of the halving by prediction errors.
        `first_rung_cost`, `second_rung_cost` : part of the cost without a limit that the best must
        reach after the first two rungs, else no limit is missing. In sampled devices the right one
        left at most 0.5 and 0.07; where none was missing the best left 0.96 and 0.7.
        `hopeless_cost` : factor on the cost of the best from which another limit gets
        `brief_effort` only; the others get `beside_effort`. `inactive_change` : relative change of
        a cost below which a limit does not act. `repredicted_limits` : kinds of limits whose best
        is led by predictions once more.
    Edits of the program
        `edits_by_event`, `edits_by_sweep` : edits that enter the halving, by screening on one
        record and on the sweep; `edit_entrants` of them by prediction errors.
        `edits_from_nominal` : further entrants by screening from nominal values, where the fit has
        driven parameters far from them: of 56 edits of a grid-forming model the right one ranked
        44th from the fitted values and 1st from the nominal ones. `edit_rungs` : of the halving;
        the right edit was 5th at its end in one of 21 sampled devices, else first. `edit_fits` :
        entrants that are fitted in any case, `close_cost` : factor on the cost of the first up to
        which more are, where one explains the data.
    Acceptance where the voltage between samples dominates the noise
        `doubtful_cost` : part of its degrees of freedom that the cost of an adequate model may
        reach before it is doubted; right models of sampled devices left 0.002 at most.
        `explained_cost` : part of that which the right edit leaves. `rival_cost` : factor on the
        least cost of several candidates beyond which another one is no competitor; 2 for the right
        one at most, in three sampled devices. `clear_gain` : part of another cost that is clearly
        less.
    """

    limit_starts_first_origin: int = 2
    limit_starts: int = 1
    most_grid_starts: int = 100
    kept_grid_starts: int = 4
    limit_rungs: tuple[HalvingRung, ...] = (
        HalvingRung(1, 1, 24),
        HalvingRung(1, 3, 12),
        HalvingRung(3, 2, 6),
        HalvingRung(5, 2, 4),
    )
    first_rung_cost: float = 0.9
    second_rung_cost: float = 0.5
    hopeless_cost: float = 10.0
    inactive_change: float = 1e-9
    beside_effort: tuple[int, int] = (2, 3)
    brief_effort: tuple[int, int] = (1, 2)
    repredicted_limits: int = 3
    edits_by_event: int = 32
    edits_by_sweep: int = 8
    edit_entrants: int = 16
    edits_from_nominal: int = 8
    edit_rungs: tuple[HalvingRung, ...] = (
        HalvingRung(1, 3, 8),
        HalvingRung(3, 2, 6),
        HalvingRung(5, 2, 6),
    )
    edit_fits: int = 4
    close_cost: float = 2.0
    doubtful_cost: float = 0.03
    explained_cost: float = 0.1
    rival_cost: float = 6.0
    clear_gain: float = 0.5


SCREENING = EventScreeningSettings()
