"""The page as a whole: order, escaping, self-containment, and partial or damaged output."""

from __future__ import annotations

import copy
import json
import re
from html.parser import HTMLParser
from pathlib import Path

import numpy as np
import pytest

from report.fake_out import angle_solid, boundary_of, plane, ring, scattered
from report.fake_report import CONVERTED, HOSTILE, fake_report
from scan2fea.errors import FormatError, InputError, UsageError
from scan2fea.report.html import _came_in, _kind, render_page, write_report
from scan2fea.report.saved import Saved
from scan2fea.types import PointCloud

ANGLE = angle_solid()
SKIN, RING = boundary_of(ANGLE), ring()
CLOUDS = {1: scattered(SKIN, 3000, 0.0005, 1), 2: plane(np.array([1.9, 1.9, 0.75]), 0.6, 0.4, 900, 3), 3: scattered(RING, 3000, 0.0005, 2)}


class InMemory(Saved):
    """An output folder whose geometry is at hand."""

    def scene(self):
        return PointCloud.of(np.concatenate([cloud.points for cloud in CLOUDS.values()]))

    def cloud(self, item):
        return CLOUDS.get(item["id"])

    def surface(self, item):
        return {1: SKIN, 3: RING}.get(item["id"])

    def solid(self, item):
        return ANGLE if item["id"] == 1 else None


class NoPictures(Saved):
    """Where only the text is looked at."""

    def scene(self):
        return None

    cloud = surface = solid = lambda self, item: None


class Reader(HTMLParser):
    """Collects tags, addresses and text; complains about elements that do not nest."""

    def __init__(self, page):
        super().__init__()
        self.tags, self.addresses, self.words, self.open, self.images = [], [], [], [], []
        self.feed(page)
        assert not self.open, self.open

    def handle_starttag(self, tag, attrs):
        attributes = dict(attrs)
        assert len(attributes) == len(attrs), f"an attribute of {tag} is repeated"
        assert not any(name.startswith("on") for name in attributes)
        self.tags.append((tag, attributes))
        self.addresses += [attributes[name] for name in ("href", "src") if attributes.get(name)]
        self.images += [attributes] if tag == "img" else []
        if tag not in {"meta", "img", "br", "hr", "link"}:
            self.open.append(tag)

    def handle_startendtag(self, tag, attrs):
        self.tags.append((tag, dict(attrs)))

    def handle_endtag(self, tag):
        assert self.open.pop() == tag

    def handle_data(self, data):
        self.words.append(data)

    def ids(self):
        return [attributes["id"] for _, attributes in self.tags if "id" in attributes]

    def text(self):
        return " ".join(self.words)


def saved(tmp_path, report=None):
    return NoPictures(out=tmp_path, report=report or fake_report())


@pytest.fixture(scope="module")
def page():
    return render_page(InMemory(out=Path("nowhere"), report=fake_report()))


def test_page_has_everything_in_order(page):
    marks = [
        "1 of 3 objects converted",
        "How to repeat",
        "Overview",
        "The scene",
        "first mode, Hz",
        'id="object-1"',
        "What was seen",
        "Inside the mesh",
        "Self weight",
        "Mode 1, 412.5 Hz",
        "Mode 2, 431.2 Hz",
        "<h3>Checks",
        'id="object-2"',
        'id="object-3"',
        "How it was done",
        "Options that differ from their defaults",
        "What was assumed",
        "Glossary",
    ]
    places = [page.index(mark) for mark in marks]
    assert places == sorted(places)


def test_page_stands_alone_and_runs_nothing(page):
    read = Reader(page)
    names = {name for name, _ in read.tags}
    assert not names & {"script", "iframe", "object", "embed", "form", "base", "link"}
    for address in read.addresses:
        assert address.startswith(("data:image/png;base64,", "#", "./")), address
    assert "url(" not in page and "@import" not in page
    assert any(attributes.get("http-equiv") == "Content-Security-Policy" for _, attributes in read.tags)
    assert 'lang="en"' in page and 'name="viewport"' in page


def test_hostile_names_stay_names(page):
    assert "<script" not in page
    folder, _, name = HOSTILE.rpartition("/")
    assert folder in Reader(page).text() and name in Reader(page).text()


def test_every_picture_has_words_and_a_scale(page):
    read = Reader(page)
    assert len(read.images) == 1 + 10 + 1 + 3  # the scene, the angle, the plate, the ring (open: no thickness)
    assert all(len(image["alt"]) > 10 and int(image["width"]) and int(image["height"]) for image in read.images)
    assert page.count('class="scale"') == len(read.images)


def test_numbers_of_the_scene_lead_to_the_objects(page):
    read = Reader(page)
    pins = [a["href"] for name, a in read.tags if name == "a" and "pin" in a.get("class", "")]
    assert pins == ["#object-1", "#object-2", "#object-3"]
    assert {pin[1:] for pin in pins} <= set(read.ids()) and len(set(read.ids())) == len(read.ids())


def test_failed_checks_come_first_and_say_what_to_do(tmp_path):
    report = fake_report()
    report["objects"] = report["objects"][1:2]
    report["objects"][0]["checks"].reverse()
    words = re.sub(r"\s+", " ", Reader(render_page(saved(tmp_path, report))).text())
    assert "What would make it convert scan it from below as well" in words
    assert words.index("seen from both sides 0.48 0.3") < words.index("points 5 121")


