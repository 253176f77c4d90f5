"""Figures of the post-flight layer from made-up groups: no flight, no filter."""

import json

import numpy as np
import pytest
import xarray as xr

from edl_filter.report import figures
from edl_filter.report.colours import GREEN
from edl_filter.report.description import bounds
from edl_filter.report.figures import FIGURES, draw_all
from edl_filter.report.matplotlib_renderer import draw
from edl_filter.results.reader import ResultReader

NAMES = [
    "mach_and_knudsen",
    "atmosphere_profile",
    "database_atmospheres",
    "flight_atmospheres",
    "force_coefficients",
    "moment_coefficients",
    "rolling_moment",
    "angles_by_method",
    "angular_accelerations",
    "oscillation",
]
COEFFICIENTS = ("CA", "CN", "CY", "Cl", "Cm", "Cn")
START, USEFUL, END, PARACHUTE = 10.0, 40.0, 199.9, 200.0


def make_tree(count: int = 1500) -> xr.DataTree:
    """A swinging flight of 200 s whose density is 5 % above the one expected."""
    time = np.linspace(0.1, END, count)
    swing = np.sin(0.7 * time)
    altitude = 1.2e5 - 550.0 * time
    density = 2e-2 * np.exp(-altitude / 1e4)

    def group(**values):
        dims = ("time", "axis")
        data = {name: (dims[: np.ndim(v)], v) for name, v in values.items()}
        return xr.Dataset(data, coords={"time": time})

    def air(factor):
        rho = factor * density
        names = ("density", "pressure", "temperature")
        values = dict(zip(names, (rho, 190.0 * 200.0 * rho, np.full(count, 200.0)), strict=True))
        sigma = {f"{name}_sigma": 0.02 * v for name, v in values.items()}
        mach = 30.0 - 0.14 * time
        return group(altitude=altitude, mach=mach, knudsen=1e-7 / rho, ca=1.6 + 0.0 * rho, **values, **sigma)

    def coefficients(size, spread):
        values = dict.fromkeys(COEFFICIENTS, size * swing)
        return group(**values, **{f"{name}_{spread}": np.full(count, 0.01) for name in COEFFICIENTS})

    tensor = np.column_stack((swing, swing, -swing))
    terms = {f"rolling_{k}": k_size * swing for k, k_size in (("spin", 0.3), ("difference", 0.1), ("xy", 0.0))}
    forces = group(alpha=0.05 * swing, beta=-0.05 * swing, Cm=0.01 * swing, Cn=0.01 * swing)
    forces["alpha"][500:600] = np.nan  # no solution there
    attrs = {
        "domain_start": START,
        "domain_useful": USEFUL,
        "domain_end": END,
        "continuum_from": 60.0,
        "continuum_limit": 0.002,
        "mach_times": json.dumps({"25": 35.0, "15": 107.0, "5": None}),
        "instabilities": json.dumps({"first": None, "second": [100.0, 110.0]}),
    }
    angles = ("alpha", "beta", "alpha_total")
    differences = [f"{a}_{k}" for a in ("alpha", "beta") for k in ("forces", "moments", "between", "between_sigma")]
    events = xr.Dataset(
        {"time_s": ("event", [0.0, PARACHUTE])}, coords={"event": ["entry_interface", "parachute_deploy"]}
    )
    middles = np.arange(44.0, END - 4.0, 4.0)
    parts = ("growth", "growth_sigma", "stiffness", "stiffness_sigma", "rate")
    windows = xr.Dataset(dict.fromkeys(parts, ("time", 0.01 + 1e-5 * middles)), coords={"time": middles})
    windows["growth"] = windows["growth"].where(windows["time"] != middles[3])  # too few swings there
    groups = {
        "/": xr.Dataset(attrs={"title": "Test flight", "epoch_utc": "2004-01-04T04:19:51.9"}),
        "/trajectory": xr.Dataset(coords={"time": time}),
        "/events": events,
        "/postflight": xr.Dataset(attrs=attrs),
        "/postflight/atmosphere/flight": air(1.05),
        "/postflight/atmosphere/preflight": air(1.0),
        "/postflight/coefficients/flight": coefficients(0.010, "sigma"),
        "/postflight/coefficients/preflight_density": coefficients(0.0105, "sigma"),
        "/postflight/coefficients/database": coefficients(0.009, "three_sigma"),
        "/postflight/coefficients/database_preflight": coefficients(0.0095, "three_sigma"),
        "/postflight/coefficients/database_measured": coefficients(0.009, "three_sigma").drop_vars("CA"),
        "/postflight/atmosphere_differences": group(
            **dict.fromkeys(("mach", "knudsen"), 3.0 + swing),
            **dict.fromkeys([f"{n}_database" for n in COEFFICIENTS if n != "Cl"], 5.0 * swing),
            **dict.fromkeys([f"{n}_flight" for n in COEFFICIENTS], 5.0 * swing),
        ),
        "/postflight/combination/forces": forces,
        "/postflight/combination/moments": group(alpha=swing, beta=swing, CN=0.01 * swing, CY=0.01 * swing),
        "/postflight/angles": group(**dict.fromkeys((*angles, *differences), 0.05 * swing)),
        "/postflight/motion": group(
            angular_acceleration=tensor,
            angular_acceleration_sigma=np.full(count, 0.01),
            **terms,
            rolling_xz=0.0 * swing,
            rolling_yz=0.0 * swing,
        ),
        "/postflight/oscillation": windows,
    }
    return xr.DataTree.from_dict(groups)


