"""The MCP server, started as a coding agent starts it: a child process that speaks on its standard
streams.
"""

import asyncio
import json
import os
import re
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest

import ibrid
from ibrid.structure.diagrams.library import textbook_text

pytest.importorskip(
    "mcp_types", reason="the mcp package, version 2, is not installed: pip install 'ibrid[mcp]'"
)

from ibrid_search.agents.wire import PARSE_ERROR, identity_of, understood
from mcp import Client, StdioServerParameters
from mcp.client.stdio import stdio_client

ROOT = Path(__file__).resolve().parents[2]
NAIVE = textbook_text("naive")
UNWIRED = 'def build(g):\n    g.add("LCL", "plant")\n'
CODE = """\
import sys
from pathlib import Path
import ibrid
from ibrid.fit.settings import FitSettings
from ibrid.study import Study
from ibrid_search.agents.mcp_server import serve
sweep = ibrid.read_sweep(ibrid.benchmarks()["paper_like"])
sys.exit(serve(Study(sweep), out=Path(sys.argv[1]) if sys.argv[1:] else None, fit=FitSettings(restarts=0)))
"""
CALLS: dict[str, tuple[str, Any]] = {
    "naive": ("evaluate_program", {"program": NAIVE}),
    "illegal": ("evaluate_program", {"program": UNWIRED}),
    "record": ("show_record", {"step": 0}),
    "best": ("list_best", {}),
    "huge": ("check_grammar", {"program": "x" * 2_000_000}),
    "many": ("evaluate_program", {"program": "def f(g):\n" + "    g.add('Gain', 'g')\n" * 5_000}),
    "type": ("evaluate_program", {"program": ["g.add"]}),
    "unknown": ("evaluate_programs", {"program": NAIVE}),
    "path": ("show_record", {"step": "../../../etc/passwd"}),
    "path as program": ("evaluate_program", {"program": "/etc/passwd"}),
    "code": ("evaluate_program", {"program": "import os\nos.abort()\n"}),
    "surplus": ("list_best", {"folder": "/etc"}),
    "alive": ("check_grammar", {"program": NAIVE}),
}


def server(*words: str) -> StdioServerParameters:
    return StdioServerParameters(
        command=sys.executable, args=["-c", CODE, *words], env={"OMP_NUM_THREADS": "1"}
    )


async def converse(
    calls: dict[str, tuple[str, Any]], mode: str = "auto", *words: str
) -> dict[str, Any]:
    """One server, all calls in order; the answers as (is_error, content), with what the server says
    about itself.
    """
    with open(os.devnull, "w") as nowhere:
        async with Client(
            stdio_client(server(*words), nowhere), mode=mode, read_timeout_seconds=600
        ) as client:
            found: dict[str, Any] = {
                "tools": (await client.list_tools()).tools,
                "instructions": client.instructions,
            }
            for key, (tool, arguments) in calls.items():
                result = await client.call_tool(tool, arguments)
                (content,) = result.content
                found[key] = (result.is_error, json.loads(content.text))  # pyright: ignore[reportAttributeAccessIssue]
            return found


@pytest.fixture(scope="module")
def answers() -> dict[str, Any]:
    return asyncio.run(converse(CALLS))


@pytest.mark.nightly
def test_the_tools_are_listed_with_their_schemas(answers: dict[str, Any]):
    tools = {tool.name: tool for tool in answers["tools"]}
    page = (ROOT / "docs" / "agents.md").read_text(encoding="utf-8")
    listed = page.partition("## The tools")[2].partition("## ")[0]
    assert set(tools) == set(re.findall(r"`([a-z]+_[a-z]+|diagnose|compare|finish)`", listed)) - {
        "left_out"
    }
    assert tools["show_record"].input_schema["required"] == ["step"]
    assert "paper" not in answers["instructions"]
    assert "p=1,q=0.3" in answers["instructions"]


@pytest.mark.slow
def test_the_naive_program_is_evaluated_like_by_ibrid_evaluate(answers: dict[str, Any]):
    failed, answer = answers["naive"]
    record = ibrid.evaluate(
        ibrid.textbook("naive"), ibrid.read_sweep(ibrid.benchmarks()["paper_like"]), restarts=0
    )
    assert not failed
    assert answer["nrmse"] == pytest.approx(record.nrmse, rel=1e-5)  # shown with six digits
    assert answer["same_as"] == 0  # it is also the start


@pytest.mark.slow
def test_an_illegal_program_is_answered_with_its_violations(answers: dict[str, Any]):
    failed, answer = answers["illegal"]
    assert not failed
    assert answer["status"] == "illegal"
    assert len(answer["violations"]) == 4


@pytest.mark.slow
def test_the_record_and_the_best_are_shown(answers: dict[str, Any]):
    assert answers["record"][1]["worst_parts"]
    assert [one["step"] for one in answers["best"][1]["best"]] == [0]


@pytest.mark.slow
@pytest.mark.parametrize("key", ["huge", "type", "unknown", "path", "surplus"])
def test_a_wrong_call_is_an_error_in_one_sentence(answers: dict[str, Any], key: str):
    failed, answer = answers[key]
    assert failed
    assert list(answer) == ["error"]
    assert len(answer["error"]) < 400


@pytest.mark.slow
@pytest.mark.parametrize("key", ["many", "path as program", "code"])
def test_hostile_text_is_no_more_than_refused(answers: dict[str, Any], key: str):
    assert answers[key][1]["status"] in ("unreadable", "illegal")
    assert "root:" not in json.dumps(answers[key][1])


