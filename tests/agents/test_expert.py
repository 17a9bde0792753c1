"""An engineer at the tools of the MCP server: a fixed transcript of calls that identifies a virtual
synchronous machine.
"""

import asyncio
import json
import os
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from ibrid_search.agents.tool import LONGEST_ANSWER
from ibrid_search.report.page import write_run_page
from ibrid_search.run.run_folder import ARCHIVE
from ibrid_search.run.store import Store
from ibrid_search.step import EVALUATED

import ibrid
from ibrid.measurement.formats.csv_file import sweep_csv
from ibrid.measurement.sweeps.noise import add_noise
from ibrid.structure.comparison.compare import compare

pytest.importorskip(
    "mcp_types", reason="the mcp package, version 2, is not installed: pip install 'ibrid[mcp]'"
)

from mcp import Client, StdioServerParameters
from mcp.client.stdio import stdio_client

#: What the engineer asked, in order; programs as lines.
TRANSCRIPT = json.loads((Path(__file__).parent / "expert_vsm.json").read_text(encoding="utf-8"))


async def replayed(data: Path, folder: Path) -> list[dict[str, Any]]:
    """The answers to the calls of the transcript, by the server that a coding agent starts."""
    words = ["-m", "ibrid", "mcp", str(data), "--out", str(folder)]
    started = StdioServerParameters(
        command=sys.executable, args=words, env={"OMP_NUM_THREADS": "1"}
    )
    answers = []
    with open(os.devnull, "w") as nowhere:
        async with Client(stdio_client(started, nowhere), read_timeout_seconds=300) as client:
            for call in TRANSCRIPT:
                result = await client.call_tool(call["tool"], given(call))
                (content,) = result.content
                assert not result.is_error, content
                answers.append(json.loads(content.text))  # pyright: ignore[reportAttributeAccessIssue]
    return answers


def given(call: dict[str, Any]) -> dict[str, Any]:
    arguments = dict(call["arguments"])
    if "program" in arguments:
        arguments["program"] = "\n".join(arguments["program"]) + "\n"
    return arguments


@pytest.fixture(scope="module")
def sitting(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, list[dict[str, Any]]]:
    folder = tmp_path_factory.mktemp("expert")
    sweep = add_noise(
        ibrid.read_sweep(ibrid.benchmarks()["gfm_vsm"]), 60, rng=np.random.default_rng(1)
    )
    (folder / "data.csv").write_text(sweep_csv(sweep), encoding="utf-8")
    return folder / "run", asyncio.run(replayed(folder / "data.csv", folder / "run"))


@pytest.mark.nightly
def test_an_expert_identifies_a_virtual_synchronous_machine_within_fifteen_evaluations(sitting):
    folder, answers = sitting
    with Store.open(folder / ARCHIVE, read_only=True) as store:
        assert sum(step.status in EVALUATED for step in store.steps()) <= 15
        assert [call.tool for call in store.calls()] == [call["tool"] for call in TRANSCRIPT]
    assert answers[-1]["kept"]
    assert answers[-1]["doubts"] == []
    answer = ibrid.read_record(folder / "best.json")
    assert answer.grade == "explains"
    found = compare(answer.diagram, ibrid.textbook("gfm_vsm"))
    assert found.modules.f1 == 1.0
    assert (
        found.connections.f1 >= 0.95
    )  # the damping acts before or behind a sum, which is the same


@pytest.mark.nightly
def test_the_expert_followed_what_the_diagnosis_named(sitting):
    _, answers = sitting
    programs = [
        answer["program"]
        for call, answer in zip(TRANSCRIPT, answers, strict=True)
        if call["tool"] == "diagnose"
    ]
    evaluated = [
        given(call)["program"] for call in TRANSCRIPT if call["tool"] == "evaluate_program"
    ]
    assert [one.strip() for one in programs] == [one.strip() for one in evaluated[1:]]


@pytest.mark.nightly
def test_every_answer_is_short_and_names_the_next_call(sitting):
    _, answers = sitting
    for answer in answers:
        rest = {key: value for key, value in answer.items() if key != "program"}
        assert len(json.dumps(rest, ensure_ascii=False)) <= LONGEST_ANSWER
        assert answer["next"]


@pytest.mark.nightly
def test_the_page_of_the_run_replays_the_calls_and_gives_the_reasons(sitting):
    page = write_run_page(sitting[0]).read_text(encoding="utf-8")
    assert "What the agent asked" in page
    assert page.count("<strong>show_residuals</strong>") == 2
    assert "A droop alone leaves 250 sigma below 50 Hz" in page
