"""The archive: lineages, ranks, migration, eviction; what other search frameworks get wrong does
not happen here.
"""

from collections import Counter
from dataclasses import replace

import numpy as np
import pytest
from collecting import each_of
from ibrid_search.archives.archive import Archive, Entry
from ibrid_search.settings import SearchSettings

from ibrid.errors import IbridError

SMALL = SearchSettings(population=60, islands=5, elites=8, sweep=40, front=0.0, variety=0.0)


def entry(step: int, reward: float = 0.0, island: int = 0, **changes) -> Entry:
    one = Entry(
        step=step,
        hash=f"structure {step}",
        parent=0,
        island=island,
        reward=reward,
        nrmse=float(np.exp(-reward)),
        order=4,
        free=6,
        stable=True,
        program=f"program {step}",
    )
    return replace(one, **changes)


START = entry(0, reward=-1.0, parent=None)


def started(settings: SearchSettings = SMALL, start: Entry = START) -> Archive:
    archive = Archive(settings)
    assert archive.admit_start(start)
    return archive


def grown(settings: SearchSettings, number: int, seed: int = 0) -> tuple[Archive, list[Entry]]:
    """An archive after proposals 1 to `number`, and the children in order."""
    archive, rng, children = started(settings), np.random.default_rng(seed), []
    for step in range(1, number + 1):
        parent, island = archive.sample(rng, step)
        reward = parent.reward + rng.normal()
        simple = {
            "order": int(rng.integers(20)),
            "free": int(rng.integers(20)),
            "stable": bool(rng.random() < 0.8),
        }
        children.append(entry(step, reward, island, parent=parent.step, **simple))
        archive.admit(children[-1])
    return archive, children


def seen(archive: Archive, settings: SearchSettings) -> list[set[int]]:
    """Steps that each island sees."""
    return [{one.step for one in archive.island(number)} for number in range(settings.islands)]


# lineages


def test_with_migration_off_lineages_never_cross():
    settings = replace(SMALL, migrants=0.0, population=2000)
    archive, children = grown(settings, 1500)
    home = {one.step: one.island for one in children}
    assert all(one.parent == 0 or home[one.parent] == one.island for one in children)
    assert {one.island for one in archive.elites} <= set(range(settings.islands))
    assert archive.statistics().guests == (0,) * settings.islands


def test_the_child_of_the_start_is_native_on_the_active_island():
    archive, rng = started(), np.random.default_rng(0)
    assert [archive.sample(rng, number)[1] for number in range(12)] == [
        0,
        1,
        2,
        3,
        4,
        0,
        1,
        2,
        3,
        4,
        0,
        1,
    ]


def test_thirty_two_proposals_are_spread_over_all_islands():
    archive, rng = started(SearchSettings()), np.random.default_rng(0)
    islands = Counter(archive.sample(rng, number)[1] for number in range(1, 33))
    assert sorted(islands) == list(range(10))
    assert set(islands.values()) <= {3, 4}


def test_the_child_of_an_elite_stays_on_the_elites_island():
    archive, rng = (
        started(replace(SMALL, from_elites=1.0, from_island=0.0, elites=1)),
        np.random.default_rng(0),
    )
    archive.admit(entry(1, 5.0, island=3))
    assert {archive.sample(rng, number)[1] for number in range(20)} == {3}


@pytest.mark.parametrize(
    ("share", "island"), [({"from_elites": 0.0, "from_island": 1.0}, 2), ({"from_elites": 1.0}, 1)]
)
def test_the_child_of_a_migrant_stays_where_its_parent_was_drawn(share, island):
    settings = replace(SMALL, from_island=0.0, sweep=1, elites=1)
    archive, rng = started(replace(settings, **share)), np.random.default_rng(0)
    archive.admit(entry(1, 5.0, island=1))
    drawn = [archive.sample(rng, 2) for _ in range(200)]
    assert {home for parent, home in drawn if parent.step == 1} == {island}


# one entry per structure, valid ones only


def test_a_known_structure_changes_nothing():
    archive = started()
    archive.admit(entry(1, 1.0))
    before = archive.entries
    assert not archive.admit(entry(2, 3.0, hash="structure 1"))
    assert not archive.admit(entry(3, hash=START.hash))
    assert not archive.admit_start(entry(4, hash="structure 1"))
    assert archive.entries == before
    assert archive.statistics().repeated == 3


