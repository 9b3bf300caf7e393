"""A small server for one page: this machine only unless told otherwise, and only for who knows the address."""

from __future__ import annotations

import hmac
import ipaddress
import logging
import secrets
import socket
import threading
import time
from http import HTTPStatus
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from importlib.resources import files

from clew.errors import InputError
from clew.view.live.frame import Feed
from clew.view.live.message import Messenger

_log = logging.getLogger(__name__)

LOOPBACK = "127.0.0.1"
MOST_STREAMS = 8  # pages that are served at once
SILENCE = 5.0  # seconds after which a page is told that the server is there
PATIENCE = 10.0  # seconds that a page may take to fetch what is sent
CLIENT_SHARE = 0.02  # of a processor that one page may cost, so that the run keeps the rest
_PAGE = {"": ("live.html", "text/html"), "live.js": ("live.js", "text/javascript"),
         "draw.js": ("draw.js", "text/javascript"), "live.css": ("live.css", "text/css")}
_HEADERS = {
    "Cache-Control": "no-store",
    "Content-Security-Policy": "default-src 'none'; script-src 'self'; style-src 'self'; connect-src 'self'; "
                               "img-src 'self' data:; base-uri 'none'; form-action 'none'; frame-ancestors 'none'",
    "Referrer-Policy": "no-referrer",
    "X-Content-Type-Options": "nosniff",
}  # fmt: skip


class LiveServer:
    """Serves a page and the stream of a `Feed` below an address that cannot be guessed.

    Args:
        feed: what the page shows.
        title: of the page.
        host: address to listen at; one that other machines reach has to be asked for.
        port: 0 for any that is free.

    Raises:
        InputError: the server cannot listen there.
    """

    def __init__(self, feed: Feed, title: str = "", host: str = LOOPBACK, port: int = 0) -> None:
        self.feed, self.title = feed, title
        self.token = secrets.token_urlsafe(24)
        self._streams: set[_Handler] = set()
        self._lock = threading.Lock()
        self.closing = threading.Event()
        try:
            family = socket.getaddrinfo(host, port, type=socket.SOCK_STREAM)[0][0]
            self._http = _Http(self, family, (host, port))
        except (OSError, OverflowError) as error:
            raise InputError(f"the live view cannot listen at {host}, port {port} ({error}); "
                             "choose another --live-host or --live-port") from None
        self.host, self.port = host, int(self._http.server_address[1])
        self._names = {host.lower(), "localhost", socket.gethostname().lower()} - {""}
        self._thread = threading.Thread(target=self._http.serve_forever, kwargs={"poll_interval": 0.2},
                                        name="clew live view", daemon=True)
        self._thread.start()

    @property
    def url(self) -> str:
        """The address of the page, with its token."""
        shown = self.host
        if self.host in ("", "0.0.0.0", "::"):
            shown = socket.gethostname()
        return f"http://{f'[{shown}]' if ':' in shown else shown}:{self.port}/{self.token}/"

    @property
    def streams(self) -> int:
        """Pages that are being served."""
        return len(self._streams)

    def enter(self, handler: _Handler) -> bool:
        """Whether one more page may be served."""
        with self._lock:
            if len(self._streams) < MOST_STREAMS:
                self._streams.add(handler)
            return handler in self._streams

    def leave(self, handler: _Handler) -> None:
        """A page has gone."""
        with self._lock:
            self._streams.discard(handler)

    def knows(self, host: str) -> bool:
        """Whether a `Host` header names this server as its users would.

        A page of a stranger whose name was made to point here (DNS rebinding) sends that name; addresses in numbers
        and names that this machine gave itself are no such names.
        """
        name = host.rsplit(":", 1)[0] if host.rsplit(":", 1)[-1].isdigit() else host
        try:
            return self._serves(ipaddress.ip_address(name.strip("[]")))
        except ValueError:
            return name.lower() in self._names

    def _serves(self, address: ipaddress.IPv4Address | ipaddress.IPv6Address) -> bool:
        return address.is_loopback or self.host not in (LOOPBACK, "localhost", "::1")

    def close(self, seconds: float = 2.0) -> None:
        """Stop; pages get up to `seconds` to fetch the last frame if one was published with `last`."""
        until = time.monotonic() + seconds
        while self.feed.newest().last and self.streams and time.monotonic() < until:
            time.sleep(0.02)
        self.closing.set()
        self._http.shutdown()
        self._http.server_close()


