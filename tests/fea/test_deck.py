import itertools
import os
import re
import shutil
import subprocess

import numpy as np
import pytest

from fea.bars import bar, l_bar
from scan2fea.errors import InternalError
from scan2fea.fea import FeaOptions, build_model, solve, write_bdf, write_inp
from scan2fea.fea.assemble import assemble
from scan2fea.fea.deck import element_faces
from scan2fea.fea.elements import FACES
from scan2fea.types import TetMesh
from scan2fea.units import UNIT_SYSTEMS


def calculix(text, folder):
    """(displacements of each step, text of the .dat file) by ccx; skips without it, but not in CI."""
    exe = shutil.which("ccx")
    if exe is None:
        assert "CI" not in os.environ, "CI must have CalculiX: apt-get install calculix-ccx"
        pytest.skip("CalculiX (ccx) is not installed here")
    (folder / "model.inp").write_text(text)
    run = subprocess.run([exe, "-i", "model"], cwd=folder, capture_output=True, text=True, timeout=120, env={**os.environ, "OMP_NUM_THREADS": "1"})
    assert run.returncode == 0 and "*ERROR" not in run.stdout and "*WARNING" not in run.stdout, run.stdout[-2000:]
    steps, rows = [], None
    for line in (folder / "model.frd").read_text().splitlines():
        if line.startswith(" -4") and "DISP" in line:
            rows = []
        elif line.startswith(" -1") and rows is not None:
            rows.append([float(line[13 + 12 * k : 25 + 12 * k]) for k in range(3)])
        elif line.startswith(" -3") and rows is not None:
            steps.append(np.array(rows))
            rows = None
    return steps, (folder / "model.dat").read_text()


def block(text, name):
    """Data lines under the keyword that begins with `name`."""
    lines = text.splitlines()
    start = next(k for k, line in enumerate(lines) if line.startswith(name))
    stop = next(k for k in range(start + 1, len(lines)) if lines[k].startswith("*"))
    return [line.rstrip(",").split(",") for line in lines[start + 1 : stop]]


@pytest.mark.parametrize(
    ("mesh", "down"),
    [(bar((0.1, 0.1, 1.0), (1, 1, 6)), "-z"), (l_bar(0.127, 0.00635, 0.6, 3, 12), "-x"), (bar((1.0, 0.3, 0.3), (6, 2, 2), order=1), "-y")],
    ids=["post", "angle lying", "linear"],
)
def test_calculix_runs_it_and_agrees(mesh, down, tmp_path):
    options = FeaOptions(down=down)
    model = build_model(mesh, options)
    ours = solve(model, options)
    steps, dat = calculix(write_inp(model), tmp_path)
    assert len(steps) == 1 + 4
    largest = np.linalg.norm(ours.displacement_m, axis=1).max()
    assert np.linalg.norm(steps[0], axis=1).max() == pytest.approx(largest, rel=1e-4)
    assert np.abs(steps[0] - ours.displacement_m).max() < 1e-4 * largest
    total = re.search(r"total force.*?LOWEST.*?\n\s*\n\s*(\S+)\s+(\S+)\s+(\S+)", dat)
    reaction = np.array([float(x) for x in total.groups()])
    # CalculiX prints what the elements pull at the support; the weight of the held nodes themselves goes straight into the ground
    row = np.asarray(assemble(mesh, model.material).mass_matrix().sum(axis=1))
    at_support = row[model.node_sets["LOWEST"]].sum() * model.acceleration_m_s2
    assert np.abs(reaction - at_support - ours.reaction_n).max() < 1e-4 * np.linalg.norm(ours.reaction_n)
    rows = re.findall(r"^\s+\d+\s+(\S+)\s+(\S+)\s+(\S+)\s+(\S+)\s*$", dat[dat.index("E I G E N V A L U E") :], re.M)
    frequencies = [float(r[2]) for r in rows[:4]]
    assert len(frequencies) == 4 and 0 < frequencies[0] <= frequencies[3]
    # Rayleigh: the static shape bounds the lowest frequency from above, (1/2pi) sqrt(a'Mu / u'Mu) >= f1
    assert frequencies[0] < 5 * ours.frequencies_hz[6]


def test_calculix_finds_the_same_free_modes(tmp_path):
    """CalculiX integrates the mass of C3D10 by another rule: 6e-4 apart on a bar one element deep, 7e-5 on two, 2e-5 on three."""
    model = build_model(bar((1.0, 0.1, 0.06), (16, 2, 2)))
    ours = solve(model)
    text = write_inp(model, n_modes=10)
    free = re.sub(r"\*BOUNDARY\n.*\n", "", text)
    free = re.sub(r"\*\* step 1.*?\*END STEP\n", "", free, flags=re.S)
    _, dat = calculix(free, tmp_path)
    rows = re.findall(r"^\s+(\d+)\s+(\S+)\s+(\S+)\s+(\S+)\s+(\S+)\s*$", dat, re.M)
    theirs = [float(r[3]) for r in rows[:10]]
    assert theirs[6:] == pytest.approx(ours.frequencies_hz[6:].tolist(), rel=1e-4)


