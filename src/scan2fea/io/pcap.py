"""The classic pcap file of network captures, as far as UDP over Ethernet and IPv4 goes."""

from __future__ import annotations

import struct
from pathlib import Path

import numpy as np

from scan2fea.errors import FormatError, require
from scan2fea.kernel.jit import jit
from scan2fea.types import ByteArray, IntArray

# byte order by the first bytes; the second pair counts nanoseconds
_MAGIC = {b"\xd4\xc3\xb2\xa1": "<", b"\xa1\xb2\xc3\xd4": ">", b"\x4d\x3c\xb2\xa1": "<", b"\xa1\xb2\x3c\x4d": ">"}
MAGIC = tuple(_MAGIC)
_ETHERNET = 1
_HEADER, _RECORD = 24, 16
_LONGEST = 1 << 18  # libpcap's own limit of a packet
_HEADS = 14 + 20 + 8  # Ethernet, IPv4 without options, UDP
_UDP, _IPV4, _VLAN = 17, 0x0800, 0x8100
_FROM, _TO = bytes((192, 168, 1, 201)), bytes((255, 255, 255, 255))  # a Velodyne unit as it leaves the factory broadcasts
_MAC = bytes.fromhex("ffffffffffff607688000000")


def pcap_header() -> bytes:
    """The head of a little-endian file with microseconds."""
    return struct.pack("<IHHiIII", 0xA1B2C3D4, 2, 4, 0, 0, 65535, _ETHERNET)


def record_header(time_s: float, length: int) -> bytes:
    """The head of a packet of `length` bytes that came at a time."""
    micro = int(time_s * 1e6)
    return struct.pack("<IIII", micro // 1_000_000 & 0xFFFFFFFF, micro % 1_000_000, length, length)


def packet_header(payload: int, port: int) -> bytes:
    """Ethernet, IPv4 and UDP heads of a broadcast datagram of `payload` bytes; UDP without checksum, as the units send it."""
    udp = struct.pack(">HHHH", port, port, 8 + payload, 0)
    ip = struct.pack(">BBHHHBBH4s4s", 0x45, 0, 20 + 8 + payload, 0, 0x4000, 255, _UDP, 0, _FROM, _TO)
    total = sum(struct.unpack(">10H", ip))
    total = (total & 0xFFFF) + (total >> 16)
    total = ~((total & 0xFFFF) + (total >> 16)) & 0xFFFF
    return _MAC + struct.pack(">H", _IPV4) + ip[:10] + struct.pack(">H", total) + ip[12:] + udp


def datagrams(path: Path, content: ByteArray, payload: int) -> tuple[IntArray, int]:
    """First byte of every UDP payload of exactly `payload` bytes, and the number of other packets.

    Raises FormatError for a file that is no capture of Ethernet, is cut off or damaged.
    """
    size = len(content)
    require(size >= _HEADER, FormatError, f"{path} has {size} bytes, the head of a pcap file {_HEADER}: it is cut off")
    order = _MAGIC.get(content[:4].tobytes())
    if order is None:
        raise FormatError(f"{path} begins with {content[:4].tobytes()!r}, which no pcap file does: it is damaged or another format")
    head = content.data
    major, link = struct.unpack_from(order + "H", head, 4)[0], struct.unpack_from(order + "I", head, 20)[0]
    require(major == 2, FormatError, f"{path} is pcap version {major}: version 2 is read; it is damaged or was written by another program")
    require(link & 0xFFFF == _ETHERNET, FormatError, f"{path} was recorded on link type {link & 0xFFFF}, not on Ethernet (1): record it again")
    found = np.zeros(size // (_RECORD + _HEADS + payload) + 1, np.int64)
    n, n_other, stop = _walked(content, order == ">", payload, found)
    if stop + _RECORD > size > stop:
        raise FormatError(f"{path} is cut off at byte {stop}, in the head of a packet: copy or record it again")
    if stop < size:
        kept, left = struct.unpack_from(order + "I", head, stop + 8)[0], size - stop - _RECORD
        raise FormatError(f"{path}: the packet at byte {stop} promises {kept} bytes, {left} are left: it is cut off or damaged")
    return found[:n], n_other


@jit
def _word(content: ByteArray, at: int, is_big: bool) -> int:
    """Four bytes as an unsigned number."""
    a, b, c, d = int(content[at]), int(content[at + 1]), int(content[at + 2]), int(content[at + 3])
    return (a << 24 | b << 16 | c << 8 | d) if is_big else (d << 24 | c << 16 | b << 8 | a)


@jit
def _walked(content: ByteArray, is_big: bool, payload: int, found: IntArray) -> tuple[int, int, int]:
    """From packet to packet: numbers of wanted and other ones, and the byte behind the last sound one. `found` takes the payloads' first bytes."""
    size, position, n, n_other = len(content), _HEADER, 0, 0
    while position + _RECORD <= size:
        kept, whole = _word(content, position + 8, is_big), _word(content, position + 12, is_big)
        start = position + _RECORD
        if kept > _LONGEST or start + kept > size:
            break
        at = _payload(content, start, kept, payload) if whole == kept else -1
        if at >= 0:
            found[n] = at
            n += 1
        else:
            n_other += 1
        position = start + kept
    return n, n_other, position


@jit
def _payload(content: ByteArray, start: int, kept: int, payload: int) -> int:
    """First byte of the payload of a whole UDP datagram of the wanted length, -1 for any other packet."""
    if kept < _HEADS + payload:
        return -1
    at = start + 12
    kind = int(content[at]) << 8 | int(content[at + 1])
    if kind == _VLAN:
        at += 4
        kind = int(content[at]) << 8 | int(content[at + 1])
    ip = at + 2
    if kind != _IPV4 or int(content[ip]) >> 4 != 4 or int(content[ip + 9]) != _UDP:
        return -1
    udp = ip + 4 * (int(content[ip]) & 15)
    if udp + 8 + payload > start + kept or (int(content[udp + 4]) << 8 | int(content[udp + 5])) != 8 + payload:
        return -1
    return udp + 8