class _Http(ThreadingHTTPServer):
    daemon_threads = True
    block_on_close = False

    def __init__(self, live: LiveServer, family: int, address: tuple[str, int]) -> None:
        self.live = live
        self.address_family = socket.AddressFamily(family)
        super().__init__(address, _Handler)

    def server_bind(self) -> None:
        """Bind without asking the name service for a name, which may take seconds."""
        self.socket.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        self.socket.bind(self.server_address)
        self.server_address = self.socket.getsockname()

    def handle_error(self, request: object, client_address: object) -> None:
        """A page that goes away is nothing to speak of."""
        _log.debug("connection of %s ended", client_address, exc_info=True)


class _Handler(BaseHTTPRequestHandler):
    server: _Http
    timeout = PATIENCE  # of the socket
    server_version, sys_version = "clew", ""

    def do_GET(self) -> None:
        """The page, its parts, and the stream."""
        live = self.server.live
        _, _, rest = self.path.partition("/")
        token, slash, name = rest.partition("?")[0].partition("/")
        if not live.knows(self.headers.get("Host", "")) or not hmac.compare_digest(
                token.encode("utf-8", "replace"), live.token.encode()):
            self._answer(HTTPStatus.FORBIDDEN, b"This address needs the token that clew printed.\n")
        elif not slash:
            self._answer(HTTPStatus.MOVED_PERMANENTLY, b"", headers={"Location": f"/{live.token}/"})
        elif name == "events":
            self._stream()
        elif name in _PAGE:
            file, kind = _PAGE[name]
            body = files("clew.view.live").joinpath(file).read_text(encoding="utf-8")
            self._answer(HTTPStatus.OK, body.replace("{{title}}", _escaped(live.title)).encode(), kind)
        else:
            self._answer(HTTPStatus.NOT_FOUND, b"There is no such page.\n")

    def _answer(self, status: HTTPStatus, body: bytes, kind: str = "text/plain",
                headers: dict[str, str] | None = None) -> None:
        self.send_response(status)
        for name, value in {**_HEADERS, **(headers or {})}.items():
            self.send_header(name, value)
        self.send_header("Content-Type", f"{kind}; charset=utf-8")
        self.send_header("Content-Length", str(len(body)))
        self.end_headers()
        self.wfile.write(body)

    def _stream(self) -> None:
        live = self.server.live
        if not live.enter(self):
            self._answer(HTTPStatus.SERVICE_UNAVAILABLE, b"Too many pages are open.\n")
            return
        try:
            self.send_response(HTTPStatus.OK)
            for name, value in {**_HEADERS, "Content-Type": "text/event-stream"}.items():
                self.send_header(name, value)
            self.end_headers()
            self._send_frames(live)
        except OSError:  # the page was closed, or is too slow
            _log.debug("a page has gone")
        finally:
            live.leave(self)

    def _send_frames(self, live: LiveServer) -> None:
        messenger, seen, told = Messenger(), 0, time.monotonic()
        while not live.closing.is_set():
            found = live.feed.wait(seen, 0.5)
            if found is None:
                if time.monotonic() - told > SILENCE:
                    self.wfile.write(b": still here\n\n")
                    told = time.monotonic()
                continue
            version, frame = found
            spent = time.thread_time()
            self.wfile.write(messenger.write(frame))
            told = time.monotonic()
            spent = time.thread_time() - spent
            seen = version - 1 if messenger.behind else version
            if frame.last and not messenger.behind:
                return
            if not frame.last:
                live.closing.wait(spent / CLIENT_SHARE)

    def log_message(self, format: str, *arguments: object) -> None:
        """To the log, not to the terminal, and without the address, which holds the token."""
        _log.debug("request from %s", self.client_address[0])


def _escaped(text: str) -> str:
    return text.replace("&", "&amp;").replace("<", "&lt;").replace(">", "&gt;").replace('"', "&quot;")
