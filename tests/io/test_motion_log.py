"""Logs of motion sensors: names, units, and rows that cannot be used."""


import numpy as np
import pytest

import real_scans
from scan2fea.errors import FormatError, InputError
from scan2fea.io.motion_log import INERTIAL, POSES, POSITIONS, RANGES, kind_of_log, read_inertial, read_positions, read_ranges
from scan2fea.io.nmea import read_nmea
from scan2fea.io.pcap import packet_header, pcap_header, record_header
from scan2fea.io.unit_inertial import read_unit_inertial
from scan2fea.kernel.geodesy import earth_centred, east_north_up, gravity

G = 9.80665
MONTEREY = real_scans.DATA / "velodyne/monterey-first-100-packets.pcap"
real = real_scans.needs("velodyne")


def inertial_csv(path, head="time_s,ax_m_s2,ay_m_s2,az_m_s2,gx_rad_s,gy_rad_s,gz_rad_s", rows=None, scale=(1.0, 1.0)):
    time = np.arange(50) / 100.0
    rows = np.c_[time, np.tile([0.0, 0.0, G / scale[0]], (50, 1)), np.tile(np.array([0.1, 0.2, 0.3]) / scale[1], (50, 1))] if rows is None else rows
    path.write_text("\n".join([head, *(",".join(map(repr, row)) for row in np.asarray(rows).tolist())]) + "\n")
    return path


@pytest.mark.parametrize(
    ("head", "scale"),
    [
        ("time_s,ax_m_s2,ay_m_s2,az_m_s2,gx_rad_s,gy_rad_s,gz_rad_s", (1.0, 1.0)),
        (",".join(["Time (s)", *(f"Accelerometer {a} (g)" for a in "XYZ"), *(f"Gyroscope {a} (deg/s)" for a in "XYZ")]), (G, np.pi / 180)),
        ("t,acc_x,acc_y,acc_z,gyr_x,gyr_y,gyr_z", (1.0, 1.0)),
        ("timestamp,accel_x [mg],accel_y [mg],accel_z [mg],gyro_x [dps],gyro_y [dps],gyro_z [dps]", (G * 1e-3, np.pi / 180)),
        ("time,fx,fy,fz,wx,wy,wz", (G, 1.0)),
    ],
)
def test_names_and_units_are_understood(tmp_path, head, scale):
    path = inertial_csv(tmp_path / "imu.csv", head, scale=scale)
    assert kind_of_log(path) == INERTIAL
    log = read_inertial(path).value
    np.testing.assert_allclose(log.force, np.tile([0, 0, G], (50, 1)), atol=1e-12)
    np.testing.assert_allclose(log.rate, np.tile([0.1, 0.2, 0.3], (50, 1)))
    assert not log.is_gap.any() and log.magnetic is None


def test_rows_that_cannot_be_used_are_left_out_and_counted(tmp_path):
    time = np.arange(200) / 100.0
    rows = np.c_[time, np.tile([0.0, 0.0, G, 0.1, 0.2, 0.3], (200, 1))]
    rows[20, 5] = np.nan
    rows[50, 0] = rows[48, 0]
    rows = np.delete(rows, slice(100, 150), axis=0)
    read = read_inertial(inertial_csv(tmp_path / "imu.csv", rows=rows))
    assert len(read.value) == 148
    assert np.flatnonzero(read.value.is_gap).tolist() == [98]
    said = " | ".join(read.notes)
    assert "1 of 150 rows hold a value that is missing" in said and "1 of 149 times do not rise" in said
    assert "1 gaps in time, the longest of 0.51 s" in said


def test_what_cannot_be_is_refused(tmp_path):
    backwards = np.c_[np.arange(50)[::-1] / 100.0, np.tile([0.0, 0.0, G, 0.1, 0.2, 0.3], (50, 1))]
    with pytest.raises(InputError, match="times do not rise"):
        read_inertial(inertial_csv(tmp_path / "a.csv", rows=backwards))
    with pytest.raises(InputError, match="by its size it is in g, name the columns ax_g"):
        read_inertial(inertial_csv(tmp_path / "b.csv", scale=(G, 1.0)))
    with pytest.raises(InputError, match="2000 degrees per second"):
        read_inertial(inertial_csv(tmp_path / "c.csv", scale=(1.0, 1e-3)))
    with pytest.raises(InputError, match="gravity in no unit"):
        read_inertial(inertial_csv(tmp_path / "d.csv", "t,ax,ay,az,gx,gy,gz", scale=(5.0, 1.0)))
    with pytest.raises(FormatError, match="rate and specific force"):
        read_inertial(inertial_csv(tmp_path / "e.csv", "t,a,b,c,d,e,f"))
    with pytest.raises(FormatError, match="no column is named time"):
        read_inertial(inertial_csv(tmp_path / "f.csv", "k,ax,ay,az,gx,gy,gz"))
    with pytest.raises(FormatError, match="a line of names is needed"):
        kind_of_log(inertial_csv(tmp_path / "g.csv", "# nothing"))
    (tmp_path / "h.csv").write_text("time,ax\n")
    with pytest.raises(InputError, match="no rows"):
        kind_of_log(tmp_path / "h.csv")


