"""`ibrid search DATA --out RUN` and `ibrid mcp DATA`: the search over block diagrams, and its tools for coding agents."""

import json
import os
from argparse import ArgumentTypeError, Namespace
from collections.abc import Callable, Mapping
from dataclasses import replace
from importlib.util import find_spec
from typing import TYPE_CHECKING, Any

from ibrid.commands import inputs
from ibrid.commands.outputs import complain
from ibrid.commands.own_kinds import add_kinds_option
from ibrid.errors import IbridError

if TYPE_CHECKING:
    from ibrid_search.running import Run

    from ibrid.structure.diagram import Diagram


MODEL_HELP = (
    "for llm and agent, repeatable: NAME@http://host:port/v1, NAME with OPENAI_BASE_URL set, litellm:VENDOR/NAME, or a folder "
    "with a local model; *WEIGHT behind it for several. The key comes from OPENAI_API_KEY"
)

#: How servers are asked: what an option takes, how it is read, and what it is for.
SERVER: Mapping[str, tuple[str, Callable[[str], Any], str]] = {
    "effort": ("WORD", str, "how much a reasoning model thinks, in the words of its server: low, medium, high"),
    "temperature": ("X", inputs.finite, "of the sampling (1)"),
    "max-tokens": ("N", inputs.natural, "of an answer, thinking included (16384; of a local model 2048)"),
    "timeout": ("S", inputs.positive, "seconds for one answer (600)"),
    "form": (
        "FORM",
        str,
        "how a server holds an answer of llm to an edit: schema, tool, gbnf or text (auto: the first that it takes)",
    ),
}


def declare(commands: Any) -> None:
    """Add the commands to the parser."""
    search = commands.add_parser("search", help="find the hidden controller: evaluated edits of shipped diagrams")
    search.add_argument("data", metavar="DATA", help=inputs.DATA_HELP)
    search.add_argument(
        "--events", metavar="EVENTS", help="records of events, which judge what the sweep does not tell apart"
    )
    inputs.add_events_options(search)
    search.add_argument("--out", required=True, metavar="RUN", help="folder of the run; a new one, unless --resume")
    search.add_argument(
        "--start",
        metavar="PROGRAM",
        help="where to begin, and nowhere else (the shipped diagrams that a first look finds best; naive is the paper's start): "
        + inputs.PROGRAM_HELP,
    )
    search.add_argument(
        "--devices",
        type=inputs.natural,
        default=1,
        metavar="N",
        help="inverters behind the terminals, without --start (1)",
    )
    search.add_argument(
        "--proposer",
        default="diagnosis",
        help="diagnosis (default) | rules | random | policy | llm | agent, or one of a plug-in (ibrid modules lists them), or a "
        "mix with weights such as rules:0.7,random:0.3",
    )
    search.add_argument(
        "--model",
        action="append",
        default=[],
        metavar="MODEL",
        help=MODEL_HELP,
    )
    search.add_argument(
        "--policy", metavar="DIR", help="weights of the proposer policy, from ibrid policy train (those that ship)"
    )
    for name, unit in (
        ("tokens", "tokens in and out"),
        ("cost", "cost, with --model-price,"),
        ("seconds", "seconds of waiting"),
    ):
        search.add_argument(
            f"--model-{name}", type=inputs.positive, metavar="X", help=f"{unit} that language models may take in all"
        )
    search.add_argument(
        "--model-price",
        action="append",
        default=[],
        type=_price,
        metavar="IN,OUT",
        help="of a million tokens in and out, in the currency of --model-cost; once for all models, or once for each in their "
        "order (nothing)",
    )
    search.add_argument(
        "--prompt",
        choices=("engineer", "paper"),
        default="engineer",
        help="question to the proposer llm: engineer (default), with the diagnosis of the parent, or paper, the paper's own",
    )
    for option, (metavar, kind, help_text) in SERVER.items():
        search.add_argument(f"--model-{option}", type=kind, metavar=metavar, help=help_text)
    search.add_argument(
        "--model-extra",
        action="append",
        default=[],
        type=_field,
        metavar="NAME=JSON",
        help="a further field of every request to a server, repeatable: top_p=0.9, chat_template_kwargs={...}",
    )
    search.add_argument("--budget", type=inputs.natural, default=500, metavar="N", help="evaluations at most (500)")
    search.add_argument("--target", type=inputs.positive, metavar="X", help="NRMSE that ends the search")
    search.add_argument("--workers", type=inputs.natural, metavar="N", help="evaluate on so many cores (all)")
    search.add_argument("--ray", metavar="ADDRESS", help="a Ray cluster: auto, or HEAD:6379")
    inputs.add_study_options(search, random="everything random")
    add_kinds_option(search)
    search.add_argument(
        "--history",
        type=inputs.natural,
        metavar="N",
        help="best and failed candidates a proposer sees (llm 4, others 0)",
    )
    inputs.add_port_option(search)
    inputs.add_labels_option(search, "exact")
    search.add_argument("--require", metavar="WHAT", help="what a candidate must be: stable,passive:LO-HI (Hz)")
    search.add_argument(
        "--choose",
        default="plausible",
        help="the answer by: plausible (default: held-out points where there are any, then the fewest numbers within the "
        "noise) | error | frequencies | op, the latter two held out",
    )
    search.add_argument(
        "--truth",
        metavar="PROGRAM",
        help="shown beside the answer, also when given with --resume alone; the search does not see it",
    )
    search.add_argument(
        "--learn",
        action="store_true",
        help="train the proposer on the way, by its rewards: policy, or llm with one --model FOLDER, "
        "or --model FOLDER@http://host:port/v1 where a server with log-probabilities answers for the weights of the folder and "
        "loads them after every update (SGLang)",
    )
    search.add_argument(
        "--learn-profile",
        metavar="NAME",
        help="settings to begin with: paper (default), 512 answers to an update; small, for a few hundred evaluations, 8 of "
        "which one is evaluated",
    )
    for name, (metavar, kind, help_text) in _learning_options().items():
        search.add_argument(f"--learn-{name.replace('_', '-')}", type=kind, metavar=metavar, help=help_text)
    search.add_argument(
        "--learn-constrained",
        action="store_true",
        default=None,
        help="a language model can write nothing but edits with lines, modules and ports that exist, as the proposer policy",
    )
    search.add_argument("--resume", action="store_true", help="go on with the run in the folder")
    search.set_defaults(run=run_search)
    tools = commands.add_parser("mcp", help="the evaluator as tools for coding agents, an MCP server on stdio")
    tools.add_argument("data", metavar="DATA", help=inputs.DATA_HELP)
    tools.add_argument(
        "--out", metavar="RUN", help="keep what is evaluated in this folder, and go on with it if it is there"
    )
    tools.add_argument("--start", metavar="PROGRAM", help="step 0 (naive): " + inputs.PROGRAM_HELP)
    inputs.add_study_options(tools)
    tools.add_argument("--seconds", type=inputs.positive, default=30.0, metavar="S", help="limit of an evaluation (30)")
    tools.set_defaults(run=run_mcp)


