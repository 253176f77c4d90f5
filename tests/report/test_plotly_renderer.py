"""The page draws the same data as matplotlib, from one description."""

import base64

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp

from edl_filter.report.description import (
    Axis,
    Band,
    Bars,
    Curve,
    Figure,
    HeatCell,
    HeatMap,
    Legend,
    Line,
    Panel,
    Region,
    Span,
    Text,
)  # fmt: skip
from edl_filter.report.figures import FIGURES, available
from edl_filter.report.matplotlib_renderer import draw
from edl_filter.report.plotly_renderer import plotly_figure
from edl_filter.results import Result
from edl_filter.results.groups import Group, Variable
from edl_filter.results.reader import ResultReader

#: More bins than any curve here has samples: neither renderer reduces it.
BINS = 10**6


def unpacked(values):
    return np.frombuffer(base64.b64decode(values["bdata"]), "<f4")


def single(*elements, **panel):
    return Figure("title", ((Panel(Axis("x", "s"), Axis("y", "m"), elements, **panel),),), (3.0,))


def traces(figure, bins=BINS):
    return plotly_figure(figure, 400, bins)["data"]


def assert_same_curves(figure):
    """Every curve is in both renderings with the data of the description; returns the number of curves."""
    canvas, plotly = draw(figure), plotly_figure(figure, 600, BINS)
    plotted = [line.get_xydata() for axes in canvas.axes for line in axes.lines]
    packed = [np.column_stack((unpacked(t["x"]), unpacked(t["y"]))) for t in plotly["data"] if t["type"] == "scatter"]
    curves = [e for panel in figure.panels for e in panel.elements if isinstance(e, Curve)]
    for curve in curves:
        points = np.column_stack((curve.x, curve.y))
        assert any(p.shape == points.shape and np.array_equal(p, points, equal_nan=True) for p in plotted)
        single_precision = points.astype("<f4")
        assert any(p.shape == points.shape and np.array_equal(p, single_precision, equal_nan=True) for p in packed)
    return len(curves)


numbers = st.floats(-1e6, 1e6, allow_nan=False, width=32)
values = st.one_of(numbers, st.just(float("nan")))


@settings(max_examples=25, deadline=None)
@given(
    hnp.arrays(float, st.integers(2, 40), elements=values),
    st.sampled_from(("x", "y", "none")),
    st.sampled_from(("", "circle", "star")),
)
def test_any_curve_has_the_same_data_in_both(y, independent, symbol):
    x = np.arange(len(y), dtype=float)
    first = Curve(x, y, "first", "blue", "m", independent=independent, symbol=symbol)
    second = Curve(y, x, "second", "green", width=0.0, symbol="diamond")
    assert assert_same_curves(single(first, second, legend=Legend("best"))) == 2


@pytest.fixture(scope="module")
def reader(practice_06):
    """The shipped flight, of which every tenth sample remains: neither renderer reduces its curves."""
    thinned = {}
    for path, group in Result(practice_06).groups.items():
        variables = {}
        for name, v in group.variables.items():
            step = 10 if v.dims[:1] == ("time",) and len(v.values) > 500 else 1
            variables[name] = v if step == 1 else Variable(v.dims, v.values[::step], v.attrs)
        thinned[path] = Group(variables, group.attrs)
    return ResultReader(thinned)


@pytest.mark.parametrize("name", list(FIGURES))
def test_the_figures_of_a_run_have_the_same_curves_in_both(reader, name):
    assert name in available(reader)
    assert assert_same_curves(FIGURES[name].describe(reader)) > 0


@settings(max_examples=25, deadline=None)
@given(hnp.arrays(float, st.integers(3, 40), elements=numbers), st.floats(0.125, 8.0, width=16))
def test_a_band_covers_the_same_range_in_both(middle, half):
    x = np.arange(len(middle), dtype=float)
    figure = single(Band(x, middle - half, middle + half, "band"))
    vertices = draw(figure).axes[0].collections[0].get_paths()[0].vertices
    (trace,) = traces(figure)
    for column, key in ((0, "x"), (1, "y")):
        packed = unpacked(trace[key])
        ends = [vertices[:, column].min(), vertices[:, column].max()]
        np.testing.assert_allclose([packed.min(), packed.max()], ends, rtol=1e-5, atol=1e-5)


