"""Key expressions as Zenoh has them, in plain Python: `*` one chunk, `**` any number, `$*` within a chunk."""

from __future__ import annotations

import re
from functools import lru_cache


def is_pattern(key: str) -> bool:
    """Whether a key names more than one variable."""
    return "*" in key


def matches(pattern: str, key: str) -> bool:
    """Whether a key (without wildcards) fits a pattern. Chunks that begin with `@` fit only themselves, as in Zenoh."""
    return _compiled(pattern).fullmatch("/" + key) is not None


@lru_cache(maxsize=1000)
def _compiled(pattern: str) -> re.Pattern[str]:
    chunks = ("(?:/[^/@][^/]*)*" if chunk == "**" else "/" + _chunk(chunk) for chunk in pattern.split("/"))
    return re.compile("".join(chunks))


def _chunk(chunk: str) -> str:
    if chunk == "*":
        return "[^/@][^/]*"
    return "[^/]*".join(re.escape(part) for part in chunk.split("$*"))
