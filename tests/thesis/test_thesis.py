"""The experiments: every number of the thesis is there, what they give is whole, the same twice, and one that fails takes no other along."""

import csv
import dataclasses
import hashlib
import io
import json
import re
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from scan2fea.errors import MeshingError, UsageError
from scan2fea.kernel.quality import TRIANGLE_LIMITS
from scan2fea.thesis import EXPERIMENTS, ThesisOptions, results, run, run_thesis
from scan2fea.thesis.bench import Bench
from scan2fea.thesis.canvas import told
from scan2fea.thesis.chain import Step
from scan2fea.thesis.chores import KINDS, done, in_turn
from scan2fea.thesis.clouds import BEAM, DENSE_M, beam_points, beam_solid, treated
from scan2fea.thesis.conclusion import cases_of
from scan2fea.thesis.experiment import Table
from scan2fea.thesis.measured import measured
from scan2fea.thesis.page import CHAPTERS
from scan2fea.thesis.published import blanks, printed_tables
from scan2fea.thesis.registry import REPRINTED, chosen
from scan2fea.thesis.results import HEAD, largest_part
from scan2fea.types import TriangleMesh

QUICK = ThesisOptions(quick=True)
ASKED = (
    [f"F2.{k}" for k in (4, 5, 6, 7, 8, 9, 11, 13, 16, 17, 18, 19, 20)] + [f"F3.{k}" for k in range(1, 7)] + [f"F4.{k}" for k in range(1, 54)]
    + ["T3.1", "T3.2"] + [f"T4.{k}" for k in range(1, 8)]
)  # fmt: skip
CUBE = TriangleMesh(
    vertices=np.array([[x, y, z] for x in (0.0, 1.0) for y in (0.0, 1.0) for z in (0.0, 1.0)]),
    faces=np.array(["013", "032", "467", "475", "045", "051", "237", "276", "026", "064", "157", "173"]).view("U1").reshape(12, 3).astype(np.int64),
)


def hashes(folder: Path) -> dict[str, str]:
    return {p.name: hashlib.sha256(p.read_bytes()).hexdigest() for p in sorted(folder.iterdir()) if p.is_file()}


class TestRegistry:
    def test_every_number_is_there(self):
        assert set(ASKED) <= set(EXPERIMENTS)
        assert not set(REPRINTED) & set(EXPERIMENTS)

    def test_no_figure_of_chapters_2_to_4_is_forgotten(self):
        known = set(EXPERIMENTS) | set(REPRINTED)
        assert {f"F2.{k}" for k in range(1, 21)} <= known

    def test_sections_rise(self):
        sections = [tuple(int(part) for part in e.section.split(".")) for e in EXPERIMENTS.values() if e.section[0].isdigit()]
        assert sections == sorted(sections)

    def test_only_keeps_the_order_of_the_thesis(self):
        assert [e.id for e in chosen("t4.1, F2.4,F4.9")] == ["F2.4", "T4.1", "F4.9"]

    @pytest.mark.parametrize(("only", "says"), [("F9.9", "F9.9: no such experiment"), ("F2.10", "reprints it"), (",", "names nothing")])
    def test_an_unknown_number_is_told(self, only, says):
        with pytest.raises(UsageError, match=says):
            chosen(only)


class TestChores:
    @pytest.mark.parametrize("options", [QUICK, ThesisOptions()])
    def test_every_one_is_of_a_known_kind_and_follows_what_it_needs(self, options):
        groups = in_turn(chore for e in EXPERIMENTS.values() for chore in e.needs(options))
        every = [chore for group in groups for chore in group]
        assert len(every) == len(set(every)) and {chore[0] for chore in every} <= set(KINDS)
        place = {chore: k for k, group in enumerate(groups) for chore in group}
        for kind, *case in every:
            if kind in ("first", "chain", "held"):
                assert place["beam", case[0]] < place[(kind, *case)]
                assert case[1] == "AF" or place["normals", case[0]] < place[(kind, *case)]
        assert {("best", case) for case in cases_of(options)} <= set(every)

    def test_a_quick_run_prepares_less(self):
        count = [len({c for e in EXPERIMENTS.values() for c in e.needs(o)}) for o in (QUICK, ThesisOptions())]
        assert count[0] < count[1]

    def test_one_that_cannot_be_made_is_left_to_its_experiments(self, tmp_path, monkeypatch):
        asked = []

        def bad(*_):
            asked.append("lab")
            raise MeshingError("no")

        monkeypatch.setitem(KINDS, "lab", bad)
        bench = Bench(folder=tmp_path, options=QUICK)
        done(bench, ("lab",))  # is told by the experiments that need it
        assert asked == ["lab"]

        def broken(*_):
            raise ZeroDivisionError

        monkeypatch.setitem(KINDS, "lab", broken)
        with pytest.raises(ZeroDivisionError):  # a fault of ours is not hidden
            done(bench, ("lab",))