@pytest.fixture(scope="module")
def tree() -> xr.DataTree:
    return make_tree()


def test_the_angle_of_attack_shows_the_instabilities(tree):
    flown = xr.DataTree.from_dict({node.path: node.to_dataset() for node in tree.subtree})
    angle = xr.DataArray(np.full(flown["trajectory"].sizes["time"], 0.05), dims="time")
    flown["trajectory"] = xr.DataTree(flown["trajectory"].to_dataset().assign(alpha_total=angle))
    entry = canvas("total_angle_of_attack", flown).axes[0]
    assert [t.get_text() for t in entry.texts].count("unstable") == 1
    spans = [p.get_extents() for p in entry.patches]
    assert [entry.transData.inverted().transform((s.x0, 0))[0] for s in spans] == pytest.approx([100.0])
    bare = canvas("total_angle_of_attack", less(flown, "/postflight")).axes[0]
    assert "unstable" not in [t.get_text() for t in bare.texts] and not bare.patches


def canvas(name, tree):
    return draw(FIGURES[name].describe(ResultReader.of(tree)))


def available(tree):
    return figures.available(ResultReader.of(tree))


def less(tree: xr.DataTree, *paths: str) -> xr.DataTree:
    groups = {node.path: node.to_dataset() for node in tree.subtree}
    return xr.DataTree.from_dict({k: v for k, v in groups.items() if not k.startswith(paths)})


def test_all_files_are_written(tree, tmp_path):
    assert [p.stem for p in draw_all(tree, tmp_path)] == NAMES
    assert all(p.read_bytes().startswith(b"\x89PNG") and p.stat().st_size > 5000 for p in tmp_path.iterdir())


@pytest.mark.parametrize("name", NAMES)
def test_axes_have_labels_with_units_and_the_flights_marks(tree, name):
    figure = canvas(name, tree)
    assert figure.axes[0].get_title(loc="left").startswith("Test flight: ")
    texts = {text.get_text() for ax in figure.axes for text in ax.texts}
    assert "Mach 15" in texts
    assert "Mach 5" not in texts  # the flight does not reach it
    if name == "atmosphere_profile":
        assert [ax.get_xlabel() for ax in figure.axes][:3] == ["density (kg/m³)", "pressure (Pa)", "temperature (K)"]
        assert figure.axes[0].get_ylabel() == "altitude (km)"
        return
    assert all(ax.get_ylabel().endswith(")") and "(" in ax.get_ylabel() for ax in figure.axes)
    assert figure.axes[-1].get_xlabel() == "time since 2004-01-04 04:19:51.9 UTC (s)"
    assert {"parachute", "unstable"} <= texts
    for ax in figure.axes:
        low, high = ax.get_xlim()
        assert (low in (START, USEFUL)) and high == PARACHUTE
        marked = [line.get_xdata()[0] for line in ax.lines if line.get_gid() == "event"]
        assert marked == [t for t in (35.0, 107.0, PARACHUTE) if t >= low]


@pytest.mark.parametrize(
    ("missing", "gone"),
    [
        ("/postflight", set(NAMES)),
        ("/postflight/atmosphere/preflight", {"mach_and_knudsen", "atmosphere_profile"}),
        (
            "/postflight/atmosphere_differences",
            {"mach_and_knudsen", "database_atmospheres", "flight_atmospheres"},
        ),
        ("/postflight/coefficients/preflight_density", {"flight_atmospheres"}),
        ("/postflight/coefficients/database_measured", {"force_coefficients", "moment_coefficients"}),
        ("/postflight/combination/moments", {"force_coefficients", "angles_by_method"}),
        ("/postflight/motion", {"rolling_moment", "angular_accelerations"}),
        ("/postflight/oscillation", {"oscillation"}),
    ],
)
def test_figures_without_their_groups_are_skipped(tree, missing, gone):
    some = less(tree, missing)
    assert available(some) == [n for n in NAMES if n not in gone]
    assert all(canvas(n, some).axes for n in available(some)[:2])


