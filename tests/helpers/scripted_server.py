"""A chat server on loopback that answers by script, well or badly."""

import json
import threading
import time
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass, field
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from typing import Any

#: One turn of the script: writes the reply to a request.
Turn = Callable[["Handler"], None]


@dataclass
class Script:
    """`turns` : played in order, the last one again and again.

    `requests`, `headers` (lower case) : what was asked so far.
    """

    turns: list[Turn]
    url: str = ""
    requests: list[dict[str, Any]] = field(default_factory=list)
    headers: list[Mapping[str, str]] = field(default_factory=list)
    over: threading.Event = field(default_factory=threading.Event)


class Server(ThreadingHTTPServer):
    script: Script


class Handler(BaseHTTPRequestHandler):
    server: Server

    def do_POST(self) -> None:
        script = self.server.script
        self.body = body = self.rfile.read(int(self.headers.get("content-length", 0)))
        script.headers.append({name.lower(): value for name, value in self.headers.items()})
        script.requests.append(json.loads(body or b"{}"))
        try:
            script.turns[min(len(script.requests), len(script.turns)) - 1](self)
        except OSError:  # the client went away, as it should from a server that hangs
            self.close_connection = True

    def reply(
        self, body: bytes, status: int = 200, content_type: str = "application/json", **headers: str
    ) -> None:
        """Send a whole reply."""
        self.send_response(status)
        self.send_header("content-type", content_type)
        self.send_header("content-length", str(len(body)))
        for name, value in headers.items():
            self.send_header(name.replace("_", "-"), value)
        self.end_headers()
        self.wfile.write(body)

    def log_message(self, format: str, *args: Any) -> None:
        pass


@contextmanager
def scripted(*turns: Turn) -> Iterator[Script]:
    """A server on a free port of 127.0.0.1 that plays `turns`."""
    script = Script(list(turns))
    with Server(("127.0.0.1", 0), Handler) as server:
        server.script = script
        server.daemon_threads = True
        script.url = f"http://127.0.0.1:{server.server_address[1]}/v1"
        thread = threading.Thread(target=server.serve_forever, kwargs={"poll_interval": 0.02})
        thread.start()
        try:
            yield script
        finally:
            script.over.set()
            server.shutdown()
            thread.join()


def completion(message: Mapping[str, Any], usage: Any = None, finish: str = "stop") -> bytes:
    """The body of a chat completion."""
    usage = {"prompt_tokens": 100, "completion_tokens": 20} if usage is None else usage
    choice = {"index": 0, "message": {"role": "assistant", **message}, "finish_reason": finish}
    return json.dumps({"object": "chat.completion", "choices": [choice], "usage": usage}).encode()


def says(text: Any, usage: Any = None, finish: str = "stop", **message: Any) -> Turn:
    """A well-formed answer."""
    return sends(completion({"content": text, **message}, usage, finish))


def sends(
    body: bytes, status: int = 200, content_type: str = "application/json", **headers: str
) -> Turn:
    """Any bytes with any status."""
    return lambda handler: handler.reply(body, status, content_type, **headers)


def refuses(status: int, message: str = "", **headers: str) -> Turn:
    """An error in the form of the OpenAI interface."""
    return sends(
        json.dumps({"error": {"message": message, "type": "error"}}).encode(), status, **headers
    )


def hangs(handler: Handler) -> None:
    """Never answers."""
    handler.server.script.over.wait()
    handler.close_connection = True


def drips(handler: Handler) -> None:
    """Sends a byte now and then for ever, so that no single read takes long."""
    handler.send_response(200)
    handler.send_header("content-type", "application/json")
    handler.end_headers()
    handler.close_connection = True
    while not handler.server.script.over.is_set():
        handler.wfile.write(b" ")
        handler.wfile.flush()
        time.sleep(0.02)


def closes(handler: Handler) -> None:
    """Breaks the connection in the middle of the reply."""
    handler.send_response(200)
    handler.send_header("content-length", "1000")
    handler.end_headers()
    handler.wfile.write(b'{"choices": [')
    handler.close_connection = True
