"""`scan2fea COMMAND ...`: parses, runs, and turns every error into one line and an exit code.

Exit codes: 0 done, 2 usage, 3 bad input, 4 nothing converted or check not passed, 5 a fault of ours, 130 interrupted.
"""

from __future__ import annotations

import argparse
import importlib
import os
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from scan2fea import __version__
from scan2fea.errors import Scan2FeaError

EXIT_FAULT, EXIT_INTERRUPTED = 5, 130


def parser() -> argparse.ArgumentParser:
    """The whole command line."""
    top = argparse.ArgumentParser(prog="scan2fea", description="From raw 3D scans to checked finite element models.", allow_abbrev=False)
    top.add_argument("--version", action="version", version=f"scan2fea {__version__}")
    commands = top.add_subparsers(dest="command", metavar="COMMAND", required=True)

    run = commands.add_parser("run", help="scans to solved, checked FE models", allow_abbrev=False)
    run.add_argument("inputs", nargs="+", metavar="INPUT", help="scan files (or closed meshes) of one scene")
    run.add_argument("-o", "--out", required=True, metavar="OUT", help="folder for everything that is made")
    _add_options(run)
    run.add_argument("--resume", action="store_true", help="go on in OUT: what is unchanged is not made again; labels.csv may have been edited")
    run.add_argument("--unit", help="unit of the input where its format states none [input.unit]")
    run.add_argument("--poses", metavar="FILE", help="where each input stood (bun.conf, TUM, KITTI, 4x4) [registration.poses]")
    run.add_argument("--calibration", metavar="FILE", help="calib.txt of KITTI: from scans to the camera of --poses [registration.calibration]")
    run.add_argument("--labels", metavar="COLUMN", help="take the objects from this column (name or number) [input.labels]")
    run.add_argument(
        "--sensor-position", nargs=3, type=float, metavar=("X", "Y", "Z"), help="where the scanner stood, in the frame and unit of each file"
    )

    run.add_argument("--member", metavar="D", help="section of every object, where it is known: L127x127x6.35 (mm), HE 140 A, W8X31 [route.member]")
    run.add_argument("--catalogue", metavar="FILE", help="CSV table of sections instead of the shipped one [route.catalogue]")

    demo = commands.add_parser("demo", help="a simulated lab scan through everything", allow_abbrev=False)
    demo.add_argument("-o", "--out", default="scan2fea-demo", metavar="OUT")
    _add_options(demo)

    simulate = commands.add_parser("simulate", help="scan a scene of exact solids: points, truth, meshes, STEP, picture", allow_abbrev=False)
    simulate.add_argument("scene", metavar="SCENE", help="a scene file (TOML), or lab (the source thesis's room), or demo")
    simulate.add_argument("-o", "--out", required=True, metavar="OUT", help="folder for everything that is made")
    _add_scene_options(simulate)
    simulate.add_argument(
        "--format", action="append", metavar="F", help="ply (default: everything known of each point), pcd, ptx, las or xyz; repeatable"
    )
    simulate.add_argument("--no-step", action="store_true", help="leave the STEP files out: of finely curved objects they take longer than the scan")

    plan = commands.add_parser("plan", help="what planned stations will see of a scene, and which dimensions that will tell", allow_abbrev=False)
    plan.add_argument("scene", metavar="SCENE", help="a scene file (TOML), or lab, or demo")
    _add_scene_options(plan)
    plan.add_argument("--json", action="store_true", help="print the plan as JSON")

    check = commands.add_parser("check", help="would a solver accept this mesh or deck, is this STEP file one solid?", allow_abbrev=False)
    check.add_argument("file", metavar="MESH")
    check.add_argument("--json", action="store_true", help="print the figures as JSON")

    info = commands.add_parser("info", help="what a file holds", allow_abbrev=False)
    info.add_argument("file", metavar="FILE")
    info.add_argument("--unit", help="unit of the file where its format states none")

    fit = commands.add_parser("fit", help="the points of one file as one member: dimensions with standard deviations", allow_abbrev=False)
    fit.add_argument("file", metavar="FILE")
    fit.add_argument("-o", "--out", metavar="MEMBER.json", help="write the member here too")
    fit.add_argument("--family", help="family of its section: L, I, C, T, RHS, CHS, rect, round [estimation.family]")
    fit.add_argument("--member", metavar="D", help="section that is known: L127x127x6.35 (mm), HE 140 A, W8X31 [route.member]")
    fit.add_argument("--catalogue", metavar="FILE", help="CSV table of sections instead of the shipped one [route.catalogue]")
    fit.add_argument("--unit", help="unit of the file where its format states none [input.unit]")
    fit.add_argument(
        "--sensor-position", nargs=3, type=float, metavar=("X", "Y", "Z"), help="where the scanner stood, in the frame and unit of the file"
    )
    _add_options(fit)

    register = commands.add_parser("register", help="scans into one frame: cloud.ply, trajectory.txt and how sure each place is", allow_abbrev=False)
    register.add_argument("inputs", nargs="+", metavar="INPUT", help="scan files of one scene")
    register.add_argument("-o", "--out", required=True, metavar="OUT", help="folder for what is made")
    register.add_argument("--unit", help="unit of the input where its format states none [input.unit]")
    register.add_argument("--poses", metavar="FILE", help="where each input stood (bun.conf, TUM, KITTI, 4x4) [registration.poses]")
    register.add_argument("--calibration", metavar="FILE", help="calib.txt of KITTI: from scans to the camera of --poses [registration.calibration]")
    register.add_argument(
        "--sensor-position", nargs=3, type=float, metavar=("X", "Y", "Z"), help="where the scanner stood, in the frame and unit of each file"
    )
    _add_options(register)

    segment = commands.add_parser("segment", help="scans to one label per point: cloud.ply, labels.csv and a picture", allow_abbrev=False)
    segment.add_argument("inputs", nargs="+", metavar="INPUT", help="scan files of one scene")
    segment.add_argument("-o", "--out", required=True, metavar="OUT", help="folder for what is made")
    methods = "euclidean (default), kmeans, fuzzy_cmeans, agglomerative, divisive, given, single [segmentation.method]"
    segment.add_argument("--method", metavar="M", help=methods)
    segment.add_argument("--unit", help="unit of the input where its format states none [input.unit]")
    segment.add_argument("--poses", metavar="FILE", help="where each input stood (bun.conf, TUM, KITTI, 4x4) [registration.poses]")
    segment.add_argument("--labels", metavar="COLUMN", help="true labels of the file (name or number), to compare with [input.labels]")
    segment.add_argument(
        "--sensor-position", nargs=3, type=float, metavar=("X", "Y", "Z"), help="where the scanner stood, in the frame and unit of each file"
    )
    _add_options(segment)

    reconstruct = commands.add_parser("reconstruct", help="the points of one file as one closed surface", allow_abbrev=False)
    reconstruct.add_argument("file", metavar="FILE")
    reconstruct.add_argument("-o", "--out", required=True, metavar="OUT", help="folder for what is made")
    reconstruct.add_argument(
        "--method", metavar="M", help="visibility (default), planar, advancing_front, scale_space, ball_pivoting [reconstruction.method]"
    )
    reconstruct.add_argument("--unit", help="unit of the file where its format states none [input.unit]")
    reconstruct.add_argument(
        "--sensor-position", nargs=3, type=float, metavar=("X", "Y", "Z"), help="where the scanner stood, in the frame and unit of the file"
    )
    _add_options(reconstruct)

    config = commands.add_parser("config", help="print every option, with its explanation, as TOML", allow_abbrev=False)
    _add_options(config, seed=False)

    view = commands.add_parser("view", help="open the report of a run", allow_abbrev=False)
    view.add_argument("out", metavar="OUT")
    return top


