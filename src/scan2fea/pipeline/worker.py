"""`python -m scan2fea.pipeline.worker FOLDER`: one object in a process of its own, so that a crash in a library takes no other along.

Reads FOLDER/part.npz and FOLDER/task.json, writes the object's files and FOLDER/result.json, and tells its events as JSON lines on
standard output.
"""

from __future__ import annotations

import json
import sys
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from scan2fea.io.artifacts import load
from scan2fea.pipeline.config import from_tree
from scan2fea.pipeline.convert import convert
from scan2fea.pipeline.record import Record


def main(folder: Path) -> None:
    """Convert the object of `folder`."""
    task = json.loads((folder / "task.json").read_text(encoding="utf-8"))
    stream = sys.stdout

    def say(event: Mapping[str, Any]) -> None:
        stream.write(json.dumps(event) + "\n")
        stream.flush()

    record = Record(folder, resume=task["resume"], say=say, label=task["label"])
    part = load(folder / "part.npz")
    row = convert(part, task["key"], from_tree(task["config"]), record, Path(task["out"]))
    partial = folder / "result.json.partial"
    partial.write_text(json.dumps({"object": row, "stages": record.stages}, allow_nan=False), encoding="utf-8")
    partial.replace(folder / "result.json")


if __name__ == "__main__":
    main(Path(sys.argv[1]))
