"""What one ray tells about a prismatic member: where it would hit, how likely it hits at all, and how both change with every parameter, exactly.

A ray is seen in the plane of the section: it starts at q, runs along e per metre of range, and every corner k of the outline has an offset
u_k across the ray and a range s_k. Between two corners a face is a straight line of range over u, and the faces that meet the light first
cut the offsets into intervals. The beam is a Gaussian over u (standard deviation w), so a face that shows on [ua, ub] takes the share
Phi(ub / w) - Phi(ua / w) of the beam, and a range r from it has the density

    integral over [ua, ub] of N(u; 0, w^2) N(r; r0 + g u, sigma^2) du = N(r; r0, S) [Phi((ub - m) / v) - Phi((ua - m) / v)],
    S = sigma^2 + g^2 w^2,   m = g w^2 (r - r0) / S,   v = sigma w / sqrt(S)

which is smooth in everything: no ray jumps from a leg to what lies behind it. The ends of the member cut the same way along the axis.
A member whose axis is curved is sheared along the ray to first order; what is left is curvature times depth squared over 8.
"""

from __future__ import annotations

import math

import numpy as np

from scan2fea.kernel.jit import jit_ieee, jit_inline
from scan2fea.types import BoolArray, FloatArray, IntArray

# columns of the scores of `ray_terms`; the section's values follow
QX, QY, EX, EY, LOG_SIGMA, LOG_FOOT, START, END, DROPPED, OUTLIER, SHIFT, VALUES = range(12)
N_FRONT = 64  # faces of the outline that one ray may pass in front of each other
WINDOW = 8.0  # standard deviations of the beam; Phi(-8) = 6e-16
LEAST_SPAN = 1e-12  # of its offsets: a face edge-on
_ROOT_2 = math.sqrt(2.0)
_DENSITY = 1.0 / math.sqrt(2.0 * math.pi)


@jit_inline
def _phi(x: float) -> float:
    return _DENSITY * math.exp(-0.5 * x * x)


@jit_inline
def _between(a: float, b: float) -> float:
    """Phi(b) - Phi(a), a <= b, without losing the tail."""
    if a > 0.0:
        return 0.5 * (math.erfc(a / _ROOT_2) - math.erfc(b / _ROOT_2))
    return 0.5 * (math.erfc(-b / _ROOT_2) - math.erfc(-a / _ROOT_2))


@jit_inline
def _in_front(u: FloatArray, s: FloatArray, after: IntArray, reach: float, front: IntArray) -> int:
    """Faces that look at the sensor within `reach` (u falls along them: outlines run counter-clockwise), by the corner they start at, in column 0."""
    n = 0
    for k in range(len(u)):
        j = after[k]
        if u[j] < u[k] and u[j] < reach and u[k] > -reach and (s[j] > 0.0 or s[k] > 0.0) and n < N_FRONT:
            front[n, 0] = k
            n += 1
    return n


@jit_inline
def _cuts(u: FloatArray, after: IntArray, reach: float, front: IntArray, n: int) -> int:
    """The corners of those faces that lie within reach, in order of u, in column 1."""
    cuts = front[:, 1]
    n_cuts = 0
    for i in range(n):
        for side in range(2):
            c = front[i, 0] if side == 0 else after[front[i, 0]]
            if abs(u[c]) >= reach or n_cuts >= len(cuts):
                continue
            at = n_cuts
            while at > 0 and u[cuts[at - 1]] > u[c]:
                cuts[at] = cuts[at - 1]
                at -= 1
            cuts[at] = c
            n_cuts += 1
    return n_cuts


@jit_inline
def _nearest(u: FloatArray, s: FloatArray, after: IntArray, middle: float, front: IntArray, n: int) -> int:
    """The face that is first at the offset `middle`, by the corner it starts at; -1 for none."""
    best, nearest = -1, math.inf
    for f in range(n):
        k = front[f, 0]
        j = after[k]
        if u[j] <= middle <= u[k]:
            at_middle = s[j] + (s[k] - s[j]) * (middle - u[j]) / (u[k] - u[j])
            if 0.0 < at_middle < nearest:
                best, nearest = k, at_middle
    return best


