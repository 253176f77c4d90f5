"""Positions of labels above a row of marks."""

import numpy as np
import pytest

from edl_filter.report.label_layout import place_labels


class TestLabels:
    @pytest.mark.parametrize("seed", range(20))
    def test_nothing_meets(self, seed):
        rng = np.random.default_rng(seed)
        span, gap = 500.0, 4.0
        marks = np.sort(rng.uniform(0.0, span, rng.integers(1, 8)))
        widths = rng.uniform(20.0, 90.0, len(marks))
        places = place_labels(marks, widths, span, gap)
        for i, a in enumerate(places):
            assert -gap <= a.start and a.start + widths[i] <= span + gap
            for j, b in enumerate(places):
                if i != j and a.row == b.row:
                    assert a.start >= b.start + widths[j] or b.start >= a.start + widths[i]
                if i != j and a.row > b.row:  # the leader of i passes row of j
                    assert not b.start < marks[i] < b.start + widths[j]

    def test_marks_far_apart_need_one_row(self):
        assert {p.row for p in place_labels([100.0, 300.0, 500.0], [60.0] * 3, 500.0)} == {0}

    def test_no_marks(self):
        assert place_labels([], [], 100.0) == []
