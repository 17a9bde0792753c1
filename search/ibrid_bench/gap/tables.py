"""The results as tables of 100 columns: naming, refusals, costs, each effect, confusions, and every
miss with its trial.
"""

from collections import Counter
from collections.abc import Iterable, Iterator, Sequence
from statistics import mean, median
from textwrap import wrap

from ibrid_bench.gap.detection import LIMIT, REMOVAL_LIMIT, STARTS
from ibrid_bench.gap.held_out import MOST
from ibrid_bench.gap.misses import Row, confusions, hidden, miss, said
from ibrid_bench.gap.scoring import FAILED
from ibrid_bench.gap.several import GROUPS, group_of
from ibrid_bench.gap.share import Share

WIDTH = 100
_MAIN = {"frequencies": 16, "points": 2}


def trial_line(row: Row, done: int, of: int) -> str:
    """One trial when it is there: x marks a miss."""
    mark = "x" if miss(row) else " "
    return f"{done:3d}/{of} {mark} {row['seconds']:5.1f} s  {row['key']}  {said(row)}"


def report(rows: Sequence[Row]) -> Iterator[str]:
    """All tables."""
    yield from _intro(rows)
    stated = [row for row in rows if row.get("stated", True)]
    yield from _naming(stated)
    yield from _other_kinds(stated)
    yield from _unstated([row for row in rows if not row.get("stated", True)])
    yield from _costs(rows)
    yield from _by_effect(rows)
    yield from _below(rows)
    yield from _confused(rows)
    yield from _missed(rows)


def _intro(rows: Sequence[Row]) -> Iterator[str]:
    yield from wrap(
        f"{len(rows)} hidden cases. Shares with Wilson's 95 % interval in percent. An effect is "
        "above the detection limit when "
        f"the best of {STARTS} refits of the model without it costs {LIMIT:g} more than the truth: "
        "chi2 of the response without "
        "noise, weighed by the noise (clean data: 1e-4 of |Y|), and prior of the nominal values. "
        "For a block to be removed the "
        f"prior's part is enough from {REMOVAL_LIMIT:g} on, three standard deviations of its "
        "nominal value.",
        WIDTH,
    )


def _title(text: str) -> Iterator[str]:
    yield from ("", text, "-" * len(text))


def _naming(rows: Sequence[Row]) -> Iterator[str]:
    single = [row for row in rows if row["kind"] == "effect" and row["named_first"] is not None]
    main = [row for row in single if all(row[name] == value for name, value in _MAIN.items())]
    groups = [
        *(
            (name, [row for row in main if row["data"] == name])
            for name in ("clean", "60dB", "40dB")
        ),
        ("all three", main),
        ("20dB, any", [row for row in single if row["data"] == "20dB"]),
        ("60 freq.", [row for row in single if row["frequencies"] == 60]),
        ("1 point", [row for row in single if row["points"] == 1]),
        ("4 points", [row for row in single if row["points"] == 4]),
    ]
    yield from _title(
        "One hidden effect above the detection limit; clean, 60 and 40 dB: 16 frequencies, 2 points"
    )
    yield _wide("", "above", "verdict right", "named first", "in its class", "held out", "size")
    yield _wide("wanted", "", "", "90%", "98%", f"90% <= {MOST:g} floors", "2")
    for name, group in groups:
        seen = [row for row in group if row["above"]]
        sizes = [row["class_size"] for row in seen if row["class_size"]]
        yield _wide(
            name,
            f"{len(seen)}/{len(group)}",
            *(
                str(Share.of(row[column] for row in seen))
                for column in ("right_verdict", "named_first", "inside_class")
            ),
            str(_held_out(seen)),
            f"{mean(sizes):.1f}" if sizes else "-",
        )


def _wide(name: str, above: str, *cells: str) -> str:
    *shares, size = cells
    return f"{name:9}{above:>6}" + "".join(f"{cell:>20}" for cell in shares) + f"{size:>5}"


def _held_out(rows: Iterable[Row]) -> Share:
    return Share.of(
        row["holdout"] is not None and row["holdout"] <= MOST
        for row in rows
        if row["verdict"] == "named"
    )


def _other_kinds(rows: Sequence[Row]) -> Iterator[str]:
    of = {
        kind: [row for row in rows if row["kind"] == kind and not group_of(row["effects"])]
        for kind in {row["kind"] for row in rows}
    }

    def share(kind: str, column: str, *, above: bool = False) -> str:
        return str(Share.of(row[column] for row in of.get(kind, ()) if row["above"] or not above))

    absorbed = [row for row in of.get("effect", ()) if row["named_first"] is None]
    yield from _title("Everything else")
    lines = (
        ("nothing hidden: false alarm", share("nothing", "false_alarm"), "<= 3%"),
        ("nothing hidden: verdict right", share("nothing", "right_verdict"), ""),
        ("only parameters wrong: false alarm", share("parameters", "false_alarm"), "<= 3%"),
        ("only parameters wrong: verdict right", share("parameters", "right_verdict"), ""),
        ("not in the catalogue: a wrong name", share("foreign", "false_name"), "<= 3%"),
        (
            "not in the catalogue, above the limit: verdict right",
            share("foreign", "right_verdict", above=True),
            "",
        ),
        (
            "two effects, both above the limit: both named",
            share("pair", "all_named", above=True),
            ">= 80%",
        ),
        (
            "two effects, both above the limit: first one right",
            share("pair", "named_first", above=True),
            "",
        ),
        *(
            (f"{name}, all above the limit: all named", _all_named(rows, name), ">= 80%")
            for name in GROUPS
        ),
        (
            "wrong convention, above the limit: verdict right",
            share("convention", "right_verdict", above=True),
            "",
        ),
        ("sigma stated too small: verdict right", share("wrong-noise", "right_verdict"), ""),
        (
            "effect that parameters absorb: verdict right",
            str(Share.of(row["right_verdict"] for row in absorbed)),
            "",
        ),
        (
            "any: more effects named than hidden",
            str(Share.of(bool(row["extra"]) for row in _with(rows, "extra"))),
            "",
        ),
        ("any: no answer at all", str(Share.of(row["verdict"] == FAILED for row in rows)), "none"),
    )
    for what, found, wanted in lines:
        yield f"{what:52} {found:>22}   {wanted}".rstrip()


