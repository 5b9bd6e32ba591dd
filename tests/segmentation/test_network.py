"""The network of kinds: gradients against central differences, a convolution against its definition, descent, temperature, mirror images."""

import numpy as np
import pytest
from scipy.signal import correlate

from scan2fea.segmentation.canonical import GRID, N_CHANNELS, N_EXTRA, look_at
from scan2fea.segmentation.kinds import KindNetwork, fitted_temperature, guess_kinds, kind_probabilities, segment_kinds
from scan2fea.segmentation.network import _layers, initial, logits, loss_and_gradients, softmax, trained
from scan2fea.types import PointCloud, Segments


def small(seed=0):
    params = {name: value.astype(float) for name, value in initial((4, 8, 4, 2), 3, 5, seed).items()}
    rng = np.random.default_rng(seed)
    return params, rng.standard_normal((3, 4, 8, 4, 2)), rng.standard_normal((3, 3)), np.array([0, 3, 4]), rng


def test_every_gradient_is_the_central_difference():
    params, x, extra, label, rng = small()
    _, grad = loss_and_gradients(params, x, extra, label)
    assert set(grad) == set(params)
    for name, weights in params.items():
        for place in {tuple(rng.integers(size) for size in weights.shape) for _ in range(12)}:
            losses = []
            for step in (1e-6, -1e-6):
                moved = {key: value.copy() for key, value in params.items()}
                moved[name][place] += step
                losses.append(loss_and_gradients(moved, x, extra, label)[0])
            assert grad[name][place] == pytest.approx((losses[0] - losses[1]) / 2e-6, abs=1e-6)


def test_a_layer_is_the_convolution_and_the_largest_of_eight():
    params, x, extra, _, _ = small(1)
    kernel = params["w1"].reshape(3, 3, 3, 2, -1)
    top = _layers(params, x, extra)["top1"]
    for out in range(top.shape[-1]):
        padded = np.pad(x[1], ((1, 1), (1, 1), (1, 1), (0, 0)))
        full = sum(correlate(padded[..., c], kernel[..., c, out], mode="valid") for c in range(2)) + params["b1"][out]
        full = np.maximum(full, 0)
        for place in np.ndindex(2, 4, 2):
            block = full[tuple(slice(2 * k, 2 * k + 2) for k in place)]
            assert top[1][(*place, out)] == pytest.approx(block.max(), abs=1e-12)


def test_softmax_sums_to_one_and_does_not_overflow():
    p = softmax(np.array([[1e4, 0.0, -1e4], [1.0, 1.0, 1.0]]))
    assert p == pytest.approx(np.array([[1, 0, 0], [1 / 3] * 3]))


def test_training_learns_and_repeats():
    rng = np.random.default_rng(0)
    x = rng.random((64, 4, 8, 4, 1)).astype(np.float32)
    label = np.repeat([0, 1], 32)
    x[label == 1, :, :, 0] += 1.0  # a layer of the grid is filled: no mirror image of the section changes that
    extra = np.zeros((64, 1), np.float32)
    start = initial((4, 8, 4, 1), 1, 2, 0)
    params, losses = trained(start, x, extra, label, epochs=8, rate=5e-3, seed=0)
    again, _ = trained(start, x, extra, label, epochs=8, rate=5e-3, seed=0)
    assert all(np.array_equal(params[name], again[name]) for name in params)
    assert losses[-1] < 0.2 * losses[0]
    assert (logits(params, x, extra).argmax(axis=1) == label).mean() > 0.95


def test_the_temperature_undoes_a_scale():
    """Labels drawn from softmax(z): logits of 3 z are three times too sure."""
    rng = np.random.default_rng(0)
    z = 2 * rng.standard_normal((4000, 4))
    p = softmax(z)
    label = (rng.random((4000, 1)) > p.cumsum(axis=1)).sum(axis=1)
    assert fitted_temperature(3 * z, label) == pytest.approx(3.0, rel=0.06)


def beam(n=3000, seed=0):
    rng = np.random.default_rng(seed)
    side = rng.integers(3, size=n)
    u, z = rng.uniform(-0.05, 0.05, n), rng.uniform(0, 2, n)
    x = np.where(side == 0, 0.0, u)
    y = np.where(side == 0, 2 * u, np.where(side == 1, 0.1, -0.1))
    return np.stack([x, y, z], axis=1) + 1e-4 * rng.standard_normal((n, 3))


def test_the_look_follows_the_object_and_not_its_place_or_size():
    points = beam()
    turn = np.linalg.qr(np.random.default_rng(1).standard_normal((3, 3)))[0]
    one, other = look_at(points), look_at(7.0 * points @ turn.T + [3.0, -2.0, 9.0])
    assert one.grid.shape == (*GRID, N_CHANNELS) and one.extra.shape == (N_EXTRA,)
    assert np.allclose(one.extra, other.extra, atol=0.02)
    # the frame is the same but for the sign of its axes
    images = [other.grid[:: -1 if a else 1, :: -1 if b else 1, :: -1 if c else 1] for a in (0, 1) for b in (0, 1) for c in (0, 1)]
    assert min(np.abs(one.grid[..., 0] - image[..., 0]).mean() for image in images) < 0.02
    assert one.extra[0] == pytest.approx(np.log(2.0 / 0.2), abs=0.1)  # length over depth


def test_too_few_points_or_a_line_are_not_looked_at():
    assert look_at(np.zeros((59, 3))) is None
    assert look_at(np.outer(np.linspace(0, 1, 100), [1.0, 2.0, 3.0])) is None
    assert look_at(np.zeros((100, 3))) is None


def test_mirror_images_of_a_section_are_one_and_below_the_limit_it_is_unknown():
    params = initial((*GRID, N_CHANNELS), N_EXTRA, 3, 0)
    network = KindNetwork(kinds=("a", "b", "c"), params=params, temperature=1.0)
    look = look_at(beam())
    grids = np.stack([look.grid, look.grid[::-1], look.grid[:, ::-1]])
    p = kind_probabilities(network, grids, np.stack([look.extra] * 3))
    assert p.sum(axis=1) == pytest.approx(1.0) and np.allclose(p[0], p[1], atol=1e-6) and np.allclose(p[0], p[2], atol=1e-6)
    cold = KindNetwork(kinds=("a", "b", "c"), params=params, temperature=1e3)
    (doubt,) = guess_kinds(cold, [beam()])
    assert doubt.kind == "unknown" and doubt.confidence == pytest.approx(1 / 3, abs=0.05)
    sure = KindNetwork(kinds=("a", "b", "c"), params=params, temperature=1e-3)
    first, none = guess_kinds(sure, [beam(), np.zeros((5, 3))])
    assert first.kind in "abc" and first.confidence > 0.6
    assert none.kind == "unknown" and np.isnan(none.confidence)


@pytest.mark.parametrize("up", np.eye(3))
def test_floor_is_level_or_else_what_carries(up):
    rng = np.random.default_rng(0)
    side = np.roll(up, 1)
    floor, wall = (rng.random((n, 3)) * (1 - across) for n, across in ((600, up), (500, side)))
    cloud = PointCloud.of(np.concatenate([floor, wall]))
    segments = Segments(labels=np.repeat([0, 1], [600, 500]), kinds=("support", "support"), how={})
    said = [guess.kind for guess in segment_kinds(None, cloud, segments)]
    assert said == (["wall", "floor"] if side[2] else ["floor", "wall"])