@pytest.mark.parametrize("reward", [np.nan, np.inf, -np.inf])
def test_an_entry_without_a_finite_reward_is_not_admitted(reward):
    archive = started()
    assert not archive.admit(entry(1, reward))
    assert len(archive) == 1
    assert archive.admit(entry(1, 0.5))  # its structure is not taken by the failure


def test_an_unstable_entry_is_kept_but_is_no_elite_no_migrant_and_not_the_best():
    archive = started(replace(SMALL, sweep=1))
    archive.admit(entry(1, 9.0, stable=False))
    archive.admit(entry(2, 1.0))
    assert [one.step for one in archive.entries] == [1, 2, 0]
    assert [one.step for one in archive.elites] == [2, 0]
    assert archive.best == entry(2, 1.0)
    assert all(1 not in steps for steps in seen(archive, SMALL))


def test_an_unstable_entry_is_a_parent_only_in_a_draw_from_everything():
    for from_island, expected in ((0.4, {0}), (0.0, {0, 1})):
        archive, rng = started(replace(SMALL, from_island=from_island)), np.random.default_rng(0)
        archive.admit(entry(1, 9.0, stable=False))
        assert {archive.sample(rng, number)[0].step for number in range(100)} == expected


def test_an_unstable_start_is_drawn_until_there_is_something_stable():
    unstable = replace(START, stable=False)
    archive, rng = started(start=unstable), np.random.default_rng(0)
    assert archive.best is None
    assert archive.sample(rng, 3) == (unstable, 3)
    archive.admit(entry(1, -5.0, island=2))
    drawn = Counter(archive.sample(rng, 0)[0].step for _ in range(1000))
    assert (
        850 <= drawn[1] <= 950
    )  # 0.8 for elites and empty island 0, half of 0.2; four standard deviations are 38


def test_an_empty_archive_has_no_parent_and_says_what_to_do():
    with pytest.raises(IbridError, match="admit the start first"):
        Archive(SMALL).sample(np.random.default_rng(0), 1)


# parents


@pytest.mark.slow
def test_pools_are_drawn_with_their_shares():
    archive, rng = started(replace(SMALL, elites=1)), np.random.default_rng(1)
    archive.admit(entry(1, 5.0, island=1))  # the elite
    for step in range(2, 30):
        archive.admit(entry(step, step / 10, island=2))
    drawn = Counter(archive.sample(rng, 0)[0].step for _ in range(10_000))
    each = 0.2 / 30  # of everything; island 0 sees the start alone
    assert drawn[1] / 10_000 == pytest.approx(0.6 + each, abs=0.02)  # four standard deviations
    assert drawn[0] / 10_000 == pytest.approx(0.2 + each, abs=0.016)


@pytest.mark.slow
@pytest.mark.parametrize("power", [0.0, 1.0, 2.0])
def test_elites_are_drawn_by_a_power_of_their_rank(power):
    settings = replace(SMALL, from_elites=1.0, from_island=0.0, rank_power=power, crowding=np.inf)
    archive, rng = started(settings), np.random.default_rng(2)
    for step in range(1, 20):
        archive.admit(entry(step, -float(step), island=step % 5))
    drawn = Counter(archive.sample(rng, number)[0].step for number in range(20_000))
    expected = np.arange(1, settings.elites + 1) ** -power
    found = [drawn[one.step] / 20_000 for one in archive.elites]
    np.testing.assert_allclose(
        found, expected / expected.sum(), atol=0.015
    )  # four standard deviations


@pytest.mark.slow
def test_a_parent_with_many_children_is_drawn_less_often():
    settings = replace(
        SMALL, from_elites=1.0, from_island=0.0, rank_power=0.0, crowding=10.0, elites=2
    )
    archive, rng = started(settings), np.random.default_rng(3)
    archive.admit(entry(1, 9.0))
    archive.admit(entry(2, 8.0))
    for step in range(3, 33):  # thirty children of the first: a quarter of its weight is left
        archive.admit(replace(entry(step, -float(step)), parent=1))
        archive.admit(
            replace(entry(step + 100, 7.0), parent=2, hash=f"structure {step}")
        )  # known, so no child
    drawn = Counter(archive.sample(rng, number)[0].step for number in range(20_000))
    assert drawn[1] / 20_000 == pytest.approx(
        0.2, abs=0.012
    )  # 1/4 against 1; four standard deviations


