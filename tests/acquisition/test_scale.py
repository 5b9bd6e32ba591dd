"""Scale of photographs: targets by name and by marker, places of one photograph, cameras; exact cameras before a plane with two markers."""

from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np
import pytest
from PIL import Image

from scan2fea.acquisition.cameras import Camera
from scan2fea.acquisition.depths import Depths, Picture
from scan2fea.acquisition.options import AcquisitionOptions
from scan2fea.acquisition.scale import Scale, length_of, scale_of
from scan2fea.acquisition.structure import Structure, View
from scan2fea.errors import InputError

K = np.array([[400.0, 0.0, 199.5], [0.0, 400.0, 149.5], [0.0, 0.0, 1.0]])
SIZE, DEPTH = (400, 300), 2.0
MIDDLES = {3: np.array([-0.4, 0.1, DEPTH]), 7: np.array([0.5, -0.2, DEPTH])}
APART = float(np.linalg.norm(MIDDLES[7] - MIDDLES[3]))
PX_PER_LENGTH = 400.0  # of the plane's picture


@pytest.fixture(scope="module")
def solved(tmp_path_factory: pytest.TempPathFactory) -> Structure:
    """Two cameras side by side that look at the plane z = 2, in the lengths of the structure."""
    folder = tmp_path_factory.mktemp("targets")
    plane = np.full((800, 1200), 200, np.uint8)
    dictionary = cv2.aruco.getPredefinedDictionary(cv2.aruco.DICT_APRILTAG_36h11)
    for number, middle in MIDDLES.items():
        marker = cv2.aruco.generateImageMarker(dictionary, number, 80)
        x, y = (round(float(c)) for c in middle[:2] * PX_PER_LENGTH + (600, 400))
        plane[y - 40 : y + 40, x - 40 : x + 40] = marker
    views = []
    for k, eye in enumerate((np.array([-0.15, 0.0, 0.0]), np.array([0.2, 0.05, 0.1]))):
        # pixel of the plane's picture (middle of a marker lies half a pixel before its 41st) to pixel of the photograph
        on_plane = np.array([[1 / PX_PER_LENGTH, 0, -599.5 / PX_PER_LENGTH], [0, 1 / PX_PER_LENGTH, -399.5 / PX_PER_LENGTH], [0, 0, 1.0]])
        H = K @ (np.array([[1, 0, -eye[0]], [0, 1, -eye[1]], [0, 0, DEPTH - eye[2]]])) @ on_plane
        Image.fromarray(cv2.warpPerspective(plane, H, SIZE, flags=cv2.INTER_AREA, borderValue=200)).save(folder / f"{k}.png")
        T = np.eye(4)
        T[:3, 3] = eye
        camera = Camera(K=K, distortion=np.zeros(4))
        views.append(
            View(path=str(folder / f"{k}.png"), camera=camera, size=SIZE, T_world_camera=T, point=np.zeros(0, np.int64), pixel=np.zeros((0, 2)))
        )
    return Structure(views=tuple(views), points=np.zeros((0, 3)), reason={}, error_px=0.2, how={})


def _scale(solved: Structure, **options: str) -> Scale:
    length = length_of(AcquisitionOptions(**options))
    assert length is not None
    empty = np.zeros((SIZE[1], SIZE[0]))
    pictures = [Picture(K=K, grey=empty.astype(np.uint8), colour=np.zeros((*empty.shape, 3), np.uint8)) for _ in solved.views]
    depths = [Depths(w=empty + 1 / (DEPTH - v.T_world_camera[2, 3]), sigma=empty + 1e-4, n=empty + 2, scatter=1.0) for v in solved.views]
    return scale_of(length, solved, depths, pictures)


def _seen(middle: np.ndarray, view: View) -> np.ndarray:
    pixel = K @ (middle - view.T_world_camera[:3, 3])
    return pixel[:2] / pixel[2]


def test_numbered_markers(solved: Structure) -> None:
    found = _scale(solved, scale="0.5 m between targets 3 7")
    assert found.m_per_unit == pytest.approx(0.5 / APART, rel=0.005)
    assert 1e-4 < found.relative_std < 0.02
    with pytest.raises(InputError, match="target 9 is seen in 0 placed photographs"):
        _scale(solved, scale="0.5 m between targets 3 9")


def test_named_targets(solved: Structure) -> None:
    listed = Path(solved.views[0].path).parent / "targets.csv"
    rows = [(Path(v.path).name, name, *_seen(m, v)) for v in solved.views for name, m in (("A", MIDDLES[3]), ("B", MIDDLES[7]))]
    listed.write_text("photograph,name,x,y\n" + "".join(f"{p},{n},{x},{y}\n" for p, n, x, y in rows))
    try:
        assert _scale(solved, scale="50 cm between targets A B").m_per_unit == pytest.approx(0.5 / APART, rel=1e-9)
        listed.write_text("photograph,name,x,y\n" + "".join(f"{p},{n},{x},{y + 40 * (p == '1.png')}\n" for p, n, x, y in rows))
        with pytest.raises(InputError, match="not the same thing in all photographs"):
            _scale(solved, scale="0.5 m between targets A B")
        listed.write_text("name,x,y\nA,1,2\n")
        with pytest.raises(InputError, match="header photograph,name,x,y"):
            _scale(solved, scale="0.5 m between targets A B")
    finally:
        listed.unlink()


def test_two_places_of_one_photograph(solved: Structure) -> None:
    a, b = (_seen(m, solved.views[1]) for m in MIDDLES.values())
    found = _scale(solved, known_length=f"0.5 m 1.png {a[0]:.2f},{a[1]:.2f} {b[0]:.2f},{b[1]:.2f}")
    assert found.m_per_unit == pytest.approx(0.5 / APART, rel=1e-4)
    with pytest.raises(InputError, match=r"no photograph '9.png' was placed"):
        _scale(solved, known_length="0.5 m 9.png 1,2 3,4")
