"""`ibrid search DATA --out RUN`, its live page `ibrid watch RUN`, its tools for coding agents,
`ibrid mcp DATA`, and its learned proposer, `ibrid policy train --out DIR`.
"""

import os
from argparse import Namespace
from collections.abc import Callable, Mapping
from dataclasses import replace
from importlib.util import find_spec
from pathlib import Path
from typing import TYPE_CHECKING, Any

from ibrid.commands import inputs
from ibrid.commands.outputs import INTERRUPTED, UNFINISHED
from ibrid.errors import IbridError
from ibrid.own_files import DATABASE
from ibrid.streams import complain

if TYPE_CHECKING:
    from ibrid.structure.diagrams.diagram import Diagram
    from ibrid_search.running import Run

#: Options that say how servers are asked.
SERVER = ("effort", "temperature", "max_tokens", "timeout", "form")


def run_search(arguments: Namespace) -> int:
    """Search and say what was found; 0 with an answer, 3 where candidates are unfinished, 130 when
    stopped, 1 without one.
    """
    given = inputs.measured_or_events(arguments)
    data, events = (given[1], None) if given[0] is None else given
    start = None if arguments.start is None else inputs.program(arguments.start)
    truth = None if arguments.truth is None else inputs.program(arguments.truth)

    from math import inf

    from ibrid_search.chat.spending import QUESTIONS, Limits
    from ibrid_search.proposers.choose import Proposers
    from ibrid_search.running import search
    from ibrid_search.settings import Goal, SearchSettings, Workers

    proposers = Proposers(
        arguments.proposer,
        models=arguments.model,
        limits=Limits(
            tokens=_told(arguments.model_tokens, inf),
            cost=_told(arguments.model_cost, inf),
            seconds=_told(arguments.model_seconds, inf),
            questions=_told(arguments.questions, QUESTIONS),
        ),
        prices=arguments.model_price,
        prompt=arguments.prompt,
        server=_server(arguments),
        policy=arguments.policy,
        learn=_learning(arguments),
    )
    goal = Goal(
        arguments.budget, arguments.target, require=arguments.require or "", choose=arguments.choose
    )
    try:
        run = search(
            data,
            arguments.out,
            start=start,
            proposer=proposers,
            budget=goal,
            workers=Workers(_workers(arguments.workers, arguments.ray), arguments.ray),
            settings=SearchSettings(
                history=arguments.history, devices=arguments.devices, effort=arguments.effort
            ),
            seed=arguments.seed,
            parameters=arguments.parameters,
            equilibrium=arguments.equilibrium,
            vocabulary=inputs.vocabulary(arguments.vocabulary, arguments.kinds),
            holdout_op=arguments.holdout_op,
            port=inputs.port(arguments.port, data),
            labels=arguments.labels,
            truth=truth,
            events=events,
            resume=arguments.resume,
            progress="auto",
        )
    except KeyboardInterrupt:
        begun = (Path(arguments.out) / DATABASE).is_file()
        raise KeyboardInterrupt(f"stopped at once; {_go_on(arguments)}" if begun else "") from None
    return _say(run, arguments, truth)


def _learning_options() -> Mapping[str, tuple[str, Callable[[str], Any], str]]:
    """Settings of learning that have an option; none where ibrid-policy is not installed."""
    if find_spec("ibrid_policy") is None:
        return {}
    from ibrid_search.policy_package import policy_part

    return policy_part("learning.options").LEARNING


def learning_arguments() -> dict[str, dict[str, Any]]:
    """Options of `ibrid search` that say how a proposer learns."""
    return {
        f"--learn-{name.replace('_', '-')}": {"type": kind, "metavar": metavar, "help": words}
        for name, (metavar, kind, words) in _learning_options().items()
    }


def _learning(arguments: Namespace) -> Any:
    """Settings of learning as given; False without --learn."""
    names = ("profile", "constrained", *_learning_options())
    given = {
        name: found for name in names if (found := getattr(arguments, f"learn_{name}")) is not None
    }
    if not arguments.learn:
        if given:
            raise IbridError(
                f"--learn-{next(iter(given)).replace('_', '-')} says how a proposer learns; add "
                "--learn, or leave it out"
            )
        return False

    from ibrid_search.policy_package import policy_part

    return replace(policy_part("learning.settings").profile(given.pop("profile", "paper")), **given)


def _server(arguments: Namespace) -> dict[str, Any]:
    """How servers are asked, as given."""
    given = {
        name: found for name in SERVER if (found := getattr(arguments, f"model_{name}")) is not None
    }
    return given | ({"extra": dict(arguments.model_extra)} if arguments.model_extra else {})


def _told(value: float | None, otherwise: float) -> float:
    return otherwise if value is None else value


