"""Ports by URI: bytes in and out, without ever waiting.

- `serial:///dev/ttyUSB0?baud=115200`: a serial port or radio modem.
- `pty:///run/dir/platform`: a pseudo-terminal that a far end (the simulator) has made under this path.
- `loop://NAME`: two queues inside this process, for `MemoryBus`.
"""

from __future__ import annotations

import contextlib
import errno
import os
import stat
import termios
import tty
from collections.abc import Callable
from pathlib import Path
from typing import Protocol
from urllib.parse import SplitResult, parse_qs, urlsplit

_CHUNK = 4096
_OUR_PTY = stat.S_IXUSR


class DriverError(Exception):
    """A port cannot be opened or has gone; one line."""


class Driver(Protocol):
    """An open port. Every method but `fileno` and `close` raises DriverError when the port has gone."""

    def read(self) -> bytes:
        """Return what has come, possibly nothing."""

    def write(self, data: bytes) -> None:
        """Send as much as the port takes now; the rest is lost, as on a radio."""

    def fileno(self) -> int | None:
        """Return the descriptor that becomes readable when bytes come; None when there is none."""

    def close(self) -> None:
        """Give the port back; may be called twice."""


def open_driver(uri: str) -> Driver:
    """Return the shore's end of a port; raise DriverError when it cannot be opened."""
    split = urlsplit(uri)
    if split.scheme not in _NEAR:
        raise DriverError(f"{uri}: no such kind of port; known: {', '.join(f'{s}://' for s in _NEAR)}")
    return _NEAR[split.scheme](split)


def open_far_end(uri: str) -> Driver:
    """Return the platform's end of a `pty://` or `loop://` port, made anew; raise DriverError when it cannot be.

    An earlier one of the same name is replaced. The shore may come, go and come back.
    """
    split = urlsplit(uri)
    if split.scheme not in _FAR:
        raise DriverError(f"{uri}: has no far end; use {' or '.join(f'{s}://' for s in _FAR)}")
    return _FAR[split.scheme](split)


class _TerminalPort:
    """A terminal in raw, non-blocking mode; an end of file (a hang-up) and every error mean that it has gone."""

    def __init__(self, descriptor: int, label: str, on_close: Callable[[], None]) -> None:
        self._descriptor = descriptor
        self._label = label
        self._on_close: Callable[[], None] | None = on_close

    def read(self) -> bytes:
        data = b""
        try:
            while len(piece := os.read(self._descriptor, _CHUNK)) == _CHUNK:
                data += piece
        except BlockingIOError:
            return data
        except OSError as error:
            raise DriverError(f"{self._label}: {error.strerror}") from None
        if not piece:
            raise DriverError(f"{self._label}: hung up")
        return data + piece

    def write(self, data: bytes) -> None:
        try:
            os.write(self._descriptor, data)
        except BlockingIOError:
            pass
        except OSError as error:
            raise DriverError(f"{self._label}: {error.strerror}") from None

    def fileno(self) -> int | None:
        return self._descriptor

    def close(self) -> None:
        if self._on_close is not None:
            self._on_close()
            self._on_close = None


def _open_serial(split: SplitResult) -> Driver:
    import serial

    path = split.netloc + split.path
    try:
        baud = int(parse_qs(split.query).get("baud", ["115200"])[0])
        port = serial.Serial(path, baud, timeout=0, exclusive=True)
    except ValueError as error:
        raise DriverError(f"{path}: {error}") from None
    except OSError as error:  # serial.SerialException is one
        raise DriverError(f"{path}: {_reason(error)}") from None
    descriptor = port.fileno()
    mode = termios.tcgetattr(descriptor)
    mode[6][termios.VMIN] = 1  # pyserial's 0 makes "nothing yet" look like "unplugged"
    termios.tcsetattr(descriptor, termios.TCSANOW, mode)
    return _TerminalPort(descriptor, path, port.close)