def test_positions_in_metres_and_in_degrees(tmp_path):
    (tmp_path / "m.csv").write_text("time_s,x_m,y_m,z_m,sx_m,sy_m,sz_m\n0,1,2,3,0.1,0.1,0.2\n1,2,3,4,0.1,0.1,0.2\n")
    read = read_positions(tmp_path / "m.csv").value
    assert kind_of_log(tmp_path / "m.csv") == POSITIONS
    np.testing.assert_array_equal(read.position, [[1, 2, 3], [2, 3, 4]])
    assert read.origin is None and read.sigma_m[1, 2] == 0.2
    (tmp_path / "d.csv").write_text("time,lat,lon,alt\n0,45.0,7.0,300\n1,45.001,7.0,310\n2,45.0,7.001,300\n")
    read = read_positions(tmp_path / "d.csv").value
    np.testing.assert_allclose(read.position, [[0, 0, 0], [0, 111.13, 10], [78.85, 0, 0]], atol=0.03)
    (tmp_path / "w.csv").write_text("time,lat,lon,alt\n0,450.0,7.0,300\n1,45.001,7.0,310\n")
    with pytest.raises(InputError, match="beyond 90"):
        read_positions(tmp_path / "w.csv")


def test_nmea(tmp_path):
    body = "GPGGA,{},4807.038,N,01131.000,E,{},08,0.9,545.4,M,46.9,M,,"
    lines = []
    for clock, quality in (("235959.00", 1), ("000000.50", 1), ("000001.00", 0), ("000002.00", 4)):
        text = body.format(clock, quality)
        checksum = 0
        for c in text:
            checksum ^= ord(c)
        lines.append(f"${text}*{checksum:02X}")
    lines.insert(1, "$GPGGA,000000.00,4807.038,N,01131.000,E,1,08,0.9,545.4,M,46.9,M,,*00")
    (tmp_path / "a.nmea").write_text("\r\n".join([*lines, "$GPVTG,1,T"]))
    rows, notes = read_nmea(tmp_path / "a.nmea")
    np.testing.assert_allclose(rows[:, 0], [86399, 86400.5, 86402])
    np.testing.assert_allclose(rows[0, 1:], [48 + 7.038 / 60, 11 + 31 / 60, 592.3])
    assert "1 sentences with a wrong checksum were left out" in notes and "1 sentences without a fix were left out" in notes
    assert kind_of_log(tmp_path / "a.nmea") == POSITIONS


def capture(path, *sentences):
    content = pcap_header()
    for k, text in enumerate(sentences):
        for _ in range(3):  # repeated until the next comes
            head = packet_header(512, 8308)
            content += record_header(k, len(head) + 512) + head + bytes(206) + (text.encode() + b"\r\n").ljust(306, b"\0")
    path.write_bytes(content)
    return path


def test_nmea_in_the_position_packets_of_a_capture(tmp_path):
    here, lost = "$GPRMC,220632,A,3707.8324,N,12139.2864,W,000.0,144.7,111212,013.8,E,D*09", "$GPRMC,220632,V,,,,,,,111212,,,N"
    with pytest.raises(FormatError, match="holds 1 sentences GGA or RMC with a fix"):
        read_positions(capture(tmp_path / "a.pcap", here, lost, ""))
    path = capture(tmp_path / "b.pcap", here, lost, "$GPRMC,220633,A,3707.8424,N,12139.2864,W", "$GPRMC,220634,A,3707.8424,N,12139.2864,W*00")
    assert kind_of_log(path) == POSITIONS
    found = read_positions(path)
    assert found.value.time_s.tolist() == [79592.0, 79593.0]
    np.testing.assert_allclose(found.value.position[1], [0.0, 18.5, 0.0], atol=0.05)  # a hundredth of a minute of latitude
    assert found.value.sigma_m[0].tolist() == [3.0, 3.0, 100.0] and "no height" in " ".join(found.notes)


@real
def test_the_receiver_of_a_real_capture_stands_still():
    found = read_positions(MONTEREY)
    assert len(found.value) == 2 and np.ptp(found.value.time_s) == 1.0
    assert not found.value.position.any() and np.degrees(found.value.origin[0]) == pytest.approx(37 + 7.8324 / 60)