def _all_named(rows: Sequence[Row], group: str) -> str:
    return str(
        Share.of(
            row["all_named"] for row in rows if row["above"] and group_of(row["effects"]) == group
        )
    )


def _unstated(rows: Sequence[Row]) -> Iterator[str]:
    if not rows:
        return
    yield from _title("Noise of 60 or 40 dB that the file does not state; 16 frequencies, 2 points")
    seen = [row for row in rows if row["kind"] == "effect" and row["above"]]
    for what, found, wanted in (
        (
            "nothing hidden: false alarm",
            Share.of(row["false_alarm"] for row in rows if row["kind"] == "nothing"),
            "<= 3%",
        ),
        (
            "one effect above the limit: named first",
            Share.of(row["named_first"] for row in seen),
            "",
        ),
        (
            "one effect above the limit: no other name",
            Share.of(not row["answer"] or row["inside_class"] for row in seen),
            "",
        ),
    ):
        yield f"{what:52} {found!s:>22}   {wanted}".rstrip()


def _with(rows: Iterable[Row], column: str) -> list[Row]:
    return [row for row in rows if row[column] is not None]


def _costs(rows: Sequence[Row]) -> Iterator[str]:
    yield from _title("Intervals, held-out error, time")
    for data, group in (
        ("noisy", [row for row in rows if row["noise_db"]]),
        ("clean", [row for row in rows if not row["noise_db"]]),
    ):
        inside, number, left_open = (sum(row["covered"][k] for row in group) for k in range(3))
        wanted = "90-98%" if data == "noisy" else "no target"
        yield (
            f"{data} data: true values within 95 % intervals {Share(inside, number)}   ({wanted}); "
            f"no interval: {left_open}"
        )
    ratios = [row["holdout"] for row in rows if row["holdout"] is not None and row["above"]]
    if ratios:
        yield (
            f"held-out error of repairs over the noise floor: median {median(ratios):.3g}, largest "
            f"{max(ratios):.3g}"
        )
    for frequencies, wanted in ((16, "<= 60 s"), (60, "no target; 90 s at 40")):
        spent = [row["seconds"] for row in rows if row["frequencies"] == frequencies]
        if spent:
            yield (
                f"{frequencies} frequencies: median {median(spent):.1f} s, longest "
                f"{max(spent):.1f} s a case   ({wanted})"
            )


def _by_effect(rows: Sequence[Row]) -> Iterator[str]:
    yield from _title("Each effect hidden alone")
    single = [row for row in rows if row["kind"] == "effect"]
    names = sorted({_id(row) for row in single})
    yield f"{'':33}{'above':>7}{'named first':>20}{'in its class':>20}{'verdict right':>20}"
    for name in names:
        group = [row for row in single if _id(row) == name]
        seen = [row for row in group if row["above"]]
        cells = [
            str(Share.of(row[column] for row in seen))
            for column in ("named_first", "inside_class", "right_verdict")
        ]
        yield f"{name:33}{f'{len(seen)}/{len(group)}':>7}" + "".join(
            f"{cell:>20}" for cell in cells
        )


def _id(row: Row) -> str:
    return row["hidden"][0].split(":")[0]


def _below(rows: Sequence[Row]) -> Iterator[str]:
    below = [row for row in rows if row["above"] is False]
    if not below:
        return
    yield from _title(f"Below the detection limit: {len(below)} cases")
    often = Counter(map(hidden, below))
    yield from wrap(", ".join(f"{name} {number}" for name, number in sorted(often.items())), WIDTH)
    yield (
        "no gap, or parameters only: "
        f"{sum(row['verdict'] in ('no-gap', 'parameters-only') for row in below)}"
    )
    yield f"in its class all the same:  {sum(row['inside_class'] is True for row in below)}"
    yield (
        "a wrong name:               "
        f"{sum(bool(miss(row)) and row['verdict'] != FAILED for row in below)}"
    )


def _confused(rows: Sequence[Row]) -> Iterator[str]:
    found = list(confusions(rows))
    if not found:
        return
    yield from _title("Hidden -> answered")
    for truth, answer, number in found:
        yield f"{number:3d}  {truth} -> {answer}"


def _missed(rows: Sequence[Row]) -> Iterator[str]:
    missed = [(row, words) for row in rows if (words := miss(row))]
    yield from _title(f"Misses: {len(missed)}" if missed else "No misses")
    if missed:
        yield (
            'make bench-gap ARGS="--keep --out out/one --only TRIAL" repeats one and keeps all its '
            "files."
        )
    for row, words in missed:
        yield row["key"]
        if row["kind"] == "pair":
            yield f"    hidden {' + '.join(row['hidden'])}"
        yield from wrap(words, WIDTH, initial_indent="    ", subsequent_indent="    ")
