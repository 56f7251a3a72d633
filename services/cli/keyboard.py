"""Single keys from a terminal, without waiting for Enter; silent where there is no terminal."""

from __future__ import annotations

import os
import re
import select
import sys
import termios
import time
import tty
from types import TracebackType
from typing import Self

_SEQUENCE = re.compile(r"\x1b(\[[0-9;]*[A-Za-z~]|O[A-Z])")
_NAMES = {
    "\x1b[A": "up",
    "\x1b[B": "down",
    "\x1b[5~": "pgup",
    "\x1b[6~": "pgdn",
    "\r": "enter",
    "\n": "enter",
    "\x1b": "esc",
    "\x7f": "backspace",
    "\x08": "backspace",
}


class Keyboard:
    """Reads keys of the terminal on stdin while open. Ctrl-C stays what it is."""

    def __init__(self) -> None:
        self._before: list[object] | None = None
        self._typed = ""

    def __enter__(self) -> Self:
        if sys.stdin.isatty():
            self._before = termios.tcgetattr(sys.stdin)
            tty.setcbreak(sys.stdin)
        return self

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None, at: TracebackType | None) -> None:
        if self._before is not None:
            termios.tcsetattr(sys.stdin, termios.TCSADRAIN, self._before)  # type: ignore[arg-type]

    def read(self, timeout_s: float) -> str:
        """Return the next key (a character, or up, down, pgup, pgdn, enter, esc, backspace), "" after the timeout."""
        if self._before is None:
            time.sleep(timeout_s)
            return ""
        if not self._typed:
            if not select.select([sys.stdin], [], [], timeout_s)[0]:
                return ""
            self._typed = os.read(sys.stdin.fileno(), 64).decode(errors="ignore")
        sequence = _SEQUENCE.match(self._typed)
        typed = sequence.group() if sequence else self._typed[:1]
        self._typed = self._typed[len(typed) :]
        return _NAMES.get(typed, typed if typed.isprintable() else "")
