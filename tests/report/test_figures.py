"""Figures from a small made-up result: no flight, no filter."""

import matplotlib as mpl
import numpy as np
import pytest
import xarray as xr
from matplotlib.figure import Figure as Canvas
from scipy.stats import chi2

from edl_filter.report import attitude, constraints, figures, motion, track, trajectory
from edl_filter.report.description import Axis, Figure, Line, Panel, Text
from edl_filter.report.figures import FIGURES, draw_all
from edl_filter.report.matplotlib_renderer import draw, draw_panel, write_figure
from edl_filter.report.text import time_label
from edl_filter.report.track import LocalMap, landing_estimate
from edl_filter.results.reader import ResultReader

EVENTS = {"parachute_deploy": 60.0, "heat_shield_separation": 66.0, "bridle_cut": 88.0, "landing": 90.0}
RADIUS, RATE = 3.39e6, 7e-5
PANELS = (
    trajectory.altitude,
    trajectory.speed,
    trajectory.uncertainty,
    motion.axial_deceleration,
    lambda reader: motion.acceleration(reader, 0),
    lambda reader: motion.angular_rate(reader, 2),
    attitude.total_angle_of_attack,
    attitude.quaternion,
)
MAPS = (track.ground_track, track.landing_ellipse)
#: Figures that need no post-flight groups.
RECONSTRUCTION = list(FIGURES)[:9]
ROWS = (constraints.innovations, constraints.left_out)


def make_tree(count: int = 801) -> xr.DataTree:
    """A straight way down to longitude 1 rad on the equator, and two constraints."""
    time = np.linspace(0.0, 100.0, count)
    down = np.clip(1.0 - time / 90.0, 0.0, None)
    longitude = 1.0 - 0.2 * down
    angle = longitude + 0.3 + RATE * time  # the prime meridian stands at 0.3 rad
    altitude = 1.2e5 * down - 2e3
    radius = RADIUS + altitude
    position = np.column_stack((radius * np.cos(angle), radius * np.sin(angle), np.zeros(count)))
    vector = np.column_stack((-60.0 * np.sin(np.pi * time / 100.0), np.sin(time), np.cos(time)))
    spin = np.column_stack((np.sin(0.1 * time), np.zeros((count, 2)), np.cos(0.1 * time)))
    covariance = np.tile(np.diag([1e4, 1e4, 4e4, 1, 1, 1, 1e-6, 1e-6, 1e-6]), (count, 1, 1))
    along = {
        "altitude": altitude,
        "latitude": np.zeros(count),
        "longitude": longitude,
        "speed": 5e3 * down,
        "alpha_total": 0.02 + 0.01 * np.sin(time),
        "altitude_sigma": np.full(count, 100.0),
        "speed_sigma": np.full(count, 1.0),
        "alpha_total_sigma": np.full(count, 0.002),
    }
    path = xr.Dataset(
        {
            **{name: ("time", values) for name, values in along.items()},
            "position": (("time", "axis"), position),
            "inertial_from_body": (("time", "quaternion"), spin),
            "covariance": (("time", "state", "state_2"), covariance),
            "specific_force": (("time", "axis"), vector),
            "angular_rate": (("time", "axis"), 0.1 * vector),
        },
        coords={"time": time},
    )
    events = xr.Dataset({"time_s": ("event", list(EVENTS.values()))}, coords={"event": list(EVENTS)})
    site = (RADIUS - 2e3) * np.array([np.cos(1.0), np.sin(1.0), 0.0])
    root = xr.Dataset(attrs={"title": "Test flight", "mission": "test", "epoch_utc": "2004-01-04T04:19:51.9"})
    return xr.DataTree.from_dict(
        {
            "/": root,
            "/trajectory": path,
            "/events": events,
            "/constraints/landing": constraint([90.0], ("fixed x (m)", "fixed y (m)", "fixed z (m)"), site),
            "/constraints/altimeter": constraint(np.arange(61.0, 89.0), ("height (m)",), np.zeros(1)),
        }
    )


