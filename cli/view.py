"""`polish-sim view`: a saved run again; and where the pages of `--live` and `view` are served.

This computer alone, unless asked otherwise. A saved run has its page already, which is served as it is.
viser is imported when a live page is opened.
"""

from __future__ import annotations

import contextlib
import io
import ipaddress
import socket
from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, NamedTuple
from urllib.parse import urlsplit

from polish_sim.cli import console
from polish_sim.cli.options import Given, argument, refuse_without, takes
from polish_sim.errors import InputError, needed

if TYPE_CHECKING:
    from http.server import HTTPServer


LOOPBACK = "127.0.0.1"
PORT = 8080
PORTS = 20  #: Tried one after the other where none was asked for


class Address(NamedTuple):
    """Where a page is served."""

    host: str
    port: int = 0  #: 0: the first free one

    @property
    def url(self) -> str:
        """For the browser's address line."""
        return f"http://{f'[{self.host}]' if ':' in self.host else self.host}:{self.port}"


def asked_address(given: Given) -> Address:
    """Where a command is to serve its page."""
    return Address(given["--live-host"] or LOOPBACK, given["--live-port"] or 0)


def live_address(given: Given) -> Address | None:
    """Where a live view is asked for; None if none is.

    Raises:
        InputError: It cannot be shown, or only its address is given.
    """
    if not given.get("--live"):
        refuse_without(given, "--live", "--live-port", "--live-host")
        return None
    needed("viser", "the live view needs viser", "view")
    return asked_address(given)


def free_address(asked: Address) -> Address:
    """An address that can be listened on: the port asked for, else the first free one.

    Raises:
        InputError: All of them are taken.
    """
    ports = [asked.port] if asked.port else range(PORT, PORT + PORTS)
    problem = ""
    for port in ports:
        try:
            family = socket.getaddrinfo(asked.host, port, type=socket.SOCK_STREAM)[0][0]
            with socket.socket(family, socket.SOCK_STREAM) as trial:
                trial.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
                trial.bind((asked.host, port))
            return Address(asked.host, port)
        except OSError as error:
            problem = error.strerror or str(error)
    tried = f"port {ports[0]}" if len(ports) == 1 else f"the ports {ports[0]} to {ports[-1]}"
    raise InputError(
        f"no page can be served at '{asked.host}', {tried}: {problem}. Choose another with --live-port or "
        "--live-host."
    )


def allowed(origin: str | None, host: str) -> bool:
    """Whether a browser's page of this origin may use the server it calls ``host``, both as in a request's
    header.

    Only the server's own pages may, and by a name that anybody could lead to this address (DNS rebinding)
    none.
    """
    name = urlsplit(f"//{host}").hostname or ""
    known = name in ("localhost", socket.gethostname().lower())
    if not known:
        with contextlib.suppress(ValueError):
            known = bool(ipaddress.ip_address(name))
    return known and (origin is None or urlsplit(origin).netloc == host)


@contextlib.contextmanager
def _guarded() -> Iterator[None]:
    """While viser starts: let its server refuse pages of other origins, and keep its banner off the
    results."""
    import websockets.asyncio.server as websockets

    serve: Any = websockets.serve

    def serve_own(*words: Any, process_request: Any, **more: Any) -> Any:
        def process(connection: Any, request: Any) -> Any:
            if allowed(request.headers.get("Origin"), request.headers.get("Host", "")):
                return process_request(connection, request)
            return connection.respond(403, "refused: this page belongs to another server\n")

        return serve(*words, process_request=process, **more)

    websockets.serve = serve_own  # type: ignore[assignment, misc]
    try:
        with contextlib.redirect_stdout(io.StringIO()):
            yield
    finally:
        websockets.serve = serve  # type: ignore[misc]


def open_server(asked: Address) -> tuple[Any, Address]:
    """A viser server that cannot be shared with the internet, and where it is.

    Raises:
        InputError: Nothing can be served there.
    """
    import viser
    from viser import _messages

    address = free_address(asked)
    with _guarded():
        server = viser.ViserServer(address.host, address.port, "polish-sim", verbose=False)
    # Any page could ask viser to open a tunnel to its makers' server.
    server._websock_server.unregister_handler(_messages.ShareUrlRequest)
    server.gui.configure_theme(show_logo=False, show_share_button=False)
    return server, address


def close_server(server: Any) -> None:
    """Close a server, its threads and its port."""
    with contextlib.redirect_stdout(io.StringIO()):
        server.stop()


def say_address(asked: Address, address: Address) -> None:
    """Print where the page is, and whom that lets in."""
    if not asked.port and address.port != PORT:
        console.note(f"port {PORT} is in use: the page is at {address.port}")
    console.note(f"live view: open {address.url} in a browser")
    if not _is_loopback(address.host):
        console.note(
            f"live view: whoever can reach {address.host} can watch the run, pause it and change it; there "
            "is no password, and nothing is encrypted."
        )


def _is_loopback(host: str) -> bool:
    with contextlib.suppress(OSError, ValueError):
        return ipaddress.ip_address(socket.getaddrinfo(host, None)[0][4][0]).is_loopback
    return False


def page_server(address: Address, content: bytes) -> HTTPServer:
    """A server of one page of HTML, for pages of its own alone."""
    from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer

    class Answer(BaseHTTPRequestHandler):
        def do_GET(self) -> None:
            may = allowed(self.headers.get("Origin"), self.headers.get("Host", ""))
            self.send_response(200 if may else 403)
            self.send_header("Content-Type", "text/html; charset=utf-8")
            self.end_headers()
            self.wfile.write(content if may else b"refused: this page belongs to another server")

        def log_message(self, *_: object) -> None:
            """Nothing is said of requests."""

    class Server(ThreadingHTTPServer):
        address_family = socket.AF_INET6 if ":" in address.host else socket.AF_INET
        daemon_threads = True

    return Server((address.host, address.port), Answer)


@takes("--live-port", "--live-host")
def view(run: Annotated[Path, argument("RUN", "Run folder made by 'run'.")], given: Given) -> None:
    """Show a saved run in the browser until Ctrl-C: the cell in 3D, the force, the part as it is worked
    on."""
    from polish_sim.experiments.report import saved_page, saved_records
    from polish_sim.page.page import page_html

    saved = saved_page([run], saved_records([run]))
    if saved is None or not len(saved.motion.time):
        raise InputError(
            f"'{run}' has nothing to show: it lacks its page, and its cell cannot be set up again."
        )
    asked = asked_address(given)
    address = free_address(asked)
    with page_server(address, page_html(saved).encode()) as server, contextlib.suppress(KeyboardInterrupt):
        say_address(asked, address)
        server.serve_forever()
