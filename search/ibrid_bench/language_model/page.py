"""The page docs/language_model_results.md, made from the rows of the ledger."""

from collections.abc import Iterable, Mapping, Sequence

from ibrid_bench.gap.share import Share
from ibrid_bench.language_model.answering import LONGEST_FIELDS, SCHEMA, SETTINGS, STATES, WAYS, Row
from ibrid_bench.language_model.questions import BUDGET, INVERTERS, PLACES
from ibrid_bench.markdown import markdown_table
from ibrid_policy.learning.updates import mean_of_known
from ibrid_search.proposers.language_model import QUESTION_TOKENS, SLIPS
from ibrid_search.step import Status

#: What became of an answer, as columns: the ends of a proposal that each stands for.
ENDS: Mapping[str, tuple[Status, ...]] = {
    "valid": (Status.PENDING,),
    "known": (Status.UNCHANGED, Status.DUPLICATE),
    "implausible": (Status.IMPLAUSIBLE,),
    "illegal": (Status.UNREADABLE, Status.ILLEGAL),
    "no match": (Status.NO_MATCH, Status.AMBIGUOUS),
    "no edit": (Status.NO_EDIT,),
    "no answer": (Status.NO_ANSWER,),
}

_TOP = """# What a small language model can do

Made by `make bench-lm` from the rows of its ledger. A local model gets requests that occurred in
searches by rules, and its answers are judged as in a search:

- **valid**: a legal edit that leads to a new structure, which would be fitted
- **known**: a legal edit to the parent's structure, or to an earlier one of the search
- **implausible**: a legal diagram that a physical check refuses before it is fitted
- **illegal**: the edited text is no program, or violates the grammar of diagrams
- **no match**: a block whose SEARCH is not in the program, or there more than once
- **no edit**: text without a SEARCH/REPLACE block; **no answer**: nothing that can be read

Requests number {places} of searches of {budget} evaluations on {inverters}, in the paper's setting,
each in its shortest form ({question:,} tokens at most); {group} answers to each at temperature 1,
of {longest} tokens at most. **free**: any text. **constrained**: only tokens that continue an edit
of the program, with existing lines, kinds and ports, at most {lines} lines removed and {lines}
added (`--learn-constrained`). **schema**: a server on loopback gets the request of
`--proposer llm`, with data and diagnosis (an estimated {engineer:,} tokens at most), and holds its
answers to the JSON schema of an edit ({fields} tokens at most); an answer may take an edit of the
diagnosis by its number, and must after {slips} invalid edits of its own in a row. **different**:
texts among the answers to each request, added up. **cut**: answers that had not ended. Shares with
Wilson's 95 % interval in percent; answers to one request are alike, so the true interval is wider.
Seconds: of one core for an answer, including its share of reading the request.
"""
_LEARNING = """Between the two states the model proposed in a search of its own, constrained, and was
trained during it: `--learn` with a batch of one request and {group} answers, judged by screening
fits, and a step along the gradient. The search had another seed than those of the requests. Gain:
of an answer on its parent, mean, the penalty where it is invalid. Answers with nearly equal rewards
have a gradient near zero, and the batch teaches nothing.
"""


def page(rows: Iterable[Row]) -> str:
    """Markdown: a section for each model; what is missing says so."""
    kept = list(rows)
    text = _TOP.format(
        places=" and ".join(map(str, PLACES)),
        budget=BUDGET,
        inverters=", ".join(f"`{one}`" for one in INVERTERS),
        question=SETTINGS.question,
        group=SETTINGS.group,
        longest=SETTINGS.longest,
        lines=SETTINGS.lines,
        engineer=QUESTION_TOKENS["engineer"],
        fields=LONGEST_FIELDS,
        slips=SLIPS,
    )
    models = dict.fromkeys(row["model"] for row in kept)
    parts = [_section(name, [row for row in kept if row["model"] == name]) for name in models]
    return "\n".join([text, *parts]) if parts else f"{text}\nNothing is measured yet.\n"