def test_same_input_same_bytes(tmp_path, page):
    before = copy.deepcopy(fake_report())
    report = fake_report()
    assert render_page(InMemory(out=tmp_path, report=report)) == page
    assert report == before


def test_only_files_that_exist_are_linked(tmp_path):
    (tmp_path / "objects/01").mkdir(parents=True)
    (tmp_path / "objects/01/model.step").write_text("x", encoding="utf-8")
    (tmp_path / "config.toml").write_text("", encoding="utf-8")
    made = render_page(saved(tmp_path))
    assert made.count('href="./objects/01/model.step"') == 2  # in the table and in the section
    assert "model.inp" not in made and 'href="./config.toml"' in made and "log.jsonl" not in made


@pytest.mark.parametrize(
    "spoil", [lambda r: r.update(objects=[]), lambda r: r.update(objects=r["objects"][1:]), lambda r: [r.pop(k) for k in list(r)]]
)
def test_partial_reports_make_a_page(tmp_path, spoil):
    report = fake_report()
    spoil(report)
    (tmp_path / "report.json").write_text(json.dumps(report), encoding="utf-8")
    path = write_report(tmp_path)
    assert path == tmp_path / "report.html"
    Reader(path.read_text(encoding="utf-8"))


@pytest.mark.parametrize("key", sorted(CONVERTED))
def test_a_converted_object_without_one_of_its_records_makes_a_page(tmp_path, key):
    report = fake_report()
    report["objects"] = report["objects"][:1]
    for spoilt in (lambda o: o.pop(key), lambda o: o.update({key: None})):
        item = copy.deepcopy(CONVERTED)
        spoilt(item)
        report["objects"] = [item]
        words = Reader(render_page(saved(tmp_path, report))).text()
        assert ("could not be converted" in words) == (key == "verdict")


def test_damaged_files_are_told_and_left_out(tmp_path):
    folder = tmp_path / "objects/01"
    folder.mkdir(parents=True)
    for name in ("cloud.ply", "surface.ply", "volume.vtu"):
        (folder / name).write_bytes(b"ply\nformat nonsense\xff")
    (tmp_path / "cloud.ply").write_bytes(b"")
    (tmp_path / "report.json").write_text(json.dumps(fake_report()), encoding="utf-8")
    words = Reader(write_report(tmp_path).read_text(encoding="utf-8")).text()
    assert words.count("could not be drawn") == 4


def test_missing_and_damaged_report(tmp_path):
    with pytest.raises(InputError):
        write_report(tmp_path)
    (tmp_path / "report.json").write_text("{", encoding="utf-8")
    with pytest.raises(FormatError):
        write_report(tmp_path)
    (tmp_path / "report.json").write_text("{}", encoding="utf-8")
    (tmp_path / "report.html").mkdir()
    with pytest.raises(UsageError, match=r"report\.html"):
        write_report(tmp_path)


def test_members_show_what_was_not_observed(tmp_path):
    report = fake_report()
    report["objects"] = report["objects"][:1]
    report["objects"][0]["member"] = {
        "family": "L",
        "parameters": {"a": {"value_m": 0.12724, "std_m": 0.0004, "observable": True}, "t": {"value_m": 0.00635, "std_m": None, "observable": False}},
        "catalogue": [{"name": "L 127x127x6.35", "probability": 0.71}, {"name": "<b>", "probability": 0.2}],
        "residual": 0.1,
        "damage": [],
    }
    words = Reader(render_page(saved(tmp_path, report))).text()
    assert "127.2 \u00b1 0.4 mm" in words and "not observable: from the catalogue" in words and "Built with t from a catalogue" in words
    assert "71 %" in words


def test_many_stages_are_summed(tmp_path):
    report = fake_report()
    report["stages"] = [{"name": "tets", "object": k, "seconds": 1.0, "peak_mb": float(k), "n_in": 2, "n_out": 3, "options": {}} for k in range(70)]
    words = re.sub(r"\s+", " ", Reader(render_page(saved(tmp_path, report))).text())
    assert "tets all 140 210 70 69" in words


def test_pictures_shrink_when_there_are_very_many(tmp_path):
    report = fake_report()
    report["objects"] = [dict(report["objects"][1], id=2) for _ in range(80)]
    made = Reader(render_page(InMemory(out=tmp_path, report=report)))
    assert {image["width"] for image in made.images[1:]} == {"350"}


def top_of(n: int, **more: object) -> str:
    rows = [{"path": f"in/{k:02d}.ply", "n_points": 10, "used": k != 3, "reason": "empty" if k == 3 else "", "unit": "m", **more} for k in range(n)]
    return str(_came_in(rows))


def test_many_inputs_are_one_sentence_and_what_was_left_out():
    assert top_of(4).count("<tr") == 5
    many = top_of(9, unit_source="assumed", sensor="known")
    assert "9 inputs, 00.ply to 08.ply: 90 points, unit m (ASSUMED), sensor position known" in many and "no: empty" in many
    assert many.count("<tr") == 2 and "05.ply" not in many


def test_a_probability_is_told_only_of_the_kind_it_belongs_to():
    item = {"kind": "free form", "guess": {"kind": "L", "confidence": 0.999}}
    assert "%" not in str(_kind(item, 0)) and "99.9 %" in str(_kind({**item, "kind": "L"}, 0))
