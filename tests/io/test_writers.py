"""Every written file is read back by others (trimesh, meshio) and by us, bit for bit where the format can, and twice the same."""

import errno
import itertools

import meshio
import numpy as np
import pytest
import trimesh

from scan2fea.errors import FormatError, InputError, InternalError, UsageError
from scan2fea.io import (
    read_mesh,
    read_scan,
    write_cloud_ply,
    write_mesh_ply,
    write_msh,
    write_scan_ply,
    write_stl,
    write_text,
    write_trajectory,
    write_vtu,
)
from scan2fea.io.files import replacing
from scan2fea.io.volume import boundary_of
from scan2fea.types import PointCloud, Rays, Scan, TetMesh, Trajectory, TriangleMesh

# the cube as six tets around its diagonal 0-7
CUBE = np.array(list(itertools.product((0.0, 1.0), repeat=3)))
SIX = np.array([[0, 1, 3, 7], [0, 3, 2, 7], [0, 2, 6, 7], [0, 6, 4, 7], [0, 4, 5, 7], [0, 5, 1, 7]])
EDGES = np.array([[0, 1], [1, 2], [0, 2], [0, 3], [1, 3], [2, 3]])


def cube(order=1, scale=1.0, offset=(0.0, 0.0, 0.0)):
    nodes, tets = CUBE * scale + offset, SIX.copy()
    volume = np.linalg.det(nodes[tets[:, 1:]] - nodes[tets[:, :1]])
    tets[volume < 0] = tets[volume < 0][:, [0, 2, 1, 3]]
    if order == 2:
        pairs = np.sort(tets[:, EDGES], axis=2).reshape(-1, 2)
        unique, inverse = np.unique(pairs, axis=0, return_inverse=True)
        nodes, tets = np.concatenate([nodes, nodes[unique].mean(axis=1)]), np.concatenate([tets, len(nodes) + inverse.reshape(-1, 6)], axis=1)
    boundary = boundary_of(tets)
    corners = nodes[boundary[:, :3]]
    normal = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    axis = np.argmax(np.abs(normal), axis=1)
    tag = 2 * axis + (normal[np.arange(12), axis] > 0)
    return TetMesh(nodes=nodes, tets=tets, boundary=boundary, face_tag=tag, face_names=("x-", "x+", "y-", "y+", "z-", "z+"))


def closed(faces):
    edges = {(a, b) for f in faces.tolist() for a, b in zip(f, f[1:] + f[:1], strict=True)}
    return len(edges) == 3 * len(faces) and all((b, a) in edges for a, b in edges)


def volume(vertices, faces):
    a, b, c = (vertices[faces[:, k]] for k in range(3))
    return np.einsum("ij,ij->", a, np.cross(b, c)) / 6


def surface(**kw):
    mesh = cube(**kw)
    return TriangleMesh(
        vertices=mesh.nodes,
        faces=mesh.boundary,
        face_origin=np.arange(12) % 3,
        deviation_m=np.linspace(-1e-3, 1e-3, 8),
    )


@pytest.mark.parametrize("order", [1, 2])
def test_boundary_is_closed_and_outward(order):
    mesh = cube(order)
    assert closed(mesh.boundary[:, :3])
    assert volume(mesh.nodes, mesh.boundary[:, :3]) == pytest.approx(1.0, rel=1e-14)
    if order == 2:  # mid nodes lie in the middle of the edges 01 12 02
        for k, (a, b) in enumerate(((0, 1), (1, 2), (0, 2))):
            np.testing.assert_array_equal(mesh.nodes[mesh.boundary[:, 3 + k]], mesh.nodes[mesh.boundary[:, [a, b]]].mean(axis=1))


