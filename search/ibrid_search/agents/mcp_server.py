"""`ibrid mcp DATA`: the tools as an MCP server on standard input and output, for coding agents.

Requests are read in a thread of their own and answered by the main thread one by one, which Ctrl-C
stops. Standard output belongs to the protocol: what else is printed goes to standard error
(`wire`).
"""

import asyncio
import importlib.util
import json
import os
import sys
import traceback
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import Future
from contextlib import ExitStack, contextmanager
from pathlib import Path
from queue import SimpleQueue
from threading import Event, Thread
from typing import TYPE_CHECKING, Any

import ibrid
from ibrid.errors import IbridError
from ibrid.fit import kernel
from ibrid.fit.settings import FitSettings
from ibrid.foreign_text import show_controls_within
from ibrid.measurement.formats.csv_file import sweep_csv
from ibrid.streams import complain
from ibrid.structure.compiling.check import require_legal
from ibrid.structure.diagrams.diagram import Diagram
from ibrid.structure.diagrams.library import textbook
from ibrid.structure.diagrams.program import program_text
from ibrid.study import Study
from ibrid.writing import PlainData
from ibrid_search.agents.logbook import USUAL, Logbook
from ibrid_search.agents.study_folder import StudyFolder
from ibrid_search.agents.tool import Tool, call_by_name, capped, failed
from ibrid_search.agents.workbench import Workbench
from ibrid_search.language_models.language import words
from ibrid_search.run.run_folder import digest, open_run
from ibrid_search.step import Status

if TYPE_CHECKING:
    from mcp.server.lowlevel import Server

_MISSING = (
    "ibrid mcp needs the Python SDK of the Model Context Protocol, version 2; install it with: pip "
    "install 'ibrid[mcp]'"
)

#: Seconds after which an answer comes: clients give up after a minute or two.
ANSWER_WITHIN = 20.0
#: Keeps a call: name, arguments and answer.
Note = Callable[[str, Any, PlainData], None]
_Call = tuple[Callable[[], PlainData], "Future[PlainData]"]


def serve(
    study: Study,
    *,
    out: Path | None = None,
    start: Diagram | None = None,
    fit: FitSettings = USUAL,
    answer_within: float | None = ANSWER_WITHIN,
    folder: Path | None = None,
    allow_devices: bool = False,
) -> int:
    """Answer on standard input and output until the input ends; returns the exit status, 0, or 1
    where the streams failed.

    out : folder that keeps what was evaluated. start : the program of step 0, the naive one when
    not given. fit : effort of an evaluation. answer_within : seconds after which a diagnosis comes
    with what is there, and goes on when it is asked again; None for whole answers. folder : whose
    files the commands of ibrid may read and write, as a tool; None: no such tool. allow_devices :
    whether they may run model files.

    Raises IbridError when the SDK is missing, an option does not exist or a folder cannot be used.
    """
    if importlib.util.find_spec("mcp_types") is None:  # version 1 has no such package
        raise IbridError(_MISSING)
    start = start or textbook("naive")
    require_legal(start, study.kinds, equilibrium=study.equilibrium)
    with ExitStack() as closing:
        logbook = closing.enter_context(open_logbook(study, fit, out, program_text(start)))
        tools = Workbench(logbook, answer_within).all
        if folder is not None:
            files = StudyFolder(
                folder, logbook, allow_devices=allow_devices, answer_within=answer_within
            )
            tools = (*tools, *closing.enter_context(files).tools)
        calls: SimpleQueue[_Call | None] = SimpleQueue()
        listening = Event()
        reasons = list[str]()
        told = (
            tools,
            logbook.note_call,
            _instructions(study),
            calls,
            listening,
            reasons,
        )
        Thread(target=_listen, args=told, daemon=True).start()
        listening.wait()  # from here on standard output is out of reach
        kernel.load()
        if not logbook.steps:
            logbook.submit(program_text(start), note="the start")
        while (call := calls.get()) is not None:  # until the input ends
            function, answer = call
            if answer.set_running_or_notify_cancel():
                answer.set_result(function())
    for why in reasons:
        complain(f"the connection ended, {why}")
    return 1 if reasons else 0


