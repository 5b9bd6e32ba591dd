"""The values that travel between stages. Frozen; arrays are read-only; everything is SI.

Each value is a dataclass of arrays, numbers, strings and other values of this file, so that `io.artifacts` can write every one of
them to disk and read it back bit for bit.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, Literal

import numpy as np
import numpy.typing as npt

from scan2fea.errors import InternalError

FloatArray = npt.NDArray[np.float64]
IntArray = npt.NDArray[np.int64]
BoolArray = npt.NDArray[np.bool_]
ByteArray = npt.NDArray[np.uint8]

MEASURED, INTERPOLATED, INVENTED = 0, 1, 2  # values of TriangleMesh.face_origin


class Value:
    """Base of the values: its arrays become read-only views, and arrays that share an axis must agree in length."""

    _ROWS: tuple[tuple[str, ...], ...] = ()  # groups of field names whose arrays have the same number of rows

    def __post_init__(self) -> None:
        for field in dataclasses.fields(self):  # type: ignore[arg-type]
            value = getattr(self, field.name)
            if isinstance(value, np.ndarray):
                view = np.ascontiguousarray(value).view()
                view.flags.writeable = False
                object.__setattr__(self, field.name, view)
        for group in self._ROWS:
            rows = {name: len(getattr(self, name)) for name in group if getattr(self, name) is not None}
            if len(set(rows.values())) > 1:
                raise InternalError(f"{type(self).__name__}: numbers of rows differ: {rows}")


@dataclass(frozen=True, eq=False, kw_only=True)
class PointCloud(Value):
    """n points in one frame of reference.

    points : (n, 3) float64, metres.
    ray : (n,) int64, row in the Rays that stand beside the cloud, -1 where the sensor is not known.
    frame : (n,) int64, number of the input the point came from.
    raw_index : (n,) int64, row in that input as it lies in the file.
    normals : (n, 3) float64, unit, outward, or None.
    sigma_along_m, sigma_across_m : (n,) float64, standard deviation along and across the ray, or None where not stated.
    is_inferred : (n,) bool, True where the point was not measured but put there by a stage; or None (all measured).
    colour : (n, 3) uint8 or None.   intensity : (n,) float64 or None.   label : (n,) int64, labels the file gave, or None.
    """

    points: FloatArray
    ray: IntArray
    frame: IntArray
    raw_index: IntArray
    normals: FloatArray | None = None
    sigma_along_m: FloatArray | None = None
    sigma_across_m: FloatArray | None = None
    is_inferred: BoolArray | None = None
    colour: ByteArray | None = None
    intensity: FloatArray | None = None
    label: IntArray | None = None

    _ROWS = (("points", "ray", "frame", "raw_index", "normals", "sigma_along_m", "sigma_across_m", "is_inferred", "colour", "intensity", "label"),)

    def __len__(self) -> int:
        return len(self.points)

    @classmethod
    def of(cls, points: npt.ArrayLike, **columns: Any) -> PointCloud:
        """A cloud of bare points: no rays, input 0, rows numbered in order; `columns` replaces any field."""
        xyz = np.asarray(points, float).reshape(-1, 3)
        n = len(xyz)
        base: dict[str, Any] = {"ray": np.full(n, -1, np.int64), "frame": np.zeros(n, np.int64), "raw_index": np.arange(n, dtype=np.int64)}
        return cls(points=xyz, **{**base, **columns})

    def take(self, rows: BoolArray | IntArray) -> PointCloud:
        """The cloud of the given rows (a mask or indices), in their order."""
        columns: dict[str, Any] = {f.name: getattr(self, f.name) for f in dataclasses.fields(self)}
        taken: dict[str, Any] = {name: None if column is None else column[rows] for name, column in columns.items()}
        return PointCloud(**taken)

    def replaced(self, **columns: Any) -> PointCloud:
        """The cloud with some columns replaced."""
        return dataclasses.replace(self, **columns)


@dataclass(frozen=True, eq=False, kw_only=True)
class Rays(Value):
    """m rays of the sensors. Filters and segmentation never touch them: what a ray has seen empty stays seen.

    origin : (m, 3) metres.   direction : (m, 3) unit.   range_m : (m,), nan where nothing came back (a miss).
    time_s : (m,) or None.   ring : (m,) int64 or None.   footprint_rad : (m,) full opening of the beam, or None.
    """

    origin: FloatArray
    direction: FloatArray
    range_m: FloatArray
    time_s: FloatArray | None = None
    ring: IntArray | None = None
    footprint_rad: FloatArray | None = None

    _ROWS = (("origin", "direction", "range_m", "time_s", "ring", "footprint_rad"),)

    def __len__(self) -> int:
        return len(self.origin)


@dataclass(frozen=True, eq=False, kw_only=True)
class Scan(Value):
    """A cloud and the rays its column `ray` points into."""

    cloud: PointCloud
    rays: Rays | None = None

    def sensors(self, rows: IntArray | None = None) -> FloatArray:
        """(n, 3) where each point (or those of `rows`) was seen from; nan where that is not known."""
        ray = self.cloud.ray if rows is None else self.cloud.ray[rows]
        position = np.full((len(ray), 3), np.nan)
        if self.rays is not None:
            known = ray >= 0
            position[known] = self.rays.origin[ray[known]]
        return position

    def compact(self) -> Scan:
        """The same cloud with only the rays that its points came along."""
        if self.rays is None:
            return self
        used, packed = np.unique(self.cloud.ray, return_inverse=True)
        first = int(len(used) > 0 and used[0] < 0)
        columns: dict[str, Any] = {f.name: getattr(self.rays, f.name) for f in dataclasses.fields(self.rays)}
        taken: dict[str, Any] = {name: None if column is None else column[used[first:]] for name, column in columns.items()}
        rays = Rays(**taken)
        return Scan(cloud=self.cloud.replaced(ray=packed.astype(np.int64) - first), rays=rays if len(rays) else None)


@dataclass(frozen=True, eq=False, kw_only=True)
class Trajectory(Value):
    """k poses. T_world_frame : (k, 4, 4).   placed : (k,) bool, False where the frame was left out.   time_s : (k,) or None.

    covariance : (k, 6, 6) of the errors of each pose, position (m) then rotation vector (rad), both along the world's axes:
    the true pose is exp(turn) R, x + shift. nan where nothing is stated of that part, None where nothing is stated at all.
    """

    T_world_frame: FloatArray
    placed: BoolArray
    time_s: FloatArray | None = None
    covariance: FloatArray | None = None

    _ROWS = (("T_world_frame", "placed", "time_s", "covariance"),)


@dataclass(frozen=True, eq=False, kw_only=True)
class InertialLog(Value):
    """k rows of an inertial unit, in its own axes. time_s : (k,) rising.   rate : (k, 3) rad/s.   force : (k, 3) specific force, m/s^2 (at rest it
    points up).   magnetic : (k, 3) of any unit, or None.   is_gap : (k,) True where too much time passed since the row before.
    """

    time_s: FloatArray
    rate: FloatArray
    force: FloatArray
    is_gap: BoolArray
    magnetic: FloatArray | None = None

    _ROWS = (("time_s", "rate", "force", "is_gap", "magnetic"),)

    def __len__(self) -> int:
        return len(self.time_s)


@dataclass(frozen=True, eq=False, kw_only=True)
class PositionLog(Value):
    """k rows of a satellite receiver. time_s : (k,) rising.   position : (k, 3) metres east, north, up of the origin.   sigma_m : (k, 3) or None.

    origin : (3,) latitude and longitude (rad) and height (m) of the origin, or None where the file has metres.
    """

    time_s: FloatArray
    position: FloatArray
    sigma_m: FloatArray | None = None
    origin: FloatArray | None = None

    _ROWS = (("time_s", "position", "sigma_m"),)

    def __len__(self) -> int:
        return len(self.time_s)


@dataclass(frozen=True, eq=False, kw_only=True)
class RangeLog(Value):
    """m rays of a scanner of one beam that turns about z, in its own frame. time_s : (m,) rising.   angle : (m,) rad from x towards y.
    range_m : (m,), nan where nothing came back.   first : (s + 1,) the row each of s sweeps begins with, and m.
    """

    time_s: FloatArray
    angle: FloatArray
    range_m: FloatArray
    first: IntArray

    _ROWS = (("time_s", "angle", "range_m"),)

    def __len__(self) -> int:
        return len(self.first) - 1


@dataclass(frozen=True, eq=False, kw_only=True)
class Footing(Value):
    """A plane that an object may rest on: normal . x = offset_m, the normal (3,) towards the object.

    sigma_m : of the plane's points across it.   std_m : of its place under the object.   band_m : half the thickness within which points, the
    object's too, went to the plane.   points : (k, 3) of the plane beside the object.   is_support : False for the face of another object.
    """

    normal: FloatArray
    offset_m: float
    sigma_m: float
    std_m: float
    band_m: float
    points: FloatArray
    is_support: bool = True


@dataclass(frozen=True, eq=False, kw_only=True)
class Segments(Value):
    """One label per point of the segmented cloud.

    labels : (n,) int64; -1 is "no object". kinds : kind of label 0, 1, ...: "object", "support" (floor, table top, wall), "clutter".
    how : what the method decided from the data, for the report (radius_m, n_planes, ...).
    named : what a person calls label 0, 1, ... (I, pipe, floor, ...), "" where nobody did; empty: nobody did of any.
    """

    labels: IntArray
    kinds: tuple[str, ...]
    how: Mapping[str, Any]
    named: tuple[str, ...] = ()


@dataclass(frozen=True, eq=False, kw_only=True)
class TriangleMesh(Value):
    """Triangles, counter-clockwise seen from outside.

    vertices : (n, 3) metres.   faces : (m, 3) int64.
    face_origin : (m,) int64, MEASURED, INTERPOLATED or INVENTED; or None where not yet known.
    face_region : (m,) int64, number of the smooth region (true plane, ...) the face lies on, -1 free form; or None.
    deviation_m : (n,) signed distance of the nearest points from the vertex, along its outward normal; or None.
    """

    vertices: FloatArray
    faces: IntArray
    face_origin: IntArray | None = None
    face_region: IntArray | None = None
    deviation_m: FloatArray | None = None

    _ROWS = (("vertices", "deviation_m"), ("faces", "face_origin", "face_region"))


@dataclass(frozen=True, eq=False, kw_only=True)
class TetMesh(Value):
    """Tetrahedra of positive volume.

    nodes : (n, 3) metres.   tets : (m, 4) or (m, 10) int64, VTK order (mid nodes of edges 01 12 02 03 13 23).
    boundary : (k, 3) or (k, 6) int64, outward, mid nodes of edges 01 12 02.
    face_tag : (k,) int64, index into face_names: the CAD face each boundary triangle lies on.
    """

    nodes: FloatArray
    tets: IntArray
    boundary: IntArray
    face_tag: IntArray
    face_names: tuple[str, ...]

    _ROWS = (("boundary", "face_tag"),)

    @property
    def order(self) -> int:
        return 1 if self.tets.shape[1] == 4 else 2


@dataclass(frozen=True, eq=False, kw_only=True)
class Brep(Value):
    """A CAD solid as STEP text (AP214, millimetres) and what it holds; never a library's live object.

    face_names, face_kinds ("plane", "cylinder", "facet", ...): one per B-Rep face, in the order of the STEP file.
    region_of_face : (f,) int64, the face_region of the surface it was made from, -1 for a single facet.
    facet_of_face : (f,) int64, the surface face a single facet stands for, -1 otherwise.
    face_centre, face_area : (f, 3), (f,) metres, of solids with curved faces, whose triangles only come near to them; else None.
    mesh_step : the same solid, face by face, as a mesher reads it best, where that is another text.
    """

    step: str
    face_names: tuple[str, ...]
    face_kinds: tuple[str, ...]
    region_of_face: IntArray
    facet_of_face: IntArray
    volume_m3: float
    area_m2: float
    is_valid: bool
    n_solids: int
    n_free_edges: int
    face_centre: FloatArray | None = None
    face_area: FloatArray | None = None
    mesh_step: str = ""

    @property
    def is_curved(self) -> bool:
        """Whether triangles only come near to its faces."""
        return self.face_area is not None


@dataclass(frozen=True, eq=False, kw_only=True)
class Section(Value):
    """A plane cross-section. loops : closed polygons, (k, 2) each in metres, outer counter-clockwise, holes clockwise.

    face_names : per loop, the name of the member's face over each edge i -> i + 1; edges that share a name are one (curved) face.
    """

    family: str
    loops: tuple[FloatArray, ...]
    face_names: tuple[tuple[str, ...], ...]


@dataclass(frozen=True, kw_only=True)
class Parameter(Value):
    """One dimension of a member. std_m is None where nothing was estimated (fixed, or taken from the prior).

    source : "fitted", "fixed" (the user gave it); where the data do not tell it "catalogue" (a size of the table stands in) or "estimate" (the
    points' own estimate does, which they cannot vouch for).
    spread_m : of a dimension that is not observable, how far it may be from `value_m` (one standard deviation); None where nothing is known of it.
    """

    name: str
    value_m: float
    std_m: float | None
    observable: bool
    source: str
    spread_m: float | None = None


@dataclass(frozen=True, kw_only=True)
class CatalogueEntry(Value):
    """A hypothesis about the section and its posterior probability; `parameters` are the dimensions it stands for.

    is_standard : the outer dimensions are those of a size of the table.
    offset_m : how far outside of its faces the scan's would all lie, were it this size (sensor's zero, paint); below 0: within.
    """

    name: str
    probability: float
    parameters: Mapping[str, float]
    is_standard: bool = False
    offset_m: float = 0.0


@dataclass(frozen=True, eq=False, kw_only=True)
class Damage(Value):
    """A place where the points leave the fitted member by more than chance. depth_m > 0: material is missing."""

    kind: str
    position_m: FloatArray
    size_m: float
    depth_m: float
    std_m: float
    p_value: float


@dataclass(frozen=True, eq=False, kw_only=True)
class SectionChange(Value):
    """A dimension of the section that changes along the member, piecewise linear from one end to the other.

    kind : "taper" (one slope) or "haunch" (grown towards one or both ends).   z_m : (k,) rising, 0 to length.   value_m, std_m : (k,).
    side : 0 where both sides of a centred dimension move alike, 1 or -1 where the face of larger or smaller coordinate stays straight.
    The parameter of that name of the member holds the least value.
    """

    kind: str
    dimension: str
    z_m: FloatArray
    value_m: FloatArray
    std_m: FloatArray
    side: int = 0

    _ROWS = (("z_m", "value_m", "std_m"),)


@dataclass(frozen=True, kw_only=True)
class Bend(Value):
    """A circular bend of a member's axis, from start_m along the axis on; lengths along the axis go on through bends.

    The axis turns by angle_rad about a centre at radius_m in the direction cos(roll) x + sin(roll) y of the member's frame as the bends before have
    turned it. radius_std_m, angle_std_rad : standard deviations.
    """

    start_m: float
    angle_rad: float
    radius_m: float
    roll_rad: float
    radius_std_m: float = 0.0
    angle_std_rad: float = 0.0

    @property
    def length_m(self) -> float:
        """Of its arc."""
        return self.angle_rad * self.radius_m


@dataclass(frozen=True, kw_only=True)
class RootFillet(Value):
    """The fillets of a rolled section, which share one radius. radius_m : 0 where its corners are sharp, or do not tell.   std_m : 0 where it is 0.

    is_observable : whether the points tell a radius, or that there is none.   most_m : no larger radius goes with the points (three standard
    deviations), inf where they do not tell.   source : "fitted", "fixed" (the user gave it) or "assumed" (EN 10365, of sloping flanges).
    toe_m : radius of the toes of an angle or of sloping flanges.   toe_source : of that: "fitted" or "assumed" (a share of the root radius).
    slope : of the inner faces of flanges, 0 where they are parallel to the outer ones.
    """

    radius_m: float = 0.0
    std_m: float = 0.0
    is_observable: bool = False
    most_m: float = math.inf
    source: str = "fitted"
    toe_m: float = 0.0
    toe_std_m: float = 0.0
    toe_source: str = "fitted"
    slope: float = 0.0
    slope_std: float = 0.0


@dataclass(frozen=True, eq=False, kw_only=True)
class RoundHole(Value):
    """A round hole straight through a wall of a member.

    face : of the wall, that its `start` (3,) lies on, in the middle of its mouth.   through : (3,) from there to the other face, both in the world.
    std_m : of the radius.   place_std_m : of its middle, along one direction of the face.   n_points : that tell it, on its rims and inside.
    """

    face: str
    start: FloatArray
    through: FloatArray
    radius_m: float
    std_m: float
    place_std_m: float
    n_points: int


@dataclass(frozen=True, eq=False, kw_only=True)
class Member(Value):
    """A prismatic member: a section of `kernel.sections` swept along a nearly straight axis.

    T_world_member : (4, 4); the section lies in x, y of the member (frame of kernel.sections), its axis runs along +z from 0 to length.
    bow : (2, k) metres, coefficients of the Legendre polynomials of degree 2 .. k + 1 on [0, length] by which the axis leaves the straight
    line in x and in y (zero for a straight member).   twist : (k,) radians, the same for the roll, from degree 1 on.
    end_normals : (2, 3) outward unit normals of the two end planes in the member's frame; (0, 0, -1) and (0, 0, 1) where square.
    covariance : (p, p) of the parameters in their order, metres squared; zero rows where nothing was estimated.
    seen : name of each face of the section -> share of its length that points support.
    families : family -> posterior probability.   damage : significant places only.   change : of the section along the axis, None for a prism.
    inside : "solid", "hollow", or "unknown" where neither a face from within nor an end told a bar from a tube.
    told_toes : faces that end a wall, were not seen, and are known by a mirror image that was.
    bends : of a pipe with elbows, from its first end on; z of the member is then the way along the axis, and end normals are as before the bends.
    reached : faces that were not seen and are known by where both their neighbours stop.   seated : by the support that they rest on.
    root : fillets where its walls meet; the dimensions are those of its faces, which would meet in sharp corners.
    holes : round ones through its walls; of these its dimensions, its section and its beams know nothing.
    """

    family: str
    parameters: tuple[Parameter, ...]
    T_world_member: FloatArray
    bow: FloatArray
    twist: FloatArray
    end_normals: FloatArray
    covariance: FloatArray
    sigma_m: float
    noise: str
    outlier_share: float
    seen: Mapping[str, float]
    families: Mapping[str, float]
    catalogue: tuple[CatalogueEntry, ...] = ()
    damage: tuple[Damage, ...] = ()
    change: SectionChange | None = None
    inside: str = "unknown"
    told_toes: tuple[str, ...] = ()
    reached: tuple[str, ...] = ()
    seated: tuple[str, ...] = ()
    bends: tuple[Bend, ...] = ()
    root: RootFillet = RootFillet()
    holes: tuple[RoundHole, ...] = ()

    def values(self) -> dict[str, float]:
        """Every dimension by name, metres."""
        return {p.name: p.value_m for p in self.parameters}


@dataclass(frozen=True, kw_only=True)
class Material(Value):
    """Linear elastic. youngs_pa, density_kg_m3, yield_pa in SI; source names the standard."""

    name: str
    youngs_pa: float
    poisson: float
    density_kg_m3: float
    yield_pa: float | None
    source: str


@dataclass(frozen=True, eq=False, kw_only=True)
class Load(Value):
    """One load on a set. kind : "force" (N, spread evenly over the surface), "moment" (Nm, about the surface's centroid), "pressure" (Pa, vector[0],
    pressing inward), "gravity" (m/s2, on the whole body).   vector : (3,).
    """

    set_name: str
    kind: str
    vector: FloatArray


@dataclass(frozen=True, eq=False, kw_only=True)
class LoadCase(Value):
    """Loads that act together."""

    name: str
    loads: tuple[Load, ...]


@dataclass(frozen=True, eq=False, kw_only=True)
class FEModel(Value):
    """A mesh with a material, supports and loads.

    node_sets : name -> (k,) int64 node numbers from 0.   surfaces : name -> (k,) rows of mesh.boundary.   supports : name of a node set -> the
    directions in which it is held, of "xyz".   acceleration_m_s2 : (3,) of the self weight, the first case.   cases : those that the user asks for
    besides; is_floating: in these nothing is held, loads are balanced by inertia.   failed : case -> why it cannot be solved.
    """

    mesh: TetMesh
    material: Material
    node_sets: Mapping[str, IntArray]
    supports: Mapping[str, str]
    acceleration_m_s2: FloatArray
    surfaces: Mapping[str, IntArray] = dataclasses.field(default_factory=dict)
    cases: tuple[LoadCase, ...] = ()
    is_floating: bool = False
    failed: Mapping[str, str] = dataclasses.field(default_factory=dict)


@dataclass(frozen=True, kw_only=True)
class CaseResult(Value):
    """One figure of one load case; `expected` and `relative_error` are None where no independent figure exists."""

    name: str
    measure: str
    unit: str
    value: float
    expected: float | None = None
    relative_error: float | None = None
    std: float | None = None


@dataclass(frozen=True, eq=False, kw_only=True)
class CaseField(Value):
    """One static case. displacement_m : (n, 3).   von_mises_pa : (n,) averaged at the nodes.   reaction_n, applied_n : (3,).   load_n : sum of the
    sizes of all nodal forces, which a torque has too.
    """

    name: str
    displacement_m: FloatArray
    von_mises_pa: FloatArray
    reaction_n: FloatArray
    applied_n: FloatArray
    load_n: float


@dataclass(frozen=True, eq=False, kw_only=True)
class FEResult(Value):
    """What the solver found.

    fields : the static cases, the first is the self weight.   mode_shapes : (k, n, 3), scaled to a largest displacement of 1.
    frequencies_hz : (6 + k,) the rigid-body modes first, as computed.   singular : (s,) nodes at which the true stress has no limit.
    failed : case -> why it has no result.
    """

    cases: tuple[CaseResult, ...]
    fields: tuple[CaseField, ...]
    mode_shapes: FloatArray
    frequencies_hz: FloatArray
    n_dof: int
    solver: str
    singular: IntArray = dataclasses.field(default_factory=lambda: np.zeros(0, np.int64))
    failed: Mapping[str, str] = dataclasses.field(default_factory=dict)

    @property
    def displacement_m(self) -> FloatArray:
        """(n, 3) of the self weight."""
        return self.fields[0].displacement_m

    @property
    def reaction_n(self) -> FloatArray:
        return self.fields[0].reaction_n

    @property
    def applied_n(self) -> FloatArray:
        return self.fields[0].applied_n


@dataclass(frozen=True, kw_only=True)
class Check(Value):
    """One thing that must hold. `says` is the failure in words a user can act on; it is read only where `passed` is False."""

    name: str
    value: float | bool | str | None
    limit: float | bool | str | None
    unit: str
    passed: bool
    says: str = ""


@dataclass(frozen=True, kw_only=True)
class Route(Value):
    """How an object becomes a solid, and why."""

    name: Literal["estimation", "reconstruction"]
    reason: str