@pytest.mark.parametrize("order", [1, 2])
@pytest.mark.parametrize("suffix", ["vtu", "msh"])
def test_volume_files_read_back_by_meshio_and_by_us(order, suffix, tmp_path):
    mesh = cube(order, scale=0.3, offset=(1 / 3, -2.0, 1e4))
    path, twice = tmp_path / f"a.{suffix}", tmp_path / f"b.{suffix}"
    for target in (path, twice):
        if suffix == "vtu":
            write_vtu(target, mesh, {"u & <v>": mesh.nodes, "flag": np.arange(len(mesh.nodes)) > 3}, {"q": np.arange(6)})
        else:
            write_msh(target, mesh)
    assert path.read_bytes() == twice.read_bytes()
    other = meshio.read(path)
    kind = "tetra" if order == 1 else "tetra10"
    assert other.points.tobytes() == mesh.nodes.tobytes()
    np.testing.assert_array_equal(np.concatenate([b.data for b in other.cells if b.type == kind]), mesh.tets)
    ours = read_mesh(path)
    assert ours.nodes.tobytes() == mesh.nodes.tobytes()
    np.testing.assert_array_equal(ours.tets, mesh.tets)
    np.testing.assert_array_equal(ours.boundary, mesh.boundary)
    if suffix == "vtu":
        assert other.point_data["u & <v>"].tobytes() == mesh.nodes.tobytes()
        assert other.point_data["flag"].tolist() == [0] * 4 + [1] * (len(mesh.nodes) - 4)
        assert other.cell_data["q"][0].tolist() == list(range(6))
    else:
        assert set(other.field_data) == {*mesh.face_names, "volume"}
        assert [ours.face_names[k] for k in ours.face_tag] == [mesh.face_names[k] for k in mesh.face_tag]


def test_gmsh_opens_the_msh_with_its_groups(tmp_path):
    import gmsh

    mesh = cube(2)
    write_msh(tmp_path / "a.msh", mesh)
    gmsh.initialize(interruptible=False)
    try:
        gmsh.option.setNumber("General.Terminal", 0)
        gmsh.open(str(tmp_path / "a.msh"))
        groups = {gmsh.model.getPhysicalName(d, t): d for d, t in gmsh.model.getPhysicalGroups()}
        assert groups == {**dict.fromkeys(mesh.face_names, 2), "volume": 3}
        quality = gmsh.model.mesh.getElementQualities(gmsh.model.mesh.getElementsByType(11)[0], "minSJ")
        assert min(quality) > 0.1  # wrong mid nodes would turn it negative
        assert sum(gmsh.model.mesh.getElementQualities(gmsh.model.mesh.getElementsByType(11)[0], "volume")) == pytest.approx(1.0)
    finally:
        gmsh.finalize()


@pytest.mark.parametrize("binary, compression", [(False, None), (True, None), (True, "zlib")])
@pytest.mark.parametrize("order", [1, 2])
def test_reads_vtu_of_meshio(order, binary, compression, tmp_path):
    mesh = cube(order)
    other = meshio.Mesh(mesh.nodes, [("tetra" if order == 1 else "tetra10", mesh.tets)])
    meshio.write(tmp_path / "a.vtu", other, binary=binary, compression=compression)
    ours = read_mesh(tmp_path / "a.vtu")
    np.testing.assert_allclose(ours.nodes, mesh.nodes, atol=1e-12)
    np.testing.assert_array_equal(ours.tets, mesh.tets)


@pytest.mark.parametrize("form, binary", [("gmsh22", False), ("gmsh", False), ("gmsh", True)])
@pytest.mark.parametrize("order", [1, 2])
def test_reads_msh_of_meshio(order, form, binary, tmp_path):
    mesh = cube(order)
    other = meshio.Mesh(mesh.nodes, [("tetra" if order == 1 else "tetra10", mesh.tets)])
    meshio.write(tmp_path / "a.msh", other, file_format=form, binary=binary)
    ours = read_mesh(tmp_path / "a.msh")
    np.testing.assert_allclose(ours.nodes, mesh.nodes, atol=1e-12)
    np.testing.assert_array_equal(ours.tets, mesh.tets)


def test_reads_a_deck_with_gaps_and_long_lines(tmp_path):
    mesh = cube(2)
    nodes = "\n".join(f"{10 * (k + 1)}, {x!r}, {y!r}, {z!r}" for k, (x, y, z) in enumerate(mesh.nodes.tolist()))
    numbers = [[str(10 * (n + 1)) for n in tet] for tet in mesh.tets.tolist()]
    rows = "\n".join(f"{k + 1}, {', '.join(tet[:5])},\n {', '.join(tet[5:])}" for k, tet in enumerate(numbers))
    (tmp_path / "a.inp").write_text(
        f"** a comment\n*HEADING\nx\n*Node, nset=all\n{nodes}\n*ELEMENT, TYPE=C3D10, ELSET=E\n{rows}\n*NODE FILE\nU\n*STEP\n", newline="\r\n"
    )
    ours = read_mesh(tmp_path / "a.inp", "mm")
    assert ours.nodes.tobytes() == (mesh.nodes * 1e-3).tobytes()
    np.testing.assert_array_equal(ours.tets, mesh.tets)


