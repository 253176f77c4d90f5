"""Labels of the axes that matplotlib draws; `test_plotly_renderer` compares what both renderers draw."""

from edl_filter.report.matplotlib_renderer import power_label


def test_labels_of_powers():
    assert [power_label(v) for v in (1e-3, 1.0, 1e5)] == ["0.001", "1", "100 000"]
