"""The command line: what each command takes. One function a command; options that several share are added by one function each."""

from __future__ import annotations

import argparse
from typing import TYPE_CHECKING

from scan2fea import __version__

if TYPE_CHECKING:
    Commands = argparse._SubParsersAction[argparse.ArgumentParser]


CALIBRATION = "of pictures: their cameras, or a folder of chessboards [acquisition.calibration]; else calib.txt of KITTI [registration.calibration]"


def parser() -> argparse.ArgumentParser:
    """The whole command line: one function per command below, in the order of the help."""
    top = argparse.ArgumentParser(prog="scan2fea", description="From raw 3D scans to checked finite element models.", allow_abbrev=False)
    top.add_argument("--version", action="version", version=f"scan2fea {__version__}")
    commands = top.add_subparsers(dest="command", metavar="COMMAND", required=True)
    for add in (_run, _demo, _simulate, _plan, _check, _info, _fit, _register, _fuse, _segment, _train, _reconstruct, _thesis, _config, _view):
        add(commands)
    return top


def _run(commands: Commands) -> None:
    run = commands.add_parser("run", help="scans to solved, checked FE models", allow_abbrev=False)
    _add_scans(run, "scan files (or closed meshes), photographs, or folders of them, of one scene")
    run.add_argument("--resume", action="store_true", help="go on in OUT: what is unchanged is not made again; labels.csv may have been edited")
    _add_poses(run)
    _add_pictures(run)
    run.add_argument("--labels", metavar="COLUMN", help="take the objects from this column (name or number) [input.labels]")
    _add_motion(run)
    _add_member(run, "section of every object, where it is known: L127x127x6.35 (mm), HE 140 A, W8X31 [route.member]")
    _add_options(run)


def _demo(commands: Commands) -> None:
    demo = commands.add_parser("demo", help="a simulated lab scan through everything", allow_abbrev=False)
    demo.add_argument("-o", "--out", default="scan2fea-demo", metavar="OUT")
    _add_options(demo)


def _simulate(commands: Commands) -> None:
    simulate = commands.add_parser("simulate", help="scan a scene of exact solids: points, truth, meshes, STEP, picture", allow_abbrev=False)
    simulate.add_argument("scene", metavar="SCENE", help="a scene file (TOML), or lab (the source thesis's room), or demo")
    simulate.add_argument("-o", "--out", required=True, metavar="OUT", help="folder for everything that is made")
    _add_scene_options(simulate)
    simulate.add_argument(
        "--format", action="append", metavar="F", help="ply (default: everything known of each point), pcd, ptx, las or xyz; repeatable"
    )
    simulate.add_argument("--no-step", action="store_true", help="leave the STEP files out: of finely curved objects they take longer than the scan")


def _plan(commands: Commands) -> None:
    plan = commands.add_parser("plan", help="what planned stations will see of a scene, and which dimensions that will tell", allow_abbrev=False)
    plan.add_argument("scene", metavar="SCENE", help="a scene file (TOML), or lab, or demo")
    _add_scene_options(plan)
    plan.add_argument("--json", action="store_true", help="print the plan as JSON")


def _check(commands: Commands) -> None:
    check = commands.add_parser("check", help="would a solver accept this mesh or deck, is this STEP file one solid?", allow_abbrev=False)
    check.add_argument("file", metavar="MESH")
    check.add_argument("--json", action="store_true", help="print the figures as JSON")


def _info(commands: Commands) -> None:
    info = commands.add_parser("info", help="what a file holds", allow_abbrev=False)
    info.add_argument("file", metavar="FILE")
    info.add_argument("--unit", help="unit of the file where its format states none")


def _fit(commands: Commands) -> None:
    fit = commands.add_parser("fit", help="the points of one file as one member: dimensions with standard deviations", allow_abbrev=False)
    _add_scan(fit)
    fit.add_argument("-o", "--out", metavar="MEMBER.json", help="write the member here too")
    fit.add_argument("--family", help="family of its section: L, I, C, T, RHS, CHS, rect, round [estimation.family]")
    _add_member(fit, "section that is known: L127x127x6.35 (mm), HE 140 A, W8X31 [route.member]")
    _add_options(fit)


