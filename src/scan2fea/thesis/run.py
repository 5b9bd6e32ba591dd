"""The experiments one after the other: what is unchanged is not run again, what fails says why and takes no other along."""

from __future__ import annotations

import csv
import hashlib
import io
import json
import math
import time
from collections.abc import Callable, Mapping, Sequence
from functools import partial
from pathlib import Path
from typing import Any

from scan2fea.errors import Scan2FeaError, UsageError, require
from scan2fea.io import write_text
from scan2fea.io.files import write_bytes
from scan2fea.pipeline.record import key_of
from scan2fea.thesis.bench import Bench, ThesisOptions
from scan2fea.thesis.canvas import told
from scan2fea.thesis.chores import Workers, done, in_turn
from scan2fea.thesis.experiment import Cell, Experiment, Made, Table
from scan2fea.thesis.page import render_page
from scan2fea.thesis.registry import EXPERIMENTS, chosen

KEEP, PAGE = ".thesis", "thesis.html"
Say = Callable[[Mapping[str, Any]], None]


def run_thesis(
    out: Path, options: ThesisOptions = ThesisOptions(), only: str | None = None, say: Say | None = None, jobs: int = 1
) -> dict[str, Made]:
    """Make the experiments (`only`: numbers, by commas) in `out`: thesis.html, a CSV per table, a PNG per figure. Returns what came of each.

    jobs : processes that work at once; the results do not depend on it.
    The page shows all experiments that `out` holds. Raises UsageError for an unknown number, a folder of somebody else and no jobs.
    """
    require(jobs >= 1, UsageError, f"--jobs {jobs}: at least 1")
    wanted = chosen(only)
    _prepare(out)
    tell: Say = say or (lambda _: None)
    bench = Bench(folder=out / KEEP / "kept", options=options)
    kept = {experiment.id: found for experiment in wanted if (found := _kept(out, experiment, options)) is not None}
    todo = [experiment for experiment in wanted if experiment.id not in kept]
    for name in kept:
        tell({"event": "end", "id": name, "seconds": 0.0, "kept": True, "failed": ""})
    fresh = _at_once(bench, out, todo, tell, jobs) if jobs > 1 and len(todo) > 1 else _in_order(bench, out, todo, tell)
    made = {experiment.id: {**kept, **fresh}[experiment.id] for experiment in wanted}
    page = {name: item for name, experiment in EXPERIMENTS.items() if (item := made.get(name) or _kept(out, experiment, options)) is not None}
    write_text(out / PAGE, render_page(page, options))
    return made


def _in_order(bench: Bench, out: Path, todo: Sequence[Experiment], tell: Say) -> dict[str, Made]:
    made = {}
    for number, experiment in enumerate(todo, 1):
        tell({"event": "begin", "id": experiment.id, "title": experiment.title, "number": number, "of": len(todo)})
        began = time.perf_counter()
        made[experiment.id] = found = _made_and_written(out, bench, experiment.id)
        tell({"event": "end", "id": experiment.id, "seconds": time.perf_counter() - began, "kept": False, "failed": found.failed})
    return made


def _at_once(bench: Bench, out: Path, todo: Sequence[Experiment], tell: Say, jobs: int) -> dict[str, Made]:
    """First what several share, then the experiments, by `jobs` processes."""
    made = {}
    groups = in_turn(chore for experiment in todo for chore in experiment.needs(bench.options))
    n_chores, began, ended = sum(map(len, groups)), time.perf_counter(), 0
    with Workers(bench, jobs) as workers:
        for group in groups:
            for chore, _ in workers.each(done, group):
                ended += 1
                tell({"event": "chore", "id": " ".join(chore), "number": ended, "of": n_chores})
        for name, found in workers.each(partial(_made_and_written, out), [experiment.id for experiment in todo]):
            made[name] = found
            tell({"event": "end", "id": name, "seconds": time.perf_counter() - began, "kept": False, "failed": found.failed})
    return made


def _made_and_written(out: Path, bench: Bench, name: str) -> Made:
    experiment = EXPERIMENTS[name]
    found = _made(experiment, bench)
    _write(out, experiment, found, bench.options)
    return found


