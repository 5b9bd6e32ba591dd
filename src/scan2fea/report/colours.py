"""Palettes that colour-blind readers can tell apart, and the few fixed colours of the page.

Anchor colours are the published ones: viridis (S. van der Walt and N. Smith, CC0, every sixteenth of its table), the diverging blue-white-orange
of ColorBrewer "PuOr"/"RdBu" family (C. Brewer), and the eight hues of Okabe and Ito (2008) for categories.
"""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from scan2fea.types import ByteArray, FloatArray, IntArray


def _rgb(text: str) -> ByteArray:
    """(n, 3) bytes of colours written as RRGGBB."""
    return np.array([[int(word[i : i + 2], 16) for i in (0, 2, 4)] for word in text.split()], np.uint8)


VIRIDIS = _rgb("440154 481a6c 472f7d 414487 39568c 31688e 2a788e 23888e 1f988b 22a884 35b779 54c568 7ad151 a5db36 d2e21b fde725")
DIVERGING = _rgb("053061 2166ac 4393c3 92c5de d1e5f0 ffffff fddbc7 f4a582 d6604d b2182b 67001f")  # ColorBrewer RdBu, reversed: blue is inside
CATEGORIES = _rgb("0072b2 e69f00 009e73 cc79a7 56b4e9 d55e00 f0e442 8c6bb1 66a61e a6761d 1b9e77 666666")

ORIGIN_NAMES = ("measured", "interpolated", "invented")
ORIGIN_COLOURS = _rgb("4a90b8 f0c24b c8442c")  # differ in lightness as well as in hue
NO_DATA = np.array([176, 176, 176], np.uint8)
BACKDROP = np.array([214, 214, 210], np.uint8)  # points that belong to no object
PLAIN = np.array([150, 170, 186], np.uint8)


def viridis(share: FloatArray) -> ByteArray:
    """(n, 3) colours of shares in 0..1 (clipped; not finite: grey)."""
    return _mapped(share, VIRIDIS)


def diverging(share: FloatArray) -> ByteArray:
    """(n, 3) colours of shares in -1..1: blue below, white at zero, red above (clipped; not finite: grey)."""
    return _mapped(0.5 * (np.asarray(share, float) + 1), DIVERGING)


def categories(number: IntArray) -> ByteArray:
    """(n, 3) colours of class numbers; negative: no class. After the twelve hues come the same ones, darker."""
    number = np.asarray(number, np.int64)
    darker = 1 - 0.25 * (number // len(CATEGORIES) % 3)
    colours = (CATEGORIES[number % len(CATEGORIES)] * darker[:, None]).astype(np.uint8)
    colours[number < 0] = BACKDROP
    return colours


def css(colour: npt.ArrayLike) -> str:
    """#rrggbb."""
    red, green, blue = (int(value) for value in np.asarray(colour))
    return f"#{red:02x}{green:02x}{blue:02x}"


def gradient(anchors: ByteArray) -> str:
    """The palette as a CSS gradient from left to right."""
    return f"linear-gradient(to right,{','.join(css(colour) for colour in anchors)})"


def _mapped(share: FloatArray, anchors: ByteArray) -> ByteArray:
    share = np.asarray(share, float)
    known = np.isfinite(share)
    place = np.clip(np.where(known, share, 0), 0, 1) * (len(anchors) - 1)
    knots = np.arange(len(anchors))
    colours = np.stack([np.interp(place, knots, anchors[:, channel]) for channel in range(3)], axis=1)
    colours[~known] = NO_DATA
    return np.asarray(np.rint(colours), np.uint8)
