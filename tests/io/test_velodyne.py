import struct
import tracemalloc

import numpy as np
import pytest

import real_scans
from scan2fea.cli.main import main
from scan2fea.errors import FormatError, InputError
from scan2fea.io import read_scan
from scan2fea.io.pcap import pcap_header
from scan2fea.io.velodyne import open_velodyne, write_velodyne
from scan2fea.simulation.lidar import Hdl32eOptions, firings_of, scan_lidar
from scan2fea.simulation.motion import kinematics, path_of
from sensed import clutter

DATA = real_scans.DATA / "velodyne"
MONTEREY, PUCK = DATA / "monterey-first-100-packets.pcap", DATA / "vlp-16-test-90deg-1-50-frames.pcap"
real = real_scans.needs("velodyne")
COLUMNS = frozenset(("intensity", "ring", "time", "frame"))


def decoded(path):
    """points, is_miss, columns of a capture; points in firing order."""
    pieces = list(open_velodyne(path, path.stat().st_size).pieces(COLUMNS))
    columns = {name: np.concatenate([p.columns[name] for p in pieces]) for name in COLUMNS}
    return np.concatenate([p.points for p in pieces]), np.concatenate([p.is_miss for p in pieces]), columns


def simulated(path, options, seed=1):
    """Write a capture; the same points in the frame of the sensor at each firing, their rings and times."""
    scans = scan_lidar(clutter(), options, seed)
    told = [firings_of(scan, options) for scan in scans]
    write_velodyne(path, *(np.concatenate([getattr(t, name) for t in told]) for name in ("time_s", "azimuth_deg", "range_m", "intensity")))
    local, ring, time = [], [], []
    for scan in scans:
        state = kinematics(path_of(options, "x"), scan.rays.time_s[::32])
        beam = scan.rays.origin + scan.rays.range_m[:, None] * scan.rays.direction - np.repeat(state.position, 32, axis=0)
        seen = np.isfinite(scan.rays.range_m)
        local.append(np.einsum("nij,ni->nj", np.repeat(state.rotation, 32, axis=0), beam)[seen])
        ring.append(scan.rays.ring[seen])
        time.append(scan.rays.time_s[seen])
    return np.concatenate(local), np.concatenate(ring), np.concatenate(time)


def apart(a, b):
    """Largest difference of the ranges (m) and of the directions (degrees)."""
    ra, rb = np.linalg.norm(a, axis=1), np.linalg.norm(b, axis=1)
    cross = np.linalg.norm(np.cross(a, b), axis=1) / (ra * rb)
    return np.abs(ra - rb).max(), np.degrees(np.arcsin(np.minimum(cross, 1))).max()


STILL = {"positions_m": ((0.0, 0.0, 1.2),), "frames": 2}
MOVING = {"positions_m": ((0, 0, 1.2), (0.6, 0.1, 1.2)), "orientations_deg": ((0, 0, 0), (2, 1, 30)), "times_s": (0.0, 0.5), "keep_every": 5}


@pytest.mark.parametrize("options", [Hdl32eOptions(**STILL), Hdl32eOptions(rate_hz=5.0, **STILL), Hdl32eOptions(rate_hz=20.0, **MOVING)])
def test_what_was_simulated_is_read_back_within_the_quantisation(tmp_path, options):
    expected, ring, time = simulated(tmp_path / "a.pcap", options)
    points, is_miss, columns = decoded(tmp_path / "a.pcap")
    assert len(points[~is_miss]) == len(expected) > 2000
    off_m, off_deg = apart(points[~is_miss], expected)
    assert off_m < 1e-9  # the simulated ranges are whole steps of 2 mm already
    assert off_deg < 0.01
    np.testing.assert_array_equal(columns["ring"][~is_miss], ring)
    np.testing.assert_allclose(columns["time"][~is_miss], time, atol=1.1e-6)  # whole microseconds


