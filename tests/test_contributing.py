"""The example of CONTRIBUTING.md is run as it stands there."""

import re
import types
from pathlib import Path

import numpy as np
import pytest

from scan2fea.errors import UsageError
from scan2fea.segmentation import SegmentationOptions, scene, segment_scene
from scan2fea.types import PointCloud, Scan

TEXT = (Path(__file__).parents[1] / "CONTRIBUTING.md").read_text(encoding="utf-8")


@pytest.fixture
def example():
    code = re.search(r"```python\n(.*?)```", TEXT, re.S)
    module = types.ModuleType("layers")
    exec(compile(code.group(1), "CONTRIBUTING.md", "exec"), module.__dict__)
    return module.layers


def two_layers():
    rng = np.random.default_rng(1)
    low = np.c_[rng.random((400, 2)), 0.01 * rng.random(400)]
    return PointCloud.of(np.r_[low, low + np.array([0, 0, 1.0])][rng.permutation(800)])


def test_example_separates_layers(example):
    cloud = two_layers()
    labels = example(cloud)
    assert np.array_equal(labels, (cloud.points[:, 2] > 0.5).astype(int))


def test_one_line_in_the_registry_makes_it_a_method(example, monkeypatch):
    monkeypatch.setattr(scene, "METHODS", {**scene.METHODS, "layers": example})
    segments = segment_scene(Scan(cloud=two_layers()), SegmentationOptions(method="layers", supports=False))
    assert sorted(np.bincount(segments.labels)) == [400, 400]


def test_without_the_line_it_is_unknown():
    with pytest.raises(UsageError, match="layers"):
        segment_scene(Scan(cloud=two_layers()), SegmentationOptions(method="layers"))


def test_registry_in_the_text_begins_as_that_of_the_code():
    text = re.search(r"METHODS: .* = \{.*?\}", TEXT, re.S).group(0)
    assert '"layers": layers,' in text
    code = Path(scene.__file__).read_text(encoding="utf-8")
    head = "\n".join(line.strip() for line in text.splitlines()[:2])
    assert head in "\n".join(line.strip() for line in code.splitlines())
