"""`python -m web build` and `python -m web serve`."""

import argparse
import socket
from functools import partial
from http.server import SimpleHTTPRequestHandler, ThreadingHTTPServer
from pathlib import Path

from web import PAGE


def serve(folder: Path, host: str, port: int) -> None:
    """Show a page that was built, until Ctrl-C; any server of files will do."""
    if not (folder / "index.html").is_file():
        raise SystemExit(f"no page is in {folder}: run `python -m web build` first")
    files = partial(_Quiet, directory=folder)
    try:
        server = ThreadingHTTPServer((host, port), files)
    except OSError as error:
        raise SystemExit(
            f"cannot serve at {host}, port {port} ({error.strerror}): name another "
            "port, such as `make throw PORT=8001`"
        ) from error
    with server:
        name = "localhost" if host == "127.0.0.1" else _own_address(host)
        print(f"Throw a cloth: http://{name}:{server.server_port}", flush=True)
        print("Open it in a browser; Ctrl-C stops the server.", flush=True)
        try:
            server.serve_forever()
        except KeyboardInterrupt:
            print()


class _Quiet(SimpleHTTPRequestHandler):
    """Serves files, and prints no line for each of them."""

    def log_request(self, *about: object) -> None:
        """Say nothing of what was sent."""


def _own_address(host: str) -> str:
    """The address by which others in the network reach this machine."""
    if host != "0.0.0.0":
        return host
    # A datagram socket finds its way without sending anything
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as way:
        try:
            way.connect(("192.0.2.1", 9))
        except OSError:  # no network
            return "localhost"
        return str(way.getsockname()[0])


def main() -> None:
    """Build the page, or serve it."""
    parser = argparse.ArgumentParser(prog="python -m web")
    commands = parser.add_subparsers(dest="command", required=True)
    building = commands.add_parser("build", help="make the page, a minute")
    building.add_argument("--into", type=Path, default=PAGE, help="an empty folder")
    serving = commands.add_parser("serve", help="show a page that was built")
    serving.add_argument("--folder", type=Path, default=PAGE, help="where it lies")
    serving.add_argument("--port", type=int, default=8000)
    serving.add_argument(
        "--host",
        default="127.0.0.1",
        help="0.0.0.0 also serves telephones in the same network",
    )
    arguments = parser.parse_args()
    if arguments.command == "build":
        from web.build import build  # takes seconds, which serving does not

        try:
            build(arguments.into)
        except (ConnectionError, PermissionError) as error:
            raise SystemExit(str(error)) from error
        print(f"{arguments.into / 'index.html'}: open it in a browser")
    else:
        serve(arguments.folder, arguments.host, arguments.port)


if __name__ == "__main__":
    main()
