"""Finite elements against closed forms, CalculiX and the truth: the tables of docs/fea.md.

    python benchmarks/fea.py sections | beam | patch | slopes | calculix | coverage [--seeds N] [--state FILE] [--quick]

`coverage` is resumable: each fitted member is one line of the state file (JSON).
"""

from __future__ import annotations

import argparse
import json
import math
import os
import re
import resource
import shutil
import subprocess
import tempfile
import time
from collections import defaultdict
from dataclasses import replace
from itertools import permutations
from pathlib import Path

import numpy as np
import scipy.sparse as sp
import scipy.sparse.linalg as spla

from scan2fea.estimation.layers import layers_of
from scan2fea.estimation.member import MemberOptions, fit_member
from scan2fea.estimation.solid import solid_of
from scan2fea.fea import FeaOptions, build_model, material, solve, write_inp
from scan2fea.fea.assemble import assemble
from scan2fea.fea.beam import assemble_beams, clamped, frequencies, solve_beams, straight
from scan2fea.fea.budget import beam_response, budget
from scan2fea.fea.elements import quadrature, shape
from scan2fea.fea.section_properties import properties_of
from scan2fea.fea.strain import _strains
from scan2fea.kernel.measures import tet_volumes
from scan2fea.kernel.transforms import random_rotation
from scan2fea.simulation.member import MemberScanOptions, member_points
from scan2fea.tetmeshing import layered
from scan2fea.tetmeshing.tets import boundary_of, tet_mesh
from scan2fea.types import Material, Member, Parameter, PointCloud, Scan

STEEL = Material(name="steel", youngs_pa=200e9, poisson=0.3, density_kg_m3=7850.0, yield_pa=None, source="cad-fe table")
SHAPES = {
    "L": ({"a": 0.127, "b": 0.127, "t": 0.00635}, 3.048),
    "I": ({"h": 0.2, "b": 0.1, "tw": 0.0056, "tf": 0.0085}, 2.0),
    "C": ({"h": 0.2, "b": 0.075, "tw": 0.0085, "tf": 0.0115}, 2.0),
    "T": ({"h": 0.1, "b": 0.1, "tw": 0.01, "tf": 0.01}, 1.5),
    "RHS": ({"h": 0.1, "b": 0.06, "t": 0.005}, 1.5),
    "CHS": ({"d": 0.1143, "t": 0.006}, 1.5),
    "rect": ({"b": 0.1, "t": 0.01}, 1.0),
    "round": ({"d": 0.05}, 1.0),
}
# a second program's figures, mm: area, Ix, Iy, J, Cw
KNOWN = {
    "L": (1572.58, 2.51626e6, 2.51626e6, 20920, 2.688e7),
    "I": (2724.8, 1.84559e7, 1.41934e6, 50693, 1.2975e10),
    "C": (3229.5, 1.92702e7, 1.70609e6, 107649, 1.068e10),
    "T": (1900, 1.80004e6, 8.40833e5, 63171, 2.97e7),
    "RHS": (1500, 1.9625e6, 8.625e5, 1.8811e6, 7.1e7),
    "CHS": (2041.41, 3.00212e6, 3.00212e6, 6.00423e6, 0.0),
    "rect": (1000, 8333.3, 833333, 31233, 6.64e6),
}


def member_of(family, values, length, covariance=None):
    names = [*values, "length"]
    numbers = {**values, "length": length}
    p = len(names)
    return Member(
        family=family,
        parameters=tuple(Parameter(name=n, value_m=numbers[n], std_m=None, observable=True, source="fitted") for n in names),
        T_world_member=np.eye(4), bow=np.zeros((2, 1)), twist=np.zeros(1), end_normals=np.array([[0, 0, -1.0], [0, 0, 1.0]]),
        covariance=np.zeros((p, p)) if covariance is None else covariance, sigma_m=0.0, noise="gaussian", outlier_share=0.0, seen={}, families={},
    )  # fmt: skip


