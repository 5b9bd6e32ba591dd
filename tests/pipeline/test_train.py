"""`scan2fea train`: a user's labels make a forest that finds them again, the same bytes each time; kinds are told and decide nothing."""

import json

import numpy as np
import pytest

from scan2fea.cli.main import main
from scan2fea.io import InputOptions, read_scan, write_scan_ply
from scan2fea.pipeline.config import Config
from scan2fea.pipeline.kinds import kinds_of, names_of, with_kinds
from scan2fea.pipeline.objects import parts_of
from scan2fea.pipeline.scene import place_all
from scan2fea.pipeline.segment_rows import segment_rows
from scan2fea.pipeline.train import TrainOptions, judged, looks_of_kinds, train
from scan2fea.segmentation import Selection, SelectOptions, select
from scan2fea.segmentation.kinds import Guess
from scan2fea.segmentation.weights import read_weights, shipped_weights
from scan2fea.types import PointCloud, Scan, Segments


def yard(seed):
    """A level floor (7) and four upright posts (9)."""
    rng = np.random.default_rng(seed)
    floor = np.c_[rng.uniform(0, 3, (6000, 2)), np.zeros(6000)]
    posts = [np.c_[0.06 * rng.uniform(-1, 1, (700, 2)) + at, rng.uniform(0.02, 2, 700)] for at in rng.uniform(0.5, 2.5, (4, 2))]
    points = np.concatenate([floor, *posts])
    return points + 1e-3 * rng.standard_normal(points.shape), np.repeat([7, 9], [6000, 2800])


@pytest.fixture(scope="module")
def labelled(tmp_path_factory):
    folder = tmp_path_factory.mktemp("yards")
    paths = []
    for seed in (0, 1):
        points, label = yard(seed)
        paths.append(folder / f"yard{seed}.ply")
        write_scan_ply(paths[-1], Scan(cloud=PointCloud.of(points, label=label)))
    return paths


def test_a_users_labels_are_learned_and_found_again(labelled, tmp_path, capsys):
    outs = [tmp_path / "one.npz", tmp_path / "two.npz"]
    for out in outs:
        assert main(["train", str(labelled[0]), "-o", str(out), "--labels", "label", "--names", "floor,post", "--objects", "0"]) == 0
    assert "classes of points: " in capsys.readouterr().out
    assert outs[0].read_bytes() == outs[1].read_bytes()
    report = json.loads(outs[0].with_suffix(".json").read_text())
    assert report["points"]["accuracy"] > 0.95 and "objects" not in report
    weights = read_weights(outs[0])
    assert weights.forest.classes == ("floor", "post")
    shipped = shipped_weights().network
    assert all(np.array_equal(weights.network.params[name], shipped.params[name]) for name in shipped.params)
    found = tmp_path / "found"
    assert main(["segment", str(labelled[1]), "-o", str(found), "--method", "learned", "--set", f"segmentation.weights={outs[0]}"]) == 0
    rows = json.loads((found / "report.json").read_text())["segments"]
    assert [row["role"] for row in rows] == ["support"] + ["object"] * 4
    assert rows[0]["kind"] == "floor" and rows[0]["n_points"] > 5500


@pytest.mark.parametrize(
    ("options", "code", "told"),
    [
        (["-o", "w.txt"], 2, "weights are written as .npz"),
        (["-o", "w.npz", "--names", "a,b,c"], 2, "--names gives 3 names, but the files have 2 classes (7, 9)"),
        (["-o", "w.npz", "--epochs", "-1"], 2, "numbers from 0 up; one is -1"),
        (["-o", "w.npz", "--base", "none.npz"], 3, "none.npz cannot be read"),
    ],
)
def test_bad_orders_are_told_in_one_line(labelled, tmp_path, monkeypatch, capsys, options, code, told):
    monkeypatch.chdir(tmp_path)
    assert main(["train", str(labelled[0]), "--labels", "label", "--objects", "0", *options]) == code
    said = capsys.readouterr().err.splitlines()[-1]
    assert told in said
    assert not list(tmp_path.glob("w.*"))


def test_files_without_labels_are_told(tmp_path):
    path = tmp_path / "bare.ply"
    write_scan_ply(path, Scan(cloud=PointCloud.of(yard(0)[0])))
    with pytest.raises(Exception, match=r"bare\.ply: no point has a label: name the column with --labels"):
        train([path], tmp_path / "w.npz", TrainOptions(objects=0), InputOptions())


