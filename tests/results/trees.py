"""Comparison of two results."""

import numpy as np


def same(a, b, attributes=True):
    assert {n.path for n in a.subtree} >= {n.path for n in b.subtree}
    for node in b.subtree:
        x, y = a[node.path].to_dataset(), node.to_dataset()
        assert set(x.variables) == set(y.variables), node.path
        for name in x.variables:
            assert x[name].dims == y[name].dims, (node.path, name)
            assert x[name].equals(y[name]), (node.path, name)
            if attributes:
                assert {k: np.ravel(v).tolist() for k, v in x[name].attrs.items()} == {
                    k: np.ravel(v).tolist() for k, v in y[name].attrs.items()
                }