def run_search(arguments: Namespace) -> int:
    """Search and say what was found; 0 with an answer, 1 without one or when it was stopped."""
    sweep, events = inputs.measured_or_events(arguments)
    if sweep is None:
        raise IbridError(f"a search needs a sweep; give it as DATA, and {arguments.data} as --events")
    start = None if arguments.start is None else inputs.program(arguments.start)
    truth = None if arguments.truth is None else inputs.program(arguments.truth)

    from math import inf

    from ibrid_search.proposers.choose import Proposers
    from ibrid_search.running import search
    from ibrid_search.settings import Goal, SearchSettings, Workers
    from ibrid_search.spending import Limits

    proposers = Proposers(
        arguments.proposer,
        models=arguments.model,
        limits=Limits(
            tokens=arguments.model_tokens or inf,
            cost=arguments.model_cost or inf,
            seconds=arguments.model_seconds or inf,
        ),
        prices=arguments.model_price,
        prompt=arguments.prompt,
        server=_server(arguments),
        policy=arguments.policy,
        learn=_learning(arguments),
    )
    goal = Goal(arguments.budget, arguments.target, require=arguments.require or "", choose=arguments.choose)
    try:
        found = search(
            sweep,
            arguments.out,
            start=start,
            proposer=proposers,
            budget=goal,
            workers=Workers(_workers(arguments.workers, arguments.ray), arguments.ray),
            settings=SearchSettings(history=arguments.history, devices=arguments.devices),
            seed=arguments.seed,
            parameters=arguments.parameters,
            equilibrium=arguments.equilibrium,
            vocabulary=inputs.vocabulary(arguments.vocabulary, arguments.kinds),
            holdout_op=arguments.holdout_op,
            port=inputs.port(arguments.port, sweep),
            labels=arguments.labels,
            truth=truth,
            events=events,
            resume=arguments.resume,
            progress="auto",
        )
    except KeyboardInterrupt:
        complain(f"stopped at once; {_go_on(arguments)}")
        return 1
    return _say(found, arguments, truth)


