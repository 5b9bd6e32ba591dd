"""Small scenes for the tests of sensors, and rays cast by brute force."""

import numpy as np

from scan2fea.kernel.construction import Plain
from scan2fea.simulation.shapes import box
from scan2fea.simulation.solids import Scene, Shape, Solid
from scan2fea.types import TriangleMesh


def block(low, high):
    """A box between two corners."""
    mesh = box(*(np.asarray(high, float) - np.asarray(low, float)))
    return TriangleMesh(vertices=mesh.vertices + np.asarray(low, float), faces=mesh.faces)


def scene(*meshes, reflectance=0.5):
    """A scene of solids that are nothing but their mesh."""
    shines = np.broadcast_to(reflectance, len(meshes))
    solids = []
    for k, (mesh, shine) in enumerate(zip(meshes, shines, strict=True)):
        shape = Shape(
            kind="box", family="box", parameters={}, mesh=mesh, exact=None, chord_m=0.0, section=(), n_cad_faces=6, probes=(), base=Plain(mesh=mesh)
        )  # fmt: skip
        solids.append(Solid(name=f"solid{k}", shape=shape, T_world_shape=np.eye(4), mesh=mesh, volume_m3=1.0, reflectance=float(shine)))
    return Scene(name="test", solids=tuple(solids))


def clutter(seed=0):
    """A floor, a wall and thin and thick blocks in every distance, one before the other."""
    rng = np.random.default_rng(seed)
    meshes = [block((-6, -6, -0.2), (6, 6, 0)), block((5, -6, 0), (5.1, 6, 4))]
    for _ in range(6):
        low = np.append(rng.uniform(1.2, 4, 1), np.append(rng.uniform(-2, 2, 1), rng.uniform(0.05, 1, 1)))
        meshes.append(block(low, low + rng.uniform(0.02, 0.7, 3)))
    return scene(*meshes)


def nearest_by_brute_force(mesh, origin, direction):
    """(n,) range of the nearest triangle along each ray, inf for none."""
    best = np.full(len(origin), np.inf)
    for a, b, c in mesh.vertices[mesh.faces]:
        m = np.stack([np.broadcast_to(b - a, origin.shape), np.broadcast_to(c - a, origin.shape), -direction], -1)
        flat = np.abs(np.linalg.det(m)) < 1e-15
        m[flat] = np.eye(3)
        u, v, t = np.moveaxis(np.linalg.solve(m, (origin - a)[..., None])[..., 0], -1, 0)
        hit = ~flat & (u >= 0) & (v >= 0) & (u + v <= 1) & (t > 0)
        best = np.where(hit, np.minimum(best, t), best)
    return best
