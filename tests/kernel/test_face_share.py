"""The shares of a mixture against the rounds written out, and against the shares that points were drawn with."""

import numpy as np

from scan2fea.kernel.face_share import likeliest_share


def drawn(n=4000):
    rng = np.random.default_rng(5)
    own = rng.choice(3, n, p=[0.5, 0.3, 0.2])
    x = rng.normal(2.0 * own, 1.0)
    return np.exp(-0.5 * (x[:, None] - 2.0 * np.arange(3)) ** 2) / np.sqrt(2 * np.pi)


def test_rounds_are_those_written_out():
    density, share = drawn(), np.full(3, 1 / 3)
    for _ in range(7):
        parts = density * share
        own = parts / (parts.sum(1) + 0.01)[:, None]
        share = own.sum(0) / own.sum()
    assert np.allclose(likeliest_share(density, np.full(3, 1 / 3), 0.01, 7, 0.0), share, rtol=1e-12)


def test_the_shares_are_found():
    found = likeliest_share(drawn(), np.full(3, 1 / 3), 1e-9, 500, 1e-7)
    assert np.abs(found - [0.5, 0.3, 0.2]).max() < 0.03
