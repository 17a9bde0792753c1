"""A model in a folder behind the OpenAI interface on loopback, its answers held to the schema that
a request asks for.
"""

import json
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from http.server import BaseHTTPRequestHandler, HTTPServer
from pathlib import Path
from typing import Any

from ibrid_search.proposers.local_model import LocalModel

from ibrid.errors import IbridError


class SchemaServer(HTTPServer):
    """One question at a time; ends with the `with` block that it serves in."""

    model: LocalModel


class _Handler(BaseHTTPRequestHandler):
    server: SchemaServer

    def do_POST(self) -> None:
        asked = json.loads(self.rfile.read(int(self.headers.get("content-length", 0))))
        try:
            schema = asked["response_format"]["json_schema"]["schema"]
        except (KeyError, TypeError):
            return self._reply(
                400,
                {
                    "error": {
                        "message": "this server answers under response_format json_schema alone"
                    }
                },
            )
        try:
            answer = self.server.model.fill(
                asked["messages"], schema, "schema", int(asked.get("seed", 0))
            )
        except IbridError as error:
            return self._reply(500, {"error": {"message": str(error)}})
        return self._reply(200, _completion(answer.text, answer.usage, cut=answer.cut))

    def _reply(self, status: int, told: dict[str, Any]) -> None:
        body = json.dumps(told).encode()
        self.send_response(status)
        self.send_header("content-type", "application/json")
        self.send_header("content-length", str(len(body)))
        self.end_headers()
        self.wfile.write(body)

    def log_message(self, format: str, *args: Any) -> None:
        """Nothing."""


def _completion(text: str, usage: Any, *, cut: bool) -> dict[str, Any]:
    message = {"role": "assistant", "content": text}
    choice = {"index": 0, "message": message, "finish_reason": "length" if cut else "stop"}
    counted = {name: usage[name] for name in ("prompt_tokens", "completion_tokens")}
    return {"object": "chat.completion", "choices": [choice], "usage": counted}


@contextmanager
def serving(folder: Path, *, longest: int, threads: int = 2) -> Iterator[str]:
    """The address of a server of this model. longest : tokens of an answer."""
    with SchemaServer(("127.0.0.1", 0), _Handler) as server:
        server.model = LocalModel(folder, max_tokens=longest, threads=threads)
        thread = threading.Thread(
            target=server.serve_forever, kwargs={"poll_interval": 0.05}, daemon=True
        )
        thread.start()
        try:
            yield f"http://127.0.0.1:{server.server_address[1]}/v1"
        finally:
            server.shutdown()
            thread.join()
