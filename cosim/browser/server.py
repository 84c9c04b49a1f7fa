"""The HTTP end of the page: loopback only, one token, few addresses; a request is refused before more of it is read.

The standard library's server is enough here and one dependency less: one person, one page, a dozen addresses, and each
connection carries one request (HTTP/1.0), so there is nothing to smuggle. What its documentation warns of (files served by
path, CGI) is not used.
"""

import contextlib
import hmac
import json
import os
import secrets
import socket
import socketserver
import threading
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, field
from http import HTTPStatus
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from importlib.resources import files
from pathlib import Path
from typing import Any, Protocol
from urllib.parse import unquote, urlsplit

from cosim.console import to_jsonable
from cosim.errors import CosimError, UsageError

ADDRESS = "127.0.0.1"
NAMES = (ADDRESS, "localhost")  # a page elsewhere cannot have either as its own name
QUIET = 60.0  # s without a byte, after which a connection is given up
FORM = 4 << 20  # bytes of a request that is no file
BLOCK = 1 << 20
SHOWN = 120  # characters of a file's name

PAGE_POLICY = (
    "default-src 'none'; script-src 'self'; style-src 'self'; img-src data:; connect-src 'self'; frame-src 'self'; "
    "base-uri 'none'; form-action 'none'; frame-ancestors 'none'"
)
# the report holds texts of foreign logs: it runs as a stranger to the page, and can reach nothing
REPORT_POLICY = (
    "sandbox allow-scripts allow-modals allow-downloads; default-src 'none'; script-src 'unsafe-inline'; "
    "style-src 'unsafe-inline'; img-src data: blob:; base-uri 'none'; form-action 'none'; frame-ancestors 'self'"
)
STATIC = {
    "": ("page.html", "text/html; charset=utf-8"),
    "page.css": ("page.css", "text/css; charset=utf-8"),
    "page.js": ("page.js", "text/javascript; charset=utf-8"),
}


class Desk(Protocol):
    """What lies behind the page: `cosim.browser.session.Session`."""

    folder: Path

    def limits(self) -> dict[str, int]:
        """Suffix of a file that is taken -> its largest size in bytes."""

    def state(self, known: str = "") -> dict[str, Any]:
        """All that the page shows; without log and form where the page knows those of this revision."""

    def report(self) -> bytes | None:
        """The report of the last diagnosis."""

    def said(self, text: str) -> str:
        """A text in the language of the page."""

    def take(self, file: Path, suffix: str, name: str, role: str) -> None:
        """A file was dropped; it is the desk's from now on.

        Args:
            file: where it lies.
            suffix: its kind.
            name: what people call it.
            role: what a log is for, as the page says; not to be trusted.
        """

    def ask(self, what: str, given: dict[str, Any]) -> None:
        """A button was pressed.

        Raises:
            KeyError: there is no such button.
        """


class RefusedError(Exception):
    """A request that gets no answer but this one.

    Args:
        status: of HTTP.
        message: says why.
    """

    def __init__(self, status: HTTPStatus, message: str) -> None:
        super().__init__(message)
        self.status = status


class TicketUsedError(Exception):
    """A ticket was shown, and is used up: the page is at its real address."""


@dataclass
class Gate:
    """Who may ask: decided from a request's head alone.

    Attributes:
        port: on which the server listens.
        token: the first part of every address.
        ticket: leads to the page once. A browser is started with it, since other users may see the words of a process.
    """

    port: int
    token: str = field(default_factory=lambda: secrets.token_urlsafe(24), repr=False)
    ticket: str = field(default_factory=lambda: secrets.token_urlsafe(24), repr=False)
    _lock: threading.Lock = field(default_factory=threading.Lock, repr=False)

    @property
    def url(self) -> str:
        """Address of the page."""
        return f"http://{ADDRESS}:{self.port}/{self.token}/"

    @property
    def url_once(self) -> str:
        """Address that leads to the page once."""
        return f"http://{ADDRESS}:{self.port}/{self.ticket}"

    def check(self, method: str, target: str, hosts: list[str], origins: list[str]) -> str:
        """What is asked for, behind the token.

        Args:
            method: of HTTP.
            target: as in the request line.
            hosts: every header Host.
            origins: every header Origin.

        Raises:
            RefusedError: it comes from another page, under another name, or without the token.
            TicketUsedError: it is the first with the ticket.
        """
        allowed = {f"{name}:{self.port}" for name in NAMES}
        if len(hosts) != 1 or hosts[0] not in allowed:
            raise RefusedError(HTTPStatus.MISDIRECTED_REQUEST, "this is not the name of this page")
        if origins != [f"http://{hosts[0]}"] and (origins or method != "GET"):
            raise RefusedError(HTTPStatus.FORBIDDEN, "asked from another page")
        first, _, rest = urlsplit(target).path.removeprefix("/").partition("/")
        with self._lock:
            if self.ticket and hmac.compare_digest(first.encode(), self.ticket.encode()):
                self.ticket = ""
                raise TicketUsedError
        if not hmac.compare_digest(first.encode(), self.token.encode()):
            raise RefusedError(
                HTTPStatus.FORBIDDEN,
                "the address lacks its token: open the one that 'cosim open' has printed",
            )
        return rest


