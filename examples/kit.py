"""What the examples share: they run the real command line and remember what they ran, what it said, and one picture."""

from __future__ import annotations

import base64
import contextlib
import io
import json
import re
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from scan2fea.cli.main import main


@dataclass
class Kit:
    """folder : where an example may write.   steps : (command line, what it printed) in order.   picture : PNG of the gallery, or empty."""

    folder: Path
    steps: list[tuple[str, str]] = field(default_factory=list)
    picture: bytes = b""

    def scan2fea(self, *words: str | Path, code: int = 0) -> str:
        """Run a command as a user would; returns what it prints. Paths inside the folder are shown as they would be typed there."""
        out = io.StringIO()
        with contextlib.redirect_stdout(out), contextlib.redirect_stderr(io.StringIO()) as errors:
            found = main([str(word) for word in words])
        if found != code:
            raise RuntimeError(f"scan2fea {' '.join(map(str, words))}: exit code {found}, not {code}: {errors.getvalue()[-400:]}")
        shown = " ".join(f'"{word}"' if " " in word else word for word in _folded([self._short(word) for word in words]))
        self.steps.append((f"scan2fea {shown}", self._short(out.getvalue()).strip()))
        return out.getvalue()

    def write(self, name: str, text: str) -> Path:
        path = self.folder / name
        path.write_text(text, encoding="utf-8")
        return path

    def json(self, name: str) -> Any:
        return json.loads((self.folder / name).read_text(encoding="utf-8"))

    def report_picture(self, out: Path, title: str) -> None:
        """The picture of OUT/report.html with this title."""
        page = (out / "report.html").read_text(encoding="utf-8")
        found = re.search(r'data:image/png;base64,([^"]+)', page[page.index(f'class="title">{title}<') :])
        assert found is not None
        self.picture = base64.b64decode(found[1])

    def _short(self, text: object) -> str:
        return str(text).replace(f"{self.folder}/", "").replace(str(self.folder), ".")


def _folded(words: list[str]) -> list[str]:
    """Four and more files of one folder and ending in a row, as a shell would be told of them."""
    out: list[str] = []
    while words:
        like = re.fullmatch(r"(.+/)[^/]+(\.\w+)", words[0])
        n = 1
        while like and n < len(words) and re.fullmatch(re.escape(like[1]) + r"[^/]+" + re.escape(like[2]), words[n]):
            n += 1
        out += [f"{like[1]}*{like[2]}"] if like and n >= 4 else words[:n]
        words = words[n:]
    return out
