"""What is said of a motion that is not believed."""

import dataclasses
import math

import numpy as np
from scipy.spatial import cKDTree

from scan2fea.io import read_scan
from scan2fea.pipeline.simulate import scanned, with_sensor
from scan2fea.pipeline.simulate_logs import write_logs
from scan2fea.pipeline.sweeps import _gap, _why_not, unrolled
from scan2fea.registration import Odometry, RegistrationOptions
from scan2fea.registration.agreement import Agreement
from scan2fea.simulation.motion import path_of, trajectory_at
from scan2fea.simulation.scene_names import lab_file
from scan2fea.types import Rays

FOUND = {
    "T_world_knot": np.tile(np.eye(4), (3, 1, 1)), "T_world_sweep": np.tile(np.eye(4), (2, 1, 1)), "middle": np.full(2, 0.5),
    "std_m": np.full(2, 0.01), "std_rad": np.full(2, 0.01), "disagreement_m": 0.5, "changed": 0.0,
    "slide_m": 0.01, "slide": np.array([1.0, 0, 0]), "open_m": 0.1, "stride": 1, "used": 1.0,
}  # fmt: skip


def test_sweeps_that_contradict_each_other_are_named_with_value_and_limit():
    told = Odometry(**FOUND, agreement=Agreement(contradicted=0.46, limit=0.05, pair=(0, 99)))
    assert not told.is_sure
    said = "under the best motion the beams of sweep 100 contradict 46% of what sweep 1 saw (5% allowed)"
    assert _why_not(told) == f"its motion could not be found: {said}"
    none = Odometry(**FOUND, agreement=Agreement(contradicted=math.nan, limit=0.05, pair=(0, 0)))
    assert "no two sweeps see the same part of the scene" in _why_not(none)
    agreed = Odometry(**FOUND, agreement=Agreement(contradicted=0.01, limit=0.05, pair=(0, 1)))
    assert _why_not(agreed) == "its motion could not be found: forwards and backwards in time differ by 0.5 m"


def test_the_gap_between_beams_is_that_of_the_rings_or_along_them():
    def fan(elevations_deg, step_deg):
        e, a = (x.ravel() for x in np.meshgrid(np.radians(elevations_deg), np.radians(np.arange(0, 360, step_deg)), indexing="ij"))
        direction = np.stack([np.cos(e) * np.cos(a), np.cos(e) * np.sin(a), np.sin(e)], axis=1)
        ring = np.unique(e, return_inverse=True)[1]
        missed = np.random.default_rng(0).standard_normal((5 * len(e), 3))  # most beams of a scanner outdoors do not come back
        missed /= np.linalg.norm(missed, axis=1, keepdims=True)
        direction, ring = np.concatenate([missed, direction]), np.concatenate([np.full(len(missed), -1), ring])
        return Rays(origin=np.zeros_like(direction), direction=direction, range_m=np.ones(len(ring)), ring=ring)

    assert abs(math.degrees(_gap(fan([-2, 0, 2, 4], 0.5))) - 2) < 1e-9
    assert abs(math.degrees(_gap(fan([-0.5, 0, 0.5], 3.0))) - 3) < 0.01
    assert _gap(fan([0.0], 1.0)) == 0.0


def test_rays_that_met_nothing_move_with_the_scanner(tmp_path):
    given = with_sensor(lab_file(0), "hdl32e")
    sensor = dataclasses.replace(given.sensors[0], options=dataclasses.replace(given.sensors[0].options, times_s=(0.0, 0.4)))
    scans = [scan for _, scan in scanned(dataclasses.replace(given, sensors=(sensor,)), 0)]
    write_logs(tmp_path, "lab", "hdl32e", sensor.options, scans, 0)
    raw = read_scan(tmp_path / "lab.pcap")
    times = np.linspace(0.0, 0.4, 41)
    made, path, _ = unrolled(raw, 0, RegistrationOptions(), trajectory_at(path_of(sensor.options, "hdl32e"), times))
    rays, cloud = made.scan.rays, made.scan.cloud
    lost = np.isnan(rays.range_m)
    assert path is not None and np.array_equal(cloud.ray, np.arange(len(cloud))) and not lost[: len(cloud)].any()
    true_origin, true_direction = (
        np.concatenate([getattr(s.rays, name)[np.isnan(s.rays.range_m)] for s in scans]) for name in ("origin", "direction")
    )
    assert 0.9 * len(true_origin) < lost.sum() <= len(true_origin) + 384  # a packet is filled up
    # the shots of a packet lie apart by the angle of a firing; each true one has its own within that, at the place of that moment
    away, nearest = cKDTree(np.hstack([rays.origin[lost], rays.direction[lost]])).query(np.hstack([true_origin, true_direction]))
    within = away < 4e-3
    assert within.mean() > 0.95 and len(np.unique(nearest[within])) > 0.9 * len(true_origin)
