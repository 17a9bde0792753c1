"""The numbers of the screening of structural edits, with their units and where they come from."""

from dataclasses import dataclass

from ibrid.gap.recordings.successive_halving import HalvingRung


@dataclass(frozen=True)
class ScreeningSettings:
    """Numbers of the screening fits, of the ranking of edits and of the selection criterion.

    Counts unless a unit is given. Errors are relative (NRMSE, or residual over noise times the
    relative noise level); gains are differences of ln(error). Values without a source are choices
    of this project.

    Data
        `max_operating_points`, `max_frequencies` : used by a screening fit at most, evenly chosen;
        a full fit uses all.
    Starts from the values of the parent
        `completion_draws` : samples of the parameters that the parent lacks. `parent_descents` :
        of these starts, those descended on the final error. `error_steps` : iterations of each.
    Starts from the textbook ranges, so that the parent's local minimum can be left
        `global_draws` : samples of all parameters. `log_descents` : the best of them, descended on
        ln(Y / data). `log_steps` : iterations of each. `polished_starts` : of all ends, those
        descended on the final error.
    Diagrams without known values (library, programs of an agent)
        `library_draws` : samples of all parameters. `library_descents` : descended on ln(Y / data).
        `library_error_steps` : iterations on the final error. `events_factor` : factor on both
        counts for recorded events, whose one direction of Y leaves more local minima.
    Score
        `uncommon_edit_cost` : equivalent free parameters added for a block or wire that no
        catalogue suggests. `implausibility_cost` : equivalent free parameters of one plausibility
        issue. `tie_cost` : ln(error) that a free parameter costs where the noise is unknown; breaks
        ties only.
    Errors with a meaning
        `exact_error` : an error up to this counts as exact (rounding of a converged fit).
        `doubtful_error` : an error below this is not credited to a diagram with absurd plant
        values, which absorb a missing effect. `gross_error`, `gross_noise_ratio` : an error above
        the first, and above that multiple of the noise level, means another structure rather than a
        detail. `exact_screening_error` : screening error up to which a full fit may be exact.
        `absurd_factor` : ratio to its typical value beyond which a plant parameter is absurd.
    Order of the stages (effects, other edits, pairs and exchanges, blocks and wires anywhere)
        `promising_gain` : ln(error) gained, parameters paid for, from which later stages are
        skipped. `layer_gain` : the same for a missing control layer. `single_edit_stages` : stages
        that a short ranking is limited to. `pair_seeds` : single edits that pairs are built on.
        `polished_pairs` : pairs that get a complete screening fit. `reported_ports` : locations of
        an unknown transfer function that are reported. `explained_share` : of chi2 per degree of
        freedom that such a transfer function may leave.
    Recorded events
        `event_library_entrants`, `event_edit_entrants` : candidates that enter successive halving
        (Jamieson & Talwalkar, AISTATS 2016). `rungs` : its rungs. `event_error_ratio` : library
        diagrams with an error above this multiple of the least are not started from, since a full
        fit to recordings takes a minute.
    Memory
        `cached_fits`, `cached_edit_lists` : kept at most, then forgotten.
    """

    max_operating_points: int = 3
    max_frequencies: int = 32

    completion_draws: int = 8
    parent_descents: int = 3
    error_steps: int = 16

    global_draws: int = 64
    log_descents: int = 6
    log_steps: int = 16
    polished_starts: int = 3

    library_draws: int = 96
    library_descents: int = 8
    library_error_steps: int = 24
    events_factor: int = 4

    uncommon_edit_cost: int = 2
    implausibility_cost: int = 2
    tie_cost: float = 1e-3

    exact_error: float = 1e-6
    doubtful_error: float = 1e-3
    gross_error: float = 0.03
    gross_noise_ratio: float = 2.0
    exact_screening_error: float = 1e-5
    absurd_factor: float = 30.0

    promising_gain: float = 0.7
    layer_gain: float = 0.2
    single_edit_stages: int = 2
    pair_seeds: int = 3
    polished_pairs: int = 16
    reported_ports: int = 3
    explained_share: float = 0.25

    event_library_entrants: int = 16
    event_edit_entrants: int = 24
    rungs: tuple[HalvingRung, ...] = (
        HalvingRung(rounds=1, steps=4, survivors=24),
        HalvingRung(rounds=3, steps=2, survivors=8),
    )
    event_error_ratio: float = 5.0

    cached_fits: int = 20_000
    cached_edit_lists: int = 400


#: The settings in use.
SCREENING = ScreeningSettings()
