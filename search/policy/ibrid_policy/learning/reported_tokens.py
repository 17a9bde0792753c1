"""Which token of the vocabulary a server means: servers report the text of a token, which several
may have.
"""

import re
from collections import defaultdict
from collections.abc import Mapping
from typing import Any

from ibrid_search.chat.chat import ChatError

_NUMBER = re.compile(r"token_id:(\d{1,9})")
_BYTE = re.compile(r"<0x([0-9A-Fa-f]{2})>")
#: What stands in the text of a token for bytes that are no whole character.
_BROKEN = "\ufffd"


class ReportedTokens:
    """Tokens by what a server reports of them, for one tokenizer.

    `name` : of the model, for sentences.
    """

    def __init__(self, tokenizer: Any, name: str) -> None:
        from transformers.convert_slow_tokenizer import bytes_to_unicode  # pyright: ignore[reportMissingImports]

        self.name, self.size = name, len(tokenizer)
        self._by_name: Mapping[str, int] = tokenizer.get_vocab()
        self._by_text: Mapping[str, list[int]] = defaultdict(list)
        self._by_bytes: Mapping[bytes, list[int]] = defaultdict(list)
        letters = {letter: byte for byte, letter in bytes_to_unicode().items()}
        for piece, token in self._by_name.items():
            text = tokenizer.decode([token], clean_up_tokenization_spaces=False)
            self._by_text[text].append(token)
            if _BROKEN in text and (raw := _raw(piece, letters)) is not None:
                self._by_bytes[raw].append(token)

    def token(self, one: Any, where: str) -> int:
        """The token of an entry of `logprobs.content`.

        Its number where there is one ("token_id:7" as vLLM writes it, or `id`), else the one with
        these bytes if they are no whole character, else the one with this text, else the one with
        this name in the vocabulary. Raises ChatError, which begins with `where`, for a token that
        is not in the vocabulary, and for a text that several have.
        """
        entry = one if isinstance(one, Mapping) else {}
        text = entry.get("token")
        numbered = _NUMBER.fullmatch(text) if isinstance(text, str) else None
        number = int(numbered[1]) if numbered else entry.get("id")
        if isinstance(number, int) and not isinstance(number, bool) and 0 <= number < self.size:
            return number
        found = [] if numbered else self._meant(text, entry.get("bytes"))
        if not found:
            raise ChatError(
                f"{where} has a token {text!r:.40} that {self.name} lacks; serve the model that is "
                "trained"
            )
        if len(found) > 1:
            raise ChatError(
                f"{where} says {text!r:.40}, which is the text of {len(found)} tokens of "
                f"{self.name}; use a server that gives "
                "their numbers, as vLLM does (return_tokens_as_token_ids)"
            )
        return found[0]

    def _meant(self, text: Any, raw: Any) -> list[int]:
        if not isinstance(text, str):
            return []
        if (
            _BROKEN in text
            and isinstance(raw, list)
            and all(isinstance(one, int) and 0 <= one < 256 for one in raw)
        ):
            found = self._by_bytes.get(bytes(raw))
            if found:
                return found
        named = [self._by_name[text]] if text in self._by_name else []
        return self._by_text.get(text) or named


def _raw(piece: str, letters: Mapping[str, int]) -> bytes | None:
    """The bytes of a piece of a byte-level vocabulary, or of one with a name such as <0xE2>."""
    if (byte := _BYTE.fullmatch(piece)) is not None:
        return bytes([int(byte[1], 16)])
    return bytes(letters[one] for one in piece) if set(piece) <= letters.keys() else None