@jit_inline
def _visible(u: FloatArray, s: FloatArray, after: IntArray, reach: float, pieces: IntArray) -> int:
    """Cut the offsets within `reach` into intervals on which one face is the first: rows (corner the face starts at, lower end, upper end).

    Ends are corners, or -1 and -2 for -reach and +reach.
    """
    front = pieces[N_FRONT:]
    n = _in_front(u, s, after, reach, front)
    if n == 0:
        return 0
    n_cuts = _cuts(u, after, reach, front, n)
    cuts = front[:, 1]
    m = 0
    for i in range(n_cuts + 1):
        low = -reach if i == 0 else u[cuts[i - 1]]
        high = reach if i == n_cuts else u[cuts[i]]
        best = _nearest(u, s, after, 0.5 * (low + high), front, n) if high > low else -1
        if best < 0:
            continue
        upper = -2 if i == n_cuts else cuts[i]
        lower = -1 if i == 0 else cuts[i - 1]
        if m > 0 and pieces[m - 1, 0] == best and pieces[m - 1, 2] == lower:
            pieces[m - 1, 2] = upper
        elif m < N_FRONT:
            pieces[m, 0] = best
            pieces[m, 1] = lower
            pieces[m, 2] = upper
            m += 1
    return m


@jit_inline
def _outward(pieces: IntArray, piece: int, n: int, after: IntArray) -> tuple[float, float]:
    """Which way the lower and the upper end of an interval give way where the sensor sees edges farther out: away from the nearer face.

    0 at a corner that two visible faces share.
    """
    k, low, high = pieces[piece, 0], pieces[piece, 1], pieces[piece, 2]
    up = down = 0.0
    if low >= 0:
        owns = low in (k, after[k])
        if piece > 0 and pieces[piece - 1, 2] == low:
            other = pieces[piece - 1, 0]
            down = 0.0 if owns and low in (other, after[other]) else (-1.0 if owns else 1.0)
        else:
            down = -1.0
    if high >= 0:
        owns = high in (k, after[k])
        if piece + 1 < n and pieces[piece + 1, 1] == high:
            other = pieces[piece + 1, 0]
            up = 0.0 if owns and high in (other, after[other]) else (1.0 if owns else -1.0)
        else:
            up = 1.0
    return down, up


@jit_inline
def _end_share(z: float, ends: FloatArray, shift: float, w: float, out: FloatArray) -> None:
    """Share of the beam between the ends, and its derivatives: out = share, d/d start, d/d end, d/d z, d/d log w."""
    b = (ends[1] + shift - z) / w
    a = (ends[0] - shift - z) / w
    if b > WINDOW and a < -WINDOW:
        out[0] = 1.0
        out[1:] = 0.0
        return
    pb, pa = _phi(b), _phi(a)
    out[0] = _between(a, b)
    out[1] = -pa / w
    out[2] = pb / w
    out[3] = (pa - pb) / w
    out[4] = a * pa - b * pb


@jit_inline
def _share(ua: float, ub: float, w: float, out: FloatArray) -> None:
    """Share of the beam on [ua, ub]: out = share, d/d r0, d/d g, d/d ua, d/d ub, d/d log sigma, d/d log w."""
    a, b = ua / w, ub / w
    pa, pb = _phi(a), _phi(b)
    out[0] = _between(a, b)
    out[1] = out[2] = out[5] = 0.0
    out[3] = -pa / w
    out[4] = pb / w
    out[6] = a * pa - b * pb