@pytest.mark.parametrize("units", ["mm-N-MPa", "in-lbf-psi"])
def test_other_units_give_the_same_part(units, tmp_path):
    model = build_model(bar((0.1, 0.1, 1.0), (1, 1, 5)))
    text = write_inp(model, UNIT_SYSTEMS[units])
    assert f"** units: {units}" in text
    length = UNIT_SYSTEMS[units].length
    steps, dat = calculix(text, tmp_path)
    assert np.abs(steps[0]).max() / length == pytest.approx(figure(solve(model)), rel=1e-4)
    assert "E I G E N V A L U E" in dat


def figure(result):
    return np.abs(result.displacement_m).max()


def test_deck_says_what_it_is():
    model = build_model(bar((0.1, 0.1, 0.4), (1, 1, 2)))
    text = write_inp(model, lines=("from scan.ply",))
    assert "** units: m-N-Pa (m, N, Pa, kg, s)" in text and "** from scan.ply" in text and "** run: ccx -i model" in text
    assert "*ELEMENT, TYPE=C3D10, ELSET=BODY" in text and text.count("*STEP\n") == 2
    assert float(block(text, "*ELASTIC")[0][0]) == 210e9 and float(block(text, "*DENSITY")[0][0]) == 7850
    xyz = np.array(block(text, "*NODE, NSET=ALL"), float)
    assert (xyz[:, 0] == np.arange(1, len(xyz) + 1)).all()
    assert np.allclose(xyz[:, 1:], model.mesh.nodes, rtol=0, atol=1e-12)
    assert (np.array(block(text, "*ELEMENT"), int)[:, 1:] == model.mesh.tets + 1).all()
    for name, nodes in model.node_sets.items():
        if name != "ALL":
            listed = [int(x) for row in block(text, f"*NSET, NSET={name}") for x in row]
            assert listed == (nodes + 1).tolist()
    assert max(map(len, text.splitlines())) < 120
    assert all(len(entry.strip()) <= 20 for row in block(text, "*NODE, NSET") for entry in row)
    assert write_inp(model) == write_inp(model) != text


def test_surfaces_name_the_faces_of_elements():
    mesh = bar((1, 1, 1), (2, 2, 2))
    sides = element_faces(mesh)
    corners = mesh.tets[sides[:, :1], np.array(FACES)[sides[:, 1]]]
    assert (np.sort(corners, axis=1) == np.sort(mesh.boundary[:, :3], axis=1)).all()
    text = write_inp(build_model(mesh))
    listed = [row for name in mesh.face_names for row in block(text, f"*SURFACE, NAME={name}, TYPE=ELEMENT")]
    assert len(listed) == len(mesh.boundary) and all(re.fullmatch(r" S[1-4]", row[1]) for row in listed)
    wrong = np.array(mesh.boundary)
    wrong[0, :3] = [0, 1, len(mesh.nodes) - 1]
    with pytest.raises(InternalError, match="face of no element"):
        element_faces(TetMesh(nodes=mesh.nodes, tets=mesh.tets, boundary=wrong, face_tag=mesh.face_tag, face_names=mesh.face_names))


def test_nastran_deck_reads_back():
    """Read in fixed fields, as a Nastran solver does."""
    model = build_model(bar((0.1, 0.1, 0.4), (1, 1, 2)))
    text = write_bdf(model, UNIT_SYSTEMS["mm-N-MPa"])
    lines = text.splitlines()
    bulk = lines[lines.index("BEGIN BULK") + 1 :]
    assert bulk[-1] == "ENDDATA" and "SOL 101" in lines
    grid = [a + b[8:] for a, b in itertools.pairwise(bulk) if a.startswith("GRID*")]
    xyz = np.array([[float(g[40 + 16 * k : 56 + 16 * k]) for k in range(3)] for g in grid])
    assert np.allclose(xyz, 1e3 * model.mesh.nodes, rtol=1e-9, atol=1e-9)
    tets = []
    for a, b in itertools.pairwise(bulk):
        if a.startswith("CTETRA"):
            assert a[16:24].strip() == "1" and b[:8].strip() == ""
            tets.append([int(a[24 + 8 * k : 32 + 8 * k]) for k in range(6)] + [int(b[8 + 8 * k : 16 + 8 * k]) for k in range(4)])
    assert (np.array(tets) - 1 == model.mesh.tets).all()
    middle = {(0, 1): 4, (1, 2): 5, (0, 2): 6, (0, 3): 7, (1, 3): 8, (2, 3): 9}  # 12 23 13 14 24 34 of the manual
    for (i, j), k in middle.items():
        x = xyz[np.array(tets) - 1]
        assert np.allclose(x[:, k], (x[:, i] + x[:, j]) / 2)
    mat1 = next(a + b[8:] for a, b in itertools.pairwise(bulk) if a.startswith("MAT1*"))
    e, nu, rho = (float(mat1[8 + 16 * k : 24 + 16 * k]) for k in (1, 3, 4))
    assert (e, nu, rho) == (pytest.approx(210e3), pytest.approx(0.3), pytest.approx(7.85e-9))
    grav = next(a + b[8:] for a, b in itertools.pairwise(bulk) if a.startswith("GRAV*"))
    assert float(grav[40:56]) == pytest.approx(9806.65) and float(grav[88:104]) == -1.0
    start = next(k for k, line in enumerate(bulk) if line.startswith("SPC1"))
    listed = [int(x) for x in bulk[start].split()[3:]]
    for line in bulk[start + 1 :]:
        if not line.startswith(" "):
            break
        listed += [int(x) for x in line.split()]
    assert listed == (model.node_sets["LOWEST"] + 1).tolist()
    assert max(map(len, bulk)) <= 80
