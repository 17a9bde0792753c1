"""Counts through how many files a value walks in a workflow, and how often it comes back to a room
that it had left.

    python docs/making/count_walks.py [--walk evaluate] [--show]

The value is the path in read_sweep, the diagram in evaluate, the sweep in find_gap and search. It
travels as itself (a path as any text that is equal) and as what is made of it: objects of the
package's classes that a function gives back which took it.

step      a call of a function of `ibrid` or `ibrid_search` of which an argument, or an attribute of an argument, is the value
files     files with a step; steps that follow each other in one file are one visit
rooms     visits of a folder that was left before; loops over candidates do not multiply: each pair (file left, file entered)
          counts once
returns   the same of files: visits of a file that was left before
"""

import argparse
import sys
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from enum import Enum
from functools import cache, partial
from inspect import CO_VARARGS, CO_VARKEYWORDS
from itertools import pairwise
from pathlib import Path
from tempfile import TemporaryDirectory
from types import CodeType, FrameType
from typing import Any

import ibrid
from ibrid.fit import kernel

ROOT = Path(__file__).resolve().parents[2]
FOLDERS = (ROOT / "ibrid", ROOT / "search" / "ibrid_search")
DATA = ROOT / "data" / "paper_like.csv"
#: Checks what public functions are given: nobody follows a value there.
BORDER = ROOT / "ibrid" / "border.py"
#: Frames that are no calls of a function, or are none from Python 3.12 on.
UNCOUNTED = ("<module>", "<listcomp>", "<dictcomp>", "<setcomp>", "<genexpr>")


@dataclass(frozen=True)
class Step:
    """A call that takes the value."""

    file: Path
    function: str


def trace_walk(work: Callable[[Any], object], value: Any) -> list[Step]:
    """Run work(value) and list this thread's calls that take the value."""
    steps: list[Step] = []
    forms = {id(value): value}  # held, so that no other object gets the id of one of them
    open_calls: list[bool] = []  # whether each took a form of the value

    def is_form(candidate: Any) -> bool:
        is_equal = (
            isinstance(value, Path)
            and isinstance(candidate, str | Path)
            and str(candidate) == str(value)
        )
        return is_equal or id(candidate) in forms

    def watch(frame: FrameType, event: str, result: Any) -> None:
        if event not in ("call", "return"):
            return
        file = _own_file(frame.f_code)
        if file is None:
            return
        if event == "return":
            if open_calls.pop() and _is_made_here(result):
                forms[id(result)] = result
            return
        arguments = list(_arguments(frame))
        takes_form = any(map(is_form, arguments))
        open_calls.append(takes_form)
        if takes_form or any(
            is_form(held) for argument in arguments for held in _attributes(argument)
        ):
            steps.append(Step(file, frame.f_code.co_qualname))

    sys.setprofile(watch)
    try:
        work(value)
    finally:
        sys.setprofile(None)
    return steps


@cache
def _own_file(code: CodeType) -> Path | None:
    """The file of a function of the package, as in the repository; None elsewhere, and at the
    border, which wraps functions.
    """
    path = Path(code.co_filename)
    is_counted = (
        path != BORDER
        and code.co_name not in UNCOUNTED
        and any(path.is_relative_to(folder) for folder in FOLDERS)
    )
    return path.relative_to(ROOT) if is_counted else None


def _is_made_here(result: Any) -> bool:
    return type(result).__module__.startswith("ibrid") and not isinstance(result, Enum)


def _arguments(frame: FrameType) -> Iterator[Any]:
    code, local = frame.f_code, frame.f_locals
    count = code.co_argcount + code.co_kwonlyargcount
    further = bool(code.co_flags & CO_VARARGS) + bool(code.co_flags & CO_VARKEYWORDS)
    yield from (local[name] for name in code.co_varnames[:count] if name in local)
    for name in code.co_varnames[count : count + further]:
        yield from local[name].values() if isinstance(local[name], dict) else local[name]


def _attributes(argument: Any) -> list[Any]:
    return [] if isinstance(argument, type) else list(getattr(argument, "__dict__", {}).values())


def count_returns(steps: list[Step], place: Callable[[Path], Path]) -> int:
    """Pairs (file left, file entered) by which the walk comes back to a place that it had left."""
    returns: set[tuple[Path, Path]] = set()
    known = {place(step.file) for step in steps[:1]}
    for left, entered in pairwise(step.file for step in steps):
        if place(left) != place(entered) and place(entered) in known:
            returns.add((left, entered))
        known.add(place(entered))
    return len(returns)


def count_walk(steps: list[Step]) -> dict[str, int]:
    """Files, returns to rooms and returns to files of a walk."""
    rooms = count_returns(steps, lambda file: file.parent)
    returns = count_returns(steps, lambda file: file)
    return {"files": len({step.file for step in steps}), "rooms": rooms, "returns": returns}


def trace_workflow(name: str) -> list[Step]:
    """Run a workflow on little: one operating point; a diagram without the device's filter before
    the PLL; two evaluations.
    """
    if name == "read_sweep":
        return trace_walk(ibrid.read_sweep, DATA)
    sweep = ibrid.read_sweep(DATA).only(["p=1,q=0.3"])
    naive, exact = ibrid.textbook("naive"), ibrid.textbook("gfl_exact")
    if name == "evaluate":
        return trace_walk(lambda diagram: ibrid.evaluate(diagram, sweep, restarts=0), naive)
    if name == "find_gap":
        return trace_walk(
            lambda data: ibrid.find_gap(exact, data, effort="low", progress="silent"), sweep
        )
    with TemporaryDirectory() as folder:
        search = partial(
            ibrid.search, folder=Path(folder) / "run", start=naive, budget=2, progress="silent"
        )
        return trace_walk(search, sweep)


if __name__ == "__main__":
    workflows = ["read_sweep", "evaluate", "find_gap", "search"]
    parser = argparse.ArgumentParser(
        description="Counts the walk of a value through the files of the package."
    )
    parser.add_argument("--walk", choices=workflows, help="of one workflow alone")
    parser.add_argument(
        "--show", action="store_true", help="list file: functions in the order of first visits"
    )
    given = parser.parse_args()
    kernel.load()
    for name in [given.walk] if given.walk else workflows:
        steps = trace_workflow(name)
        print(
            f"{name:<12}",
            *(f"{count:>4} {what}" for what, count in count_walk(steps).items()),
            flush=True,
        )
        for file in dict.fromkeys(step.file for step in steps) if given.show else ():
            functions = dict.fromkeys(step.function for step in steps if step.file == file)
            print(f"    {file}: {', '.join(functions)}")