def _learning_options() -> Mapping[str, tuple[str, Callable[[str], Any], str]]:
    """Settings of learning that have an option; none where ibrid-policy is not installed."""
    if find_spec("ibrid_policy") is None:
        return {}
    from ibrid_search.policy_package import policy_part

    return policy_part("learning.options").LEARNING


def _learning(arguments: Namespace) -> Any:
    """Settings of learning as given; False without --learn."""
    names = ("profile", "constrained", *_learning_options())
    given = {name: found for name in names if (found := getattr(arguments, f"learn_{name}")) is not None}
    if not arguments.learn:
        if given:
            raise IbridError(
                f"--learn-{next(iter(given)).replace('_', '-')} says how a proposer learns; add --learn, or leave it out"
            )
        return False

    from ibrid_search.policy_package import policy_part

    return replace(policy_part("learning.settings").profile(given.pop("profile", "paper")), **given)


def _server(arguments: Namespace) -> dict[str, Any]:
    """How servers are asked, as given."""
    names = [name.replace("-", "_") for name in SERVER]
    given = {name: found for name in names if (found := getattr(arguments, f"model_{name}")) is not None}
    return given | ({"extra": dict(arguments.model_extra)} if arguments.model_extra else {})


def _field(text: str) -> tuple[str, Any]:
    """A field of a request, for argparse; a value that is no JSON is text."""
    name, equals, value = text.partition("=")
    if not (equals and name.isidentifier()):
        raise ArgumentTypeError(f"must be NAME=JSON, such as top_p=0.9; found {text!r:.60}")
    try:
        return name, json.loads(value)
    except (ValueError, RecursionError):
        return name, value


def _price(text: str) -> tuple[float, float]:
    """Prices of tokens in and out, for argparse."""
    try:
        price_in, price_out = map(float, text.split(","))
    except ValueError:
        price_in = price_out = -1.0
    if not (0 <= price_in < float("inf") and 0 <= price_out < float("inf")):
        raise ArgumentTypeError(f"must be two prices IN,OUT, not negative, such as 0.5,1.5; found {text!r:.60}")
    return price_in, price_out


def _workers(asked: int | None, ray: str | None) -> int:
    """As asked; else all cores where Ray is installed, one where it is not."""
    if asked is not None:
        return asked
    return (os.cpu_count() or 1) if ray is not None or find_spec("ray") is not None else 1


def _go_on(arguments: Namespace) -> str:
    return f"go on with: ibrid search {arguments.data} --out {arguments.out} --resume (and the same options)"


def _say(found: "Run", arguments: Namespace, truth: "Diagram | None") -> int:
    from ibrid_search.spending import spent_words

    from ibrid.evaluation.record import Record
    from ibrid.measurement.quantities import counted

    ending = found.ending
    if found.evaluations > arguments.budget:
        ending = f"the budget of {arguments.budget} was spent already, a larger one goes on"
    print(f"\n{counted(found.evaluations, 'evaluation')} in {found.seconds:.0f} s; {ending}.")
    if spent := spent_words(found.spent):
        print(f"Language models took {spent}.")
    if not found.finished:
        complain(f"stopped; {_go_on(arguments)}")
        return 1
    if not isinstance(found.best, Record):
        complain("no candidate was valid and stable; see report.html for the reasons")
        return 1
    from ibrid.report.text import format_record

    print(format_record(found.best).rstrip("\n"))
    if truth is not None:
        from ibrid.structure.compare import compare, format_comparison

        print()
        print(format_comparison(compare(found.best.diagram, truth, found.best.vocabulary)).rstrip("\n"))
    for rival in found.selection.get("rivals", ()):
        print(f"Not proven: {rival['words']}.")
    print(f"\n{found.folder}: best.py, best.json, trajectory.csv, selection.json, report.html")
    return 0


def run_mcp(arguments: Namespace) -> int:
    """Serve the tools until the client leaves."""
    sweep = inputs.measured(arguments.data)

    start = None if arguments.start is None else inputs.program(arguments.start)

    from pathlib import Path

    from ibrid_search.mcp_server import serve

    from ibrid.fit.settings import FitSettings
    from ibrid.study import Study

    study = Study(
        sweep,
        parameters=arguments.parameters,
        equilibrium=arguments.equilibrium,
        vocabulary=inputs.vocabulary(arguments.vocabulary),
        holdout_op=arguments.holdout_op,
        seed=arguments.seed,
    )
    out = None if arguments.out is None else Path(arguments.out)
    return serve(study, out=out, start=start, fit=FitSettings(seconds=arguments.seconds))