@pytest.mark.slow
def test_draws_along_the_front_reach_the_simple_and_the_good():
    settings = replace(
        SMALL, from_elites=1.0, from_island=0.0, front=1.0, front_size=3, crowding=np.inf
    )
    archive, rng = started(settings, replace(START, reward=-9.0, free=9)), np.random.default_rng(4)
    for step, reward, free in (
        (1, 1.0, 3),
        (2, 2.0, 5),
        (3, 1.5, 6),
        (4, 3.0, 8),
        (5, 0.5, 2),
        (6, 3.0, 9),
    ):
        archive.admit(entry(step, reward, free=free))
    assert [one.step for one in archive.front] == [
        1,
        2,
        4,
    ]  # 3 and 6 are beaten by simpler ones, 5 is the fourth
    drawn = Counter(archive.sample(rng, number)[0].step for number in range(9_000))
    assert drawn.keys() == {1, 2, 4}
    assert all(count / 9_000 == pytest.approx(1 / 3, abs=0.02) for count in drawn.values())


def test_the_best_of_a_sort_of_control_is_not_evicted_while_there_is_room_for_it():
    settings = SearchSettings(population=13, islands=2, elites=4, sweep=40, front=0.0)
    archive = started(settings, replace(START, reward=-9.0, sort="nothing"))
    archive.admit(entry(1, -5.0, sort="power"))
    archive.admit(entry(2, -4.0, sort="power"))
    for step in range(3, 30):
        archive.admit(entry(step, float(step), island=step % 2, sort="phase"))
    assert len(archive) == 13
    assert [one.step for one in archive.entries if one.sort == "power"] == [2]


def test_an_archive_too_small_for_all_that_should_be_kept_drops_the_lowest():
    archive = started(
        SearchSettings(population=4, islands=1, elites=2, sweep=40), replace(START, reward=-9.0)
    )
    for step in range(1, 9):
        archive.admit(entry(step, float(step), sort=f"sort {step}", free=20 - step))
    assert [one.step for one in archive.entries] == [8, 7, 6, 0]


@pytest.mark.slow
def test_with_variety_each_sort_of_control_is_drawn_as_one_over_its_least_error():
    settings = replace(
        SMALL, from_elites=1.0, from_island=0.0, variety=1.0, rank_power=50.0, crowding=np.inf
    )
    archive, rng = (
        started(settings, replace(START, reward=np.log(1 / 0.9), nrmse=0.9)),
        np.random.default_rng(6),
    )
    for step, error, sort in (
        (1, 0.1, "phase"),
        (2, 0.2, "phase"),
        (3, 0.4, "power"),
        (4, 0.5, "power"),
    ):
        archive.admit(entry(step, -np.log(error), sort=sort))
    drawn = Counter(archive.sample(rng, number)[0].step for number in range(9_000))
    total = 1 / 0.1 + 1 / 0.4 + 1 / 0.9
    for step, error in (
        (1, 0.1),
        (3, 0.4),
        (0, 0.9),
    ):  # the best of each sort; four standard deviations are 0.02
        assert drawn[step] / 9_000 == pytest.approx(1 / error / total, abs=0.02)
    assert set(drawn) == {0, 1, 3}


@pytest.mark.parametrize(
    "change", [lambda reward: 1024 * reward, lambda reward: reward - 64, np.arctan]
)
def test_selection_sees_the_order_of_rewards_only(change):
    _, children = grown(SMALL, 150)
    plain, changed = started(), started(start=replace(START, reward=change(START.reward)))
    for one in children:
        assert plain.admit(one) == changed.admit(replace(one, reward=change(one.reward)))
    first, second = np.random.default_rng(5), np.random.default_rng(5)
    for number in range(200):
        parent, island = plain.sample(first, number)
        assert changed.sample(second, number) == (
            replace(parent, reward=change(parent.reward)),
            island,
        )


def test_the_same_admissions_in_the_same_order_give_the_same_archive():
    archive, children = grown(SMALL, 400)
    again = started()
    for one in children:
        again.admit(one)
    assert again.statistics() == archive.statistics()
    assert (again.entries, again.elites) == (archive.entries, archive.elites)
    assert seen(again, SMALL) == seen(archive, SMALL)
    rngs = np.random.default_rng(7), np.random.default_rng(7)
    assert all(
        archive.sample(rngs[0], number) == again.sample(rngs[1], number) for number in range(100)
    )


