"""A solid whose places are moved by a smooth map: every face and edge is fitted anew over its own parameters, so that nothing comes apart.

Edges keep their parameter curves: the new surface at a parameter is the moved old one. A face that stays plane stays a plane.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np

from scan2fea.cad.bezier import curve, patch
from scan2fea.cad.occ import RESOLUTION_MM, bezier_curve, bezier_surface, direction, parts, point
from scan2fea.types import FloatArray

Map = Callable[[FloatArray], FloatArray]  # (n, 3) -> (n, 3), millimetres
_FLAT = 1e-12  # of the size of a face


class Deformation:
    """One map applied to the faces of one shell, each once.

    tolerance : millimetres, how far fits may stray.
    """

    def __init__(self, move: Map, tolerance: float) -> None:
        self.move, self.tolerance = move, tolerance
        self.old: dict[str, list[Any]] = {"vertex": [], "edge": []}
        self.new: dict[str, list[Any]] = {"vertex": [], "edge": []}

    def face(self, face: Any) -> Any:
        """The moved face; its edges are shared with the other faces that this deformation moves."""
        from OCP.BRep import BRep_Builder, BRep_Tool
        from OCP.BRepTools import BRepTools
        from OCP.TopAbs import TopAbs_EDGE, TopAbs_FORWARD, TopAbs_WIRE
        from OCP.TopLoc import TopLoc_Location
        from OCP.TopoDS import TopoDS, TopoDS_Face, TopoDS_Wire

        forward = TopoDS.Face(face.Oriented(TopAbs_FORWARD))
        u0, u1, v0, v1 = BRepTools.UVBounds_s(forward)
        surface, is_plane = self._surface(BRep_Tool.Surface_s(forward), (u0, u1), (v0, v1))
        builder, made, nowhere = BRep_Builder(), TopoDS_Face(), TopLoc_Location()
        builder.MakeFace(made, surface, nowhere, RESOLUTION_MM)
        done: list[Any] = []
        for wire in parts(forward, TopAbs_WIRE):
            ring = TopoDS_Wire()
            builder.MakeWire(ring)
            for edge in parts(wire, TopAbs_EDGE, unique=False):
                fresh = self._edge(TopoDS.Edge(edge))
                if not is_plane and not any(fresh.IsSame(one) for one in done):
                    self._lie(builder, fresh, TopoDS.Edge(edge), forward, surface)
                    done.append(fresh)
                builder.Add(ring, fresh.Oriented(edge.Orientation()))
            builder.Add(made, ring.Oriented(wire.Orientation()))
        return made.Oriented(face.Orientation())

    def _surface(self, old: Any, u: tuple[float, float], v: tuple[float, float]) -> tuple[Any, bool]:
        from OCP.Geom import Geom_Plane

        def at(s: FloatArray, t: FloatArray) -> FloatArray:
            places = [old.Value(float(p), float(q)) for p, q in zip(u[0] + s * (u[1] - u[0]), v[0] + t * (v[1] - v[0]), strict=True)]
            return self.move(np.array([(p.X(), p.Y(), p.Z()) for p in places]))

        plane = _plane_of(at)
        if plane is not None:
            return Geom_Plane(point(plane[0]), direction(plane[1])), True
        return bezier_surface(patch(at, self.tolerance), u, v), False

    def _vertex(self, vertex: Any) -> Any:
        from OCP.BRep import BRep_Builder, BRep_Tool
        from OCP.TopoDS import TopoDS_Vertex

        def made() -> Any:
            p = BRep_Tool.Pnt_s(vertex)
            fresh = TopoDS_Vertex()
            BRep_Builder().MakeVertex(fresh, point(self.move(np.array([[p.X(), p.Y(), p.Z()]]))[0]), 10 * RESOLUTION_MM)
            return fresh

        return self._once("vertex", vertex, made)

    def _edge(self, edge: Any) -> Any:
        from OCP.BRep import BRep_Builder, BRep_Tool
        from OCP.TopAbs import TopAbs_FORWARD, TopAbs_VERTEX
        from OCP.TopoDS import TopoDS, TopoDS_Edge

        def made() -> Any:
            builder, fresh, old = BRep_Builder(), TopoDS_Edge(), TopoDS.Edge(edge.Oriented(TopAbs_FORWARD))
            first, last = BRep_Tool.Range_s(old)
            if BRep_Tool.Degenerated_s(old):
                builder.MakeEdge(fresh)
                builder.Degenerated(fresh, True)
            else:
                line = BRep_Tool.Curve_s(old, 0.0, 1.0)

                def at(s: FloatArray) -> FloatArray:
                    places = [line.Value(float(t)) for t in first + s * (last - first)]
                    return self.move(np.array([(p.X(), p.Y(), p.Z()) for p in places]))

                builder.MakeEdge(fresh, bezier_curve(curve(at, self.tolerance), first, last), 5 * RESOLUTION_MM)
            for vertex in parts(old, TopAbs_VERTEX, unique=False):
                builder.Add(fresh, self._vertex(TopoDS.Vertex(vertex.Oriented(TopAbs_FORWARD))).Oriented(vertex.Orientation()))
            builder.Range(fresh, first, last)
            return fresh

        return self._once("edge", edge, made)

    def _once(self, kind: str, old: Any, made: Callable[[], Any]) -> Any:
        for known, fresh in zip(self.old[kind], self.new[kind], strict=True):
            if known.IsSame(old):
                return fresh
        self.new[kind].append(made())
        self.old[kind].append(old)
        return self.new[kind][-1]

    def keep(self, edge: Any, vertices: list[Any]) -> None:
        """This edge and its vertices lie where the map moves nothing: the moved faces use them as they are."""
        self.old["edge"].append(edge)
        self.new["edge"].append(edge)
        for vertex in vertices:
            if not any(known.IsSame(vertex) for known in self.old["vertex"]):
                self.old["vertex"].append(vertex)
                self.new["vertex"].append(vertex)

    def _lie(self, builder: Any, fresh: Any, edge: Any, face: Any, surface: Any) -> None:
        """Give the edge the parameter curve on the new surface that it had on the old one; two on a seam."""
        from OCP.BRep import BRep_Tool
        from OCP.Geom2d import Geom2d_Curve  # noqa: F401  (its type must be known to the binding)
        from OCP.TopAbs import TopAbs_FORWARD, TopAbs_REVERSED
        from OCP.TopLoc import TopLoc_Location
        from OCP.TopoDS import TopoDS

        nowhere, target = TopLoc_Location(), TopoDS.Edge(fresh.Oriented(TopAbs_FORWARD))
        way = BRep_Tool.CurveOnSurface_s(TopoDS.Edge(edge.Oriented(TopAbs_FORWARD)), face, 0.0, 1.0)
        if BRep_Tool.IsClosed_s(edge, face):
            other = BRep_Tool.CurveOnSurface_s(TopoDS.Edge(edge.Oriented(TopAbs_REVERSED)), face, 0.0, 1.0)
            builder.UpdateEdge(target, way, other, surface, nowhere, RESOLUTION_MM)
        else:
            builder.UpdateEdge(target, way, surface, nowhere, RESOLUTION_MM)
        first, last = BRep_Tool.Range_s(edge)
        builder.Range(target, surface, nowhere, first, last)


def _plane_of(at: Callable[[FloatArray, FloatArray], FloatArray]) -> tuple[FloatArray, FloatArray] | None:
    """A place and the normal (along du x dv) of a moved face that is plane, else None."""
    share = np.linspace(0, 1, 7)
    u, v = (g.ravel() for g in np.meshgrid(share, share, indexing="ij"))
    places = at(u, v)
    middle = places.mean(axis=0)
    _, size, axes = np.linalg.svd(places - middle)
    if size[2] > _FLAT * size[0] or size[1] <= _FLAT * size[0]:
        return None
    grid = places.reshape(7, 7, 3)
    normal = np.cross(grid[1, 0] - grid[0, 0], grid[0, 1] - grid[0, 0])
    return middle, axes[2] * np.sign(axes[2] @ normal)
