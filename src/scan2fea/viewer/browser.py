"""The report of a run, in the reader's own browser."""

from __future__ import annotations

import webbrowser
from pathlib import Path

from scan2fea.errors import InputError, require

PAGE = "report.html"


def open_report(out: Path) -> Path:
    """Open `out`/report.html in the browser; returns its absolute path, so that it can be told where no browser opens.

    `out` may also name the page itself. Raises InputError where there is no report.
    """
    out = Path(out)
    require(out.exists(), InputError, f"{out}: no such folder; give the folder that `scan2fea run` wrote with -o")
    page = out if out.is_file() else out / PAGE
    require(page.suffix == ".html", InputError, f"{out}: is not a report; give the folder that `scan2fea run` wrote with -o")
    if not page.is_file():
        known = (out / "report.json").is_file()
        hint = "its run did not end: run it again with --resume" if known else "give the folder that `scan2fea run` wrote with -o"
        raise InputError(f"{out}: holds no {PAGE}; {hint}")
    page = page.resolve()
    webbrowser.open(page.as_uri())
    return page