def tets_of(member):
    at = layers_of(solid_of(member))
    return layered(at.points, at.triangles, at.rim, at.rim_tag, at.face_names)


def sections(_):
    print("| section | A | Ix | Iy | J | Cw | shear centre | a finer mesh changes J, Cw | cpu ms |\n|---|---|---|---|---|---|---|---|---|")
    for family, (values, _) in SHAPES.items():
        begun = time.process_time()
        p = properties_of(family, values)
        seconds = time.process_time() - begun
        q = properties_of(family, values, level=2)
        told = (p.area * 1e6, p.ixx * 1e12, p.iyy * 1e12, p.j * 1e12, p.warping * 1e18)
        known = KNOWN.get(family, told)
        cells = [f"{a:.6g} ({100 * (a / b - 1):+.3f} %)" if b > 1 else f"{a:.3g}" for a, b in zip(told, known, strict=True)]
        warping = 100 * (q.warping / p.warping - 1) if p.warping > 1e-16 else 0.0
        centre = ", ".join(f"{x:.3f}" for x in p.shear_centre * 1e3)
        print(f"| {family} | {' | '.join(cells)} | {centre} | {100 * (q.j / p.j - 1):+.3f}, {warping:+.3f} % | {1e3 * seconds:.0f} |")


def beam(_):
    """The L-beam of the thesis: 100 N along -y on the tip, root held; solid as the chain meshes it, beam, closed form's reference."""
    values, length = SHAPES["L"]
    p = properties_of("L", values)
    n = 24
    beams = straight(length, p, STEEL, n)
    matrices = assemble_beams(beams)
    held = clamped(beams, matrices, 0)
    load = np.zeros((len(held), 1))
    load[6 * n + 1] = -100.0
    tip = solve_beams(matrices, held, load)[6 * n : 6 * n + 6, 0] * 1e3
    hertz = frequencies(matrices, held, 5)[0]
    print("| model | ux, uy mm | twist mrad | f Hz |\n|---|---|---|---|")
    print("| HEX20R, 10 080 elements | -1.5707, -3.1032 | -5.739 | 7.706 11.29 22.30 40.3 47.84 |")
    print(f"| beam, {n} elements | {tip[0]:.4f}, {tip[1]:.4f} | {tip[5]:.3f} | {' '.join(f'{f:.2f}' for f in hertz)} |")
    options = FeaOptions(youngs_pa=200e9)
    member = member_of("L", values, length)
    begun = time.process_time()
    tets = tets_of(member)
    meshed = time.process_time() - begun
    begun = time.process_time()
    result = solve(build_model(tets, options), options, member)
    seconds = time.process_time() - begun
    row = {(c.name, c.measure): c for c in result.cases}
    told = (-1e3 * row["bend_y", "tip_x_m"].value, -1e3 * row["bend_y", "tip_y_m"].value, -1e3 * row["bend_y", "twist_rad"].value)
    name = f"TET10 as the chain meshes it, {result.n_dof} dof, meshed {meshed:.1f}, solved {seconds:.1f} cpu s"
    print(f"| {name} | {told[0]:.4f}, {told[1]:.4f} | {told[2]:.3f} | |")
    print("\n| case | value | beam theory | difference |\n|---|---|---|---|")
    for c in result.cases:
        if c.expected is not None:
            print(f"| {c.name} {c.measure} | {c.value:.6g} {c.unit} | {c.expected:.6g} | {100 * c.relative_error:.3g} % |")


