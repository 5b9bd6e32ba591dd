import itertools

import numpy as np
import pytest

from fea.bars import bar, l_bar
from scan2fea.fea import material
from scan2fea.fea.assemble import assemble, node_graph
from scan2fea.fea.dissection import dissect, smallest_cover, without


@pytest.mark.parametrize("seed", range(8))
def test_cover_is_the_smallest(seed):
    rng = np.random.default_rng(seed)
    edges = np.unique(np.c_[rng.integers(0, 6, 9), rng.integers(10, 16, 9)], axis=0)
    cover = set(smallest_cover(edges).tolist())
    assert all(a in cover or b in cover for a, b in edges)
    nodes = np.unique(edges)
    smaller = itertools.chain.from_iterable(itertools.combinations(nodes, k) for k in range(len(cover)))
    assert not any(all(a in c or b in c for a, b in edges) for c in map(set, smaller))


def graph(mesh):
    indptr, indices = node_graph(np.array(mesh.tets), len(mesh.nodes))
    return np.array(mesh.nodes), indptr, indices


@pytest.mark.parametrize("mesh", [bar((3, 1, 1), (9, 3, 3)), l_bar(0.1, 0.01, 0.4, 3, 8)])
def test_fronts_hold_every_entry_of_the_factor(mesh):
    """Symbolic elimination by brute force: what is tied to a node when it goes lies in its front."""
    nodes, indptr, indices = graph(mesh)
    tree = dissect(nodes, indptr, indices)
    assert sorted(tree.order) == list(range(len(nodes)))
    tied = [set(indices[a:b].tolist()) for a, b in itertools.pairwise(indptr)]
    front_of = {int(i): f for f in tree.fronts for i in f.own}
    for i in tree.order:
        later = {j for j in tied[i] if tree.rank[j] > tree.rank[i]}
        front = front_of[int(i)]
        assert later <= set(front.own.tolist()) | set(front.rest.tolist())
        for j in later:
            tied[j] |= later
    assert (np.concatenate([np.diff(tree.rank[f.rest]) for f in tree.fronts]) > 0).all()


def test_every_front_is_gathered_once_and_holding_keeps_that():
    mesh = bar((3, 1, 1), (9, 3, 3))
    nodes, indptr, indices = graph(mesh)
    tree = dissect(nodes, indptr, indices)
    held = nodes[:, 0] < 0.4
    less = without(tree, held)
    for t, n in ((tree, len(nodes)), (less, (~held).sum())):
        children = [c for f in t.fronts for c in f.children]
        assert len(set(children)) == len(children)
        roots = set(range(len(t.fronts))) - set(children)
        assert all(len(t.fronts[r].rest) == 0 for r in roots)
        assert sum(len(f.own) for f in t.fronts) == n
    assert (less.rank[held] == -1).all() and less.factor_entries < tree.factor_entries <= tree.peak_entries


def test_dissection_beats_the_band():
    """A beam is cut across its length: the factor grows with the length, not with its square."""
    sizes = []
    for n in (20, 40, 80):
        nodes, indptr, indices = graph(bar((n, 2, 2), (n, 2, 2)))
        sizes.append(dissect(nodes, indptr, indices).factor_entries / len(nodes))
    assert sizes[2] < 1.35 * sizes[1] < 1.6 * sizes[0]


def test_same_input_same_fronts():
    mesh = bar((1, 1, 1), (4, 4, 4))
    first, second = dissect(*graph(mesh)), dissect(*graph(mesh))
    assert (first.order == second.order).all()
    assert assemble(mesh, material("S235")).stiffness.tobytes() == assemble(mesh, material("S235")).stiffness.tobytes()
