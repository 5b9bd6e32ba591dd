"""Exact bodies drawn and meshed by gmsh: the triangles that the tests of CAD faces begin with."""

import contextlib

import gmsh
import numpy as np

from scan2fea.types import TriangleMesh


@contextlib.contextmanager
def drawing():
    """gmsh's Open Cascade kernel with an empty model, closed at the end."""
    gmsh.initialize(interruptible=False)
    try:
        gmsh.option.setNumber("General.Terminal", 0)
        yield gmsh.model.occ
    finally:
        gmsh.finalize()


def triangles(edge, scale=1.0):
    """The faces drawn so far as triangles about `edge` long, 24 round a circle, their sides as gmsh leaves them; lengths come out times `scale`."""
    gmsh.model.occ.synchronize()
    gmsh.option.setNumber("Mesh.MeshSizeMax", edge)
    gmsh.option.setNumber("Mesh.MeshSizeFromCurvature", 24)
    gmsh.model.mesh.generate(2)
    tags, xyz, _ = gmsh.model.mesh.getNodes()
    row = np.zeros(int(tags.max()) + 1, np.int64)
    row[tags.astype(np.int64)] = np.arange(len(tags))
    faces = row[gmsh.model.mesh.getElementsByType(2)[1].astype(np.int64).reshape(-1, 3)]
    used, packed = np.unique(faces, return_inverse=True)
    return TriangleMesh(vertices=scale * xyz.reshape(-1, 3)[used], faces=packed.reshape(-1, 3).astype(np.int64))