def constraint(times, components, measured) -> xr.Dataset:
    uses, size = len(times), len(components)
    spread = np.linspace(-2.0, 2.0, uses * size).reshape(uses, size)
    both = ("time", "component")
    return xr.Dataset(
        {
            "innovation": (both, 10.0 * spread),
            "innovation_sigma": (both, np.full((uses, size), 10.0)),
            "nis": ("time", (spread**2).sum(axis=1)),
            "accepted": ("time", np.ones(uses, np.int8)),
            "left_out": ("component", np.full(size, 300.0)),
            "left_out_sigma": ("component", np.full(size, 600.0)),
            "left_out_covariance": (("component", "component_2"), 3.6e5 * np.eye(size)),
            "measured": (both, np.tile(measured, (uses, 1))),
            "noise": (
                ("time", "component", "component_2"),
                np.tile(2.5e5 * np.eye(size), (uses, 1, 1)),
            ),
        },
        coords={"time": np.asarray(times, float), "component": list(components)},
        attrs={
            "dof": uses * size,
            "nis_interval_99_9": chi2.ppf([0.0005, 0.9995], uses * size),
            "left_out_nis": 0.25 * size,
            "left_out_dof": size,
            "left_out_nis_interval_99_9": chi2.ppf([0.0005, 0.9995], size),
        },
    )


@pytest.fixture(scope="module")
def tree() -> xr.DataTree:
    return make_tree()


def axes_of(describe, tree):
    """Axes of one panel in a figure of its own."""
    reader = ResultReader.of(tree)
    title = f"{reader.title}: subject"
    return draw(Figure(title, ((describe(reader),),), (3.6,), event_labels=True)).axes[0]


def axes_of_figure(describe, tree):
    return draw(describe(ResultReader.of(tree))).axes[0]


def available(tree):
    return figures.available(ResultReader.of(tree))


def less(tree: xr.DataTree, *paths: str) -> xr.DataTree:
    """Tree without some groups (``a/b``) or variables (``a:x``)."""
    groups = {node.path: node.to_dataset() for node in tree.subtree}
    for path in paths:
        if ":" in path:
            node, name = path.split(":")
            groups["/" + node] = groups["/" + node].drop_vars(name)
        else:
            groups = {key: value for key, value in groups.items() if not key.startswith("/" + path)}
    return xr.DataTree.from_dict(groups)


def test_all_files_are_written(tree, tmp_path):
    written = draw_all(tree, tmp_path / "new" / "figures")
    assert [p.stem for p in written] == RECONSTRUCTION
    assert all(p.read_bytes().startswith(b"\x89PNG") and p.stat().st_size > 5000 for p in written)


@pytest.mark.parametrize("panel", PANELS)
def test_panels_name_axes_with_units_and_mark_events(tree, panel):
    ax = axes_of(panel, tree)
    assert ax.get_xlabel() == "time since 2004-01-04 04:19:51.9 UTC (s)"
    assert ax.get_ylabel().endswith(")") and "(" in ax.get_ylabel()
    assert ax.get_title(loc="left").startswith("Test flight: ")
    low, high = ax.get_xlim()
    marked = [line.get_xdata()[0] for line in ax.lines if line.get_gid() == "event"]
    assert marked == [t for t in EVENTS.values() if low <= t <= high]
    assert {"parachute"} <= {text.get_text() for text in ax.texts}


@pytest.mark.parametrize("panel", (*PANELS, *MAPS, *ROWS))
def test_panels_draw_on_the_axes_they_are_given(tree, panel):
    ax = Canvas().add_subplot()
    assert draw_panel(panel(ResultReader.of(tree)), ax) is ax
    assert ax.lines or ax.collections
    assert ax.get_title(loc="left") == ""


@pytest.mark.parametrize("panel", MAPS)
def test_maps_are_in_km_of_the_site(tree, panel):
    ax = axes_of(panel, tree)
    assert ax.get_xlabel() == "east of the site (km)"
    assert ax.get_ylabel() == "north (km)"
    stars = [line for line in ax.lines if line.get_label() == "landing site"]
    assert [tuple(line.get_xydata()[0]) for line in stars] == [(0.0, 0.0)]