def _open_pty(split: SplitResult) -> Driver:
    path = split.netloc + split.path
    try:
        descriptor = os.open(path, os.O_RDWR | os.O_NOCTTY | os.O_NONBLOCK)
    except OSError as error:
        raise DriverError(f"{path}: {_reason(error)}") from None
    # A link left behind by a killed far end may by now name the terminal of somebody else.
    if not os.isatty(descriptor) or not os.fstat(descriptor).st_mode & _OUR_PTY:
        os.close(descriptor)
        raise DriverError(f"{path}: nobody is at the far end")
    try:
        tty.setraw(descriptor, termios.TCSANOW)
        termios.tcflush(descriptor, termios.TCIFLUSH)
    except termios.error as error:
        os.close(descriptor)
        raise DriverError(f"{path}: {error.args[-1]}") from None
    return _TerminalPort(descriptor, path, lambda: os.close(descriptor))


def _make_pty(split: SplitResult) -> Driver:
    path = Path(split.netloc + split.path)
    master, slave = os.openpty()
    tty.setraw(slave, termios.TCSANOW)
    os.fchmod(slave, stat.S_IRUSR | stat.S_IWUSR | _OUR_PTY)
    os.set_blocking(master, False)
    target = os.ttyname(slave)

    def close() -> None:
        with contextlib.suppress(OSError):
            if os.readlink(path) == target:
                path.unlink()
        os.close(master)
        os.close(slave)

    fresh = path.with_name(f".{path.name}.{os.getpid()}")
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        fresh.unlink(missing_ok=True)
        fresh.symlink_to(target)
        fresh.replace(path)
    except OSError as error:
        close()
        raise DriverError(f"{path}: {_reason(error)}") from None
    # The far end keeps the slave open too: so it sees no hang-up, and no busy descriptor, while the shore is away.
    return _TerminalPort(master, str(path), close)


class _LoopPort:
    """One end of two queues. Like a port it takes no more than fits its buffer."""

    def __init__(self, name: str) -> None:
        self._name = name
        self._incoming = bytearray()
        self._peer: _LoopPort | None = None
        self.closed = False

    def connect(self, peer: _LoopPort) -> None:
        """Join two ends, in place of whatever was joined before."""
        self._peer, peer._peer = peer, self
        self._incoming.clear()

    def read(self) -> bytes:
        self._check()
        if not self._incoming:
            return b""
        data = bytes(self._incoming)
        self._incoming.clear()
        return data

    def write(self, data: bytes) -> None:
        self._check()
        if self._peer is not None:
            incoming = self._peer._incoming
            if (room := _CHUNK - len(incoming)) > 0:
                incoming += data[:room]

    def fileno(self) -> int | None:
        return None

    def close(self) -> None:
        self.closed = True

    def _check(self) -> None:
        if self.closed:
            raise DriverError(f"loop://{self._name}: closed")


class _NearLoop(_LoopPort):
    def _check(self) -> None:
        if self.closed:
            raise DriverError(f"loop://{self._name}: closed")
        if self._peer is None or self._peer.closed:
            raise DriverError(f"loop://{self._name}: hung up")


_loops: dict[str, _LoopPort] = {}


def _open_loop(split: SplitResult) -> Driver:
    name = split.netloc + split.path
    far = _loops.get(name)
    if far is None or far.closed:
        raise DriverError(f"loop://{name}: nobody is at the far end")
    near = _NearLoop(name)
    near.connect(far)
    return near


def _make_loop(split: SplitResult) -> Driver:
    name = split.netloc + split.path
    if name in _loops:
        _loops[name].close()
    _loops[name] = _LoopPort(name)
    return _loops[name]


def _reason(error: OSError) -> str:
    if error.errno == errno.ENOENT:
        return "no such port"
    return os.strerror(error.errno) if error.errno else str(error)


_NEAR: dict[str, Callable[[SplitResult], Driver]] = {"serial": _open_serial, "pty": _open_pty, "loop": _open_loop}
_FAR: dict[str, Callable[[SplitResult], Driver]] = {"pty": _make_pty, "loop": _make_loop}