def _register(commands: Commands) -> None:
    register = commands.add_parser("register", help="scans into one frame: cloud.ply, trajectory.txt and how sure each place is", allow_abbrev=False)
    _add_scans(register)
    _add_poses(register)
    _add_pictures(register)
    _add_motion(register)
    _add_options(register)


def _fuse(commands: Commands) -> None:
    fuse = commands.add_parser("fuse", help="logs of motion sensors to one trajectory with covariance", allow_abbrev=False)
    fuse.add_argument("inputs", nargs="+", metavar="LOG", help="inertial log, positions (csv, NMEA), odometry (TUM), ranges in a plane: told apart")
    fuse.add_argument("-o", "--out", required=True, metavar="OUT", help="folder for what is made")
    fuse.add_argument("--method", metavar="M", help="kalman (default), complementary, particle [fusion.method]")
    fuse.add_argument("--poses", metavar="FILE", dest="known_poses", help="poses in the world (TUM), e.g. of a camera [fusion.poses]")
    fuse.add_argument("--map", metavar="SCAN", help="scan of the place, of method particle [fusion.map]")
    _add_options(fuse)


def _segment(commands: Commands) -> None:
    segment = commands.add_parser("segment", help="scans to one label per point: cloud.ply, labels.csv and a picture", allow_abbrev=False)
    _add_scans(segment)
    methods = "euclidean (default), kmeans, fuzzy_cmeans, agglomerative, divisive, learned, primitives, given, single [segmentation.method]"
    segment.add_argument("--method", metavar="M", help=methods)
    _add_poses(segment)
    _add_motion(segment)
    segment.add_argument("--labels", metavar="COLUMN", help="true labels of the file (name or number), to compare with [input.labels]")
    _add_options(segment)


def _train(commands: Commands) -> None:
    train = commands.add_parser("train", help="teach the learned segmentation: on simulated scenes, or on labelled files", allow_abbrev=False)
    train.add_argument("inputs", nargs="*", metavar="LABELLED", help="files with a class per point; without any: simulated rooms")
    train.add_argument("-o", "--out", required=True, metavar="WEIGHTS.npz", help="weights (segmentation.weights); figures go beside them as .json")
    train.add_argument("--labels", metavar="COLUMN", help="column of the classes (name or number) [input.labels]")
    train.add_argument("--names", metavar="A,B,...", help="names of the classes, in the order of their labels; floor, wall, clutter are no objects")
    train.add_argument("--unit", help="unit of the files where their format states none [input.unit]")
    train.add_argument("--objects", type=int, default=170, metavar="N", help="simulated objects of each kind (170); 0: keep the network of --base")
    train.add_argument("--rooms", type=int, default=15, metavar="N", help="simulated rooms (15) where no file is given; 0: keep the forest of --base")
    train.add_argument("--epochs", type=int, default=8, metavar="N", help="passes of the network over its objects (8)")
    train.add_argument("--base", default="", metavar="FILE", help="weights to keep a part of; default: the shipped ones")
    _add_options(train)


def _reconstruct(commands: Commands) -> None:
    reconstruct = commands.add_parser("reconstruct", help="the points of one file as one closed surface", allow_abbrev=False)
    _add_scan(reconstruct)
    reconstruct.add_argument("-o", "--out", required=True, metavar="OUT", help="folder for what is made")
    methods = "visibility (default), planar, advancing_front, scale_space, ball_pivoting, poisson [reconstruction.method]"
    reconstruct.add_argument("--method", metavar="M", help=methods)
    _add_options(reconstruct)