def test_a_vehicle_at_rest_has_no_flight_path_angle(tree):
    path = tree["trajectory"].to_dataset()
    angle = np.where(path["time"] < 90.0, -0.2, 1.0)  # of the wind once the vehicle is at rest
    groups = {node.path: node.to_dataset() for node in tree.subtree}
    at_rest = xr.DataTree.from_dict(groups | {"/trajectory": path.assign(flight_path_angle=("time", angle))})
    (curve,) = trajectory.flight_path_angle(ResultReader.of(at_rest)).elements
    assert curve.x.max() < EVENTS["landing"] and np.allclose(curve.y, np.degrees(-0.2))


def test_landing_without_its_constraint(tree):
    estimate = landing_estimate(ResultReader.of(tree))
    np.testing.assert_allclose(estimate.position, estimate.site, atol=1e-3)
    np.testing.assert_allclose(estimate.site - estimate.predicted, 300.0)
    # 600 m of left_out less the landing's own 500 m
    spread = LocalMap.centred_at(estimate.site).horizontal_covariance(estimate.predicted_covariance)
    np.testing.assert_allclose(spread, 1.1e5 * np.eye(2), atol=1e-3)


def test_a_record_that_ends_in_flight_has_a_track_and_no_landing(tree):
    groups = {node.path: node.to_dataset() for node in tree.subtree if "landing" not in node.path}
    before = groups["/events"].isel(event=[name != "landing" for name in EVENTS])
    reader = ResultReader.of(xr.DataTree.from_dict(groups | {"/events": before}))
    figure = track.track_figure(reader)
    assert figure.title == "Test flight: ground track" and [len(row) for row in figure.rows] == [1, 1]
    assert {row[0].x.label for row in figure.rows} == {"east of the end of the record"}


def test_map_keeps_distance_along_the_ground(tree):
    local = LocalMap.centred_at(np.array([RADIUS, 0.0, 0.0]))
    for angle in (1e-6, 0.1, 0.5):
        for height in (0.0, 1e5):  # height must not matter
            east = (RADIUS + height) * np.array([np.cos(angle), np.sin(angle), 0.0])
            np.testing.assert_allclose(local.offset(east), [RADIUS * angle, 0.0], rtol=1e-9, atol=1e-6)
            north = (RADIUS + height) * np.array([np.cos(angle), 0.0, np.sin(angle)])
            np.testing.assert_allclose(local.offset(north), [0.0, RADIUS * angle], rtol=1e-9, atol=1e-6)


def test_constraint_rows_name_components_and_nis(tree):
    ax = axes_of_figure(constraints.innovations_figure, tree)
    texts = [t.get_text() for t in (*ax.texts, *ax.get_yticklabels())]
    assert {"fixed x", "fixed y", "fixed z", "height"} <= set(texts)
    assert {"landing", "altimeter", "NIS in its 99.9 % interval"} <= set(texts)
    assert "8.00 in 0.02 … 17.7" in texts
    assert ax.get_xlabel().startswith("innovation (sigma)")


def test_a_nis_without_degrees_of_freedom_has_no_interval(tree):
    undetermined = less(tree)
    undetermined["constraints/landing"].attrs["left_out_dof"] = 0
    texts = [
        [e.text for e in constraints.left_out(ResultReader.of(t)).elements if isinstance(e, Text)]
        for t in (tree, undetermined)
    ]
    assert [sum(" in " in text for text in t) for t in texts] == [3, 2]  # the head, landing, altimeter


def test_constraint_far_out_is_shown_at_the_edge_with_its_number(tree):
    odd = less(tree)
    data = odd["constraints/landing"].to_dataset()
    data["left_out"] = ("component", [300.0, -6000.0, 300.0])
    data["left_out_sigma"] = ("component", [600.0, 600.0, np.inf])
    odd["constraints/landing"].dataset = data
    texts = [t.get_text() for t in axes_of_figure(constraints.left_out_figure, odd).texts]
    assert "-10.0" in texts or "−10.0" in texts
    assert "not predicted by the others" in texts