def _workers(asked: int | None, ray: str | None) -> int:
    """As asked; else all cores, but one where this system has no worker processes."""
    if asked is not None:
        return asked
    return (os.cpu_count() or 1) if ray is not None or os.name == "posix" else 1


def _go_on(arguments: Namespace) -> str:
    return (
        f"go on with: ibrid search {arguments.data} --out {arguments.out} --resume (and the same "
        "options)"
    )


def _say(run: "Run", arguments: Namespace, truth: "Diagram | None") -> int:
    from ibrid.evaluation.record import Record
    from ibrid.measurement.sweeps.quantities import counted
    from ibrid_search.chat.spending import spent_words

    ending = run.ending
    if run.evaluations > arguments.budget:
        ending = f"the budget of {arguments.budget} was spent already, a larger one goes on"
    print(f"\n{counted(run.evaluations, 'evaluation')} in {run.seconds:.0f} s; {ending}.")
    if spent := spent_words(run.spent):
        print(f"Language models took {spent}.")
    elif arguments.model and not run.spent["questions"]:
        print(
            "No language model was asked: the search ended with the diagrams that are evaluated "
            "first, so that addresses and keys were not tried."
        )
    if not run.finished:
        complain(f"stopped; {_go_on(arguments)}")
        return INTERRUPTED
    if not isinstance(run.best, Record):
        complain("no candidate was valid and stable; see report.html for the reasons")
        return 1
    from ibrid.report.texts.text import format_record

    print(format_record(run.best).rstrip("\n"))
    if truth is not None:
        from ibrid.structure.comparison.compare import compare, format_comparison

        print()
        print(format_comparison(compare(run.best.diagram, truth, run.best.vocabulary)).rstrip("\n"))
    for rival in run.selection.get("rivals", ()):
        print(f"Not proven: {rival['words']}.")
    print(f"\n{run.folder}: best.py, best.json, trajectory.csv, selection.json, report.html")
    if unfinished := run.statuses.get("unfinished", 0):
        complain(
            f"{counted(unfinished, 'candidate')} did not end and were stopped; try them again: "
            f"{_go_on(arguments)}"
        )
        return UNFINISHED
    return 0


def run_mcp(arguments: Namespace) -> int:
    """Serve the tools until the client leaves."""
    sweep = inputs.measured(arguments.data)
    start = None if arguments.start is None else inputs.program(arguments.start)

    from ibrid.fit.settings import fit_settings
    from ibrid.study import Study
    from ibrid_search.agents.mcp_server import serve

    study = Study(
        sweep,
        parameters=arguments.parameters,
        equilibrium=arguments.equilibrium,
        vocabulary=inputs.vocabulary(arguments.vocabulary),
        holdout_op=arguments.holdout_op,
        seed=arguments.seed,
    )
    out = None if arguments.out is None else Path(arguments.out)
    fit = fit_settings(arguments.effort)
    if arguments.allow_devices and arguments.folder is None:
        raise IbridError("--allow-devices needs --folder DIR, where the model files lie")
    return serve(
        study,
        out=out,
        start=start,
        fit=fit,
        answer_within=arguments.answer_within,
        folder=None if arguments.folder is None else Path(arguments.folder),
        allow_devices=arguments.allow_devices,
    )


def run_watch(arguments: Namespace) -> int:
    """Serve until Ctrl-C, which ends this command as any other: status 130."""
    from ibrid.modules.vocabulary import choose_vocabulary
    from ibrid_search.watching import watch

    kinds = choose_vocabulary(inputs.vocabulary(files=arguments.kinds))
    watch(
        [Path(folder) for folder in arguments.folder],
        arguments.port,
        kinds,
        lambda url: print(f"{url} (Ctrl-C ends it)", flush=True),
    )
    return INTERRUPTED


def run_train(arguments: Namespace) -> int:
    """Train and say how good the policy is."""
    if arguments.runs:
        return _learn_from_runs(arguments)
    from ibrid_search.policy_package import policy_part

    return policy_part("command").train(arguments)


def _learn_from_runs(arguments: Namespace) -> int:
    """What finished searches teach the diagnosis."""
    from ibrid_search.archives.experience import experience_of
    from ibrid_search.run.run_folder import make_folder

    learned, folder = experience_of(arguments.runs), Path(arguments.out)
    make_folder(folder)
    learned.write(folder)
    print(f"{'idea':<40} {'tried':>6} {'in the answer':>14} {'bonus in ln(error)':>19}")
    for part in sorted(learned.tried, key=lambda part: -learned.bonus(part)):
        print(
            f"{part:<40} {learned.tried[part]:>6} {learned.kept.get(part, 0):>14} "
            f"{learned.bonus(part):>19.2f}"
        )
    print(f"\n{folder}: experience.json; search with --proposer diagnosis --policy {folder}")
    return 0
