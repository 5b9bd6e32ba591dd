"""Tiles of a closed surface: disks that meet in borders, on any genus; flat maps that turn no triangle over."""

import numpy as np
import pytest

from predicates import rotation, sphere, torus
from scan2fea.cad.charts import flattened
from scan2fea.cad.tiles import parted, spread, tiles_at, web_of
from scan2fea.errors import CadError
from scan2fea.kernel.topology import edge_table
from scan2fea.types import TriangleMesh

SHAPES = {"ball": sphere(0.1, 4), "ring": torus(0.1, 0.03, 60, 30)}


def cut(mesh, n):
    web = web_of(mesh)
    return web, tiles_at(web, spread(web, n))


@pytest.mark.parametrize("name", SHAPES)
@pytest.mark.parametrize("n", [1, 7, 40])
def test_every_tile_is_a_disk_and_the_numbers_are_eulers(name, n):
    mesh = SHAPES[name]
    _, tiles = cut(mesh, n)
    assert sorted(set(tiles.label)) == list(range(len(tiles.loops)))
    assert all(tiles.label[seed] == k for k, seed in enumerate(tiles.seeds) if n > 1)
    corners = {v for arc in tiles.arcs for v in arc.vertices[[0, -1]].tolist()}
    assert len(corners) - len(tiles.arcs) + len(tiles.loops) == (2 if name == "ball" else 0)
    for tile, loop in enumerate(tiles.loops):
        faces = mesh.faces[tiles.label == tile]
        edges = edge_table(faces)
        assert len(np.unique(faces)) - len(edges.edges) + len(faces) == 1  # a disk
        assert len(loop) >= 2
        ring = np.concatenate([(tiles.arcs[a].vertices if a >= 0 else tiles.arcs[~a].vertices[::-1])[:-1] for a in loop])
        assert len(np.unique(ring)) == len(ring) == np.sum(edges.count == 1)


@pytest.mark.parametrize("name", SHAPES)
def test_every_border_has_its_two_tiles_and_follows_the_edges_between_them(name):
    mesh = SHAPES[name]
    web, tiles = cut(mesh, 20)
    used = np.bincount([a if a >= 0 else ~a for loop in tiles.loops for a in loop], minlength=len(tiles.arcs))
    assert (used == 2).all()
    for arc in tiles.arcs:
        assert (tiles.label[arc.half_edges // 3] == arc.left).all()
        assert (tiles.label[web.table.twin[arc.half_edges] // 3] == arc.right).all()
        np.testing.assert_array_equal(mesh.faces.ravel()[arc.half_edges], arc.vertices[:-1])
    own, beside = np.repeat(tiles.label, 3), tiles.label[web.table.twin // 3]
    assert 2 * sum(len(arc.half_edges) for arc in tiles.arcs) == np.sum(own != beside)


@pytest.mark.parametrize("name", SHAPES)
def test_no_triangle_turns_over_in_its_flat_disk(name):
    mesh = SHAPES[name]
    _, tiles = cut(mesh, 15)
    flat = flattened(mesh, tiles)
    a, b = flat[:, 1] - flat[:, 0], flat[:, 2] - flat[:, 0]
    assert (a[:, 0] * b[:, 1] - a[:, 1] * b[:, 0] > 0).all()
    assert np.linalg.norm(flat, axis=2).max() <= 1 + 1e-12


def test_a_tile_is_parted_and_the_others_keep_their_seeds():
    web, tiles = cut(SHAPES["ball"], 20)
    pieces = np.ones(len(tiles.loops), np.int64)
    pieces[4] = 3
    seeds = parted(web, tiles, pieces)
    assert len(seeds) == len(tiles.seeds) + 2
    assert set(np.delete(tiles.seeds, 4)) <= set(seeds)
    assert (tiles.label[np.setdiff1d(seeds, tiles.seeds)] == 4).all()


def test_tiles_do_not_depend_on_where_the_surface_stands():
    mesh = SHAPES["ring"]
    web, tiles = cut(mesh, 15)
    moved = TriangleMesh(vertices=mesh.vertices @ rotation(3).T + [1.0, 2.0, 3.0], faces=mesh.faces)
    again = tiles_at(web_of(moved), spread(web, 15))
    np.testing.assert_array_equal(again.label, tiles.label)


def test_an_open_surface_is_refused():
    with pytest.raises(CadError, match="closed"):
        web_of(TriangleMesh(vertices=SHAPES["ball"].vertices, faces=SHAPES["ball"].faces[1:]))