class Handler(BaseHTTPRequestHandler):
    """One request."""

    server: "Server"
    server_version, sys_version = "cosim", ""
    timeout = QUIET

    def do_GET(self) -> None:
        """See `http.server`."""
        self._answered(self._get)

    def do_POST(self) -> None:
        """See `http.server`."""
        self._answered(self._post)

    def _answered(self, work: Callable[[str], None]) -> None:
        head = self.headers
        try:
            asked = self.server.gate.check(
                self.command, self.path, head.get_all("Host", []), head.get_all("Origin", [])
            )
            work(asked)
        except TicketUsedError:
            self._write(
                HTTPStatus.SEE_OTHER, b"", "text/plain", PAGE_POLICY, {"Location": self.server.gate.url}
            )
        except RefusedError as error:
            self._fail(error.status, str(error))
        except CosimError as error:
            self._fail(HTTPStatus.UNPROCESSABLE_ENTITY, str(error), getattr(error, "row", ""))
        except OSError as error:
            if isinstance(error, (ConnectionError, TimeoutError)):
                self.close_connection = True
                return
            self._fail(
                HTTPStatus.INSUFFICIENT_STORAGE, f"the system refused a file: {error.strerror or error}"
            )
        except Exception as error:
            text = f"internal error, please report: {type(error).__name__}: {error}"
            self._fail(HTTPStatus.INTERNAL_SERVER_ERROR, text)

    def _fail(self, status: HTTPStatus, text: str, row: str = "") -> None:
        self._send(status, {"error": self.server.desk.said(text), **({"row": row} if row else {})})

    def _get(self, asked: str) -> None:
        if asked in STATIC:
            name, kind = STATIC[asked]
            self._write(HTTPStatus.OK, files("cosim.browser").joinpath(name).read_bytes(), kind, PAGE_POLICY)
        elif asked == "state":
            known = urlsplit(self.path).query.removeprefix("revision=")
            self._send(HTTPStatus.OK, self.server.desk.state(known))
        elif asked == "report" and (page := self.server.desk.report()) is not None:
            self._write(HTTPStatus.OK, page, "text/html; charset=utf-8", REPORT_POLICY)
        else:
            raise RefusedError(HTTPStatus.NOT_FOUND, "there is nothing here")

    def _post(self, asked: str) -> None:
        desk = self.server.desk
        if asked == "file":
            self._file(desk)
        else:
            given = self._form()
            try:
                desk.ask(asked, given)
            except KeyError:
                raise RefusedError(HTTPStatus.NOT_FOUND, "there is nothing here") from None
        self._send(HTTPStatus.OK, desk.state())

    def _form(self) -> dict[str, Any]:
        length = self._length("application/json", FORM, "the form")
        try:
            given = json.loads(self.rfile.read(length))
        except (ValueError, RecursionError):
            given = None
        if not isinstance(given, dict):
            raise RefusedError(HTTPStatus.BAD_REQUEST, "this is no form")
        return given

    def _file(self, desk: Desk) -> None:
        """A file into a new one of the desk's folder: nothing of its name is used but which known ending it has."""
        name = shown_name(self.headers.get("X-Name", ""))
        limits = desk.limits()
        suffix = next((known for known in limits if name.lower().endswith(known)), None)
        if suffix is None:
            raise RefusedError(
                HTTPStatus.UNSUPPORTED_MEDIA_TYPE,
                f"{name} is neither log nor model nor mapping: files that are taken end with {', '.join(limits)}",
            )
        left = self._length("application/octet-stream", limits[suffix], name)
        path = desk.folder / f"{secrets.token_hex(8)}{suffix}"
        try:
            with path.open("xb") as file:
                while left:
                    block = self.rfile.read(min(left, BLOCK))
                    if not block:
                        raise RefusedError(HTTPStatus.BAD_REQUEST, f"{name} did not come whole")
                    file.write(block)
                    left -= len(block)
        except BaseException:
            path.unlink(missing_ok=True)
            raise
        desk.take(path, suffix, name, self.headers.get("X-Role", "log"))

    def _length(self, kind: str, most: int, what: str) -> int:
        """Bytes that follow, checked before one of them is read."""
        if self.headers.get_content_type() != kind or self.headers.get("Transfer-Encoding"):
            raise RefusedError(HTTPStatus.UNSUPPORTED_MEDIA_TYPE, f"{what} must come as {kind}, in one piece")
        given = self.headers.get_all("Content-Length", [])
        if len(given) != 1 or not (given[0].isascii() and given[0].isdigit()):
            raise RefusedError(HTTPStatus.LENGTH_REQUIRED, f"{what}: how long is it?")
        length = int(given[0][:20])
        if length > most:
            raise RefusedError(
                HTTPStatus.REQUEST_ENTITY_TOO_LARGE,
                f"{what} is larger than {most >> 20} MiB: use the command line, 'cosim diagnose'",
            )
        return length

    def _send(self, status: HTTPStatus, content: Any) -> None:
        body = json.dumps(to_jsonable(content), ensure_ascii=False).encode()
        self._write(status, body, "application/json", "default-src 'none'; frame-ancestors 'none'")

    def _write(
        self, status: HTTPStatus, body: bytes, kind: str, policy: str, more: Mapping[str, str] | None = None
    ) -> None:
        with contextlib.suppress(ConnectionError, TimeoutError):
            self.send_response(status)
            for name, value in {
                "Content-Type": kind,
                "Content-Length": str(len(body)),
                "Content-Security-Policy": policy,
                "Cache-Control": "no-store",
                "Referrer-Policy": "no-referrer",
                "X-Content-Type-Options": "nosniff",
                "Cross-Origin-Opener-Policy": "same-origin",
                "Cross-Origin-Resource-Policy": "same-origin",
                **(more or {}),
            }.items():
                self.send_header(name, value)
            self.end_headers()
            self.wfile.write(body)

    def log_message(self, format: str, *args: Any) -> None:
        """Say nothing: addresses hold the token."""