class TestPublished:
    def test_rows_of_the_tables(self):
        assert list(printed_tables()) == [f"T4.{k}" for k in range(1, 8)]
        assert [len(table.rows) for table in printed_tables().values()] == [4, 6, 3, 4, 3, 4, 2]

    def test_a_row_that_stands_twice_is_the_same(self):
        first = {(r.mesh, r.stage): r for r in printed_tables()["T4.1"].rows}
        assert all(first[r.mesh, r.stage] == r for r in printed_tables()["T4.2"].rows if (r.mesh, r.stage) in first)
        optimised = [r.measures() for r in printed_tables()["T4.6"].rows if r.stage == "optimised"]
        assert optimised == [r.measures() for r in printed_tables()["T4.7"].rows]

    def test_all_but_the_known_slip_obey_the_bounds_of_triangles(self):
        every = [(name, r) for name, t in printed_tables().items() for r in t.rows]
        above = [(name, r.q3) for name, r in every if r.q3 > TRIANGLE_LIMITS["Q3"].best]
        assert above == [("T4.2", 1.333)]
        # the least of Q3 = Q1 Q2 is not below the product of the least ones; four digits are printed
        assert all(r.q3 >= r.q1 * r.q2 - 1e-4 for _, r in every)
        assert all(r.q1 <= 3**0.5 and r.q4 <= 1 and r.q2 <= 0.5 for _, r in every)


    def test_every_blank_is_answered_by_experiments(self):
        sections = [tuple(int(part) for part in blank.section.split(".")) for blank in blanks()]
        assert sections == sorted(sections) and all(blank.at for blank in blanks())
        assert {name for blank in blanks() for name in blank.at} <= set(EXPERIMENTS)


class TestChanged:
    def step(self, mesh, nodes=None, tets=()):
        empty = np.zeros((0, 3)) if nodes is None else nodes
        return Step(name="", mesh=mesh, nodes=empty, tets=np.array(tets, np.int64).reshape(-1, 4), done="", dihedral_deg=float("nan"))

    def test_vertices_that_move_are_counted(self):
        moved = CUBE.vertices.copy()
        moved[3] += [0.002, 0, 0]
        (says,) = results.changed(self.step(CUBE), self.step(dataclasses.replace(CUBE, vertices=moved)))
        assert "1 of 8 vertices of the surface moved, by 0 mm in the median, 2 mm at most; least Q3" in says

    def test_exudation_joins_other_nodes_and_moves_none(self):
        nodes = np.random.default_rng(0).random((5, 3))
        before, after = self.step(CUBE, nodes, [[0, 1, 2, 3], [1, 2, 3, 4]]), self.step(CUBE, nodes, [[3, 2, 1, 0], [0, 1, 2, 4]])
        (says,) = results.changed(before, after)
        assert "0 of 8 vertices of the surface moved; 0 of 5 nodes of the tets moved, 1 of 2 tets join other nodes than before" in says


class TestMeasured:
    def test_a_cube(self):
        m = measured(CUBE)
        assert m.converts and (m.n_shells, m.n_half_edges, m.n_crossings) == (1, 0, 0)
        assert m.volume_m3 == pytest.approx(1) and m.wall_m == pytest.approx(1)
        assert m.q[0] == pytest.approx(2**0.5) and m.q[3] == pytest.approx(0.5**0.5)  # right isosceles: lmin / R, lmin / lmax

    def test_a_cube_without_a_face_is_open(self):
        m = measured(dataclasses.replace(CUBE, faces=CUBE.faces[1:]))
        assert m.reason == "3 open edges" and m.volume_m3 is None and m.wall_m is None

    def test_two_cubes_are_two_shells_and_the_larger_one_is_kept(self):
        two = TriangleMesh(vertices=np.concatenate([CUBE.vertices, 0.5 * CUBE.vertices + 3]), faces=np.concatenate([CUBE.faces, CUBE.faces + 8]))
        assert measured(two).reason == "2 shells"
        kept, n_cut = largest_part(two)
        assert n_cut == 1 and measured(kept).volume_m3 == pytest.approx(1)

    def test_inside_out_encloses_nothing(self):
        assert measured(dataclasses.replace(CUBE, faces=CUBE.faces[:, ::-1])).reason == "it encloses no volume"


class TestClouds:
    @pytest.fixture(scope="class")
    @staticmethod
    def bench(tmp_path_factory):
        return Bench(folder=tmp_path_factory.mktemp("kept"), options=QUICK)

    def test_the_quick_beam_has_the_section_of_the_whole_one(self, bench):
        shape = beam_solid(bench).shape
        assert shape.parameters == {"a": 0.127, "b": 0.127, "t": 0.00635, "length": 0.1}
        points = beam_points(bench, "zero")
        assert len(points) == pytest.approx((2 * 0.254 * 0.1 + 2 * 0.0015726) / DENSE_M**2, rel=0.03)

    def test_the_clusters_of_the_zero_noise_lab(self, bench):
        found = treated(bench, "zero")
        assert len(found.raw) == 114_808
        inside = found.labels == found.beam
        assert (found.true_label[inside] == BEAM).all() and (found.true_label == BEAM).sum() == inside.sum()

    def test_what_was_made_is_read_back(self, bench):
        other = Bench(folder=bench.folder, options=QUICK)
        assert np.array_equal(beam_points(other, "zero"), beam_points(bench, "zero"))
        with pytest.raises(MeshingError, match="once"):
            bench.kept("bad", lambda: (_ for _ in ()).throw(MeshingError("once")))
        with pytest.raises(MeshingError, match="once"):
            bench.kept("bad", lambda: 1)


