"""The rasteriser against closed forms and brute force."""

from __future__ import annotations

import io

import numpy as np
import pytest
from PIL import Image

from report.fake_out import ring
from scan2fea.report.camera import Camera, look_at
from scan2fea.report.raster import blank, draw_discs, draw_lines, draw_triangles
from scan2fea.report.render import BACKGROUND, Dots, Shape, corner_normals, png, render

RNG = np.random.default_rng(1)


def canvas(h=40, w=60):
    return blank(h, w, np.zeros(3))


def flat(width=60, height=40):
    """One pixel a metre, seen along -z, origin in the middle."""
    return Camera(axes=np.eye(3), centre=np.zeros(3), width_px=width, height_px=height, m_per_px=1.0)


def test_triangles_equal_brute_force():
    screen = np.concatenate([RNG.uniform(-10, 70, (30, 2)), RNG.uniform(-5, 5, (30, 1))], axis=1)
    faces = RNG.permuted(np.tile(np.arange(30), (12, 1)), axis=1)[:, :3].astype(np.int64)
    colour = RNG.uniform(0, 255, (12, 3, 3))
    image, depth = canvas()
    draw_triangles(screen, faces, colour, image, depth)
    for i, j in RNG.integers(0, [40, 60], (400, 2)):
        best, seen = -np.inf, np.zeros(3)
        for face, corners in zip(faces, colour, strict=True):
            p = screen[face]
            share = np.linalg.solve(np.vstack([p[:, :2].T, np.ones(3)]), [j + 0.5, i + 0.5, 1.0])
            if (share >= 0).all() and share @ p[:, 2] > best:
                best, seen = share @ p[:, 2], share @ corners
        assert depth[i, j] == pytest.approx(best)
        assert image[i, j] == pytest.approx(seen)


def test_a_square_of_two_triangles_covers_each_pixel_once_and_only_its_own():
    screen = np.array([[10.0, 5, 0], [20, 5, 0], [20, 15, 0], [10, 15, 0]])
    image, depth = canvas()
    draw_triangles(screen, np.array([[0, 1, 2], [0, 2, 3]]), np.ones((2, 3, 3)), image, depth)
    assert np.isfinite(depth).sum() == 100 and np.isfinite(depth[5:15, 10:20]).all()
    assert np.isfinite(image).all()


def test_flat_triangles_and_nan_draw_nothing():
    screen = np.array([[10.0, 5, 0], [20, 5, 0], [30, 5, 0], [np.nan, 1, 1]])
    image, depth = canvas()
    draw_triangles(screen, np.array([[0, 1, 2], [0, 1, 3]]), np.ones((2, 3, 3)), image, depth)
    assert not np.isfinite(depth).any() and not image.any()


def test_discs():
    image, depth = canvas()
    draw_discs(
        np.array([[30.5, 20.5, 1.0], [30.5, 20.5, 0.0], [-100.0, 3, 0], [0.5, 0.5, 0]]),
        np.array([[9.0, 0, 0], [5, 5, 5], [1, 1, 1], [7, 7, 7]]),
        2.0,
        image,
        depth,
    )
    assert image[20, 30].tolist() == [9, 0, 0]  # the nearer one
    assert image[20, 32].tolist() == [9, 0, 0]  # on the rim
    assert image[22, 32].tolist() == [0, 0, 0]
    assert np.isfinite(depth).sum() == 13 + 6  # a whole disc of radius 2, and the quarter that is on the canvas
    assert image[0, 2].tolist() == [7, 7, 7]


def test_lines_are_hidden_by_what_is_nearer():
    image, depth = canvas()
    draw_triangles(np.array([[0.0, 0, 5], [30, 0, 5], [0, 80, 5]]), np.array([[0, 1, 2]]), np.zeros((1, 3, 3)), image, depth)
    draw_lines(np.array([[0.5, 3.5, 0.0], [59.5, 3.5, 0.0]]), np.array([[0, 1]]), np.full(3, 100.0), 1.0, 1.0, image, depth)
    assert not image[3, :27].any() and (image[3, 30:59] == 100).all()


