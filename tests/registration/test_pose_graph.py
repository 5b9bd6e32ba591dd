import numpy as np
import pytest

from scan2fea.kernel.transforms import inverse, random_rotation, rigid, rotation_about
from scan2fea.registration.concatenate import along_tree, concatenate
from scan2fea.registration.pose_graph import GraphLink, components, optimise, residual, rotation_vector, triangles_closed

N = 6
TRUE = np.array([np.eye(4)] + [rigid(random_rotation(k), np.random.default_rng(k).normal(size=3) * 3) for k in range(1, N)])
ABOUT = np.zeros((N, 3))


def link(a, b, sigma=0.0, seed=0, wrong=False, information=None):
    random = np.random.default_rng(seed)
    T = inverse(TRUE[a]) @ TRUE[b]
    if sigma:
        v = random.normal(0, sigma, 6)
        T = rigid(rotation_about(v[:3], float(np.linalg.norm(v[:3]))), v[3:]) @ T
    if wrong:
        T = rigid(random_rotation(99), [4.0, -3.0, 1.0])
    return GraphLink(
        target=a,
        source=b,
        T_target_source=T,
        centre=np.zeros(3),
        information=np.eye(6) / max(sigma, 1e-3) ** 2 if information is None else information,
    )


PAIRS = [(a, b) for b in range(N) for a in range(b)]


def start(scale=0.05):
    out = TRUE.copy()
    for k in range(1, N):
        out[k] = rigid(rotation_about([1, k, 2], scale), scale * np.ones(3)) @ out[k]
    return out


def test_exact_links_give_exact_poses_from_a_wrong_start():
    found = optimise(start(), [link(a, b) for a, b in PAIRS], [0], ABOUT)
    assert found.converged
    np.testing.assert_allclose(found.T_world_frame, TRUE, atol=1e-9)
    np.testing.assert_array_equal(found.T_world_frame[0], TRUE[0])


def test_one_wrong_link_has_no_weight():
    links = [link(a, b, 0.01, k, wrong=(a, b) == (1, 4)) for k, (a, b) in enumerate(PAIRS)]
    found = optimise(start(), links, [0], ABOUT)
    wrong = PAIRS.index((1, 4))
    assert found.weight[wrong] < 0.01
    assert np.delete(found.weight, wrong).min() > 0.1
    assert np.abs(found.T_world_frame - TRUE).max() < 0.05


def test_covariance_is_that_of_many_draws():
    sigma, errors, stated = 0.01, [], None
    for seed in range(60):
        links = [link(a, b, sigma, 1000 * seed + k) for k, (a, b) in enumerate(PAIRS)]
        found = optimise(TRUE, links, [0], ABOUT)
        off = found.T_world_frame[3] @ inverse(TRUE[3])
        centre = TRUE[3][:3, 3]
        errors.append(off[:3, :3] @ centre + off[:3, 3] - centre)
        stated = found.covariance[3][3:, 3:] if stated is None else stated
    assert np.mean(np.sum(np.square(errors), axis=1)) == pytest.approx(np.trace(stated), rel=0.5)


def test_an_open_direction_is_told_by_another_link():
    flat = np.diag([1.0, 1, 1, 0, 1, 1]) * 1e6  # does not tell x in the target's frame
    other = np.diag([1.0, 1, 1, 1, 0, 0]) * 1e6
    links = [link(0, 1, information=flat), link(0, 1, information=other)]
    begin = TRUE[:2].copy()
    begin[1, :3, 3] += 0.1
    found = optimise(begin, links, [0], ABOUT[:2])
    np.testing.assert_allclose(found.T_world_frame[1], TRUE[1], atol=1e-8)


def test_nothing_moves_without_links_or_freedom():
    assert optimise(TRUE, [], [0], ABOUT).T_world_frame.tolist() == TRUE.tolist()
    held = optimise(start(), [link(0, 1)], range(N), ABOUT)
    np.testing.assert_array_equal(held.T_world_frame, start())


@pytest.mark.parametrize("angle", [0.0, 1e-12, 1e-4, 1.0, 3.0, np.pi])
def test_rotation_vector_is_the_inverse_of_rotation(angle):
    axis = np.array([2.0, -1.0, 0.5]) / np.linalg.norm([2.0, -1.0, 0.5])
    v = rotation_vector(rotation_about(axis, angle))
    assert min(np.abs(v - angle * axis).max(), np.abs(v + angle * axis).max() if angle == np.pi else np.inf) < 1e-7


def test_residual_is_zero_where_poses_and_link_agree():
    np.testing.assert_allclose(residual(TRUE, link(2, 5)), 0.0, atol=1e-12)


def test_triangles_close_only_where_their_links_agree():
    links = {(0, 1): link(0, 1).T_target_source, (1, 2): link(1, 2).T_target_source, (0, 2): link(0, 2).T_target_source}
    links[2, 3], links[0, 3] = link(2, 3).T_target_source, link(0, 3, wrong=True).T_target_source
    assert triangles_closed(links, 1.0, 1e-6) == {(0, 1): 1, (1, 2): 1, (0, 2): 1, (2, 3): 0, (0, 3): 0}


def test_components_are_named_by_their_lowest_frame():
    assert components(6, [(4, 5), (1, 4), (2, 3)]) == [0, 1, 2, 2, 1, 1]


def test_poses_are_multiplied_along_a_chain():
    steps = [inverse(TRUE[k]) @ TRUE[k + 1] for k in range(N - 1)]
    np.testing.assert_allclose(concatenate(steps), TRUE, atol=1e-12)
    np.testing.assert_allclose(concatenate(steps, TRUE[2])[0], TRUE[2])
    pairs = np.array([(k + 1, k) for k in range(N - 1)])  # the other way round
    found = along_tree(N, pairs, np.array([inverse(T) for T in steps]), range(N - 1), {0: TRUE[0]})
    np.testing.assert_allclose([found[k] for k in range(N)], TRUE, atol=1e-12)