@jit_inline
def _density(r: float, r0: float, g: float, ua: float, ub: float, w: float, sigma: float, out: FloatArray) -> None:
    """Density of the range r from a face that shows on [ua, ub]; `out` as in `_share`."""
    ss, gw2 = sigma * sigma, g * w * w
    S = ss + g * gw2
    d = r - r0
    m, v = gw2 * d / S, sigma * w / math.sqrt(S)
    a, b = (ua - m) / v, (ub - m) / v
    N = math.exp(-0.5 * d * d / S) / math.sqrt(2.0 * math.pi * S)
    P = _between(a, b)
    pa, pb = _phi(a), _phi(b)
    dN_dS = 0.5 * N * (d * d / S - 1.0) / S
    out[0] = N * P
    out[1] = N * d / S * P + N * (pb - pa) * gw2 / (S * v)
    slope_m = w * w * d / S * (1.0 - 2.0 * g * gw2 / S)
    out[2] = dN_dS * 2.0 * gw2 * P + N * (pb * ((ub - m) * gw2 / S - slope_m) - pa * ((ua - m) * gw2 / S - slope_m)) / v
    out[3] = -N * pa / v
    out[4] = N * pb / v
    shift = 2.0 * m * ss / (S * v)
    out[5] = dN_dS * 2.0 * ss * P + N * (pb * (shift - b * (1.0 - ss / S)) - pa * (shift - a * (1.0 - ss / S)))
    out[6] = dN_dS * 2.0 * g * gw2 * P - N * (pb * (shift + b * ss / S) - pa * (shift + a * ss / S))


# what `_faces_of_ray` sums up: density or share, and its derivatives by log sigma, log foot, start, end, length of e, shift
TOTAL, D_SIGMA, D_FOOT, D_START, D_END, D_LENGTH, D_SHIFT = range(7)


@jit_inline
def _faces_of_ray(
    u: FloatArray, s: FloatArray, after: IntArray, pieces: IntArray, n_pieces: int, reach: float, z: float, dz: float, m: float, range_m: float,
    w: float, shift: float, ends: FloatArray, sigma: float, on_u: FloatArray, on_s: FloatArray, face: FloatArray, end: FloatArray, sums: FloatArray,
) -> None:  # fmt: skip
    """Sum over the visible faces of the density of the range (nan: of the share of the beam) and of its derivatives; adds to on_u, on_s, sums."""
    for piece in range(n_pieces):
        k, low, high = pieces[piece, 0], pieces[piece, 1], pieces[piece, 2]
        j = after[k]
        span = u[k] - u[j]
        out_low, out_high = _outward(pieces, piece, n_pieces, after)
        ua = -reach if low < 0 else u[low] + out_low * shift
        ub = reach if high < 0 else u[high] + out_high * shift
        if ub <= ua or span <= LEAST_SPAN * (abs(u[k]) + abs(u[j])):
            continue
        g = (s[k] - s[j]) / span
        r0 = s[j] - g * u[j]
        near = min(max(0.0, ua), ub)  # the offset nearest to the middle of the beam: there the face is judged to lie between the ends
        # along the axis a beam is as wide as it is and as the depth of the face in it makes it, of which there is no more than the face's
        span_u = ub - ua if low >= 0 and high >= 0 else math.inf
        square, tilt = (w / m) ** 2, 1.0 / (1.0 / (w * w) + 12.0 / (span_u * span_u))
        deep = (g * dz) ** 2 * tilt
        along_m = math.sqrt(square + deep)
        _end_share(z + (r0 + g * near) * dz, ends, shift / m, along_m, end)
        on_width = end[4] / (square + deep)
        if math.isnan(range_m):
            _share(ua, ub, w, face)
        else:
            _density(range_m, r0, g, ua, ub, w, sigma, face)
        both = end[2] - end[1]
        sums[TOTAL] += end[0] * face[0]
        sums[D_SIGMA] += end[0] * face[5]
        sums[D_FOOT] += end[0] * face[6] + on_width * (square + deep * tilt / (w * w)) * face[0]
        sums[D_START] += end[1] * face[0]
        sums[D_END] += end[2] * face[0]
        sums[D_LENGTH] -= (on_width * square + both * shift / m) * face[0] / m
        sums[D_SHIFT] += end[0] * (out_low * face[3] + out_high * face[4]) + both / m * face[0]
        along = end[3] * face[0] * dz
        on_r0 = end[0] * face[1] + along
        on_g = end[0] * face[2] + along * near + on_width * g * dz * dz * tilt * face[0]
        opened = on_width * deep * 12.0 * tilt / (span_u * span_u * span_u) * face[0]
        at_low = (along * g if near == ua else 0.0) - opened
        at_high = (along * g if near == ub else 0.0) + opened
        sums[D_SHIFT] += at_low * out_low + at_high * out_high
        if low >= 0:
            on_u[low] += end[0] * face[3] + at_low
        if high >= 0:
            on_u[high] += end[0] * face[4] + at_high
        on_g -= on_r0 * u[j]  # r0 = s_j - g u_j and g = (s_k - s_j) / (u_k - u_j)
        on_s[j] += on_r0 - on_g / span
        on_u[j] += -on_r0 * g + on_g * g / span
        on_s[k] += on_g / span
        on_u[k] -= on_g * g / span


