"""`python -m scan2fea.pipeline.worker`: one object after the other, each in a process of its own, so that a crash in a library takes no other along.

Each line of standard input is a JSON list. [FOLDER]: reads FOLDER/part.npz and FOLDER/task.json, writes the object's files and FOLDER/result.json,
and tells its events as JSON lines on standard output, the last one how its process ended. [FOLDER, "ended"]: the process before this one was stopped
or died, FOLDER/ended.json says how; what it had made by then is written to the object's files, and nothing new is made.
"""

from __future__ import annotations

import json
import os
import sys
import traceback
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from scan2fea.io.artifacts import load
from scan2fea.io.files import write_bytes
from scan2fea.pipeline.config import from_tree
from scan2fea.pipeline.convert import convert
from scan2fea.pipeline.record import ENDED, FORKS, LEFT, RESULT, Ended, Record


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


def serve() -> None:
    """Objects until standard input ends. A fork has all imports done; where there are no forks this process ends after one object."""
    for line in sys.stdin:
        arguments = json.loads(line)
        if not FORKS:
            code = _one(arguments)
        elif child := os.fork():
            code = os.waitstatus_to_exitcode(os.waitpid(child, 0)[1])
        else:
            os.dup2(os.open(os.devnull, os.O_RDONLY), 0)  # the next objects are not for it
            os._exit(_one(arguments))
        sys.stdout.write("\n" + json.dumps({"event": LEFT, "code": code}) + "\n")  # a line of its own, also after half a line of a killed process
        sys.stdout.flush()
        if not FORKS:
            return


def _one(arguments: Sequence[str]) -> int:
    """Exit code: 0, or 1 with the traceback on standard error."""
    folder = Path(arguments[0])
    try:
        main(folder, _ended(folder) if arguments[1:] else None)
    except BaseException:  # noqa: BLE001 - nothing of a fork may return into the loop of its parent
        traceback.print_exc()
        return 1
    finally:
        sys.stdout.flush()
    return 0


if __name__ == "__main__":
    serve()