@pytest.mark.slow
def test_the_server_outlives_all_of_it(answers: dict[str, Any]):
    assert answers["alive"][1]["legal"]


@pytest.mark.nightly
def test_the_older_protocol_is_spoken_too():
    answers = asyncio.run(converse({"check": ("check_grammar", {"program": NAIVE})}, "legacy"))
    assert answers["check"][1]["legal"]


@pytest.mark.nightly
def test_standard_output_carries_the_protocol_alone_and_the_server_ends_with_its_input():
    """What no UTF-8 can say, which JavaScript writes, and what the SDK cannot read is answered
    too.
    """
    hello = {
        "jsonrpc": "2.0",
        "id": 1,
        "method": "initialize",
        "params": {
            "protocolVersion": "2025-06-18",
            "capabilities": {},
            "clientInfo": {"name": "test", "version": "1"},
        },
    }
    ready = {"jsonrpc": "2.0", "method": "notifications/initialized"}
    call = {"jsonrpc": "2.0", "id": 2, "method": "tools/call"}
    call |= {"params": {"name": "list_best", "arguments": {}}}
    half = {"jsonrpc": "2.0", "id": 3, "method": "tools/call"}
    half |= {
        "params": {"name": "check_grammar", "arguments": {"program": "\ud800 \\ud800 \U0001f50c"}}
    }
    long = json.dumps({**call, "id": 4}).replace("{}", f'{{"count": {"9" * 5000}}}')
    deep = json.dumps({**call, "id": 5}).replace("{}", "[" * 5000 + "]" * 5000)
    lines = [
        json.dumps(hello),
        json.dumps(ready),
        "this is no JSON",
        json.dumps(half),
        long,
        deep,
        json.dumps(call),
    ]
    process = subprocess.Popen(
        [sys.executable, "-c", CODE],
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        stderr=subprocess.DEVNULL,
        text=True,
    )
    assert process.stdin is not None
    assert process.stdout is not None
    with process:
        process.stdin.write("\n".join(lines) + "\n")
        process.stdin.close()
        seen = [json.loads(line) for line in process.stdout]
        assert process.wait(30) == 0
    assert all(one["jsonrpc"] == "2.0" for one in seen)
    assert sorted(one["id"] for one in seen if one["id"] is not None) == [1, 2, 3, 4, 5]
    assert [one["error"]["code"] for one in seen if one["id"] is None] == [PARSE_ERROR]


@pytest.mark.nightly
@pytest.mark.parametrize(("identity", "cancelled"), [(5, "5"), ("5", 5)])
def test_a_request_that_is_cancelled_by_its_number_as_text_keeps_the_server_from_no_end(
    identity: Any, cancelled: Any
):
    params = {
        "protocolVersion": "2025-06-18",
        "capabilities": {},
        "clientInfo": {"name": "test", "version": "1"},
    }
    lines = [
        {"id": 1, "method": "initialize", "params": params},
        {"method": "notifications/initialized"},
        {"id": identity, "method": "tools/call", "params": {"name": "diagnose", "arguments": {}}},
        {"method": "notifications/cancelled", "params": {"requestId": cancelled}},
    ]
    text = "".join(f"{json.dumps({'jsonrpc': '2.0', **line})}\n" for line in lines)
    ended = subprocess.run(
        [sys.executable, "-c", CODE],
        input=text.encode(),
        capture_output=True,
        check=False,
        timeout=600,
    )
    assert ended.returncode == 0


@pytest.mark.parametrize("identity", [None, 1.5, True, [1], {"a": 1}])
def test_a_request_whose_id_no_answer_can_bear_is_refused_without_one(identity: Any):
    line = json.dumps({"jsonrpc": "2.0", "id": identity, "method": "ping", "params": {"id": 7}})
    assert understood(line) is None
    assert identity_of(line) is None


@pytest.mark.slow
@pytest.mark.skipif(not Path("/dev/full").exists(), reason="no device that is always full")
def test_streams_that_fail_end_the_server_with_a_sentence():
    ping = b'{"jsonrpc": "2.0", "id": 1, "method": "ping"}\n'
    with open("/dev/full", "wb") as full:
        ended = subprocess.run(
            [sys.executable, "-c", CODE],
            input=ping,
            stdout=full,
            stderr=subprocess.PIPE,
            check=False,
        )
    assert ended.returncode == 1
    assert b"standard input or output failed (No space left on device)" in ended.stderr


@pytest.mark.nightly
def test_what_was_evaluated_is_there_in_the_next_sitting(tmp_path: Path):
    pytest.importorskip("ibrid_search.run.store")
    folder = str(tmp_path / "run")
    program = NAIVE.replace('g.add("Gain_dq", "gain")', 'g.add("PI_dq", "gain")')
    first = asyncio.run(
        converse({"new": ("evaluate_program", {"program": program})}, "auto", folder)
    )
    assert first["new"][1]["status"] == "ok"
    again = asyncio.run(
        converse({"new": ("evaluate_program", {"program": program})}, "auto", folder)
    )
    assert again["new"][1]["status"] == "duplicate"
    assert again["new"][1]["nrmse"] == first["new"][1]["nrmse"]
    best = ibrid.read_record(tmp_path / "run" / "best.json")
    assert (tmp_path / "run" / "best.py").read_text(encoding="utf-8") == best.program