def shown_name(sent: str) -> str:
    """A file's name for people: its last part, without control characters, of a bounded length."""
    last = unquote(sent).replace("\\", "/").rpartition("/")[2]
    kept = "".join(sign for sign in last if sign.isprintable())
    return kept if len(kept) <= SHOWN else f"{kept[: SHOWN - 20]}...{kept[-17:]}"


class Server(ThreadingHTTPServer):
    """Listens on the loopback.

    Args:
        port: to listen on; 0 takes a free one.
        desk: what lies behind the page.

    Attributes:
        gate: who may ask.

    Raises:
        UsageError: the port is taken, or may not be used.
    """

    daemon_threads = True
    block_on_close = False
    allow_reuse_address = os.name == "posix"  # on Windows it would share a port that is taken
    request_queue_size = 16

    def __init__(self, port: int, desk: Desk) -> None:
        try:
            super().__init__((ADDRESS, port), Handler)
        except (OSError, OverflowError) as error:
            raise UsageError(
                f"port {port} cannot be used ({getattr(error, 'strerror', None) or error}): give another one, or leave "
                "--port out to take a free one"
            ) from None
        self.desk = desk
        self.gate = Gate(self.server_address[1])

    def server_bind(self) -> None:
        """Bind without asking the network for a name of this machine."""
        if os.name == "nt":
            self.socket.setsockopt(socket.SOL_SOCKET, socket.SO_EXCLUSIVEADDRUSE, 1)  # type: ignore[attr-defined]
        socketserver.TCPServer.server_bind(self)
        self.server_name, self.server_port = ADDRESS, self.server_address[1]

    def handle_error(self, request: Any, client_address: Any) -> None:
        """Say nothing: who went away is no matter."""


@contextlib.contextmanager
def serving(port: int, desk: Desk) -> Iterator[Gate]:
    """Within this context the page is served, by threads of this process.

    Args:
        port: to listen on; 0 takes a free one.
        desk: what lies behind the page.

    Raises:
        UsageError: the port is taken, or may not be used.
    """
    with Server(port, desk) as server:
        thread = threading.Thread(target=server.serve_forever, args=(0.1,), name="page", daemon=True)
        thread.start()
        try:
            yield server.gate
        finally:
            server.shutdown()
            thread.join()