@jit_inline
def _probability(
    total: float, is_hit: bool, hits_only: bool, silhouette: float, dropped: float, outlier: float, window: FloatArray, out: FloatArray
) -> None:
    """out = p, dp / d total, dp / d silhouette, dp / d logit dropped, dp / d logit outlier."""
    keep, back = 1.0 - outlier, 1.0 - dropped
    out[2] = out[3] = 0.0
    if hits_only:
        good, stray = total / silhouette, 1.0 / (window[0] * window[1])
        out[1] = keep / silhouette
        out[2] = -keep * good / silhouette
    elif is_hit:
        good, stray = back * total, 0.5 / window[0]
        out[1] = keep * back
        out[3] = -keep * dropped * back * total
    else:
        good, stray = 1.0 - back * total, 0.5
        out[1] = -keep * back
        out[3] = keep * dropped * back * total
    out[0] = keep * good + outlier * stray
    out[4] = outlier * keep * (stray - good)
    if out[0] <= 0.0:  # edges that are seen farther out may overlap in a narrow gap
        out[:] = 0.0
        out[0] = outlier * stray


@jit_ieee
def ray_terms(
    q: FloatArray, e: FloatArray, z: FloatArray, dz: FloatArray, range_m: FloatArray, foot_m: FloatArray, shift_m: FloatArray, corners: FloatArray,
    factors: FloatArray, after: IntArray, ends: FloatArray, sigma: float, dropped: float, outlier: float, window: FloatArray, hits_only: bool,
    logp: FloatArray, scores: FloatArray,
) -> None:  # fmt: skip
    """Log likelihood of every ray and its derivatives; fills `logp` (n,) and `scores` (n, 11 + p).

    q, e : (n, 2) start and direction per metre of range, in the plane of the section.   z, dz : (n,) the same along the axis.
    range_m : (n,), nan for a ray that passed.   foot_m : (n,) standard deviation of the beam at the member.
    shift_m : (n,) how much farther out than half of the beam the sensor still sees an edge.
    corners : (k, 2) outline, counter-clockwise.   factors : (k, 2, p) derivatives of the corners.   after : (k,) the next corner.
    ends : (2,) of the member along z.   dropped : share of the hits that do not come back.   outlier : share of rays that mean nothing.
    window : range in metres (and, for hits only, width) over which an outlier may lie.
    hits_only : rays that pass were not recorded: the offsets of the others spread evenly over the silhouette.
    """
    u, s = np.zeros(len(corners)), np.zeros(len(corners))
    on_u, on_s = np.zeros(len(corners)), np.zeros(len(corners))
    pieces = np.zeros((3 * N_FRONT, 3), np.int64)
    face, end, sums, chance = np.zeros(7), np.zeros(5), np.zeros(7), np.zeros(5)
    i_narrow = i_wide = 0
    for i in range(len(q)):
        m = math.sqrt(e[i, 0] ** 2 + e[i, 1] ** 2)
        ex, ey = e[i, 0] / m, e[i, 1] / m
        for k in range(len(corners)):
            x, y = corners[k, 0] - q[i, 0], corners[k, 1] - q[i, 1]
            u[k] = ex * y - ey * x
            s[k] = (ex * x + ey * y) / m
            on_u[k] = on_s[k] = 0.0
            if k == 0 or u[k] < u[i_narrow]:
                i_narrow = k
            if k == 0 or u[k] > u[i_wide]:
                i_wide = k
        sums[:] = 0.0
        reach = WINDOW * foot_m[i] + abs(shift_m[i])
        if u[i_narrow] < reach and u[i_wide] > -reach:
            n_pieces = _visible(u, s, after, reach, pieces)
            _faces_of_ray(
                u, s, after, pieces, n_pieces, reach, z[i], dz[i], m, range_m[i], foot_m[i], shift_m[i], ends, sigma, on_u, on_s, face, end, sums
            )
        _probability(sums[TOTAL], not math.isnan(range_m[i]), hits_only, u[i_wide] - u[i_narrow], dropped, outlier, window, chance)
        p = chance[0]
        logp[i] = math.log(p)
        scale = chance[1] / p
        if hits_only and chance[1] > 0.0:
            on_u[i_wide] += chance[2] / chance[1]
            on_u[i_narrow] -= chance[2] / chance[1]
        row = scores[i]
        row[:] = 0.0
        row[LOG_SIGMA], row[LOG_FOOT], row[SHIFT] = scale * sums[D_SIGMA], scale * sums[D_FOOT], scale * sums[D_SHIFT]
        row[START], row[END] = scale * sums[D_START], scale * sums[D_END]
        row[DROPPED], row[OUTLIER] = chance[3] / p, chance[4] / p
        row[EX], row[EY] = scale * sums[D_LENGTH] * ex, scale * sums[D_LENGTH] * ey
        for k in range(len(corners)):
            if on_u[k] != 0.0 or on_s[k] != 0.0:
                _to_columns(scale * on_u[k], scale * on_s[k], u[k], s[k], ex, ey, m, factors[k], row)