class TestRun:
    FEW = "F2.11,F2.16,F2.17,F2.19,F2.20,F3.3,F4.5"

    @pytest.fixture(scope="class")
    @staticmethod
    def out(tmp_path_factory):
        out = tmp_path_factory.mktemp("thesis") / "out"
        made = run_thesis(out, QUICK, TestRun.FEW)
        assert not [item.failed for item in made.values() if item.failed]
        return out

    def test_files(self, out):
        assert set(hashes(out)) == {f"{name}.png" for name in TestRun.FEW.split(",")} | {"F2.19.csv", "thesis.html"}
        for path in out.glob("*.png"):
            with Image.open(path) as picture:
                assert picture.size[0] >= 500 and len(picture.convert("RGB").getcolors(1 << 24)) > 2

    def test_the_page_fetches_nothing_and_tells_every_number(self, out):
        page = (out / "thesis.html").read_text(encoding="utf-8")
        assert not re.findall(r"""(?:src|href)=["'](?!data:|#)""", page)
        assert all(f'id="{name}"' in page for name in TestRun.FEW.split(","))
        assert "Not run here: F2.4" in page
        assert all(f"<td data-label=\"what is asked there\">{blank.asks}</td>" in page for blank in blanks())
        links = set(re.findall(r'href="#([^"]+)"', page))
        assert links <= set(re.findall(r'id="([^"]+)"', page)) | {f"c{key}" for key in CHAPTERS}

    def test_the_same_bytes_again(self, out, tmp_path):
        run_thesis(tmp_path / "again", QUICK, TestRun.FEW)
        assert hashes(tmp_path / "again") == hashes(out)

    def test_what_is_unchanged_is_not_made_again_and_a_damaged_file_is(self, out):
        before, events = hashes(out), []
        (out / "F2.16.png").write_bytes(b"damaged")
        run_thesis(out, QUICK, TestRun.FEW, events.append)
        assert {e["id"]: e["kept"] for e in events if e["event"] == "end"} == {name: name != "F2.16" for name in TestRun.FEW.split(",")}
        assert hashes(out) == before

    def test_two_processes_make_the_same_bytes(self, out, tmp_path):
        events = []
        run_thesis(tmp_path / "again", QUICK, TestRun.FEW, events.append, jobs=2)
        assert hashes(tmp_path / "again") == hashes(out)
        assert [e["id"] for e in events if e["event"] == "chore"] == ["lab", "beam zero", "first zero AF"]

    def test_no_process_is_no_run(self, tmp_path):
        with pytest.raises(UsageError, match="--jobs 0"):
            run_thesis(tmp_path / "none", QUICK, TestRun.FEW, jobs=0)

    def test_one_that_fails_says_why_and_takes_no_other_along(self, tmp_path, monkeypatch):
        def bad(_):
            raise MeshingError("no tets today")

        def broken(_):
            return 1 / 0

        for name, make in (("T4.1", bad), ("F4.9", broken)):
            monkeypatch.setitem(run.EXPERIMENTS, name, dataclasses.replace(EXPERIMENTS[name], make=make))
        made = run_thesis(tmp_path / "out", QUICK, "F2.11,T4.1,F4.9")
        assert [made[name].failed for name in made] == ["", "no tets today", "internal fault (ZeroDivisionError: division by zero)"]
        assert list(csv.reader(io.StringIO((tmp_path / "out/T4.1.csv").read_text()))) == [["failed"], ["no tets today"]]
        assert (tmp_path / "out/F4.9.png").read_bytes() == told("F4.9 was not made: internal fault (ZeroDivisionError: division by zero)")
        assert "no tets today" in (tmp_path / "out/thesis.html").read_text(encoding="utf-8")

    def test_a_folder_of_somebody_else_is_left_alone(self, tmp_path):
        (tmp_path / "mine.txt").write_text("mine")
        with pytest.raises(UsageError, match="holds files that are not of"):
            run_thesis(tmp_path, QUICK, "F2.11")

    def test_cells_of_a_csv(self):
        table = Table(head=("a", "b"), rows=((True, 0.123456789), (None, float("nan")), ("x, y", 3)))
        assert run.as_csv(table).decode() == 'a,b\nyes,0.123457\n,\n"x, y",3\n'

    def test_the_note_holds_no_time(self, out):
        note = json.loads((out / ".thesis/F2.19.json").read_text())
        assert set(note) == {"key", "files", "says", "table"}


def test_rows_are_as_long_as_the_head():
    rows = [results._printed_row(row) for table in printed_tables().values() for row in table.rows]
    assert {len(row) for row in rows} == {len(HEAD)}