@pytest.mark.parametrize(
    "missing",
    [
        ("events",),
        ("constraints",),
        ("constraints/landing",),
        ("constraints/landing:measured",),
        ("constraints/landing:noise", "constraints/landing:accepted"),
        ("trajectory:altitude_sigma", "trajectory:speed_sigma", "trajectory:alpha_total_sigma"),
        ("trajectory:covariance",),
    ],
)
def test_optional_parts_may_be_absent(tree, missing, tmp_path):
    part = less(tree, *missing)
    expected = set(RECONSTRUCTION)
    if missing == ("constraints",):
        expected -= {"constraint_innovations", "leave_one_out"}
    assert set(available(part)) == expected
    for name in expected & {"altitude_velocity", "total_angle_of_attack", "ground_track", "leave_one_out"}:
        assert draw(FIGURES[name].describe(ResultReader.of(part))).axes


def test_figures_without_data_are_left_out(tree, tmp_path):
    part = less(tree, "constraints", "trajectory:specific_force", "trajectory:alpha_total", "trajectory:longitude")
    assert [p.stem for p in draw_all(part, tmp_path)] == ["altitude_velocity", "angular_rates", "attitude_quaternion"]


def test_bare_attributes(tree):
    bare = less(tree)
    bare.attrs = {}
    reader = ResultReader.of(bare)
    assert reader.title == "Entry"
    assert time_label(reader.epoch_utc) == "time since the epoch"
    assert trajectory.time_axis(reader).text == "time since the epoch (s)"


def test_drawing_leaves_the_users_matplotlib_alone(tree):
    before = dict(mpl.rcParams)
    axes_of_figure(constraints.innovations_figure, tree)
    assert dict(mpl.rcParams) == before


def test_quaternion_is_of_the_body_from_j2000_and_does_not_jump(tree):
    """A turn of the frame by half a revolution about z swaps elements; a sign that flips on the way is taken out."""
    turned = tree.copy()
    turned.attrs["j2000_from_inertial"] = np.diag([-1.0, -1.0, 1.0]).ravel()
    for given, frame in ((tree, "inertial"), (turned, "J2000")):
        ax = axes_of_figure(attitude.quaternion_figure, given)
        lines = np.array([line.get_ydata() for line in ax.lines if line.get_label().startswith("q")])
        assert len(lines) == 4 and np.max(np.abs(np.diff(lines, axis=1))) < 0.1
        assert f"{frame} to body" in ax.get_title(loc="left")


def test_the_start_of_the_domain_is_marked_where_it_is_known():
    flown = make_tree()
    text = "deceleration detectable from"
    assert text not in str(axes_of(motion.axial_deceleration, flown).get_legend_handles_labels()[1])
    flown["postflight"] = xr.DataTree(xr.Dataset(attrs={"domain_start": 7.25, "threshold": 0.02}))
    ax = axes_of(motion.axial_deceleration, flown)
    assert f"{text} 7.2 s" in ax.get_legend_handles_labels()[1]
    assert [0.02, 0.02] in [list(line.get_ydata()) for line in ax.lines]


def test_figures_are_written_in_all_formats(tmp_path):
    panel = Panel(Axis("x", "s"), Axis("y", "m"), (Line(0.5),))
    figure = Figure("title", ((panel,),), (2.0,))
    starts = {"png": b"\x89PNG", "svg": b"<?xml", "pdf": b"%PDF"}
    for kind, start in starts.items():
        path = write_figure(figure, tmp_path / f"a.{kind}")
        assert path.read_bytes().startswith(start)
        again = write_figure(figure, tmp_path / f"b.{kind}")
        if kind != "svg":  # identifiers in an SVG are random
            assert again.read_bytes() == path.read_bytes()