def _prepare(out: Path) -> None:
    require(not out.exists() or out.is_dir(), UsageError, f"{out}: is a file; give a folder with -o")
    if out.is_dir() and any(out.iterdir()) and not (out / KEEP).is_dir():
        raise UsageError(f"{out}: holds files that are not of `scan2fea thesis`; give an empty or new folder with -o")
    try:
        (out / KEEP).mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise UsageError(f"{out}: cannot be written ({error.strerror}); give another folder with -o") from error


def _made(experiment: Experiment, bench: Bench) -> Made:
    try:
        return experiment.make(bench)
    except Scan2FeaError as error:
        return Made(failed=str(error))
    except Exception as error:  # noqa: BLE001 - one experiment of ours that breaks must not take the other ninety along; it is told as broken
        return Made(failed=f"internal fault ({type(error).__name__}: {error})")


def _key(experiment: Experiment, options: ThesisOptions) -> str:
    return key_of("experiment", experiment.id, options.tree())


def _names(experiment: Experiment) -> tuple[str, str]:
    """Names of the picture and of the table."""
    return f"{experiment.id}.png", f"{experiment.id}.csv"


def _write(out: Path, experiment: Experiment, made: Made, options: ThesisOptions) -> None:
    """The files of an experiment, and the note by which it is known again; a failed one is tried again next time."""
    picture, table = _names(experiment)
    files: dict[str, bytes] = {}
    if made.picture or experiment.id.startswith("F"):
        files[picture] = made.picture or told(f"{experiment.id} was not made: {made.failed}")
    if made.table is not None or experiment.id.startswith("T"):
        files[table] = as_csv(made.table or Table(head=("failed",), rows=((made.failed,),)))
    for name, content in files.items():
        write_bytes(out / name, content)
    note = out / KEEP / f"{experiment.id}.json"
    if made.failed:
        note.unlink(missing_ok=True)
        return
    known = {name: hashlib.sha256(content).hexdigest() for name, content in files.items()}
    tree: dict[str, Any] = {"key": _key(experiment, options), "files": known, "says": list(made.says)}
    tree["table"] = None if made.table is None else {"head": list(made.table.head), "rows": [[_plain(c) for c in row] for row in made.table.rows]}
    write_text(note, json.dumps(tree, indent=1) + "\n")


def _kept(out: Path, experiment: Experiment, options: ThesisOptions) -> Made | None:
    """What an earlier run made, where its inputs and its files are unchanged."""
    note = out / KEEP / f"{experiment.id}.json"
    try:
        tree = json.loads(note.read_text(encoding="utf-8"))
        if tree["key"] != _key(experiment, options):
            return None
        contents = {name: (out / name).read_bytes() for name in tree["files"]}
        if any(hashlib.sha256(content).hexdigest() != tree["files"][name] for name, content in contents.items()):
            return None
        table = tree["table"]
        rows = None if table is None else Table(head=tuple(table["head"]), rows=tuple(tuple(row) for row in table["rows"]))
        return Made(picture=contents.get(_names(experiment)[0], b""), table=rows, says=tuple(tree["says"]))
    except (OSError, ValueError, KeyError, TypeError):
        return None


def as_csv(table: Table) -> bytes:
    """UTF-8, comma, a head line; nothing where nothing is told, yes and no for truth."""
    stream = io.StringIO()
    writer = csv.writer(stream, lineterminator="\n")
    writer.writerow(table.head)
    for row in table.rows:
        writer.writerow([_text(cell) for cell in row])
    return stream.getvalue().encode()


def _text(cell: Cell) -> str:
    if cell is None or (isinstance(cell, float) and not math.isfinite(cell)):
        return ""
    if isinstance(cell, bool):
        return "yes" if cell else "no"
    return f"{cell:.6g}" if isinstance(cell, float) else str(cell)


def _plain(cell: Any) -> Any:
    """As JSON can hold it and give it back."""
    if isinstance(cell, float):
        return cell if math.isfinite(cell) else None
    return cell.item() if hasattr(cell, "item") else cell