def test_ranges_and_poses(tmp_path):
    angle = np.tile(np.linspace(-90, 90, 5), 3)
    rows = np.c_[np.arange(15) * 0.01, angle, np.where(np.arange(15) % 4 == 0, 0.0, 2.0)]
    (tmp_path / "r.csv").write_text("time,angle_deg,range\n" + "\n".join(",".join(map(str, row)) for row in rows.tolist()))
    assert kind_of_log(tmp_path / "r.csv") == RANGES
    log = read_ranges(tmp_path / "r.csv").value
    assert log.first.tolist() == [0, 5, 10, 15] and np.isnan(log.range_m).sum() == 4
    assert log.angle[4] == pytest.approx(np.pi / 2)
    (tmp_path / "p.txt").write_text("0 0 0 0 0 0 0 1\n1 1 0 0 0 0 0 1\n")
    assert kind_of_log(tmp_path / "p.txt") == POSES


def test_the_earth():
    found = earth_centred(np.array([0.0, np.pi / 2]), np.zeros(2), np.zeros(2))
    np.testing.assert_allclose(found, [[6378137.0, 0, 0], [0, 0, 6356752.3142]], atol=1e-3)
    origin = np.array([0.7, 0.2, 100.0])
    np.testing.assert_allclose(east_north_up(np.array([0.7]), np.array([0.2]), np.array([150.0]), origin), [[0, 0, 50]], atol=1e-6)
    assert gravity(0.0, 0.0) == pytest.approx(9.7803253359) and gravity(np.pi / 2, 0.0) == pytest.approx(9.8321849, abs=1e-6)


def base_packets(path, rows, begun_us=3_599_990_000):
    """Position packets 10 ms apart with the twelve words of each row (3 chips: rate, temperature, accelerations x and y)."""
    content = pcap_header()
    for k, row in enumerate(rows):
        body = bytearray(512)
        words = [(i % 4 << 12) | (int(v) & 0xFFF) for i, v in enumerate(np.ravel(row))]
        body[14:38] = np.array(words, "<u2").tobytes()
        body[198:202] = np.array([(begun_us + 10_000 * k) % 3_600_000_000], "<u4").tobytes()
        head = packet_header(512, 8308)
        content += record_header(k / 100, len(head) + 512) + head + bytes(body)
    path.write_bytes(content)
    return path


def test_the_base_of_a_scanner_tells_rates_and_forces_along_its_axes(tmp_path):
    """Each word alone, in both signs, against its axis and scale; times go on after the hour."""
    still = np.array([[0, 0, 819, 0], [0, 0, 819, 0], [0, 0, 0, 0]])
    rates = {(0, 0): (2, 1), (1, 0): (1, 1), (2, 0): (3, -1)}
    axis = rates | {(0, 2): (6, 0.5), (1, 2): (6, 0.5), (2, 2): (4, 0.5), (0, 3): (4, -0.5), (1, 3): (5, -0.5), (2, 3): (5, -0.5)}
    rows = [still] + [still + sign * 100 * np.eye(12)[4 * chip + word].reshape(3, 4) for chip, word in axis for sign in (1, -1)]
    table = read_unit_inertial(base_packets(tmp_path / "a.pcap", rows))
    np.testing.assert_allclose(table[:, 0], 3599.99 + 0.01 * np.arange(len(rows)), atol=1e-9)
    np.testing.assert_allclose(table[0, 1:], [0, 0, 0, 0, 0, 819 * 0.001221 * G], atol=1e-12)
    for k, (where, (column, sign)) in enumerate(axis.items()):
        scale = np.radians(0.09766) if where[1] == 0 else 0.001221 * G
        for row, way in ((2 * k + 1, 1), (2 * k + 2, -1)):
            expected = np.zeros(7)
            expected[column] = way * 100 * sign * scale
            np.testing.assert_allclose((table[row] - table[0])[1:], expected[1:], atol=1e-12)
    assert read_inertial(tmp_path / "a.pcap").value.rate.shape == (len(rows), 3)


def test_packets_without_inertial_words_are_told(tmp_path):
    with pytest.raises(FormatError, match="0 of 6 position packets hold inertial words"):
        read_unit_inertial(capture(tmp_path / "a.pcap", "", ""))


@real
def test_a_car_that_hardly_moves_feels_gravity_and_its_accelerometers_agree():
    log = read_inertial(MONTEREY).value
    assert len(log) == 299 and np.ptp(log.time_s) == pytest.approx(1.49, abs=0.01)
    assert abs(log.time_s[0] - read_nmea(MONTEREY)[0][0, 0]) < 2.0  # one clock
    assert np.linalg.norm(log.force.mean(axis=0)) == pytest.approx(G, rel=0.05)
    assert log.force.mean(axis=0)[2] > 0.95 * np.linalg.norm(log.force.mean(axis=0))