def test_every_element_is_in_both():
    circle = np.linspace(0.0, 6.3, 20)
    elements = (
        Region(np.cos(circle), np.sin(circle), "region"), Line(0.25, "y", "level"), Line(0.5, "x"),
        Span(0.1, 0.2, note="unstable"), Bars((0.0, 1.0), (0.0, 0.0), (3.0, -2.0), ("blue", "muted"), "bars"),
        Text("a note", 0.3, 0.4), HeatMap((HeatCell(0, 1, 2.0, "#123456", "#ffffff", "2.00", True),)),
        Curve(np.arange(2.0), np.ones(2), "error", symbol="circle", sigma=np.full(2, 0.1)),
    )  # fmt: skip
    figure = single(*elements, legend=Legend("best"), events={"parachute_deploy": 0.7})
    axes = draw(figure).axes[0]
    rendered = plotly_figure(figure, 400)
    layout = rendered["layout"]
    assert {"region", "level", "bars", "error"} <= set(axes.get_legend_handles_labels()[1])
    assert {"region", "bars", "error"} <= {t["name"] for t in rendered["data"]}
    assert {"unstable", "a note", "2.00"} <= {t.get_text() for t in axes.texts}
    assert {"a note", "2.00", "parachute"} <= {a["text"] for a in layout["annotations"]}
    bars = next(t for t in rendered["data"] if t["type"] == "bar")
    assert bars["y"] == [3.0, -2.0] == [p.get_height() for p in axes.containers[0].patches]
    lines = [s for s in layout["shapes"] if s["type"] == "line"]
    assert sorted(s["x0"] for s in lines if s["x0"] == s["x1"]) == [0.5, 0.7]
    assert [s["y0"] for s in lines if s["y0"] == s["y1"]] == [0.25]
    assert [s["x0"] for s in layout["shapes"] if s["type"] == "rect" and "y domain" in s["yref"]] == [0.1]
    assert next(t for t in rendered["data"] if t["name"] == "error")["error_y"]["array"]
    assert [line.get_xdata()[0] for line in axes.lines if line.get_gid() == "event"] == [0.7]


@pytest.mark.parametrize("scale", ["linear", "log"])
def test_axes_have_the_same_range_label_and_scale_in_both(scale):
    y = Axis("density", "kg/m³", scale, (1e-3, 1e2))
    panel = Panel(Axis("time", "s", range=(3.0, 9.0)), y, (Curve(np.array([3.0, 9.0]), np.ones(2)),))
    figure = Figure("title", ((panel,),), (3.0,))
    axes, layout = draw(figure).axes[0], plotly_figure(figure, 400)["layout"]
    assert axes.get_xlim() == tuple(layout["xaxis"]["range"]) == (3.0, 9.0)
    limits = layout["yaxis"]["range"]
    assert axes.get_ylim() == pytest.approx([10.0**v for v in limits] if scale == "log" else limits)
    assert axes.get_ylabel() == layout["yaxis"]["title"]["text"] == "density (kg/m³)"
    assert axes.get_yscale() == layout["yaxis"].get("type", "linear") == scale


def test_panels_of_a_column_share_the_time_axis():
    panels = [Panel(Axis("t", "s", range=(0.0, 1.0)), Axis(n), (Curve(np.arange(2.0), np.ones(2), n),)) for n in "ab"]
    figure = Figure("title", tuple((p,) for p in panels), (1.0, 1.0), shared_x=True)
    rendered = plotly_figure(figure, 400)
    assert [t.get("yaxis", "y") for t in rendered["data"]] == ["y", "y2"]
    assert "xaxis2" not in rendered["layout"] and rendered["layout"]["xaxis"]["anchor"] == "y2"
    domains = [rendered["layout"][name]["domain"] for name in ("yaxis", "yaxis2")]
    assert domains[0][0] > domains[1][1]
    upper, lower = draw(figure).axes
    assert (upper.get_xlabel(), lower.get_xlabel()) == ("", "t (s)")
