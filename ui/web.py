"""The web side of the page: starlette and uvicorn in a thread of their own, fed by `Page.step`."""

from __future__ import annotations

import asyncio
import contextlib
import logging
import secrets
import socket
import threading
from collections.abc import Awaitable, Callable
from pathlib import Path
from typing import Any

import uvicorn
from starlette.applications import Starlette
from starlette.concurrency import run_in_threadpool
from starlette.requests import Request
from starlette.responses import Response
from starlette.routing import Mount, Route, WebSocketRoute
from starlette.staticfiles import StaticFiles
from starlette.websockets import WebSocket, WebSocketDisconnect

from bus import topics
from bus.service import first_line
from ui.session import Session, Submit, Update, may_connect

STATIC_DIR = Path(__file__).parent / "static"
MAX_PAGES = 16
MAX_BODY = 16_384
Compute = Callable[[bytes], bytes]
_HEADERS = {
    "Cache-Control": "no-cache",  # an update of Starboard must reach the browser
    # eval, which the page has no use for, is what Playwright's wait_for_function needs
    "Content-Security-Policy": "default-src 'self'; script-src 'self' 'unsafe-eval'; frame-ancestors 'none'",
    "X-Content-Type-Options": "nosniff",
}

log = logging.getLogger("ui")


class _Files(StaticFiles):
    def file_response(self, *args: Any, **kwargs: Any) -> Response:
        response = super().file_response(*args, **kwargs)
        response.headers.update(_HEADERS)
        return response


class _Connection:
    """A session with its socket; lives in the web thread."""

    def __init__(self, websocket: WebSocket, session: Session) -> None:
        self.websocket = websocket
        self.session = session
        self.news = asyncio.Event()

    def offer(self, update: Update) -> None:
        self.session.offer(update)
        self.news.set()


class WebServer:
    """Serves the page on a socket that listens already. Everything but `deliver` and `stop` runs in its thread."""

    def __init__(
        self,
        documents: dict[str, bytes],
        submit: Submit,
        names: tuple[str, ...] = (),
        computations: dict[str, Compute] | None = None,
    ) -> None:
        """Take the JSON documents to serve by path, the way to publish, and further names of this machine.

        computations: what is worked out of a JSON body posted to a path, in a thread of its own and one at a time;
        ValueError: it made no sense.
        """
        self._submit = submit
        self._names = names
        self._computing = asyncio.Lock()
        self._connections: set[_Connection] = set()
        self._last: dict[str, bytes] = {}
        self._last_images: dict[str, bytes] = {}
        self._refused = 0
        self._status: dict[str, Any] = {}
        self._loop: asyncio.AbstractEventLoop | None = None
        self._thread: threading.Thread | None = None
        routes = [
            *(Route(path, self._document(content)) for path, content in documents.items()),
            *(Route(path, self._computation(c), methods=["POST"]) for path, c in (computations or {}).items()),
            WebSocketRoute("/ws", self._page),
            Mount("/", _Files(directory=STATIC_DIR, html=True)),
        ]
        config = uvicorn.Config(
            Starlette(routes=routes),
            log_config=None,
            log_level="warning",
            access_log=False,
            lifespan="off",
            ws="websockets-sansio",
            ws_max_size=16_384,
            ws_per_message_deflate=False,  # costs more than it saves beside the pool
            timeout_graceful_shutdown=1,
        )
        self._server = uvicorn.Server(config)

    @property
    def alive(self) -> bool:
        """Whether the thread runs."""
        return self._thread is not None and self._thread.is_alive()

    def start(self, listener: socket.socket) -> None:
        """Serve on a listening socket from now on."""
        self._thread = threading.Thread(target=self._run, args=(listener,), name="web", daemon=True)
        self._thread.start()

    def _run(self, listener: socket.socket) -> None:
        async def serve() -> None:
            self._loop = asyncio.get_running_loop()
            await self._server.serve(sockets=[listener])

        asyncio.run(serve())

    def stop(self, timeout_s: float) -> None:
        """Say goodbye to all pages and end the thread."""
        self._server.should_exit = True
        if self._thread is not None:
            self._thread.join(timeout_s)

    def deliver(self, update: Update, status: dict[str, Any]) -> None:
        """Hand an update to all pages; called from the service's thread."""
        if self._loop is not None:
            with contextlib.suppress(RuntimeError):  # the loop is closed: `alive` tells
                self._loop.call_soon_threadsafe(self._spread, update, status)

    def _spread(self, update: Update, status: dict[str, Any]) -> None:
        for key, payload in update.values.items():
            topic = topics.find(key)
            if topic is None or topic.qos is not topics.Qos.REQUEST:
                self._last[key] = payload
        self._last_images.update(update.images)
        refused = self._refused + sum(c.session.refused for c in self._connections)
        self._status = {"pages": len(self._connections), "refused": refused, **status}
        for connection in self._connections:
            connection.offer(update)

    @staticmethod
    def _document(content: bytes) -> Callable[[Request], Response]:
        return lambda _request: Response(content, media_type="application/json", headers=_HEADERS)

    def _computation(self, compute: Compute) -> Callable[[Request], Awaitable[Response]]:
        async def answer(request: Request) -> Response:
            if not may_connect(request.headers.get("origin"), request.headers.get("host", ""), self._names):
                return Response(status_code=403)
            if int(request.headers.get("content-length", MAX_BODY + 1)) > MAX_BODY:
                return Response(status_code=413)
            body = await request.body()
            try:
                async with self._computing:
                    content = await run_in_threadpool(compute, body)
            except ValueError as error:
                return Response(first_line(error), status_code=400)
            return Response(content, media_type="application/json", headers=_HEADERS)

        return answer

    async def _page(self, websocket: WebSocket) -> None:
        if len(self._connections) >= MAX_PAGES or not may_connect(
            websocket.headers.get("origin"), websocket.headers.get("host", ""), self._names
        ):
            await websocket.close(1008)
            return
        await websocket.accept()
        connection = _Connection(websocket, Session(f"page-{secrets.token_hex(2)}", self._submit))
        connection.session.offer(Update(0, self._last, self._last_images))
        self._connections.add(connection)
        sender = asyncio.create_task(self._send(connection))
        try:
            await self._receive(connection)
        finally:
            self._connections.discard(connection)
            self._refused += connection.session.refused
            connection.session.close()
            sender.cancel()

    async def _receive(self, connection: _Connection) -> None:
        """Take the page's messages until it goes or says nothing any more."""
        session, loop = connection.session, asyncio.get_running_loop()
        while True:
            try:
                async with asyncio.timeout(session.patience_s):
                    message = await connection.websocket.receive()
            except TimeoutError:
                if session.fall_silent():
                    log.warning("%s is silent: its lease is given back", session.client)
                    return
                continue
            if message["type"] == "websocket.disconnect":
                return
            problem = session.receive(message.get("text") or message.get("bytes") or b"", loop.time())
            if problem and session.refused == 1:
                log.warning("%s: refused: %s (further ones are counted on the page)", session.client, problem)

    async def _send(self, connection: _Connection) -> None:
        """Send what is new, as fast as this page takes it."""
        with contextlib.suppress(WebSocketDisconnect, RuntimeError):
            while True:
                await connection.news.wait()
                connection.news.clear()
                for frame in connection.session.take(self._status):
                    if isinstance(frame, str):
                        await connection.websocket.send_text(frame)
                    else:
                        await connection.websocket.send_bytes(frame)