def patch(_):
    """Any linear displacement on the boundary of a distorted mesh is that inside; rigid motions strain nothing."""
    from scan2fea.fea.inner import InnerForces

    member = member_of("L", *SHAPES["L"])
    mesh = tets_of(member)
    steel = material("S235")
    system = assemble(mesh, steel)
    gradient = np.random.default_rng(1).normal(size=(3, 3)) * 1e-3
    u = mesh.nodes @ gradient.T
    inside = np.ones(len(mesh.nodes), bool)
    inside[np.unique(mesh.boundary)] = False
    force = InnerForces(mesh, steel)(u)
    print(f"patch: largest force inside / on the boundary {np.abs(force[inside]).max(initial=0.0) / np.abs(force).max():.1e}")
    rigid = np.cross([1e-3, 2e-3, -1e-3], mesh.nodes) + np.array([1, 2, 3])
    print(f"rigid motion: largest force / of the linear field {np.abs(InnerForces(mesh, steel)(rigid)).max() / np.abs(force).max():.1e}")
    print(f"mass {system.mass.sum():.12g}")


def prism(cells, n, layers, triangle=False):
    """TET10 of unit squares `cells` swept over `layers` elements, n elements along a unit; cubes are cut in six along their diagonals.

    triangle: of one square only the half below its second diagonal, sheared to a triangle with equal sides.
    """
    wide = max(int(np.max(cells) + 1) * n, layers) + 1
    at = np.array([(x * n + i, y * n + j, k) for x, y in cells for i in range(n) for j in range(n) for k in range(layers)])
    ways = np.array([np.concatenate([np.zeros((1, 3), int), np.cumsum(np.eye(3, dtype=int)[list(way)], axis=0)]) for way in permutations(range(3))])
    grid = (at[:, None, None] + ways).reshape(-1, 4, 3)
    if triangle:
        grid[..., 0] = n - grid[..., 0]
        grid = grid[(grid[..., 0] + grid[..., 1]).max(axis=1) <= n]
    used, rows = np.unique(grid @ np.array([wide * wide, wide, 1]), return_inverse=True)
    nodes = np.stack([used // wide**2, used // wide % wide, used % wide], axis=1) / n
    if triangle:
        nodes = nodes @ np.array([[1, 0, 0], [0.5, math.sqrt(0.75), 0], [0, 0, 1]])
    tets = rows.reshape(-1, 4)
    turned = tet_volumes(nodes, tets) < 0
    tets[turned] = tets[turned][:, [1, 0, 2, 3]]
    boundary = boundary_of(tets)
    return tet_mesh(nodes, tets, boundary, np.zeros(len(boundary), np.int64), ("ALL",), 2)


SQUARE, ANGLE = [(0, 0)], [(0, 0), (1, 0), (2, 0), (0, 1), (0, 2)]


def slopes(_):
    """Error of energy or eigenvalue over sizes of elements, against solutions that are known: rate 4 where these are smooth (order 2)."""
    print("| body | case | elements along a unit | error | rate | last pair |\n|---|---|---|---|---|---|")
    for name, cells, sizes in (("bar 1 x 1 x 3", SQUARE, (3, 5, 7)), ("L 3 x 3 x 1, 3 long", ANGLE, (1, 2, 4))):
        found = defaultdict(list)
        for n in sizes:
            mesh = prism(cells, n, 3 * n)
            for case, off in known_cases(mesh, name).items():
                found[case].append(abs(off))
        for case, off in found.items():
            _slope(name, case, sizes, off)
    sizes = (1, 2, 4, 8)  # without a known limit
    energies = -np.diff([flexed_angle(prism(ANGLE, n, n)) for n in sizes])
    told = np.log2(energies[:-1] / energies[1:]).round(2)
    print(f"L 3 x 3 x 1, 1 long, moment on one end: rate from three sizes after one another of {sizes}: {told}")
    for name, cells, j, sizes in (
        ("triangle, sides 1", SQUARE, math.sqrt(3) / 80, (4, 8, 16)),
        ("square, sides 1", SQUARE, square_j(), (4, 8, 16, 32)),
        ("L 3 x 3 x 1", ANGLE, None, (2, 4, 8, 16, 32)),
    ):
        energies = [twisted(prism(cells, n, 1, name.startswith("tri")), n) for n in sizes]
        if j is None:  # three sizes tell the limit of what falls as n^-4/3 in the end
            shrink = 0.5 ** (4 / 3)
            j = (energies[-1] - shrink * energies[-2]) / (1 - shrink)
            steps = -np.diff(energies)
            told = ", ".join(f"{x:.2f}" for x in np.log2(steps[:-1] / steps[1:]))
            print(f"{name}: rate from three sizes after one another {told}; J {j:.6f}")
        off = np.array(energies) / j - 1
        _slope(name, "torsion, one element long", sizes, off)
        scaled = off * np.array(sizes) ** 4.0
        print(f"{name}: error x n^4 {', '.join(f'{x:.3f}' for x in scaled)}")


def _slope(name, case, sizes, off):
    off = np.abs(off)
    log, told = np.log(sizes), "in the space"
    if off.max() > 1e-9:
        told = f"{-np.polyfit(log, np.log(off), 1)[0]:.2f} | {-np.diff(np.log(off))[-1] / np.diff(log)[-1]:.2f}"
    print(f"| {name} | {case} | {', '.join(map(str, sizes))} | {', '.join(f'{x:.1e}' for x in off)} | {told} |", flush=True)


def square_j():
    """Torsion constant of a square of side 1 (Timoshenko and Goodier 1970, section 109)."""
    odd = np.arange(1, 400, 2)
    return 1 / 3 - 64 / np.pi**5 * float((np.tanh(odd * np.pi / 2) / odd**5).sum())


def twisted(mesh, n):
    """Torsion constant from the energy of a slice 1 / n thick: both ends turned, free to warp. Warping is the same along the axis."""
    x, y, z = np.asarray(mesh.nodes).T
    ends = (z == 0) | (z == z.max())
    twist = np.stack([-y * z, x * z, 0 * z], axis=1)
    corner = np.zeros(len(x), bool)
    corner[np.argmin(x + y + z)] = True
    tough = replace(STEEL, youngs_pa=2.0, poisson=0.0, density_kg_m3=1.0)
    return energy(mesh, tough, twist, np.stack([ends, ends, corner], 1))[0] * n


def flexed_angle(mesh):
    """Energy of an angle under a moment on one end, both held across: bending that grows, so with shear; Saint-Venant's without Poisson's ratio."""
    nodes = np.asarray(mesh.nodes)
    x, y, z = nodes.T
    system = assemble(mesh, replace(STEEL, youngs_pa=1.0, poisson=0.0, density_kg_m3=1.0))
    face = mesh.boundary[(z[mesh.boundary[:, :3]] == z.max()).all(axis=1)]
    area = np.linalg.norm(np.cross(nodes[face[:, 1]] - nodes[face[:, 0]], nodes[face[:, 2]] - nodes[face[:, 0]]), axis=1) / 2
    mass = np.full((6, 6), 16.0)  # of the six-node triangle, times 180 / area
    mass[:3, :3], mass[:3, 3:], mass[3:, :3] = -1, 0, 0
    for k in range(3):
        mass[k, 3 + (k + 1) % 3] = mass[3 + (k + 1) % 3, k] = -4
    mass[np.arange(6), np.arange(6)] = [6, 6, 6, 32, 32, 32]
    middle = (3 * 0.5 + 1.5 + 2.5) / 5  # of the area, along y
    force = np.zeros_like(nodes)
    np.add.at(force[:, 2], face, (area / 180)[:, None] * ((y[face] - middle) @ mass))
    ends, corner = (z == 0) | (z == z.max()), np.zeros(len(x), bool)
    corner[np.argmin(x + y + z)] = True
    free = np.flatnonzero(~np.stack([ends, ends, corner], 1).ravel())
    k = system.stiffness_matrix().tocsc()[free][:, free]
    right = force.ravel()[free]
    return -float(right @ spla.splu(k, permc_spec="MMD_AT_PLUS_A", options={"SymmetricMode": True}).solve(right))


def known_cases(mesh, name):
    """{case: relative error}: of the energy (cantilever: the square of the energy norm of the error); of the modal case of the squared frequency."""
    x, y, z = np.asarray(mesh.nodes).T
    length, ends = 3.0, (mesh.nodes[:, 2] == 0) | (mesh.nodes[:, 2] == 3)
    soft = replace(STEEL, youngs_pa=1.0, poisson=0.0, density_kg_m3=1.0)
    tough = replace(soft, poisson=0.3)
    twist = np.stack([-y * z, x * z, 0 * z], axis=1) / length
    j = square_j() if "bar" in name else properties_of("L", {"a": 3.0, "b": 3.0, "t": 1.0}, level=3).j
    pull = np.stack([-0.3 * x, -0.3 * y, z], axis=1) / length
    told = {"tension": energy(mesh, tough, pull, np.repeat(ends[:, None], 3, 1))[0] / (_area(mesh) / length) - 1,
            "torsion": energy(mesh, tough, twist, np.stack([ends, ends, z + x + y == 0], 1))[0] / (j / 2.6 / length) - 1}  # fmt: skip
    if "bar" in name:  # force on the end, no Poisson's ratio: a cubic, Timoshenko and Goodier 1970, section 21, and the same in space
        v, inertia = y - 0.5, 1 / 12
        flexed = np.stack([0 * x, z**2 * length / 2 - z**3 / 6, -v * (z * length - z**2 / 2) - v**3 / 3 + v / 4], axis=1) / inertia
        strain, volumes = _strains(mesh, energy(mesh, soft, flexed, np.repeat(ends[:, None], 3, 1))[1])
        at = np.einsum("qn,enk->eqk", shape(quadrature(2)[0], 10), mesh.nodes[mesh.tets])
        exact = np.zeros_like(strain)
        exact[..., 2, 2] = -(at[..., 1] - 0.5) * (length - at[..., 2]) / inertia
        exact[..., 1, 2] = exact[..., 2, 1] = (0.25 - (at[..., 1] - 0.5) ** 2) / 2 / inertia
        told["cantilever"] = float((volumes[..., None, None] * (strain - exact) ** 2).sum() / (volumes[..., None, None] * exact**2).sum())
    system = assemble(mesh, soft)
    exact = (np.pi / length) ** 2
    k, m = system.stiffness_matrix().tocsc(), sp.kron(system.mass_matrix(), sp.eye(3)).tocsc()
    across = np.zeros((len(x), 3), bool)
    across[:, :2] = True  # no Poisson's ratio: the motion along z stands by itself
    free = np.flatnonzero(~across.ravel())
    found = spla.eigsh(k[free][:, free], 1, m[free][:, free], sigma=0.9 * exact, return_eigenvectors=False)[0]
    return {**told, "modal": found / exact - 1}


def _area(mesh):
    return tet_volumes(mesh.nodes, mesh.tets).sum() / 3


def energy(mesh, matter, field, held):
    """Twice the strain energy of the solution that is `field` where it is held, and the solution."""
    k = assemble(mesh, matter).stiffness_matrix().tocsc()
    u, fixed = field.ravel().copy(), held.ravel()
    free = np.flatnonzero(~fixed)
    u[free] = 0.0
    u[free] = spla.splu(k[free][:, free], permc_spec="MMD_AT_PLUS_A", options={"SymmetricMode": True}).solve(-(k @ u)[free])
    return float(u @ (k @ u)), u.reshape(-1, 3)


def calculix(given):
    """Self weight of one member of each family, ours and CalculiX's from the deck, all nodes (its figures have 7 digits in the .dat file)."""
    if shutil.which("ccx") is None:
        print("CalculiX (ccx) is not installed here")
        return
    print("| part | dof | largest difference / largest displacement | cpu s ours | ccx |\n|---|---|---|---|---|")
    for family, (values, length) in list(SHAPES.items())[: 3 if given.quick else None]:
        for down in ("-z", "-y"):
            options = FeaOptions(down=down, member_cases=False)
            model = build_model(tets_of(member_of(family, values, 0.4 * length)), options)
            begun = time.process_time()
            ours = solve(model, options)
            seconds = time.process_time() - begun
            text = re.sub(r"\*NODE PRINT[^\n]*\nRF", "*NODE PRINT, NSET=ALL\nU", write_inp(model))
            text = text[: text.index("** step 2")]
            with tempfile.TemporaryDirectory() as folder:
                Path(folder, "m.inp").write_text(text)
                before = resource.getrusage(resource.RUSAGE_CHILDREN)
                subprocess.run(["ccx", "-i", "m"], cwd=folder, check=True, capture_output=True, env={**os.environ, "OMP_NUM_THREADS": "1"})
                after = resource.getrusage(resource.RUSAGE_CHILDREN)
                rows = re.findall(r"^\s+(\d+)\s+(\S+)\s+(\S+)\s+(\S+)\s*$", Path(folder, "m.dat").read_text(), re.M)
            theirs = np.zeros_like(ours.displacement_m)
            for number, *u in rows:
                theirs[int(number) - 1] = [float(x) for x in u]
            off = np.abs(theirs - ours.displacement_m).max() / np.abs(theirs).max()
            spent = after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime
            print(f"| {family}, down {down} | {ours.n_dof} | {off:.1e} | {seconds:.1f} | {spent:.1f} |", flush=True)


def coverage(given):
    """Do the stated error bars hold the truth? Members scanned (6 000 points, noise 1 mm), fitted; their response beside that of the truth."""
    path = Path(given.state)
    known = [json.loads(line) for line in path.read_text().splitlines()] if path.exists() else []
    done = {(row["family"], row["seed"]) for row in known}
    for seed in range(given.seeds):
        for family in ("L", "I", "RHS"):
            if (family, seed) in done:
                continue
            values, length = SHAPES[family]
            truth = beam_response(properties_of(family, values, level=0), STEEL, length, 100.0)
            points = member_points(family, {**values, "length": length}, 6_000, MemberScanOptions(noise_m=0.001, seed=seed), ((), ()))
            points = points @ random_rotation(np.random.default_rng([seed, 1])).T
            found = fit_member(Scan(cloud=PointCloud.of(points)), MemberOptions()).member
            row = {"family": family, "seed": seed, "found": found.family}
            if found.family == family:
                told = budget(found, STEEL, 100.0, 0.0, 200, 0)
                keys = [k for k in ("mass_kg", "bend_x_x", "twist", "buckling_n", "f1_hz") if told.std[k] > 0]
                row["z"] = {k: (told.value[k] - truth[k]) / told.std[k] for k in keys}
                row["relative"] = {k: told.std[k] / abs(told.value[k]) for k in row["z"]}
            known.append(row)
            with path.open("a") as handle:
                handle.write(json.dumps(row) + "\n")
    table = defaultdict(list)
    for row in known:
        for key, z in row.get("z", {}).items():
            table[row["family"], key].append((z, row["relative"][key]))
    print("| family | figure | fits | within 2 std | rms of z | std |\n|---|---|---|---|---|---|")
    for (family, key), rows in sorted(table.items()):
        z, relative = np.array(rows).T
        within, spread = 100 * np.mean(np.abs(z) <= 2), np.sqrt(np.mean(z**2))
        print(f"| {family} | {key} | {len(z)} | {within:.0f} % | {spread:.2f} | {100 * np.median(relative):.2f} % |")


def main():
    told = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    told.add_argument("what", choices=("sections", "beam", "patch", "slopes", "calculix", "coverage"))
    told.add_argument("--seeds", type=int, default=100)
    told.add_argument("--state", default="fea-coverage.jsonl")
    told.add_argument("--quick", action="store_true")
    given = told.parse_args()
    {"sections": sections, "beam": beam, "patch": patch, "slopes": slopes, "calculix": calculix, "coverage": coverage}[given.what](given)


if __name__ == "__main__":
    main()
