import os
import select
from collections.abc import Iterator
from pathlib import Path

import pytest

from platform_link.drivers import Driver, DriverError, open_driver, open_far_end


def read_all(port: Driver, count: int) -> bytes:
    """Return `count` bytes; the kernel hands a pseudo-terminal's bytes over in its own time."""
    data = b""
    while len(data) < count:
        if (descriptor := port.fileno()) is not None:
            assert select.select([descriptor], [], [], 5.0)[0], f"only {data!r} came"
        data += port.read()
    return data


@pytest.fixture(params=["pty", "loop"])
def uri(request: pytest.FixtureRequest, tmp_path: Path) -> str:
    return f"pty://{tmp_path}/platform" if request.param == "pty" else f"loop://{tmp_path}"


@pytest.fixture
def far(uri: str) -> Iterator[Driver]:
    port = open_far_end(uri)
    yield port
    port.close()


def test_every_byte_passes_unchanged_both_ways(uri: str, far: Driver) -> None:
    near = open_driver(uri)
    every = bytes(range(256))
    near.write(every)
    assert read_all(far, 256) == every
    far.write(every)
    assert read_all(near, 256) == every
    assert near.read() == b""
    near.close()
    near.close()


def test_the_shore_goes_and_comes_back(uri: str, far: Driver) -> None:
    for text in (b"one", b"two"):
        near = open_driver(uri)
        near.write(text)
        assert read_all(far, 3) == text
        near.close()
        assert far.read() == b""


def test_the_shore_does_not_hear_what_was_said_before_it_came(uri: str, far: Driver) -> None:
    far.write(b"old")
    near = open_driver(uri)
    assert near.read() == b""
    far.write(b"new")
    assert read_all(near, 3) == b"new"
    near.close()


def test_the_platform_goes_and_comes_back(uri: str) -> None:
    with pytest.raises(DriverError, match=r"no such port|nobody is at the far end"):
        open_driver(uri)
    far = open_far_end(uri)
    near = open_driver(uri)
    far.close()
    with pytest.raises(DriverError, match=r"hung up|Input/output error"):
        near.read()
    with pytest.raises(DriverError, match=r"hung up|Input/output error"):
        near.write(b"x")
    near.close()
    with pytest.raises(DriverError):
        open_driver(uri)
    far = open_far_end(uri)
    near = open_driver(uri)
    near.write(b"again")
    assert read_all(far, 5) == b"again"
    near.close()
    far.close()


def test_a_full_port_neither_waits_nor_grows(uri: str, far: Driver) -> None:
    near = open_driver(uri)
    for _ in range(2000):
        near.write(b"x" * 100)
    assert 0 < len(far.read()) < 200_000
    near.close()


def test_a_stale_link_never_opens_a_foreign_terminal(tmp_path: Path) -> None:
    master, slave = os.openpty()
    (tmp_path / "platform").symlink_to(os.ttyname(slave))
    with pytest.raises(DriverError, match="nobody is at the far end"):
        open_driver(f"pty://{tmp_path}/platform")
    far = open_far_end(f"pty://{tmp_path}/platform")  # replaces the link
    near = open_driver(f"pty://{tmp_path}/platform")
    near.write(b"x")
    assert read_all(far, 1) == b"x"
    for port in (near, far):
        port.close()
    assert not (tmp_path / "platform").is_symlink()
    os.close(master)
    os.close(slave)


def test_closing_a_replaced_far_end_leaves_the_new_link(tmp_path: Path) -> None:
    uri = f"pty://{tmp_path}/platform"
    old, new = open_far_end(uri), open_far_end(uri)
    old.close()
    open_driver(uri).close()
    new.close()


def test_serial_opens_any_terminal_and_tells_what_is_wrong(tmp_path: Path) -> None:
    master, slave = os.openpty()
    near = open_driver(f"serial://{os.ttyname(slave)}?baud=9600")
    os.close(slave)
    assert near.read() == b""
    near.write(bytes(range(256)))
    assert os.read(master, 256) == bytes(range(256))
    os.close(master)
    with pytest.raises(DriverError, match=r"hung up|Input/output error"):
        near.read()
    near.close()
    with pytest.raises(DriverError, match="no such port"):
        open_driver(f"serial://{tmp_path}/ttyUSB9")
    with pytest.raises(DriverError, match="invalid literal"):
        open_driver("serial:///dev/ttyUSB9?baud=fast")


def test_unknown_kinds_are_named() -> None:
    with pytest.raises(DriverError, match=r"usb://x: no such kind of port; known: serial://, pty://, loop://"):
        open_driver("usb://x")
    with pytest.raises(DriverError, match=r"has no far end; use pty:// or loop://"):
        open_far_end("serial:///dev/ttyUSB0")