def line(row: Row) -> str:
    """A row on the terminal."""
    if "updates" in row:
        made = sum(one["updated"] for one in row["updates"])
        return (
            f"learning: {made} of {len(row['updates'])} batches changed the weights, "
            f"{row['seconds']:.0f} s"
        )
    ends = ", ".join(one["status"] for one in row["answers"])
    return (
        f"{row['state']:<14} {row['way']:<11} {row['inverter']:<12} {row['place']:>3}  "
        f"{row['seconds']:>5.0f} s  {ends}"
    )


def _section(model: str, rows: Sequence[Row]) -> str:
    name, digest = model.split(" ")
    answers = [row for row in rows if "answers" in row]
    parts = [f"## {name}\n\nWeights: `{digest}`.\n", _verdict(answers), _table(answers)]
    if updates := [one for row in rows if "updates" in row for one in row["updates"]]:
        parts += ["### What it learnt\n", _LEARNING.format(group=SETTINGS.group), _updates(updates)]
    parts += ["### Every question\n", _questions(answers)]
    return "\n".join(parts)


def _groups(rows: Sequence[Row]) -> dict[tuple[str, str], list[Row]]:
    """(state, way) -> its rows, those that are there."""
    ways = (*WAYS, SCHEMA)
    found = {
        (state, way): [r for r in rows if (r["state"], r["way"]) == (state, way)]
        for state in STATES
        for way in ways
    }
    return {key: own for key, own in found.items() if own}


def _share(rows: Sequence[Row], end: str) -> Share:
    return Share.of(one["status"] in ENDS[end] for row in rows for one in row["answers"])


def _verdict(rows: Sequence[Row]) -> str:
    """What the shares of valid answers say, in sentences."""
    valid = {key: _share(own, "valid") for key, own in _groups(rows).items()}
    told = [
        f"- {state}, {way}: {share} of the answers are valid."
        for (state, way), share in valid.items()
    ]
    for way in WAYS:
        pair = [valid[state, way] for state in STATES if (state, way) in valid]
        if len(pair) == len(STATES):
            before, after = pair
            apart = before.interval[1] < after.interval[0] or after.interval[1] < before.interval[0]
            told.append(
                f"- Learning, {way}: from {before.hits} to {after.hits} of {after.number}; "
                + ("the intervals lie apart." if apart else "no difference is shown.")
            )
    return "\n".join(told) + "\n"


def _table(rows: Sequence[Row]) -> str:
    lines = []
    for (state, way), own in _groups(rows).items():
        answers = [one for row in own for one in row["answers"]]
        cut = Share.of(one["cut"] for one in answers)
        different = sum(len({one["reply"] for one in row["answers"]}) for row in own)
        tokens = sum(one["tokens"] for one in answers) / len(answers)
        seconds = sum(row["seconds"] for row in own) / len(answers)
        shares = [str(_share(own, end)) for end in ENDS]
        lines.append(
            [
                state,
                way,
                str(len(answers)),
                *shares,
                f"{different}",
                str(cut),
                f"{tokens:.0f}",
                f"{seconds:.0f}",
            ]
        )
    return markdown_table(
        ["state", "answers are", "number", *ENDS, "different", "cut", "tokens", "seconds"], lines
    )


def _updates(updates: Sequence[Mapping]) -> str:
    names = ("reward", "valid", "gain", "entropy", "divergence", "gradient", "drift")
    lines = [
        [
            str(one["number"]),
            "yes" if one["updated"] else "no",
            *(_number(one[name]) for name in names),
        ]
        for one in updates
    ]
    lines.append(
        ["mean", "", *(_number(mean_of_known(one[name] for one in updates)) for name in names)]
    )
    return markdown_table(["batch", "weights changed", *names], lines)


def _questions(rows: Sequence[Row]) -> str:
    lines = []
    for row in rows:
        ends = ", ".join(
            one["status"] if one["status"] != Status.PENDING else "valid" for one in row["answers"]
        )
        lines.append(
            [
                row["state"],
                row["way"],
                f"`{row['inverter']}`",
                str(row["place"]),
                f"{row['parent_nrmse']:.2g}",
                str(row["question_tokens"]),
                ends,
            ]
        )
    return markdown_table(
        ["state", "answers are", "inverter", "question", "error", "tokens", "answers"], lines
    )


def _number(value: float | None) -> str:
    return "-" if value is None else f"{value:.3g}"
