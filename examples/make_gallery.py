"""docs/gallery.md and its pictures, from what the examples run and say.

python examples/make_gallery.py [ex01 ...]        without names: all
"""

from __future__ import annotations

import importlib
import io
import sys
import tempfile
import time
from pathlib import Path

from kit import Kit
from PIL import Image

HERE = Path(__file__).parent
IMAGES, PAGE = HERE.parent / "docs" / "img", HERE.parent / "docs" / "gallery.md"
LONGEST_LINES, WIDEST, WIDEST_PX = 14, 150, 900
HEAD = """# Gallery

Each example is a file of `examples/`: this page and its pictures are what `python examples/make_gallery.py` makes of them, with the real command
line. The simulated scans come with their truth, and each example checks its result against it.
"""


def names() -> list[str]:
    return sorted(path.stem for path in HERE.glob("ex[0-9][0-9]_*.py"))


def made(name: str, folder: Path) -> Kit:
    """Run one example. Raises what it raises."""
    kit = Kit(folder)
    importlib.import_module(name).example(kit)
    return kit


def chapter(name: str, kit: Kit) -> str:
    """Markdown of one example: what it is about, its input, its commands and what they said, its picture."""
    module = importlib.import_module(name)
    title, _, text = (module.__doc__ or "").strip().partition("\n")
    parts = [f"## {title}", text.strip()]
    scene = getattr(module, "SCENE", None)
    if scene:
        parts.append(f"```toml\n{scene}```")
    for command, said in kit.steps:
        lines = [line if len(line) <= WIDEST else f"{line[: WIDEST - 1]}…" for line in said.splitlines()]
        more = [f"... {len(lines) - LONGEST_LINES} more lines"] if len(lines) > LONGEST_LINES else []
        shown = "\n".join([*lines[:LONGEST_LINES], *more])
        if command:
            parts.append(f"    {command}")
        if shown:
            parts.append(f"```text\n{shown}\n```")
    if kit.picture:
        parts.append(f"![{title}](img/{name[:4]}.png)")
    return "\n\n".join([*parts, f"This is `examples/{name}.py`."]) + "\n"


def small(png: bytes) -> bytes:
    """The picture with 128 colours and no wider than a page."""
    with Image.open(io.BytesIO(png)) as picture:
        rgb = picture.convert("RGB")
        rgb.thumbnail((WIDEST_PX, WIDEST_PX))
        out = io.BytesIO()
        rgb.quantize(128).save(out, "PNG", optimize=True)
        return out.getvalue()


def main() -> int:
    wanted = sys.argv[1:]
    chapters = dict(part.split("\n", 1) for part in PAGE.read_text(encoding="utf-8").split("\n## ")[1:]) if PAGE.exists() else {}
    for name in names():
        if wanted and not any(name.startswith(word) for word in wanted):
            continue
        began = time.process_time()
        with tempfile.TemporaryDirectory() as folder:
            kit = made(name, Path(folder))
        (IMAGES / f"{name[:4]}.png").write_bytes(small(kit.picture))
        title, body = chapter(name, kit).removeprefix("## ").split("\n", 1)
        chapters[title] = body
        print(f"{name}: {time.process_time() - began:.1f} s")
    order = [(importlib.import_module(name).__doc__ or "").strip().partition("\n")[0] for name in names()]
    PAGE.write_text(HEAD + "".join(f"\n## {title}\n{chapters[title]}" for title in order if title in chapters), encoding="utf-8")
    return 0


if __name__ == "__main__":
    sys.exit(main())
