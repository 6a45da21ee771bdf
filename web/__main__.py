"""`python -m web build` and `python -m web serve`."""

import argparse
from functools import partial
from http.server import SimpleHTTPRequestHandler, ThreadingHTTPServer
from pathlib import Path

from web import PAGE


def serve(folder: Path, port: int) -> None:
    """Show a page that was built, until Ctrl-C; any server of files will do."""
    if not (folder / "index.html").is_file():
        raise SystemExit(f"no page is in {folder}: run `python -m web build` first")
    files = partial(SimpleHTTPRequestHandler, directory=folder)
    with ThreadingHTTPServer(("", port), files) as server:
        print(f"http://localhost:{server.server_port} (Ctrl-C stops it)", flush=True)
        try:
            server.serve_forever()
        except KeyboardInterrupt:
            print()


def main() -> None:
    """Build the page, or serve it."""
    parser = argparse.ArgumentParser(prog="python -m web")
    commands = parser.add_subparsers(dest="command", required=True)
    building = commands.add_parser("build", help="make the page, two to four minutes")
    building.add_argument("--into", type=Path, default=PAGE, help="an empty folder")
    serving = commands.add_parser("serve", help="show a page that was built")
    serving.add_argument("--folder", type=Path, default=PAGE, help="where it lies")
    serving.add_argument("--port", type=int, default=8000)
    arguments = parser.parse_args()
    if arguments.command == "build":
        from web.build import build  # takes seconds, which serving does not

        build(arguments.into)
        print(f"{arguments.into / 'index.html'}: open it in a browser")
    else:
        serve(arguments.folder, arguments.port)


if __name__ == "__main__":
    main()
