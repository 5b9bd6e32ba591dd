"""The whole quick run: every experiment, every file that the issue names, a page that tells all of it, and the beam converted from each cloud."""

import csv
import re

from scan2fea.thesis import EXPERIMENTS, ThesisOptions, clouds, meshes, results, run_thesis, unposed
from scan2fea.thesis.registry import REPRINTED

FIGURES = [f"F2.{k}" for k in range(4, 21) if f"F2.{k}" not in REPRINTED] + [f"F3.{k}" for k in range(1, 7)] + [f"F4.{k}" for k in range(1, 54)]
TABLES = ["T3.1", "T3.2", *(f"T4.{k}" for k in range(1, 8))]


def rows_of(path):
    with path.open(encoding="utf-8", newline="") as stream:
        return list(csv.DictReader(stream))


def make_it_smaller(monkeypatch):
    """Than a quick run is anyway, where a size is all that differs: a shorter stretch, fewer iterations and sweeps."""
    monkeypatch.setattr(clouds, "QUICK_LENGTH_M", 0.06)
    for module in (meshes, results):  # the page tells it
        monkeypatch.setattr(module, "QUICK_ITERATIONS", 12)
    monkeypatch.setattr(unposed, "shares", lambda _: (20,))


def test_the_whole_quick_run(tmp_path, monkeypatch):
    """One test, so that no two workers make it twice."""
    make_it_smaller(monkeypatch)
    out = tmp_path / "out"
    made = run_thesis(out, ThesisOptions(quick=True))
    assert {name: item.failed for name, item in made.items() if item.failed} == {}
    assert set(made) == set(EXPERIMENTS)
    asked = {f"{name}.png" for name in FIGURES} | {f"{name}.csv" for name in TABLES}
    assert asked <= {path.name for path in out.iterdir()}
    page = (out / "thesis.html").read_text(encoding="utf-8")
    assert all(f'id="{name}"' in page for name in EXPERIMENTS) and "Not run here" not in page and "Not made" not in page
    assert not re.findall(r"""(?:src|href)=["'](?!data:|#)""", page)
    for table in ("T4.1", "T4.2", "T4.3", "T4.4", "T4.5", "T4.6", "T4.7"):
        best = next(row for row in rows_of(out / f"{table}.csv") if row["whose"] == "ours, best route")
        assert best["converts"] == "yes" and abs(float(best["volume / true"]) - 1) < 0.05, table
    beams = rows_of(out / "S5.2.csv")[2:]
    assert len(beams) == 3 and all(abs(float(row["error of the tip, %"])) < 10 for row in beams)
