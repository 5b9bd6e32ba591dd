"""Every experiment by its own number, in the thesis's order. An experiment is a function and a line here."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence

from scan2fea.errors import UsageError, require
from scan2fea.thesis import approach, background, blanks, conclusion, drawings, hypotheses, own_meshes, results, segments, unposed
from scan2fea.thesis.bench import ThesisOptions
from scan2fea.thesis.best import CASES, OF_CLOUD, every_of, shown
from scan2fea.thesis.experiment import Chore, Experiment
from scan2fea.thesis.published import printed_tables

_STEPS = {"first": "first mesh", "lloyd": "after Lloyd", "odt": "after ODT", "perturb": "after perturbation", "exude": "after exudation"}
# figure: mesh, step
_ZERO = {5: "AF first", 6: "SS2 first", 7: "SS4 first", 8: "SS15 first", 9: "AF lloyd", 10: "SS2 lloyd", 11: "SS4 lloyd", 12: "AF odt", 13: "SS2 odt",
         14: "SS4 odt", 15: "AF perturb", 16: "SS2 perturb", 17: "AF exude", 18: "SS2 exude", 19: "SS4 exude"}  # fmt: skip
_NOISE = {25: "AF first", 26: "SS2 first", 27: "SS4 first", 28: "SS2 lloyd", 29: "SS4 lloyd", 30: "SS2 odt", 31: "SS4 odt", 32: "SS2 perturb",
          33: "SS4 perturb", 34: "SS2 exude", 35: "SS4 exude"}  # fmt: skip
_HDL = {40: "AF first", 41: "SS2 first", 42: "SS4 first", 43: "AF lloyd", 44: "SS2 lloyd", 45: "SS4 lloyd", 46: "SS2 odt", 47: "SS4 odt",
        48: "SS2 perturb", 49: "SS4 perturb", 50: "SS2 exude", 51: "SS4 exude"}  # fmt: skip
# of each case: the clouds that its beam comes from
_CLOUD: Mapping[str, list[Chore]] = {"zero": [("lab",)], "noise": [], "hdl": [("hdl", "5"), ("treated", "hdl")]}
_SECTION = {"first": "2", "lloyd": "3", "odt": "3", "perturb": "3", "exude": "3"}


def _of_mesh(case: str, mesh: str, stage: str) -> list[Chore]:
    """What a mesh of section 4 takes: the cloud, its normals (of scale space), and the chain as far as it is wanted."""
    normals = [] if mesh == "AF" else [("normals", case)]
    return [*_CLOUD[case], ("beam", case), *normals, ("first" if stage == "first" else "chain", case, mesh)]


def _of_table(name: str, case: str) -> Callable[[ThesisOptions], Sequence[Chore]]:
    def needs(options: ThesisOptions) -> Sequence[Chore]:
        found: list[Chore] = [("best", of) for of in shown(case, quick=options.quick)]
        for row in printed_tables()[name].rows:
            found += _of_mesh(case, row.mesh, row.stage)
            if row.stage == "optimised" and (row.mesh == "AF" or not options.quick):
                found.append(("held", case, row.mesh))
        return found

    return needs


def _of_best(options: ThesisOptions) -> Sequence[Chore]:
    cases = conclusion.cases_of(options)
    sweeps = sorted({str(every_of(case)) for case in cases if case.startswith("hdl")})
    return [("lab",), *(("hdl", every) for every in sweeps), *(("best", case) for case in cases)]


def _of_own_meshes(options: ThesisOptions) -> Sequence[Chore]:
    return () if options.quick else [chore for name, case in own_meshes.OF_TABLE.items() for chore in _of_table(name, case)(options)]


def _of_pictures(case: str) -> Callable[[ThesisOptions], Sequence[Chore]]:
    return _of_clouds(("treated", case), ("best", OF_CLOUD[case][0]), *_of_mesh(case, "AF", "first"))


def _of_clouds(*chores: Chore) -> Callable[[ThesisOptions], Sequence[Chore]]:
    return lambda _: chores


def _meshes(case: str, part: int, figures: Mapping[int, str]) -> Iterable[Experiment]:
    for number, what in figures.items():
        mesh, stage = what.split()
        make, needs = results.mesh_picture_of(case, mesh, stage), _of_clouds(*_of_mesh(case, mesh, stage))
        title, section = f"{results.NAMES[mesh]}, {_STEPS[stage]}", f"4.{part}.{_SECTION[stage]}"
        yield Experiment(id=f"F4.{number}", section=section, title=title, make=make, needs=needs)


def _table(name: str, case: str) -> Experiment:
    printed = printed_tables()[name]
    return Experiment(id=name, section=printed.section, title=printed.title, make=results.quality_table(name, case), needs=_of_table(name, case))


def _all() -> Iterable[Experiment]:
    one = Experiment
    zero, noise = _of_clouds(("lab",), ("treated", "zero")), _of_clouds(("treated", "noise"))
    hdl, sweeps = _of_clouds(*_CLOUD["hdl"]), _of_clouds(("hdl", "5"))
    cut = _of_clouds(*(chore for mesh in ("SS2", "SS4") for chore in _of_mesh("hdl", mesh, "exude")), ("best", "hdl_known"))
    yield one(id="F2.4", section="2.1.2", title="One turn of a single-beam LiDAR", make=background.one_beam)
    yield one(id="F2.5", section="2.1.2", title="Data of an HDL-32E", make=background.hdl_data)
    yield one(id="S2.1", section="2.1.2", title="What the sensors of 2.1 bring home (left open)", make=blanks.sensors)
    yield one(id="S2.2", section="2.2", title="Fusion of motion sensors (left open)", make=blanks.fusion)
    yield one(id="F2.6", section="2.3.1", title="Feature of an intrinsic shape signature", make=background.feature)
    yield one(id="F2.7", section="2.3.2", title="Noise filter on an L block with 10 % strays", make=background.noise_filter)
    yield one(id="F2.8", section="2.3.3", title="An L block thinned by voxels", make=background.thinning)
    yield one(id="F2.9", section="2.3.4", title="What stands before a wall, and what is behind it", make=background.occlusion)
    yield one(id="F2.11", section="2.4.1", title="Activation functions", make=drawings.activations)
    yield one(id="F2.13", section="2.4.2", title="Divisive and agglomerative clustering", make=drawings.hierarchies)
    yield one(id="F2.16", section="2.5", title="A NURBS curve", make=drawings.spline)
    yield one(id="F2.17", section="2.5.1", title="Voronoi cells and Delaunay triangles", make=drawings.tessellation)
    yield one(id="F2.18", section="2.5.1", title="Edges and half edges", make=drawings.half_edge)
    yield one(id="S2.5.1", section="2.5.1", title="Refinement of a patch (left open)", make=blanks.refinement)
    yield one(id="F2.19", section="2.5.2", title="Bad elements and their measures (with table 2.1)", make=drawings.bad_elements)
    yield one(id="F2.20", section="2.5.2", title="Relaxation after 1, 5, 10 and 15 iterations", make=drawings.relaxation)
    yield one(id="S2.5.2", section="2.5.2", title="What eq 2.20 measures (left open)", make=blanks.eq_2_20)
    yield one(id="F3.1", section="3.3.1", title="The lab without noise", make=approach.lab_zero)
    yield one(id="F3.2", section="3.3.2", title="The lab with noise of 2 cm", make=approach.lab_noisy)
    yield one(id="F3.3", section="3.3.3", title="How an HDL-32E scans", make=approach.lidar_fan)
    yield one(id="F3.4", section="3.3.3", title="How frames are joined", make=approach.concatenation)
    yield one(id="T3.1", section="3.3.5", title="Clustering methods on control sets", make=approach.control_sets)
    yield one(id="T3.2", section="3.3.6", title="What a growing scale does", make=approach.scales, needs=_of_clouds(("lab",), ("beam", "zero")))
    yield one(id="S3.3.7", section="3.3.7", title="Which measures the optimisers improve (left open)", make=blanks.improved)
    yield one(id="F3.5", section="3.3.9", title="Informed shape estimation", make=approach.estimation_flow)
    yield one(id="F3.6", section="3.3.9", title="Shape estimation on a block of 10 x 10 x 5 in", make=approach.shape_estimation)
    yield one(id="F4.1", section="4.1", title="Zero noise: the cloud", make=segments.raw_cloud("zero"))
    yield one(id="F4.2", section="4.1", title="Zero noise: filtered and thinned", make=segments.filtered_cloud("zero"), needs=zero)
    yield one(id="F4.3", section="4.1.1", title="Zero noise: four clusterings", make=segments.clusterings("zero"), needs=zero)
    yield one(id="F4.4", section="4.1.1", title="Zero noise: clusters of 3,000 to 50,000 points", make=segments.size_limits, needs=zero)
    yield from _meshes("zero", 1, {k: v for k, v in _ZERO.items() if k <= 8})
    yield _table("T4.1", "zero")
    yield from _meshes("zero", 1, {k: v for k, v in _ZERO.items() if k > 8})
    yield _table("T4.2", "zero")
    yield one(id="F4.20", section="4.2", title="Simulated HDL-32E, every sweep", make=segments.hdl_cloud(1), needs=_of_clouds(("hdl", "1")))
    yield one(id="F4.21", section="4.2", title="Simulated HDL-32E, one sweep in five", make=segments.hdl_cloud(5), needs=sweeps)
    yield one(id="F4.22", section="4.2", title="Noise of 2 cm: the cloud", make=segments.raw_cloud("noise"))
    yield one(id="F4.23", section="4.2", title="Noise of 2 cm: filtered and thinned", make=segments.filtered_cloud("noise"), needs=noise)
    yield one(id="F4.24", section="4.2.1", title="Noise of 2 cm: four clusterings", make=segments.clusterings("noise"), needs=noise)
    yield from _meshes("noise", 2, {k: v for k, v in _NOISE.items() if k <= 27})
    yield _table("T4.3", "noise")
    yield from _meshes("noise", 2, {k: v for k, v in _NOISE.items() if k > 27})
    yield _table("T4.4", "noise")
    yield one(id="F4.36", section="4.3", title="One LiDAR frame", make=segments.one_frame, needs=sweeps)
    yield one(id="F4.37", section="4.3", title="LiDAR frames joined", make=segments.joined, needs=sweeps)
    yield one(id="S4.3", section="4.3", title="LiDAR frames joined without poses", make=unposed.without_poses, needs=unposed.chores)
    yield one(id="F4.38", section="4.3", title="LiDAR frames filtered and thinned", make=segments.filtered_cloud("hdl"), needs=hdl)
    yield one(id="F4.39", section="4.3.1", title="The beam's cluster", make=segments.hdl_clusters, needs=hdl)
    yield from _meshes("hdl", 3, {k: v for k, v in _HDL.items() if k <= 42})
    yield _table("T4.5", "hdl")
    yield from _meshes("hdl", 3, {k: v for k, v in _HDL.items() if k > 42})
    yield _table("T4.6", "hdl")
    yield one(id="F4.52", section="4.3.4", title="Scale space 2, cut", make=results.cut_picture("SS2"), needs=cut)
    yield one(id="F4.53", section="4.3.4", title="Scale space 4, cut", make=results.cut_picture("SS4"), needs=cut)
    yield one(id="T4.7", section="4.3.4", title=printed_tables()["T4.7"].title, make=results.cut_table, needs=cut)
    yield one(id="S4.4", section="4.4", title="What each data set tells of the beam", make=conclusion.dimensions, needs=_of_best)
    for number, case in enumerate(conclusion.SETS, 1):
        make, needs = conclusion.four_pictures(case), _of_pictures(case)
        yield one(id=f"S4.4.{number}", section="4.4", title=f"Shape estimation: {CASES[OF_CLOUD[case][0]]}", make=make, needs=needs)
    yield one(id="S5.1", section="5", title="Boundary representations", make=conclusion.boundary_representations, needs=_of_best)
    beside = "Finite elements: the converted beams beside the true one"
    yield one(id="S5.2", section="5", title=beside, make=conclusion.finite_elements, needs=_of_best)
    own = "Finite elements: the thesis's own meshes that convert"
    yield one(id="S5.3", section="5", title=own, make=own_meshes.thesis_meshes, needs=_of_own_meshes)
    yield one(id="H1", section="H", title="When the beam can be isolated", make=hypotheses.isolation, needs=hypotheses.isolation_chores)
    yield one(id="H2.1", section="H", title="Free form by spacing and noise", make=hypotheses.free_map, needs=hypotheses.chores_of("free"))
    yield one(id="H2.2", section="H", title="Free form by what was seen", make=hypotheses.view_map, needs=hypotheses.chores_of("views"))
    yield one(id="H2.3", section="H", title="Members by what was seen, and noise", make=hypotheses.member_map, needs=hypotheses.chores_of("member"))
    yield one(id="H2.4", section="H", title="How far smoothing may go", make=hypotheses.scale_limits)
    yield one(id="H2.5", section="H", title="Conditions that a cloud must meet", make=hypotheses.limits, needs=hypotheses.chores_of("free", "member"))


EXPERIMENTS: Mapping[str, Experiment] = {experiment.id: experiment for experiment in _all()}
# figures of other works that the thesis reprints, and schemes without data: nothing to compute
REPRINTED = {
    "F2.1": "structure from motion", "F2.2": "its steps", "F2.3": "a cloud of it", "F2.10": "map of a network", "F2.12": "blocks of a network",
    "F2.14": "parts of a surface mesh", "F2.15": "parts of a boundary representation",
}  # fmt: skip


def chosen(only: str | None) -> tuple[Experiment, ...]:
    """The experiments named, by a comma, in their own order; all without. Raises UsageError for an unknown one."""
    if only is None:
        return tuple(EXPERIMENTS.values())
    names = [name.strip().upper() for name in only.split(",") if name.strip()]
    require(names, UsageError, "--only names nothing: give numbers, e.g. --only T4.1,F4.9")
    for name in names:
        why = f"the thesis reprints it ({REPRINTED[name]}): nothing to compute" if name in REPRINTED else "no such experiment"
        require(name in EXPERIMENTS, UsageError, f"--only {name}: {why}; there are {', '.join(EXPERIMENTS)}")
    return tuple(experiment for name, experiment in EXPERIMENTS.items() if name in names)