@jit_ieee
def seen_from_axis(
    o: FloatArray, d: FloatArray, legendre: FloatArray, slopes: FloatArray, ahead: FloatArray, axis: FloatArray, roll: float,
    q: FloatArray, e: FloatArray,
) -> None:  # fmt: skip
    """Fills q, e (n, 2): start and direction of the rays seen from the axis, to first order in its slope, turned back by the roll.

    axis : (2, k) Legendre coefficients.   The rest as in `RayData`.
    """
    c, s = math.cos(roll), math.sin(roll)
    for i in range(len(o)):
        cx = cy = sx = sy = 0.0
        for k in range(axis.shape[1]):
            cx += legendre[i, k] * axis[0, k]
            cy += legendre[i, k] * axis[1, k]
            sx += slopes[i, k] * axis[0, k]
            sy += slopes[i, k] * axis[1, k]
        ax, ay = o[i, 0] - cx - sx * ahead[i], o[i, 1] - cy - sy * ahead[i]
        bx, by = d[i, 0] - sx * d[i, 2], d[i, 1] - sy * d[i, 2]
        q[i, 0], q[i, 1] = c * ax + s * ay, c * ay - s * ax
        e[i, 0], e[i, 1] = c * bx + s * by, c * by - s * bx


@jit_ieee
def in_unknowns(
    raw: FloatArray, q: FloatArray, e: FloatArray, dz: FloatArray, legendre: FloatArray, slopes: FloatArray, ahead: FloatArray, roll: float,
    sigma_share: float, foot_share: FloatArray, unit: FloatArray, scores: FloatArray,
) -> None:  # fmt: skip
    """Scores (n, p) by dimensions, roll, both rows of the axis, start, end and nuisance from the columns (n, 11 + v) of `ray_terms`.

    sigma_share, foot_share (n,) : of the derivatives, where widths have a floor.   unit : (n,) m that an edge moves by.
    """
    c, s = math.cos(roll), math.sin(roll)
    v, n = raw.shape[1] - VALUES, legendre.shape[1]
    last = v + 1 + 2 * n
    for i in range(len(raw)):
        one, row = raw[i], scores[i]
        for k in range(v):
            row[k] = one[VALUES + k]
        row[v] = one[QX] * q[i, 1] - one[QY] * q[i, 0] + one[EX] * e[i, 1] - one[EY] * e[i, 0]
        ax, ay = c * one[QX] - s * one[QY], s * one[QX] + c * one[QY]
        bx, by = c * one[EX] - s * one[EY], s * one[EX] + c * one[EY]
        for k in range(n):
            moved, tilted = legendre[i, k] + slopes[i, k] * ahead[i], slopes[i, k] * dz[i]
            row[v + 1 + k] = -moved * ax - tilted * bx
            row[v + 1 + n + k] = -moved * ay - tilted * by
        row[last], row[last + 1] = one[START], one[END]
        row[last + 2], row[last + 3], row[last + 4] = one[LOG_SIGMA] * sigma_share, one[LOG_FOOT] * foot_share[i], one[SHIFT] * unit[i]
        row[last + 5], row[last + 6] = one[DROPPED], one[OUTLIER]