def _thesis(commands: Commands) -> None:
    thesis = commands.add_parser("thesis", help="the source thesis's tables and figures, made by this program", allow_abbrev=False)
    thesis.add_argument("-o", "--out", default="scan2fea-thesis", metavar="OUT", help="folder for thesis.html, a CSV per table, a PNG per figure")
    thesis.add_argument("--only", metavar="T4.1,F4.9", help="these numbers alone")
    thesis.add_argument("--quick", action="store_true", help="smaller inputs: minutes instead of most of an hour")
    thesis.add_argument("--clock", type=float, metavar="S", help="stop ODT, perturbation, exudation after S seconds (thesis: 30), not iterations")
    thesis.add_argument("--real", metavar="FILE", help="a capture of a Velodyne HDL-32E (.pcap) for the figures of acquisition")
    thesis.add_argument("--jobs", type=int, metavar="N", help="processes at once; default: one a core (each takes up to 1.5 GB); same results")
    thesis.add_argument("--seed", type=int, default=0, help="seed of everything random")


def _config(commands: Commands) -> None:
    config = commands.add_parser("config", help="print every option, with its explanation, as TOML", allow_abbrev=False)
    _add_options(config, seed=False)


def _view(commands: Commands) -> None:
    view = commands.add_parser("view", help="open the report of a run", allow_abbrev=False)
    view.add_argument("out", metavar="OUT")


def _add_scans(command: argparse.ArgumentParser, what: str = "scan files of one scene") -> None:
    """Several files in, one folder out."""
    command.add_argument("inputs", nargs="+", metavar="INPUT", help=what)
    command.add_argument("-o", "--out", required=True, metavar="OUT", help="folder for everything that is made")
    _add_reading(command, "each file")


def _add_scan(command: argparse.ArgumentParser) -> None:
    """One file in."""
    command.add_argument("file", metavar="FILE")
    _add_reading(command, "the file")


def _add_reading(command: argparse.ArgumentParser, which: str) -> None:
    command.add_argument("--unit", help="unit of the input where its format states none [input.unit]")
    command.add_argument(
        "--sensor-position", nargs=3, type=float, metavar=("X", "Y", "Z"), help=f"where the scanner stood, in the frame and unit of {which}"
    )


def _add_poses(command: argparse.ArgumentParser) -> None:
    command.add_argument("--poses", metavar="FILE", help="where each input stood (bun.conf, TUM, KITTI, 4x4) [registration.poses]")
    command.add_argument("--calibration", metavar="FILE", help=CALIBRATION)


def _add_motion(command: argparse.ArgumentParser) -> None:
    command.add_argument("--imu", metavar="FILE", help="inertial log of the scanner: with --gps it tells the motion of a capture [fusion.imu]")
    command.add_argument("--gps", metavar="FILE", help="log of the satellite receiver (csv, NMEA, or a .pcap) [fusion.gps]")


def _add_member(command: argparse.ArgumentParser, what: str) -> None:
    command.add_argument("--member", metavar="D", help=what)
    command.add_argument("--catalogue", metavar="FILE", help="CSV table of sections instead of the shipped one [route.catalogue]")


def _add_pictures(command: argparse.ArgumentParser) -> None:
    command.add_argument("--scale", metavar="TEXT", help='of photographs: "0.25 m between targets A B", or cameras [acquisition.scale]')
    command.add_argument("--known-length", metavar="TEXT", help='of photographs: "0.8 m 03.jpg 120,340 810,355" [acquisition.known_length]')
    command.add_argument("--sensor", metavar="S", help="ultrasonic: the input is a log of pings [acquisition.sensor]")


def _add_scene_options(command: argparse.ArgumentParser) -> None:
    command.add_argument("--sensor", metavar="S", help="scan with this sensor alone, e.g. terrestrial or hdl32e")
    command.add_argument("--noise", metavar="N", help='noise of every sensor, e.g. "2 mm" (standard deviation) or "uniform:20 mm" (half width)')
    command.add_argument("--seed", type=int, default=0, help="seed of everything random")


def _add_options(command: argparse.ArgumentParser, *, seed: bool = True) -> None:
    command.add_argument("-c", "--config", metavar="FILE.toml", help="options, as `scan2fea config` prints them")
    command.add_argument("--set", action="append", default=[], metavar="KEY=VALUE", dest="settings", help="one option, e.g. select.min_points=500")
    if seed:
        command.add_argument("--seed", type=int, help="seed of everything random [run.seed]")