# migration


def test_the_best_tenth_of_an_island_becomes_visible_to_both_neighbours_once_per_sweep():
    settings = replace(SMALL, population=500, sweep=100)
    archive = started(settings)
    for step in range(1, 100):
        archive.admit(entry(step, step, island=step % 5))
    assert archive.statistics().migrations == 0
    archive.admit(entry(100, 100.0, island=0))
    assert archive.statistics().migrations == 1
    assert archive.statistics().guests == (4,) * 5  # two of 20 from either side
    visible = seen(archive, settings)
    for island in range(5):
        best = {
            max(step for step in range(1, 101) if step % 5 == island) - 5 * place
            for place in range(2)
        }
        assert {number for number in range(5) if best <= visible[number]} == {
            (island - 1) % 5,
            island,
            (island + 1) % 5,
        }
    assert len(archive) == 101


def test_a_migrant_never_migrates_on():
    settings = replace(SMALL, population=1000, sweep=5)
    archive, children = grown(settings, 600)
    assert archive.statistics().migrations >= 100
    home = {one.step: one.island for one in children}
    for island, steps in enumerate(seen(archive, settings)):
        assert all((home[step] - island) % 5 in (0, 1, 4) for step in steps if step)


@pytest.mark.parametrize(("islands", "guests"), [(1, (0,)), (2, (1, 1))])
def test_small_rings_show_nothing_twice(islands, guests):
    archive = started(replace(SMALL, islands=islands, sweep=4))
    for step in range(1, 5):
        archive.admit(entry(step, step, island=step % islands))
    assert archive.statistics().guests == guests


def test_an_island_sees_no_more_than_its_part_of_the_population_and_always_its_own_best():
    settings = replace(SMALL, sweep=10, migrants=1.0)
    archive, room = started(settings), settings.population // settings.islands
    for step in range(1, 61):  # island 2 is worse than all it is shown
        archive.admit(entry(step, -50.0 - step if step % 5 == 2 else float(step), island=step % 5))
        visible = seen(archive, settings)
        assert max(len(steps) for steps in visible) <= room
        assert step < 2 or 2 in visible[2]
    assert archive.statistics().migrations == 6
    assert {len(steps) for steps in visible} == {room}


# eviction


def test_the_lowest_reward_goes_first_and_of_equal_ones_the_least_simple():
    settings = SearchSettings(population=13, islands=2, elites=1, sweep=1000, front=0.0)
    archive = started(settings)
    archive.admit(entry(1, 9.0, island=0))
    archive.admit(entry(2, 1.0, island=1))
    crowd = [(3, 0.5, 6, 4), (4, 0.5, 7, 4), (5, 0.5, 6, 5), (6, 0.4, 1, 1), (7, 0.6, 9, 9)]
    for step, reward, free, order in crowd:
        archive.admit(entry(step, reward, free=free, order=order, island=0))
    for step in range(20, 25):
        archive.admit(entry(step, 2.0))
    assert len(archive) == 13
    gone = []
    for step in range(30, 34):
        before = {one.step for one in archive.entries}
        archive.admit(entry(step, 3.0))
        gone += before - {one.step for one in archive.entries}
    assert gone == [6, 4, 5, 3]


def test_no_elite_no_islands_best_and_no_start_is_ever_evicted():
    archive, rng = started(), np.random.default_rng(0)
    best = [entry(1 + island, -100.0 - island, island=island) for island in range(4)]
    for one in best:  # island 4 gets everything else
        archive.admit(one)
    rewards = [float(reward) for reward in rng.normal(size=300)]
    for step, reward in enumerate(rewards, start=10):
        archive.admit(entry(step, reward, island=4))
    assert len(archive) == SMALL.population
    assert {START, *best} <= set(archive.entries)
    assert [one.reward for one in archive.elites] == sorted(rewards, reverse=True)[: SMALL.elites]


def test_elites_stay_when_everything_else_is_unstable_and_better():
    archive = started()
    elites = [entry(step, -float(step), island=step % 5) for step in range(1, SMALL.elites)]
    for one in elites:
        archive.admit(one)
    for step in range(100, 200):
        archive.admit(entry(step, float(step), stable=False))
    assert len(archive) == SMALL.population
    assert set(archive.elites) == {START, *elites}


