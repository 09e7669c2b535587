"""`synth author`: the page on which presets are seen, heard and written."""

from __future__ import annotations

import argparse
import importlib.util
import signal
from typing import Any

from synth.cli.common import add_setting, add_verbose, number, rate


def add(commands: Any) -> None:
    parser = commands.add_parser(
        "author",
        help="see, hear and write presets on a page in the browser",
        allow_abbrev=False,
        description="Serves a page on this machine only, prints its address and opens it. Ends with Ctrl-C; what is not "
        "saved is kept beside the preset and offered at the next start.",
    )
    parser.add_argument("preset", nargs="?", metavar="PRESET", help="preset to open: a name, or a .toml file")
    parser.add_argument("--folder", metavar="DIR", help="folder of presets (default: that of PRESET, else the current one)")
    parser.add_argument("--port", type=number(int, 0, 65535), default=0, metavar="N", help="port (default 0: any free one)")
    parser.add_argument("--no-browser", action="store_true", help="only print the address")
    parser.add_argument(
        "-r", "--rate", type=rate, default=44100, metavar="HZ", help="44100 (default), 48000, 88200 or 96000"
    )
    add_setting(parser, "--quality", "quality")
    add_verbose(parser)
    parser.set_defaults(run=_author)


def _author(options: argparse.Namespace) -> int:
    missing = [name for name in ("starlette", "uvicorn", "websockets") if importlib.util.find_spec(name) is None]
    if missing:
        raise ValueError(f"the page needs {', '.join(missing)}: pip install 'jawari[author]'")
    from synth.author.serve import serve

    unsaid: list[OSError] = []

    def say(url: str) -> None:
        try:
            print(url, flush=True)
        except OSError as error:
            unsaid.append(error)
            if options.no_browser:  # then nobody can find the page
                signal.raise_signal(signal.SIGTERM)

    serve(
        options.preset,
        folder=options.folder,
        port=options.port,
        rate_hz=options.rate,
        quality=options.quality,
        browser=not options.no_browser,
        say=say,
    )
    if unsaid:
        raise unsaid[0]
    return 0