@jit_inline
def _to_columns(gu: float, gs: float, u: float, s: float, ex: float, ey: float, m: float, factors: FloatArray, row: FloatArray) -> None:
    """Derivatives by a corner's offset and range become those by q, e and the dimensions."""
    vx, vy = -gu * ey + gs * ex / m, gu * ex + gs * ey / m
    row[QX] -= vx
    row[QY] -= vy
    turn = (gs * u / m - gu * m * s) / m  # d/d angle of e, over its length
    stretch = -gs * s / m
    row[EX] += -turn * ey + stretch * ex
    row[EY] += turn * ex + stretch * ey
    for v in range(factors.shape[1]):
        row[VALUES + v] += vx * factors[0, v] + vy * factors[1, v]


@jit_ieee
def first_crossing(q: FloatArray, e: FloatArray, corners: FloatArray, after: IntArray) -> FloatArray:
    """(n,) range at which a beam without width meets the outline, inf where it passes.   q, e : (n, 2); corners : (k, 2)."""
    out = np.full(len(q), math.inf)
    for i in range(len(q)):
        m2 = e[i, 0] ** 2 + e[i, 1] ** 2
        for k in range(len(corners)):
            j = after[k]
            uk = e[i, 0] * (corners[k, 1] - q[i, 1]) - e[i, 1] * (corners[k, 0] - q[i, 0])
            uj = e[i, 0] * (corners[j, 1] - q[i, 1]) - e[i, 1] * (corners[j, 0] - q[i, 0])
            if (uk > 0.0) == (uj > 0.0):
                continue
            t = uj / (uj - uk)
            x = corners[j] + t * (corners[k] - corners[j]) - q[i]
            s = (x[0] * e[i, 0] + x[1] * e[i, 1]) / m2
            if 0.0 < s < out[i]:
                out[i] = s
    return out


def inside_outline(points: FloatArray, corners: FloatArray) -> BoolArray:
    """(n,) True where a point (n, 2) lies inside the outline (k, 2), by the parity of crossings."""
    x, y = points[:, :1], points[:, 1:]
    a, b = corners, np.roll(corners, -1, axis=0)
    straddles = (a[:, 1] > y) != (b[:, 1] > y)
    rise = np.where(b[:, 1] == a[:, 1], 1.0, b[:, 1] - a[:, 1])
    crossing = a[:, 0] + (y - a[:, 1]) * (b[:, 0] - a[:, 0]) / rise
    inside: BoolArray = (np.count_nonzero(straddles & (x < crossing), axis=1) % 2) == 1
    return inside