def _listen(
    tools: Sequence[Tool],
    note: Note,
    instructions: str,
    calls: "SimpleQueue[_Call | None]",
    listening: Event,
    reasons: list[str],
) -> None:
    """Speak until the input ends; what ended it otherwise goes into `reasons`."""
    from mcp.server.stdio import stdio_server

    from ibrid_search.agents.wire import Wire

    server = make_server(tools, instructions, calls, note)

    async def speak() -> None:
        wire: Any = Wire()
        async with stdio_server(stdin=wire, stdout=wire) as (incoming, outgoing):
            listening.set()
            await server.run(incoming, outgoing, server.create_initialization_options())

    try:
        asyncio.run(speak())
    except Exception as error:
        reasons.append(_why_it_ended(error))
    finally:
        listening.set()
        calls.put(None)


def make_server(
    tools: Sequence[Tool],
    instructions: str,
    calls: "SimpleQueue[_Call | None]",
    note: Note = lambda name, arguments, answer: None,
) -> "Server[Any]":
    """The server of the SDK: the tools as they are declared, each call put into the queue, awaited
    and noted.
    """
    import mcp_types as types
    from mcp.server.lowlevel import Server

    async def on_list_tools(_: Any, __: Any) -> types.ListToolsResult:
        return types.ListToolsResult(
            tools=[
                types.Tool(name=one.name, description=one.description, input_schema=one.schema)
                for one in tools
            ]
        )

    async def on_call_tool(_: Any, asked: types.CallToolRequestParams) -> types.CallToolResult:
        answer: Future[PlainData] = Future()
        calls.put((lambda: _guarded(tools, note, asked.name, asked.arguments), answer))
        content = await asyncio.wrap_future(answer)
        text = json.dumps(show_controls_within(content), ensure_ascii=False)
        return types.CallToolResult(
            content=[types.TextContent(text=text)], is_error="error" in content
        )

    return Server(
        "ibrid",
        version=ibrid.__version__,
        instructions=instructions,
        on_list_tools=on_list_tools,
        on_call_tool=on_call_tool,
    )


def _guarded(tools: Sequence[Tool], note: Note, name: str, arguments: Any) -> PlainData:
    """A call whose unforeseen end is an answer too: one bad request must not take the evaluated
    programs with it.
    """
    try:
        answer = call_by_name(tools, name, arguments)
        note(str(name)[:60], capped({"given": arguments or {}}).get("given", {}), answer)
        return answer
    except Exception as error:
        return failed(f"{name} failed: {_in_words(error)}")


def _why_it_ended(error: BaseException) -> str:
    while isinstance(error, BaseExceptionGroup):
        error = error.exceptions[0]
    if isinstance(error, OSError):
        reason = error.strerror or str(error)
        return (
            f"since standard input or output failed ({reason}); start it from a program that "
            "speaks on both"
        )
    return _in_words(error)


def _in_words(error: BaseException) -> str:
    """An unforeseen error in a sentence; its traceback goes to standard error where IBRID_DEBUG
    asks for it.
    """
    if os.environ.get("IBRID_DEBUG") == "1":
        traceback.print_exception(error, file=sys.stderr)
    return f"{type(error).__name__}: {error}; start the server with IBRID_DEBUG=1 for more"


def _instructions(study: Study) -> str:
    points = study.sweep.points
    return words(
        "server.md",
        points=f"operating point{'' if len(points) == 1 else 's'} {', '.join(study.sweep.names)}",
        frequencies=len(points[0].frequency),
        low=f"{min(float(one.frequency[0]) for one in points):g}",
        high=f"{max(float(one.frequency[-1]) for one in points):g}",
        parameters=study.parameters,
        equilibrium=study.equilibrium,
    )


_STOPPED = "the server was stopped before the evaluation ended; submit the program again"


@contextmanager
def open_logbook(
    study: Study, fit: FitSettings, folder: Path | None, start: str
) -> Iterator[Logbook]:
    """A logbook; with a folder, its store is made or, for the same data, start and options, gone on
    with.

    Raises IbridError when the folder holds another run or cannot be used.
    """
    if folder is None:
        yield Logbook(study, fit=fit)
        return
    texts = {"data": sweep_csv(study.sweep), "start": start, "truth": ""}
    options = {
        "proposer": "tools",
        "parameters": study.parameters,
        "equilibrium": study.equilibrium,
        "kinds": [kind.name for kind in study.kinds],
        "seed": study.seed,
        "holdout_op": list(study.held),
        "data_sha256": digest(texts["data"]),
        "start_sha256": digest(start),
    }
    with open_run(folder, options, texts, resume=True) as store:
        for step in store.pending():
            store.conclude(step.number, status=Status.LOST, reason=_STOPPED)
        yield Logbook(study, fit=fit, store=store, folder=folder, steps=tuple(store.steps()))