def test_the_worst_entry_of_a_full_archive_is_refused_and_an_evicted_one_does_not_return():
    archive = started()
    children = [entry(step, float(step), island=0) for step in range(1, 100)]
    for one in children:
        archive.admit(one)
    assert children[0] not in archive.entries
    assert not archive.admit(replace(children[0], reward=1e6))
    assert not archive.admit(entry(200, -10.0))
    assert archive.statistics().admitted == 99


def test_no_island_sees_an_entry_that_was_evicted():
    settings = replace(SMALL, sweep=7, migrants=1.0)
    archive, _ = grown(settings, 800)
    kept = {one.step for one in archive.entries}
    assert archive.statistics().evicted > 100
    assert all(steps <= kept for steps in seen(archive, settings))
    guests = [
        sum(one.step > 0 and one.island != number for one in archive.island(number))
        for number in range(5)
    ]
    assert archive.statistics().guests == tuple(guests)


# twenty steps of 512 children, the measurement on which another framework failed


@pytest.mark.slow
@pytest.mark.parametrize("population", [10_000, 2_000])
def test_a_long_run_of_batches_shows_none_of_the_known_pathologies(population):
    settings = SearchSettings(population=population)
    archive, rng = started(settings), np.random.default_rng(11)
    home: dict[int, int] = {}
    drawn, admitted, crossed = [], 0, 0
    for batch in range(20):
        questions = [archive.sample(rng, 512 * batch + number) for number in range(512)]
        for number, (parent, island) in enumerate(questions):
            drawn.append(parent)
            step = 1 + 512 * batch + number
            kind = rng.choice(4, p=[0.15, 0.15, 0.15, 0.55])
            if kind == 0:  # no edit: nothing to admit
                continue
            child = entry(
                step, float(rng.normal()), island, parent=parent.step, order=int(rng.integers(30))
            )
            child = (
                replace(child, hash=parent.hash)
                if kind == 1
                else replace(child, reward=np.nan)
                if kind == 2
                else child
            )
            if archive.admit(child):
                admitted += 1
                home[step] = island
                if home.get(parent.step, island) != island:
                    crossed += 1
                    assert (home[parent.step] - island) % 10 in (1, 9)
    counts = archive.statistics()
    # an entry is a structure: no copies, no copies of copies; the cap is filled with different ones
    assert (
        len({one.hash for one in archive.entries}) == len(archive) == min(admitted + 1, population)
    )
    # children are elsewhere than their parents only where a guest was drawn, a small part of the
    # 0.2 island draws
    assert 0 < crossed < 0.12 * admitted
    # migrations follow admissions
    assert counts.migrations == counts.admitted // 1000 == admitted // 1000
    # guests are elites too
    guests = {
        one
        for number in range(10)
        for one in archive.island(number)
        if one.step and one.island != number
    }
    assert guests & set(archive.elites)
    # no failure is kept, an elite or a parent
    assert all(np.isfinite(one.reward) and one.program for one in [*archive.entries, *drawn])
    assert len(set(archive.elites)) == 200
    assert sum(counts.natives) + 1 == len(archive)


# settings


@each_of(
    ("change", "law"),
    [
        ({"islands": 0}, "islands must be 1 or more"),
        ({"elites": 0}, "elites must be 1 or more"),
        ({"sweep": 0}, "sweep must be 1 or more"),
        ({"migrants": 1.5}, "migrants must be a share"),
        ({"from_elites": -0.1}, "from_elites must be a share"),
        ({"from_island": np.nan}, "from_island must be a share"),
        ({"from_elites": 0.9}, "must not exceed 1 together"),
        ({"variety": 1.5}, "variety must be a share"),
        ({"front": -0.5}, "front must be a share"),
        ({"front_size": 0}, "front_size must be 1 or more"),
        ({"crowding": 0.0}, "crowding must be above 0"),
        ({"rank_power": -1.0}, "rank_power must be finite"),
        ({"population": 13}, "population must exceed elites plus islands"),
    ],
)
def test_settings_that_cannot_hold_are_refused_in_a_sentence(change, law):
    with pytest.raises(IbridError, match=law):
        Archive(replace(SMALL, **change))


@pytest.mark.parametrize("island", [-1, 5])
def test_an_entry_of_an_island_that_does_not_exist_is_refused(island):
    with pytest.raises(IbridError, match="island must be 0 to 4"):
        started().admit(entry(1, island=island))
