"""Every value comes back bit for bit; nothing else is made from a file."""

import dataclasses
import json
import zipfile
from pathlib import Path

import numpy as np
import pytest

from scan2fea import types
from scan2fea.errors import FormatError, InputError, InternalError
from scan2fea.io import artifacts

RNG = np.random.default_rng(0)
MESH = types.TriangleMesh(vertices=RNG.normal(size=(4, 3)), faces=np.array([[0, 1, 2], [0, 2, 3]]), face_origin=np.array([0, 2]))
TETS = types.TetMesh(
    nodes=RNG.normal(size=(4, 3)),
    tets=np.array([[0, 1, 2, 3]]),
    boundary=np.array([[0, 2, 1]]),
    face_tag=np.array([0]),
    face_names=("plane_0",),
)
STEEL = types.Material(name="S235", youngs_pa=2.1e11, poisson=0.3, density_kg_m3=7850.0, yield_pa=None, source="EN 10025")
CLOUD = types.PointCloud.of(
    np.array([[0.1, -0.0, 5e-324], [np.nan, np.inf, 1 / 3]]), colour=np.array([[1, 2, 3], [4, 5, 6]], np.uint8), is_inferred=np.array([True, False])
)
RAYS = types.Rays(origin=np.zeros((1, 3)), direction=np.eye(3)[:1], range_m=np.array([np.nan]))
VALUES = [
    CLOUD,
    RAYS,
    types.Scan(cloud=CLOUD, rays=RAYS),
    types.Trajectory(T_world_frame=np.eye(4)[None], placed=np.array([True]), covariance=np.eye(6)[None]),
    types.InertialLog(time_s=np.array([1.0]), rate=RNG.normal(size=(1, 3)), force=np.ones((1, 3)), is_gap=np.array([False])),
    types.PositionLog(time_s=np.array([1.0]), position=RNG.normal(size=(1, 3)), origin=np.array([0.1, 0.2, 300.0])),
    types.RangeLog(time_s=np.array([1.0]), angle=np.array([0.1]), range_m=np.array([np.nan]), first=np.array([0, 1])),
    types.Segments(labels=np.array([0, -1]), kinds=("object",), how={"radius_m": 0.1, "n": 3, "names": ("a", "b"), "none": None}),
    MESH,
    TETS,
    types.Brep(
        step="ISO-10303-21;\n", face_names=("a",), face_kinds=("plane",), region_of_face=np.array([0]), facet_of_face=np.array([-1]), volume_m3=1 / 3,
        area_m2=float("nan"), is_valid=True, n_solids=1, n_free_edges=0,
    ),
    types.Section(family="L", loops=(np.eye(2), np.zeros((0, 2))), face_names=(("a", "b"), ())),
    types.Parameter(name="t", value_m=0.006, std_m=None, observable=False, source="catalogue"),
    types.CatalogueEntry(name="L5x5", probability=0.5, parameters={"t": 0.006}),
    types.Damage(kind="dent", position_m=np.zeros(3), size_m=0.1, depth_m=0.01, std_m=0.001, p_value=1e-6),
    types.Bend(start_m=0.5, angle_rad=1.5, radius_m=0.2, roll_rad=-0.3, radius_std_m=1e-3, angle_std_rad=2e-3),
    types.RoundHole(
        face="A_OUTER", start=np.zeros(3), through=np.array([0, 0.01, 0]), radius_m=0.009, std_m=1e-4, place_std_m=2e-4, n_points=40
    ),
    types.RootFillet(radius_m=0.012, std_m=1e-4, is_observable=True, most_m=0.0123),
    types.SectionChange(kind="taper", dimension="a", z_m=np.array([0.0, 2.0]), value_m=np.array([0.1, 0.2]), std_m=np.array([1e-4, 1e-4]), side=1),
    types.Member(
        family="L", T_world_member=np.eye(4),
        parameters=(types.Parameter(name="t", value_m=0.006, std_m=1e-4, observable=True, source="fitted"),),
        bow=np.zeros((2, 1)), twist=np.zeros(0), end_normals=np.eye(3)[[0, 2]], covariance=np.eye(1), sigma_m=0.001, noise="gaussian",
        outlier_share=0.0,
        seen={"A_OUTER": 1.0}, families={"L": 1.0},
    ),
    STEEL,
    types.FEModel(
        mesh=TETS, material=STEEL, node_sets={"base": np.array([0, 1])}, supports={"base": "xyz"}, acceleration_m_s2=np.array([0, 0, -9.81]),
        surfaces={"top": np.array([0])}, is_floating=True, failed={"wind": "no set"},
        cases=(types.LoadCase(name="push", loads=(types.Load(set_name="top", kind="force", vector=np.ones(3)),)),),
    ),
    types.FEResult(
        cases=(types.CaseResult(name="w", measure="u", unit="m", value=1e-9),), mode_shapes=np.zeros((1, 4, 3)), frequencies_hz=np.arange(7.0),
        n_dof=12, solver="direct",
        fields=(
            types.CaseField(
                name="w", displacement_m=np.zeros((4, 3)), von_mises_pa=np.zeros(4), reaction_n=np.zeros(3), applied_n=np.zeros(3), load_n=1.0
            ),
        ),
    ),
    types.Footing(normal=np.array([0.0, 0, 1]), offset_m=0.1, sigma_m=1e-3, std_m=1e-4, band_m=4e-3, points=np.eye(3)),
    types.Check(name="closed", value=True, limit=None, unit="", passed=True),
    types.Route(name="reconstruction", reason="déjà vu"),
    (1, 2.5, "x", None, True, [1, (2,)], {1: "a", "b": {}}, b"\x00\xff", np.float32(0.1), np.int64(7), Path("a") / "b"),
    np.array(3.0),
    np.zeros((0, 3), np.float32),
]  # fmt: skip