def test_both_atmospheres_are_compared_in_all_six_coefficients(tree):
    axes = canvas("flight_atmospheres", tree).axes
    assert [ax.get_ylabel().split()[0] for ax in axes[:6]] == ["CA", "CN", "CY", "Cl", "Cm", "Cn"]
    named = [label for ax in axes[6:] for label in ax.get_legend_handles_labels()[1]]
    assert named == ["CN", "CY", "Cm", "Cn", "CA", "Cl"]
    line = next(line for line in axes[7].lines if line.get_label() == "Cm")
    np.testing.assert_allclose(np.max(np.abs(line.get_ydata())), 5.0, rtol=1e-3)


def test_wild_samples_before_the_useful_domain_do_not_set_the_range(tree):
    wild = make_tree()
    for name in ("CN", "CY"):
        values = wild["postflight/coefficients/flight"][name].values
        values[wild["postflight/coefficients/flight"]["time"].values < USEFUL] = 10.0
        values[-2:] = -10.0  # the parachute's first pull
    for ax in canvas("force_coefficients", wild).axes:
        assert np.max(np.abs(ax.get_ylim())) < 0.05


def test_the_transition_to_continuum_and_the_flights_own_sigma_are_drawn(tree):
    labels = [ax.get_legend_handles_labels()[1] for ax in canvas("mach_and_knudsen", tree).axes]
    assert "continuum (Kn < 0.002)" in labels[0]
    assert [next(line for line in ax.lines if line.get_color() == GREEN).get_xdata()[0] for ax in
            canvas("mach_and_knudsen", tree).axes[:2]] == [60.0, 60.0]  # fmt: skip
    axes = canvas("force_coefficients", tree).axes[1]
    assert "flight's 1 sigma" in axes.get_legend_handles_labels()[1]
    bare = make_tree()
    del bare["postflight"].attrs["continuum_from"]  # the air never becomes a continuum
    assert "continuum (Kn < 0.002)" not in canvas("mach_and_knudsen", bare).axes[0].get_legend_handles_labels()[1]


def test_terms_that_are_nothing_are_not_named(tree):
    labels = canvas("rolling_moment", tree).axes[2].get_legend_handles_labels()[1]
    assert labels == ["by Izz − Iyy"]


def test_nothing_useful_and_nothing_stated():
    bare = make_tree()
    bare["postflight"].attrs = {"domain_useful": float("nan")}
    domain = ResultReader.of(bare).domain
    assert (domain.start, domain.useful, domain.end) == (domain.time[0], domain.time[0], domain.time[-1])
    assert domain.mach_times == {}
    assert domain.instabilities == ()
    assert all(canvas(name, bare).axes for name in NAMES)


def test_has_looks_below_children(tree):
    reader = ResultReader.of(tree)
    assert reader.has("postflight/atmosphere/flight:mach", "postflight/angles:alpha")
    assert not reader.has("postflight/atmosphere/flight:nothing")
    assert not reader.has("postflight/atmosphere/nothing:mach")


def test_bounds_of_nothing():
    assert bounds([np.full(3, np.nan)]) == (-1.0, 1.0)
    low, high = bounds([np.zeros(5)])
    assert low < 0.0 < high


def test_a_clear_window_is_inside_the_oscillations_range_and_a_vague_one_does_not_widen_it():
    flown = make_tree()
    windows = flown["postflight/oscillation"]
    growth, sigma = windows["growth"].values.copy(), np.full(windows.sizes["time"], 0.002)
    growth[5], sigma[5] = 0.3, 0.05  # six sigmas, though its sigma is large
    growth[8], sigma[8] = 5.0, 4.0
    flown["postflight/oscillation"] = xr.DataTree(
        windows.to_dataset().assign(growth=("time", growth), growth_sigma=("time", sigma))
    )
    low, high = canvas("oscillation", flown).axes[1].get_ylim()
    assert low > -0.1 and 0.3 < high < 0.5


def test_legends_are_understood_without_the_thesis(tree):
    for name, origin in (("force_coefficients", "moments"), ("moment_coefficients", "forces")):
        labels = canvas(name, tree).axes[0].get_legend_handles_labels()[1]
        assert f"from {origin}, by inverse look-up" in labels and "flight" in labels
        assert not any("combine" in label or "accels" in label for label in labels)