@pytest.mark.parametrize("text, said", [
    ("*NODE\n1,0,0,0\n*ELEMENT,TYPE=C3D8\n1,1,1,1,1,1,1,1,1\n", "elements C3D8"),
    ("*NODE\n1,0,0,0\n1,0,0,1\n*ELEMENT,TYPE=S3\n1,1,1,1\n", "numbers nodes twice"),
    ("*NODE\n1,0,0,0\n*ELEMENT,TYPE=S3\n1,1,2,1\n", "a node that is not there"),
    ("*INCLUDE,INPUT=b.inp\n", "b.inp is not there"),
    ("*NODE\n1,0,0\n*ELEMENT,TYPE=S3\n1,1,1,1\n", "has not"),
    ("*HEADING\n", "no mesh"),
])  # fmt: skip
def test_refuses_decks(text, said, tmp_path):
    (tmp_path / "a.inp").write_text(text)
    with pytest.raises(FormatError, match=said):
        read_mesh(tmp_path / "a.inp")


def test_mesh_ply_keeps_indices_and_columns(tmp_path):
    mesh = surface(offset=(0.1, 0.2, 1e6))
    write_mesh_ply(tmp_path / "a.ply", mesh)
    other = trimesh.load(tmp_path / "a.ply", process=False)
    assert np.asarray(other.vertices).tobytes() == mesh.vertices.tobytes()
    np.testing.assert_array_equal(other.faces, mesh.faces)
    data = other.metadata["_ply_raw"]
    np.testing.assert_array_equal(data["face"]["data"]["origin"].ravel(), mesh.face_origin)
    np.testing.assert_array_equal(data["vertex"]["data"]["deviation_m"].ravel(), mesh.deviation_m)
    ours = read_mesh(tmp_path / "a.ply")
    assert ours.vertices.tobytes() == mesh.vertices.tobytes()
    np.testing.assert_array_equal(ours.faces, mesh.faces)
    write_mesh_ply(tmp_path / "b.ply", mesh)
    assert (tmp_path / "a.ply").read_bytes() == (tmp_path / "b.ply").read_bytes()


@pytest.mark.parametrize("offset, is_text", [((0.0, 0.0, 0.0), False), ((3.0, -2.0, 1.0), False), ((500_000.0, 5e6, 100.0), True)])
def test_stl_stays_closed_in_place_and_of_one_volume(offset, is_text, tmp_path):
    mesh = surface(scale=0.0137, offset=offset)
    write_stl(tmp_path / "a.stl", mesh)
    assert (tmp_path / "a.stl").read_bytes().startswith(b"solid") == is_text
    ours = read_mesh(tmp_path / "a.stl")
    assert len(ours.vertices) == 8 and closed(ours.faces)
    centre = np.array(offset)
    assert volume(ours.vertices - centre, ours.faces) == pytest.approx(0.0137**3, rel=1e-4)
    other = trimesh.load(tmp_path / "a.stl", process=False)
    unique, inverse = np.unique(np.asarray(other.vertices), axis=0, return_inverse=True)
    assert len(unique) == 8 and closed(inverse[other.faces])
    assert np.abs(np.sort(unique, axis=0) - np.sort(mesh.vertices, axis=0)).max() <= 1e-6 * 0.0137 + 1e-7 * np.abs(centre).max() * (not is_text)


def test_stl_scale_and_reading_unit(tmp_path):
    write_stl(tmp_path / "a.stl", surface(), 1000.0)
    assert read_mesh(tmp_path / "a.stl", "mm").vertices.max() == 1.0


def test_stl_survives_vertices_that_float32_joins(tmp_path):
    mesh = surface()
    near = mesh.vertices.copy()
    near[1] = near[0] + [0, 0, 1e-12]
    write_stl(tmp_path / "a.stl", TriangleMesh(vertices=near, faces=mesh.faces))
    ours = read_mesh(tmp_path / "a.stl")
    assert len(ours.vertices) == 8 and closed(ours.faces)


def test_cloud_ply_round_trip(tmp_path):
    rng = np.random.default_rng(0)
    normals = rng.normal(size=(50, 3))
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    cloud = PointCloud.of(
        rng.normal(size=(50, 3)) + 5e5, normals=normals, colour=rng.integers(0, 256, (50, 3)).astype(np.uint8), intensity=rng.normal(size=50)
    )
    write_cloud_ply(tmp_path / "a.ply", cloud, {"label": np.arange(50) - 1, "is_inferred": np.zeros(50, bool), "sigma_m": np.full(50, np.nan)})
    back = read_scan(tmp_path / "a.ply").scan.cloud
    assert back.points.tobytes() == cloud.points.tobytes()
    np.testing.assert_allclose(back.normals, normals, atol=1e-15)
    assert (back.colour == cloud.colour).all() and (back.intensity == cloud.intensity).all()
    assert back.label.tolist() == list(range(-1, 49))
    assert np.asarray(trimesh.load(tmp_path / "a.ply", process=False).vertices).tobytes() == cloud.points.tobytes()
    with pytest.raises(InternalError, match="49 rows"):
        write_cloud_ply(tmp_path / "b.ply", cloud, {"x1": np.zeros(49)})
    assert not (tmp_path / "b.ply").exists()


