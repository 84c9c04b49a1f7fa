"""`cosim open` from its start to its end."""

import os
import sys
import tempfile
import threading
import webbrowser
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

from cosim.browser.language import words
from cosim.browser.server import serving
from cosim.browser.session import HELD_OUT, LOG, MORE, SYSTEMS, TABLE, TRACKER, Session
from cosim.console import warn
from cosim.interrupts import ended_in_order
from cosim.report.language import ENGLISH


def run(
    logs: Sequence[Path],
    model: str | None,
    port: int,
    out: Path,
    show: Callable[[str], None],
    browser: bool,
    language: str | None = None,
    *,
    held_out: Sequence[Path] = (),
    external: Path | None = None,
) -> list[dict[str, Any]]:
    """Serve the page until it is closed or Ctrl-C; what was dropped goes with it, results stay.

    Args:
        logs: to begin with, of one machine.
        model: one of our models by name, or an .ssp, .fmu or .toml.
        port: to listen on; 0 takes a free one.
        out: folder of results, one in it for each diagnosis.
        show: told the page's address.
        browser: open the page in the user's browser.
        language: of page and reports; by default the browser's.
        held_out: logs on which the gain is judged.
        external: the tracker's record.

    Returns:
        Folder and verdict of each diagnosis.

    Raises:
        CosimError: the port is taken, there is no such language, or log or model are bad.
        KeyboardInterrupt: Ctrl-C while a diagnosis ran; what it had found is kept.
    """
    with (
        tempfile.TemporaryDirectory(prefix="cosim-open-", ignore_cleanup_errors=True) as folder,
        ended_in_order(),
    ):
        words(language or ENGLISH)
        session = Session(Path(folder), out, language)
        if model is not None and model.lower().endswith((*SYSTEMS, TABLE)):
            session.take_own(Path(model))
        elif model is not None:
            session.choose(model)
        for k, log in enumerate(logs):
            session.take_own(log, MORE if k else LOG)
        for log in held_out:
            session.take_own(log, HELD_OUT)
        if external is not None:
            session.take_own(external, TRACKER)
        with serving(port, session) as gate:
            show(gate.url)
            try:
                if browser:
                    start_browser(gate.url_once)
                preload()
                session.work()
            except KeyboardInterrupt:
                if session.interrupted:
                    for item in session.done[-1:]:
                        warn(f"interrupted: {item['folder']} holds what was found until then")
                    raise
        return session.done


def start_browser(url: str) -> None:
    """Open a page in the browser; nothing where there is no screen: a text browser would take the terminal."""
    screen = any(os.environ.get(name) for name in ("DISPLAY", "WAYLAND_DISPLAY", "BROWSER"))
    if screen or not sys.platform.startswith("linux"):
        threading.Thread(target=webbrowser.open, args=(url,), daemon=True).start()


def preload() -> None:
    """Import what a diagnosis needs while the user looks at the columns."""
    import cosim.anysystem.command
    import cosim.report.deliver  # noqa: F401
