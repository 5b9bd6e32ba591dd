"""Photographs: a rendered room with exact cameras, scale, what cannot be used."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from PIL import Image, ImageFilter

import rendered
from scan2fea.acquisition import Acquired, AcquisitionOptions, from_photographs
from scan2fea.acquisition.depths import Told, together
from scan2fea.acquisition.images import Header
from scan2fea.acquisition.scale import length_of
from scan2fea.acquisition.structure import by_camera
from scan2fea.errors import InputError, UsageError
from scan2fea.kernel.transforms import applied

K = np.array([[520.0, 0.0, 239.5], [0.0, 520.0, 179.5], [0.0, 0.0, 1.0]])
SIZE = (480, 360)
PLACES = [(-0.9, -0.1, -0.4), (-0.45, 0.05, -0.5), (0.0, -0.05, -0.55), (0.45, 0.1, -0.5), (0.9, -0.1, -0.4)]


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Five photographs, one blurred and one unrelated."""
    path = tmp_path_factory.mktemp("photographs")
    for k, place in enumerate(PLACES):
        view = rendered.render(K, SIZE, rendered.pose(place), seed=k)
        Image.fromarray(view.colour).save(path / f"{k}.png")
    Image.fromarray(view.colour).filter(ImageFilter.GaussianBlur(12)).save(path / "blurred.png")
    return path


@pytest.fixture(scope="module")
def made(folder: Path) -> Acquired:
    apart = np.linalg.norm(np.subtract(PLACES[4], PLACES[0]))
    options = AcquisitionOptions(scale=f"{apart} m between cameras 0.png 4.png")
    return from_photographs(sorted(folder.glob("*.png")), options)


def _aligned(made: Acquired) -> tuple[np.ndarray, np.ndarray, float]:
    """Rotation, shift and scale that bring the found cameras to the true ones."""
    found = np.array([f.T_world_frame[:3, 3] for f in made.frames if f.T_world_frame is not None])
    a, b = found - found.mean(axis=0), np.array(PLACES) - np.mean(PLACES, axis=0)
    U, S, Vt = np.linalg.svd(b.T @ a)
    D = np.diag([1.0, 1.0, np.linalg.det(U @ Vt)])
    s = (S * np.diag(D)).sum() / (a**2).sum()
    R = U @ D @ Vt
    return R, np.mean(PLACES, axis=0) - s * R @ found.mean(axis=0), s


def test_cameras_are_found(made: Acquired) -> None:
    R, t, s = _aligned(made)
    placed = [f for f in made.frames if f.T_world_frame is not None]
    assert [Path(f.name).stem for f in placed] == ["0", "1", "2", "3", "4"]
    found = np.array([s * R @ f.T_world_frame[:3, 3] + t for f in placed])
    assert np.linalg.norm(found - PLACES, axis=1).max() < 0.003 * 1.8
    assert s == pytest.approx(1.0, abs=0.005)  # the scale was told
    assert made.unit_source == "option"
    assert made.how["focal_px"] == pytest.approx(520.0, rel=0.01)
    assert made.how["epipolar_px_median"] < 0.5 and made.how["reprojection_px"] < 0.7


def test_points_lie_on_the_room(made: Acquired) -> None:
    R, t, s = _aligned(made)
    points, sigma = [], []
    for frame in made.frames:
        if frame.T_world_frame is not None:
            points.append(s * applied(frame.T_world_frame, frame.scan.cloud.points) @ R.T + t)
            sigma.append(frame.scan.cloud.sigma_along_m)
    p, sd = np.concatenate(points), np.concatenate(sigma)
    assert len(p) > 10_000
    off = np.min([_off_box(p, *box) for box in (rendered.ROOM, *rendered.BOXES)], axis=0)
    assert np.median(off) < 0.01 and np.percentile(off, 90) < 0.03
    assert np.mean(off <= 3.0 * sd) > 0.85
    assert made.how["agree_2sigma"] > 0.9


def _off_box(p: np.ndarray, low: np.ndarray, high: np.ndarray) -> np.ndarray:
    """Distance to the surface of a box."""
    outside = np.linalg.norm(np.maximum(np.maximum(low - p, p - high), 0.0), axis=1)
    inside = np.minimum(p - low, high - p).min(axis=1)
    return np.where(outside > 0, outside, np.abs(inside))


def test_what_was_not_used_is_said(made: Acquired) -> None:
    left = {Path(f.name).name: f.reason for f in made.frames if f.reason}
    assert list(left) == ["blurred.png"] and "blurred" in left["blurred.png"]
    assert any("EXIF" in note for note in made.notes) and any("5 of 6" in note for note in made.notes)


def test_one_photograph_or_none_that_fit(folder: Path, tmp_path: Path) -> None:
    with pytest.raises(InputError, match="one photograph alone has no depth"):
        from_photographs([folder / "0.png"], AcquisitionOptions())
    rng = np.random.default_rng(0)
    for k in range(2):
        Image.fromarray(rng.integers(0, 255, (120, 160, 3), np.uint8)).save(tmp_path / f"{k}.png")
    with pytest.raises(InputError, match="no two of the 2 photographs show the same things"):
        from_photographs(sorted(tmp_path.glob("*.png")), AcquisitionOptions())


def test_lengths_that_cannot_be_read() -> None:
    assert length_of(AcquisitionOptions()) is None
    told = length_of(AcquisitionOptions(scale="25 cm between targets A B"))
    assert told is not None and (told.metres, told.kind, told.first, told.second) == (pytest.approx(0.25), "targets", "A", "B")
    told = length_of(AcquisitionOptions(known_length="0.8 m 03.jpg 120,340 810,355.5"))
    assert told is not None and (told.photograph, told.first, told.second) == ("03.jpg", "120,340", "810,355.5")
    for text in ("1 m", "0 m between targets A B", "1 m between targets A A", "x m between targets A B"):
        with pytest.raises(UsageError, match="--scale"):
            length_of(AcquisitionOptions(scale=text))
    with pytest.raises(UsageError, match="not both"):
        length_of(AcquisitionOptions(scale="1 m between targets A B", known_length="1 m a 1,2 3,4"))


def test_photographs_of_several_cameras_have_several_lenses() -> None:
    header = {Path(n): Header(width=w, height=10, focal_px=f, camera=c) for n, w, f, c in
              (("a", 10, 5.0, "x"), ("b", 10, 5.0, "x"), ("c", 12, 5.0, "x"), ("d", 10, 5.0, "y"), ("e", 10, float("nan"), "y"))}  # fmt: skip
    assert by_camera(list(header), header) == [[Path("a"), Path("b")], [Path("c")], [Path("d")], [Path("e")]]


def test_pairs_put_together() -> None:
    """Two that agree: their mean, with half the variance times 3 / 2; a third far off is left out; what none knows stays unknown."""
    def told(*w: float) -> Told:
        return Told(w=np.array([w]), sigma=np.full((1, len(w)), 0.01))

    found = together([told(1.0, 1.0, np.nan, 1.0), told(1.01, 1.01, np.nan, np.nan), told(1.005, 3.0, np.nan, np.nan)])
    np.testing.assert_allclose(found.w[0], [1.005, 1.005, np.nan, 1.0])
    np.testing.assert_array_equal(found.n[0], [3, 2, 0, 1])
    np.testing.assert_allclose(found.sigma[0, 1], 0.01 * np.sqrt(1.5 / 2) * max(found.scatter, 1.0))