def test_scan_ply_keeps_sensors_and_misses(tmp_path):
    points = np.random.default_rng(1).normal(size=(20, 3))
    origin = np.array([[5.0, 0, 0]] * 20 + [[0, 7.0, 0]] * 3)
    offset = points - origin[:20]
    length = np.linalg.norm(offset, axis=1)
    rays = Rays(
        origin=origin,
        direction=np.concatenate([offset / length[:, None], np.eye(3)]),
        range_m=np.concatenate([length, np.full(3, np.nan)]),
    )
    scan = Scan(cloud=PointCloud.of(points, ray=np.arange(20)), rays=rays)
    write_scan_ply(tmp_path / "folder" / "a.ply", scan)
    raw = read_scan(tmp_path / "folder" / "a.ply")
    assert (raw.n_points, raw.n_misses, raw.n_dropped, raw.sensor) == (23, 3, 0, "known")
    assert raw.scan.sensors().tobytes() == origin[:20].tobytes()
    np.testing.assert_array_equal(raw.scan.rays.direction[20:], np.eye(3))
    np.testing.assert_array_equal(raw.scan.rays.origin[20:], origin[20:])
    assert np.isnan(raw.scan.rays.range_m[20:]).all()
    np.testing.assert_allclose(raw.scan.rays.range_m[:20], length, rtol=1e-15)


def test_trajectory_rows(tmp_path):
    turn = np.eye(4)
    turn[:3, :3] = [[0, -1, 0], [1, 0, 0], [0, 0, 1]]
    turn[:3, 3] = [1, 2, 3]
    write_trajectory(tmp_path / "t.txt", Trajectory(T_world_frame=np.stack([np.eye(4), turn, np.eye(4)]), placed=np.array([True, True, False])))
    rows = np.loadtxt(tmp_path / "t.txt")
    np.testing.assert_allclose(rows[:2], [[0, 0, 0, 0, 0, 0, 0, 1], [1, 1, 2, 3, 0, 0, 0.5**0.5, 0.5**0.5]], atol=1e-15)
    assert rows[2, 0] == 2 and np.isnan(rows[2, 1:]).all()


def test_read_mesh_refuses_points_and_unknown_suffixes(tmp_path):
    write_cloud_ply(tmp_path / "a.ply", PointCloud.of(CUBE))
    with pytest.raises(InputError, match="without faces"):
        read_mesh(tmp_path / "a.ply")
    write_text(tmp_path / "a.bdf", "x")
    with pytest.raises(FormatError, match=r"suffix \.bdf is not known"):
        read_mesh(tmp_path / "a.bdf")


def test_a_folder_that_cannot_be_made_is_a_usage_error(tmp_path):
    write_text(tmp_path / "file", "x")
    with pytest.raises(UsageError, match="cannot be written"):
        write_text(tmp_path / "file" / "a.txt", "x")


@pytest.mark.parametrize("suffix", ["vtu", "msh"])
def test_cut_and_garbled_volume_files_are_refused(suffix, tmp_path):
    path = tmp_path / f"a.{suffix}"
    (write_vtu if suffix == "vtu" else write_msh)(path, cube(2))
    whole = path.read_bytes()
    for cut in (1, 40, len(whole) // 3, len(whole) // 2, len(whole) - 60):
        path.write_bytes(whole[:cut])
        with pytest.raises(InputError):
            read_mesh(path)
    rng = np.random.default_rng(0)
    for _ in range(200):
        garbled = bytearray(whole)
        for k in rng.integers(0, len(whole), 5):
            garbled[k] = rng.integers(0, 256)
        path.write_bytes(garbled)
        try:
            read_mesh(path)
        except InputError as error:
            assert str(path) in str(error) and "\n" not in str(error)


def test_a_full_disk_is_told_and_leaves_nothing_behind(tmp_path):
    with pytest.raises(UsageError, match=r"cannot be written .*make room"), replacing(tmp_path / "a.ply") as handle:
        handle.write(b"half")
        raise OSError(errno.ENOSPC, "No space left on device")
    assert list(tmp_path.iterdir()) == []