def _add_scene_options(command: argparse.ArgumentParser) -> None:
    command.add_argument("--sensor", metavar="S", help="scan with this sensor alone, e.g. terrestrial or hdl32e")
    command.add_argument("--noise", metavar="N", help='noise of every sensor, e.g. "2 mm" (standard deviation) or "uniform:20 mm" (half width)')
    command.add_argument("--seed", type=int, default=0, help="seed of everything random")


def _add_options(command: argparse.ArgumentParser, *, seed: bool = True) -> None:
    command.add_argument("-c", "--config", metavar="FILE.toml", help="options, as `scan2fea config` prints them")
    command.add_argument("--set", action="append", default=[], metavar="KEY=VALUE", dest="settings", help="one option, e.g. select.min_points=500")
    if seed:
        command.add_argument("--seed", type=int, help="seed of everything random [run.seed]")


def main(arguments: Sequence[str] | None = None) -> int:
    """Run one command; returns its exit code. Never raises but for SystemExit of argparse (2, or 0 for --help)."""
    given = parser().parse_args(arguments)
    command: Any = importlib.import_module(f"scan2fea.cli.{given.command}_command")
    try:
        return int(command.execute(given))
    except Scan2FeaError as error:
        _say(str(error))
        return error.exit_code
    except KeyboardInterrupt:
        _say("interrupted: `scan2fea run ... --resume` with the same OUT goes on from here")
        return EXIT_INTERRUPTED
    except BrokenPipeError:
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        return 0
    except MemoryError:
        _say("out of memory: give fewer points (filtering.voxel_m) or set input.memory_gib to what this machine has")
        return EXIT_FAULT
    except Exception as error:  # noqa: BLE001 - the last line of defence: a fault of ours is told, not shown as a traceback
        _say(f"internal fault ({type(error).__name__}: {error}); please report it with {_trace()}")
        return EXIT_FAULT


def _trace() -> str:
    import tempfile
    import traceback

    handle, name = tempfile.mkstemp(prefix="scan2fea-fault-", suffix=".txt")
    with os.fdopen(handle, "w", encoding="utf-8") as file:
        traceback.print_exc(file=file)
    return str(Path(name))


def _say(text: str) -> None:
    one_line = " ".join(text.split())
    print(f"scan2fea: {one_line}", file=sys.stderr)


def entry() -> None:
    """Console script."""
    sys.exit(main())