def test_the_network_is_trained_the_same_each_time(tmp_path):
    outs = [tmp_path / "one.npz", tmp_path / "two.npz"]
    for out in outs:
        report = train([], out, TrainOptions(objects=1, rooms=0, epochs=1), InputOptions())
    assert outs[0].read_bytes() == outs[1].read_bytes()
    assert report["objects"]["n_trained"] == 27 and np.sum(report["objects"]["confusion"]) == 27


def test_the_shipped_network_names_objects_it_has_not_seen():
    figures = judged(shipped_weights().network, looks_of_kinds(300_000, 3))
    assert figures["n_tested"] == 81 and figures["accuracy"] >= 0.85
    assert sum(row["n"] for row in figures["reliability"]) == 81


def two_things(tmp_path):
    rng = np.random.default_rng(0)
    points, _ = yard(0)
    path = tmp_path / "yard.ply"
    write_scan_ply(path, Scan(cloud=PointCloud.of(points)))
    scene = place_all((read_scan(path),), Config().registration, names=["yard.ply"])
    labels = np.repeat([0, 1], [6000, 2800])
    return scene, labels, rng


def test_kinds_are_told_selected_by_and_no_part_of_what_is_modelled(tmp_path):
    scene, labels, _ = two_things(tmp_path)
    plain = Segments(labels=labels, kinds=("support", "object"), how={})
    named = Segments(labels=labels, kinds=("support", "object"), how={}, named=("wall", "C"))
    guesses, given = kinds_of(scene, plain), kinds_of(scene, named)
    assert guesses[0].kind == "floor" and guesses[0].source == "support" and guesses[1].source == "network"
    assert [(guess.kind, guess.source) for guess in given] == [("wall", "user"), ("C", "user")]
    options = SelectOptions(kinds=("C",))
    assert select(scene.scan.cloud, named, options, names=names_of(named, given)).labels == (1,)
    assert select(scene.scan.cloud, named, SelectOptions(kinds=("wall",)), names=names_of(named, given)).labels == (0,)
    chosen = select(scene.scan.cloud, named, names=names_of(named, given))
    assert chosen.labels == (1,) and "a wall, which bounds the rest (select.kinds)" in chosen.why[0]
    rows = segment_rows(scene.scan.cloud, named, chosen, given)
    assert [(row["role"], row["kind"], row["object"]) for row in rows] == [("support", "wall", None), ("object", "C", 1)]
    one, other = (parts_of(scene, segments, Selection(labels=(1,), notes=()), Config()) for segments in (plain, named))
    assert one[0].kind == other[0].kind == "object"  # the guess does not reach the process that models it


def test_an_object_that_was_built_as_a_member_has_its_kind():
    chosen = Selection(labels=(4, 2), notes=())
    guesses = [Guess(kind="unknown", confidence=0.3)] * 5
    guesses[2], guesses[4] = Guess(kind="box", confidence=0.91), Guess(kind="I", confidence=0.87654)
    rows = with_kinds([{"id": 1, "member": {"family": "CHS"}}, {"id": 2}], chosen, guesses)
    assert [row["kind"] for row in rows] == ["pipe", "box"]
    assert rows[0]["guess"] == {"kind": "I", "confidence": 0.876, "source": "network"}


def test_what_was_converted_as_no_member_is_no_angle_and_no_clutter():
    said = (("L", "network"), ("clutter", "network"), ("box", "network"), ("L", "user"))
    guesses = [Guess(kind=kind, confidence=0.9, source=source) for kind, source in said]
    chosen = Selection(labels=(0, 1, 2, 3), notes=(), why={})
    converted = with_kinds([{"id": k, "verdict": "converted"} for k in (1, 2, 3, 4)], chosen, guesses)
    assert [row["kind"] for row in converted] == ["free form", "free form", "box", "L"]
    assert [row["guess"]["kind"] for row in converted] == ["L", "clutter", "box", "L"]
    assert with_kinds([{"id": 1, "verdict": "failed"}], chosen, guesses)[0]["kind"] == "L"
    assert with_kinds([{"id": 1, "verdict": "converted", "member": {"family": "rect"}}], chosen, guesses)[0]["kind"] == "rectangular bar"
