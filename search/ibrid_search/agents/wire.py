"""Standard input and output as the wire of the protocol: a line a message, and every request gets
an answer.

The SDK drops what it cannot read without a word, and whatever it is still answering when the input
ends.
"""

import asyncio
import json
import os
import re
from typing import Any

from mcp_types import JSONRPCMessage, JSONRPCNotification, JSONRPCRequest, jsonrpc_message_adapter

#: Codes of JSON-RPC 2.0: no JSON, no request.
PARSE_ERROR, INVALID_REQUEST = -32700, -32600
#: The id of a request.
_ID = re.compile(r'"id"\s*:\s*(\d{1,15}(?![\d.eE])|"[^"\\]{0,100}")')
#: In JSON: an escaped backslash, a pair of surrogates, or half of one.
_SURROGATES = re.compile(r"\\\\|\\u[dD][89abAB]\w\w\\u[dD][c-fC-F]\w\w|(\\u[dD][89a-fA-F]\w\w)")


class Wire:
    """Both streams, as the SDK takes them: lines to iterate over, and `write` and `flush`.

    Whatever else reads standard input finds it empty, and what else is printed goes to standard
    error.
    """

    def __init__(self) -> None:
        self._incoming = os.fdopen(
            _taken(0, os.open(os.devnull, os.O_RDONLY)), encoding="utf-8", errors="replace"
        )
        self._outgoing = os.fdopen(_taken(1, os.dup(2)), "w", encoding="utf-8")
        self._open: list[Any] = []
        self._answered = asyncio.Condition()
        self._writing = asyncio.Lock()

    def __aiter__(self) -> "Wire":
        return self

    async def __anext__(self) -> str:
        """The next line that the SDK can read; the input ends for it once every request before is
        answered.
        """
        from anyio import to_thread

        while line := without_half_pairs(await to_thread.run_sync(self._incoming.readline)):
            if understood(line) is None and (identity := identity_of(line)) is not None:
                line = json.dumps(
                    {"jsonrpc": "2.0", "id": identity, "method": "unreadable"}
                )  # gets an error
            if (message := understood(line)) is not None:
                self._note_request(message)
                return line
            if line.strip():
                await self._write(f"{json.dumps(_refusal(line))}\n")
        async with self._answered:
            await self._answered.wait_for(lambda: not self._open)
        raise StopAsyncIteration

    async def write(self, text: str) -> None:
        """One message, and whose answer it is."""
        await self._write(text)
        message = json.loads(text)
        if "method" not in message and message.get("id") in self._open:
            async with self._answered:
                self._open.remove(message["id"])
                self._answered.notify_all()

    async def flush(self) -> None:
        """Nothing is held back."""

    async def _write(self, text: str) -> None:
        from anyio import to_thread

        async with self._writing:
            await to_thread.run_sync(self._outgoing.write, text)
            await to_thread.run_sync(self._outgoing.flush)

    def _note_request(self, message: JSONRPCMessage) -> None:
        if isinstance(message, JSONRPCRequest):
            self._open.append(message.id)
        elif (
            isinstance(message, JSONRPCNotification) and message.method == "notifications/cancelled"
        ):
            cancelled = (message.params or {}).get("requestId")  # gets no answer any more
            self._open = [
                one for one in self._open if str(one) != str(cancelled)
            ]  # to the SDK "5" and 5 are one


def understood(line: str) -> JSONRPCMessage | None:
    """The message as the SDK reads it; None where it drops it, or takes a request for a
    notification since its id is odd.
    """
    try:
        message = jsonrpc_message_adapter.validate_json(line, by_name=False)
        odd = isinstance(message, JSONRPCNotification) and "id" in json.loads(line)
    except (ValueError, RecursionError):
        return None
    return None if odd else message


def identity_of(line: str) -> int | str | None:
    """The id of a request that cannot be read, None where an answer could not bear it."""
    try:
        message = json.loads(line)
    except (ValueError, RecursionError):
        identified = _ID.search(line)
        return json.loads(identified[1]) if identified else None
    identity = message.get("id") if isinstance(message, dict) and "method" in message else None
    return identity if isinstance(identity, int | str) and not isinstance(identity, bool) else None


def without_half_pairs(text: str) -> str:
    """JSON with the replacement character where half a surrogate pair stood."""
    return _SURROGATES.sub(lambda found: "\\ufffd" if found[1] else found[0], text)


def _refusal(line: str) -> dict[str, Any]:
    """The error of JSON-RPC for a line that is no message."""
    try:
        json.loads(line)
    except (ValueError, RecursionError):
        error = {"code": PARSE_ERROR, "message": "this line is no JSON; send one object a line"}
    else:
        error = {
            "code": INVALID_REQUEST,
            "message": "this is no request of JSON-RPC 2.0; give jsonrpc, method and an id that is "
            "text or a whole number",
        }
    return {"jsonrpc": "2.0", "id": None, "error": error}


def _taken(stream: int, instead: int) -> int:
    """A descriptor of a standard stream of its own; in place of the stream something else
    stands.
    """
    own = os.dup(stream)
    os.dup2(instead, stream)
    os.close(instead)
    return own