def test_picture_is_deterministic_and_leaves_its_input_alone():
    mesh = ring()
    before = mesh.vertices.copy()
    camera = look_at(mesh.vertices, width_px=120, height_px=80)
    things = (Shape(vertices=mesh.vertices, faces=mesh.faces, lines=True), Dots(points=mesh.vertices))
    first = render(camera, things)
    assert np.array_equal(first, render(camera, things))
    assert np.array_equal(before, mesh.vertices)
    assert first.shape == (camera.height_px, camera.width_px, 3) and first.dtype == np.uint8


def test_picture_covers_what_the_square_covers():
    square = np.array([[-10.0, -5, 0], [10, -5, 0], [10, 5, 0], [-10, 5, 0]])
    faces = np.array([[0, 1, 2], [0, 2, 3]])
    picture = render(flat(), (Shape(vertices=square, faces=faces, colours=np.full((2, 3), 100, np.uint8)),))
    drawn = (picture != np.rint(BACKGROUND)).any(axis=2)
    assert drawn.sum() == 200 and drawn[15:25, 20:40].all()
    assert len(np.unique(picture[15:25, 20:40].reshape(-1, 3), axis=0)) == 1  # one plane, one brightness


def test_nothing_to_draw_is_an_empty_picture():
    none = np.zeros((0, 3))
    picture = render(flat(), (Shape(vertices=none, faces=none.astype(np.int64)), Dots(points=none)))
    assert (picture == np.rint(BACKGROUND)).all()


def test_hatching_marks_only_the_hatched_face():
    square = np.array([[-20.0, -15, 0], [20, -15, 0], [20, 15, 0], [-20, 15, 0]])
    grey, hatched = np.full((2, 3), 200, np.uint8), np.array([True, False])
    shape = Shape(vertices=square, faces=np.array([[0, 1, 2], [0, 2, 3]]), colours=grey, hatched=hatched)
    picture = render(flat(), (shape,))
    assert len(np.unique(picture[8:30, 30:38, 0])) > 1  # right below: face 0
    upper_left = picture[6:12, 11:18, 0]
    assert len(np.unique(upper_left)) == 1


def test_vertex_colours_are_interpolated():
    square = np.array([[-20.0, -10, 0], [20, -10, 0], [20, 10, 0], [-20, 10, 0]])
    colours = np.array([[0, 0, 0], [200, 200, 200], [200, 200, 200], [0, 0, 0]], np.uint8)
    row = render(flat(), (Shape(vertices=square, faces=np.array([[0, 1, 2], [0, 2, 3]]), colours=colours, per_vertex=True),))[20, 11:49, 0].astype(
        int
    )
    assert (np.diff(row) > 0).all()


def test_corner_normals_keep_creases_and_smooth_the_rest():
    mesh = ring()
    normals = corner_normals(mesh.vertices, mesh.faces)
    centre = mesh.vertices.mean(axis=0)
    flat_ = mesh.vertices - centre
    spine = flat_ * [1, 1, 0]
    exact = flat_ - 0.2 * spine / np.linalg.norm(spine, axis=1)[:, None]
    exact /= np.linalg.norm(exact, axis=1)[:, None]
    assert np.einsum("fkj,fkj->fk", normals, exact[mesh.faces]).min() > 0.99
    roof = np.array([[0.0, 0, 0], [0, 1, 0], [1, 0, -1], [-1, 0, -1]])
    sharp = corner_normals(roof, np.array([[0, 2, 1], [0, 1, 3]]))
    assert np.allclose(sharp[0], sharp[0, 0]) and abs(sharp[0, 0] @ sharp[1, 0]) < 1e-12


def test_png_reads_back():
    picture = render(look_at(ring().vertices, width_px=160), (Shape(vertices=ring().vertices, faces=ring().faces),))
    data = png(picture)
    back = np.asarray(Image.open(io.BytesIO(data)).convert("RGB")).astype(int)
    assert back.shape == picture.shape and np.abs(back - picture).max() <= 24
    assert png(picture) == data