def same(a, b):
    if isinstance(a, np.ndarray):
        return isinstance(b, np.ndarray) and a.dtype == b.dtype and a.shape == b.shape and a.tobytes() == b.tobytes()
    if dataclasses.is_dataclass(a):
        return type(a) is type(b) and all(same(getattr(a, f.name), getattr(b, f.name)) for f in dataclasses.fields(a))
    if isinstance(a, tuple | list):
        return type(a) is type(b) and len(a) == len(b) and all(map(same, a, b))
    if isinstance(a, dict):
        return list(a) == list(b) and all(same(a[k], b[k]) for k in a)
    return type(a) is type(b) and (a == b or (a != a and b != b))


def test_every_type_of_types_is_tested():
    declared = {v for v in vars(types).values() if isinstance(v, type) and dataclasses.is_dataclass(v)}
    assert declared <= {type(v) for v in VALUES} | {types.CaseResult, types.CaseField, types.Load, types.LoadCase}


@pytest.mark.parametrize("value", VALUES, ids=lambda v: type(v).__name__)
def test_round_trip_is_bit_exact_and_the_bytes_are_fixed(value, tmp_path):
    a, b = tmp_path / "a.s2f", tmp_path / "b.s2f"
    artifacts.save(value, a)
    back = artifacts.load(a)
    assert same(value, back)
    artifacts.save(back, b)
    assert a.read_bytes() == b.read_bytes()
    assert artifacts.fingerprint(value) == artifacts.fingerprint(back)
    assert sorted(p.name for p in tmp_path.iterdir()) == ["a.s2f", "b.s2f"]


def test_fingerprint_sees_every_bit():
    changed = MESH.vertices.copy()
    changed[0, 0] = np.nextafter(changed[0, 0], 9)
    assert artifacts.fingerprint(MESH) != artifacts.fingerprint(dataclasses.replace(MESH, vertices=changed))
    assert artifacts.fingerprint(np.array([0.0])) != artifacts.fingerprint(np.array([-0.0]))


def test_big_and_transposed_arrays(tmp_path):
    array = np.arange(200_000.0).reshape(1000, 200).T
    artifacts.save((array, array.astype(">i4")), tmp_path / "a")
    assert all(map(np.array_equal, artifacts.load(tmp_path / "a"), (array, array.astype(">i4"))))


@dataclasses.dataclass
class Foreign:
    x: int = 1


@pytest.mark.parametrize("value", [object(), {1, 2}, 1j, Foreign(), np.array([None]), len])
def test_refuses_what_it_cannot_write_and_leaves_no_file(value, tmp_path):
    with pytest.raises(InternalError, match="cannot be kept on disk"):
        artifacts.save((1, value), tmp_path / "a")
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize(
    "name", ["os:system", "tests.io.test_artifacts:Foreign", "scan2fea.types:np", "scan2fea.types:Nothing", "scan2fea.types:Value", ""]
)
def test_makes_nothing_but_values_of_scan2fea(name, tmp_path):
    with zipfile.ZipFile(tmp_path / "a", "w") as archive:
        archive.writestr("tree.json", json.dumps({"schema": "scan2fea artifact 1", "value": {"is": name, "of": {}}}))
    with pytest.raises(FormatError, match="no value of this version"):
        artifacts.load(tmp_path / "a")


def test_damaged_and_missing_files(tmp_path):
    path = tmp_path / "a"
    artifacts.save(MESH, path)
    whole = path.read_bytes()
    for part in (whole[:50], whole[: len(whole) // 2], whole[:-5], b"x" * 99, whole.replace(b"vertices", b"verticex")):
        path.write_bytes(part)
        with pytest.raises(FormatError, match=r"a is damaged|another version"):
            artifacts.load(path)
    with pytest.raises(InputError, match="cannot be read"):
        artifacts.load(tmp_path / "none")


def test_loaded_arrays_are_read_only(tmp_path):
    artifacts.save(MESH, tmp_path / "a")
    with pytest.raises(ValueError):
        artifacts.load(tmp_path / "a").vertices[0, 0] = 1
