"""A server is told to load the weights of a folder, in the way of SGLang."""

import json
import urllib.error
import urllib.request
from collections.abc import Callable
from http.client import HTTPException
from pathlib import Path

from ibrid_search.chat.chat import ChatError

#: Bytes of a reply that are read at most.
LARGEST_REPLY = 100_000


class _Staying(urllib.request.HTTPRedirectHandler):
    """Follows no redirect: the key would be sent along."""

    def redirect_request(self, *_: object) -> None:
        return None


_OPENER = urllib.request.build_opener(_Staying)


def reload_from_disk(url: str, key: str = "none", timeout: float = 600.0) -> Callable[[Path], None]:
    """What makes the server at a base URL (usually ending in /v1) load the weights of a folder.

    It asks POST {root}/update_weights_from_disk {"model_path": folder}; the server must see the
    folder under the same path. Raises ChatError when the server cannot be reached, knows no such
    request, or says that it failed.
    """
    root = url.rstrip("/").removesuffix("/v1")

    def reload(folder: Path) -> None:
        path = str(folder.resolve())
        request = urllib.request.Request(
            f"{root}/update_weights_from_disk",
            json.dumps({"model_path": path}).encode(),
            {"content-type": "application/json", "authorization": f"Bearer {key}"},
        )
        try:
            with _OPENER.open(request, timeout=timeout) as response:
                reply = json.loads(response.read(LARGEST_REPLY))
            done, why = reply.get("success") is True, str(reply.get("message", "no reason given"))
        except urllib.error.HTTPError as error:
            sent_on = (
                ", a redirect, which is not followed since the key would go along"
                if 300 <= error.code < 400
                else ""
            )
            done, why = False, f"HTTP {error.code}{sent_on}"
        except (OSError, HTTPException, ValueError, AttributeError) as error:
            done, why = False, str(error)
        if not done:
            why = " ".join(why.split())[:200]
            raise ChatError(
                f"the server at {root} did not load the weights of {path} ({why}); --learn needs "
                "SGLang, which has "
                "/update_weights_from_disk and must see this folder, or --model FOLDER alone"
            )

    return reload