def test_ranges_are_rounded_to_two_millimetres_and_azimuths_to_a_hundredth(tmp_path):
    rng = np.random.default_rng(0)
    time = 46.08e-6 * np.arange(600)
    azimuth = (350 + 7200 * time) % 360
    ranges = rng.uniform(1, 100, (600, 32))
    ranges[rng.random((600, 32)) < 0.3] = np.nan
    n = write_velodyne(tmp_path / "a.pcap", time, azimuth, ranges, np.full((600, 32), 0.37))
    assert n == 50
    assert (tmp_path / "a.pcap").stat().st_size == 24 + 50 * (16 + 42 + 1206)
    points, is_miss, columns = decoded(tmp_path / "a.pcap")
    np.testing.assert_array_equal(is_miss, np.isnan(ranges.ravel()))
    beam = np.arange(32)
    flat = np.hypot(points[:, 0], points[:, 1]).reshape(-1, 32)
    order = np.where(beam % 2 == 0, beam // 2 - 23, beam // 2 - 7) * 4 / 3
    np.testing.assert_allclose((flat / np.cos(np.radians(np.round(order, 2))))[~np.isnan(ranges)], ranges[~np.isnan(ranges)], atol=0.001 + 1e-9)
    told = np.degrees(np.arctan2(-points[:, 1], points[:, 0])).reshape(-1, 32)
    expected = azimuth[:, None] + 7200 * 1.152e-6 * beam
    off = (told - expected + 180) % 360 - 180
    assert np.abs(off[~np.isnan(ranges)]).max() < 0.0075
    assert (columns["intensity"] == 37).all()
    assert columns["frame"].max() == 1


def test_zero_and_what_does_not_fit_is_no_return(tmp_path):
    ranges = np.full((12, 32), 5.0)
    ranges[0, :4] = [np.nan, 0.0009, 131.07, 131.08]
    write_velodyne(tmp_path / "a.pcap", 46.08e-6 * np.arange(12), np.arange(12.0), ranges, np.ones((12, 32)))
    points, is_miss, _ = decoded(tmp_path / "a.pcap")
    assert is_miss[:4].tolist() == [True, True, False, True]
    assert is_miss.sum() == 3
    assert points.shape == (384, 3)


def test_a_gap_in_time_begins_a_packet(tmp_path):
    time = 46.08e-6 * np.arange(30)
    time[17:] += 0.2
    n = write_velodyne(tmp_path / "a.pcap", time, np.arange(30.0), np.full((30, 32), 5.0), np.ones((30, 32)))
    assert n == 4  # 12 + 5 and 12 + 1, filled up
    _, is_miss, columns = decoded(tmp_path / "a.pcap")
    assert is_miss.sum() == (4 * 12 - 30) * 32
    first = columns["time"].reshape(-1, 32)[:, 0][~is_miss.reshape(-1, 32).all(axis=1)]
    np.testing.assert_allclose(first, time, atol=1.1e-6)


def test_read_scan_keeps_sensor_and_misses(tmp_path):
    expected, _, _ = simulated(tmp_path / "a.pcap", Hdl32eOptions(**STILL))
    raw = read_scan(tmp_path / "a.pcap")
    np.testing.assert_allclose(raw.scan.cloud.points.mean(0), expected.mean(0), atol=1e-3)
    assert raw.scan.rays is not None
    assert np.isnan(raw.scan.rays.range_m).sum() > 1000
    assert np.abs(raw.scan.sensors()[:, :2]).max() == 0  # on the turning axis
    assert np.abs(raw.scan.sensors()[:, 2]).max() == pytest.approx(0.02895 * np.tan(np.radians(30.67)))


@real
def test_real_captures():
    """A car in Monterey, and a Puck whose factory byte says HDL-32E: the pace of its packets tells."""
    points, is_miss, columns = decoded(MONTEREY)
    assert len(points) == 2702 * 384
    assert (~is_miss).sum() == 872_800
    assert int(columns["frame"][-1]) == 18
    elevation = np.degrees(np.arctan2(points[:, 2] + 0.0, np.hypot(points[:, 0], points[:, 1])))[~is_miss]
    far = np.linalg.norm(points[~is_miss], axis=1) > 20
    for ring in range(32):
        fan = elevation[far & (columns["ring"][~is_miss] == ring)]
        assert np.abs(fan - (-30.67 + ring * 4 / 3)).max(initial=0) < 0.06
    source = open_velodyne(PUCK, PUCK.stat().st_size)
    assert any("pace of a VLP-16" in note for note in source.notes)
    assert set(np.concatenate([p.columns["ring"] for p in source.pieces(COLUMNS)]).tolist()) == set(range(16))


@pytest.mark.parametrize("which", ["still", "moving", pytest.param("monterey", marks=real)])
def test_velodyne_decoder_reads_the_same(tmp_path, which):
    decoder = pytest.importorskip("velodyne_decoder")
    path = tmp_path / "a.pcap"
    if which == "monterey":
        path = MONTEREY
        points, is_miss, columns = decoded(path)
        expected, ring = points[~is_miss], columns["ring"][~is_miss]
    else:
        expected, ring, _ = simulated(path, Hdl32eOptions(**(STILL if which == "still" else MOVING)))
    config = decoder.Config(min_range=0.0)
    parts = [np.asarray(cloud) for _, cloud in decoder.read_pcap(str(path), config, as_pcl_structs=True)]
    theirs = np.concatenate([np.stack([part[c].astype(float) for c in "xyz"], axis=1) for part in parts])
    assert len(theirs) == len(expected)
    off_m, off_deg = apart(theirs, expected)
    assert off_m < 0.002
    assert off_deg < 0.01
    np.testing.assert_array_equal(np.concatenate([part["ring"] for part in parts]), ring)


def packet(payload=b"\0" * 1206, length=None):
    ip = struct.pack(">BBHHHBBH8x", 0x45, 0, 28 + len(payload), 0, 0, 64, 17, 0)
    body = b"\0" * 12 + b"\x08\x00" + ip + struct.pack(">HHHH", 2368, 2368, 8 + len(payload), 0) + payload
    size = len(body) if length is None else length
    return struct.pack("<IIII", 0, 0, size, size) + body


def data(mode=0x37, unit=0x21):
    return (struct.pack("<HH", 0xEEFF, 0) + b"\x01\x02\x03" * 32) * 12 + struct.pack("<IBB", 0, mode, unit)


HEAD = pcap_header()


@pytest.mark.parametrize(
    ("content", "message"),
    [
        (HEAD[:10], "has 10 bytes"),
        (b"\0\1\2\3" + HEAD[4:] + packet(data()), "begins with"),
        (HEAD[:4] + b"\x09\0" + HEAD[6:] + packet(data()), "pcap version 9"),
        (HEAD[:20] + struct.pack("<I", 105) + packet(data()), "link type 105"),
        (HEAD, "no data packet"),
        (HEAD + packet(), "no data packet of a Velodyne unit"),
        (HEAD + packet(data())[:700], "cut off or damaged"),
        (HEAD + packet(data()) + b"\0" * 7, "cut off at byte"),
        (HEAD + packet(data(), length=0xFFFFFFF0), "promises 4294967280 bytes"),
        (HEAD + packet(data(), length=1 << 19), "promises 524288 bytes"),
        (HEAD + packet(data(mode=0x39)), "one return per shot"),
        (HEAD + packet(data(unit=0x28)), "unit 0x28"),
        (b"\x0a\x0d\x0d\x0a" + HEAD[4:], "pcapng"),
    ],
)
def test_hostile_captures_are_refused_in_one_line(tmp_path, capsys, content, message):
    path = tmp_path / "a.pcap"
    path.write_bytes(content)
    tracemalloc.start()
    assert main(["info", str(path)]) == 3
    assert tracemalloc.get_traced_memory()[1] < 20e6
    tracemalloc.stop()
    line = capsys.readouterr().err.strip()
    assert "\n" not in line
    assert message in line
    assert "a.pcap" in line
    with pytest.raises(FormatError):
        read_scan(path)


def test_foreign_packets_between_are_passed_over(tmp_path):
    odd = [packet(b"GPRMC" * 102 + b"12"), struct.pack("<IIII", 0, 0, 3, 3) + b"abc", struct.pack("<IIII", 0, 0, 0, 0), packet(b"\0" * 1206)]
    vlan = packet(data())
    vlan = struct.pack("<IIII", 0, 0, len(vlan) - 12, len(vlan) - 12) + vlan[16:28] + b"\x81\x00\x00\x05" + vlan[28:]
    (tmp_path / "a.pcap").write_bytes(HEAD + b"".join(odd) + packet(data()) + b"".join(odd) + vlan)
    source = open_velodyne(tmp_path / "a.pcap", 0)
    assert source.n_points == 768
    assert any("8 packets without ranges" in note for note in source.notes)


def records(path):
    """The head of a capture and its packets with theirs."""
    content, at, found = path.read_bytes(), 24, []
    while at < len(content):
        size = 16 + struct.unpack_from("<I", content, at + 8)[0]
        found.append(content[at : at + size])
        at += size
    return content[:24], found


def test_packets_out_of_order_are_put_in_the_order_of_their_times(tmp_path):
    """Across the hour too; where the clock goes back by more than a network holds packets back, they stay and it is said."""
    firings = 12 * 60
    turn = np.arange(firings)
    for begun, name in ((100.0, "a"), (3599.99, "hour")):
        straight, mixed = tmp_path / f"{name}.pcap", tmp_path / f"{name}_mixed.pcap"
        ranges = np.full((firings, 32), 2.0) + 0.01 * turn[:, None]
        write_velodyne(straight, begun + 46.08e-6 * turn, turn * 0.2 % 360, ranges, np.ones((firings, 32)))
        head, own = records(straight)
        assert len(own) == 60
        mixed.write_bytes(head + b"".join([*own[:20], *own[30:41], *own[20:30], *own[41:]]))
        (points, _, columns), (again, _, others) = decoded(straight), decoded(mixed)
        np.testing.assert_array_equal(points, again)
        for column in COLUMNS:
            np.testing.assert_array_equal(columns[column], others[column])
        assert open_velodyne(straight, 1).notes == ()
        assert open_velodyne(mixed, 1).notes == ("10 packets came out of order: they were put in the order of their times",)
    write_velodyne(tmp_path / "b.pcap", 90.0 + 46.08e-6 * turn, turn * 0.2 % 360, np.full((firings, 32), 2.0), np.ones((firings, 32)))
    (head, first), (_, then) = records(tmp_path / "a.pcap"), records(tmp_path / "b.pcap")
    (tmp_path / "two.pcap").write_bytes(head + b"".join([*first, *then]))
    assert open_velodyne(tmp_path / "two.pcap", 1).notes == ("its clock goes back by 10 s: it is more than one recording; split it there",)


def test_big_endian_captures(tmp_path):
    whole = HEAD + packet(data())
    swapped = (
        struct.pack(">IHHiIII", *struct.unpack("<IHHiIII", whole[:24])) + struct.pack(">IIII", *struct.unpack("<IIII", whole[24:40])) + whole[40:]
    )
    (tmp_path / "a.pcap").write_bytes(swapped)
    assert open_velodyne(tmp_path / "a.pcap", 0).n_points == 384


def test_bad_arrays(tmp_path):
    with pytest.raises(InputError, match="needs"):
        write_velodyne(tmp_path / "a.pcap", np.zeros(3), np.zeros(3), np.zeros((3, 16)), np.zeros((3, 16)))
    with pytest.raises(InputError, match="times"):
        write_velodyne(tmp_path / "a.pcap", np.array([-1.0]), np.zeros(1), np.zeros((1, 32)), np.zeros((1, 32)))
    assert not (tmp_path / "a.pcap").exists()
