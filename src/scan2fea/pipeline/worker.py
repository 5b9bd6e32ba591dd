"""`python -m scan2fea.pipeline.worker FOLDER`: one object in a process of its own, so that a crash in a library takes no other along.

Reads FOLDER/part.npz and FOLDER/task.json, writes the object's files and FOLDER/result.json, and tells its events as JSON lines on
standard output. `... FOLDER ended`: the process before this one was stopped or died, FOLDER/ended.json says how; what it had made by then
is written to the object's files, and nothing new is made.
"""

from __future__ import annotations

import json
import sys
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from scan2fea.io.artifacts import load
from scan2fea.io.files import write_bytes
from scan2fea.pipeline.config import from_tree
from scan2fea.pipeline.convert import convert
from scan2fea.pipeline.record import ENDED, RESULT, Ended, Record


def main(folder: Path, ended: Ended | None = None) -> None:
    """Convert the object of `folder`, or write down what was made of it before its process ended."""
    task = json.loads((folder / "task.json").read_text(encoding="utf-8"))
    stream = sys.stdout

    def say(event: Mapping[str, Any]) -> None:
        stream.write(json.dumps(event) + "\n")
        stream.flush()

    record = Record(folder, resume=task["resume"], say=say, label=task["label"], ended=ended)
    part = load(folder / "part.npz")
    row = convert(part, task["key"], from_tree(task["config"]), record, Path(task["out"]))
    lacks, stages = record.lacks, record.stages
    if ended is not None:
        stages = _timed(stages, ended.stages)
        row |= {"verdict": "failed", "reason": ended.why} if lacks else {}
    write_bytes(folder / RESULT, json.dumps({"object": row, "stages": stages, "lacks": lacks}, allow_nan=False).encode())


def _timed(stages: Sequence[Mapping[str, Any]], first: Sequence[Mapping[str, Any]]) -> list[dict[str, Any]]:
    """The rows of stages whose results were only read back, with the times and memory of when they were made."""
    rows = [dict(stage) for stage in stages]
    for row, made in zip(rows, first, strict=False):
        if row["name"] == made["name"]:
            row |= {"seconds": made["seconds"], "peak_mb": made["peak_mb"]}
    return rows


def _ended(folder: Path) -> Ended:
    return Ended(**json.loads((folder / ENDED).read_text(encoding="utf-8")))


if __name__ == "__main__":
    main(Path(sys.argv[1]), _ended(Path(sys.argv[1])) if sys.argv[2:] else None)
