"""Post-flight groups, tables and summary of a result."""

import csv
import io
import json
from dataclasses import replace

import numpy as np
import pytest

from edl_filter.aero.body import SphereCone
from edl_filter.aero.free_molecular import free_molecular_coefficients
from edl_filter.aero.newtonian import newtonian_coefficients, rayleigh_pitot_cp_max
from edl_filter.errors import InputError
from edl_filter.mission import Mission, shipped_mission
from edl_filter.pipeline.forward_model import database_of
from edl_filter.pipeline.reconstruct import reconstruct
from edl_filter.postflight.flight import derive_flight, derived_quantities
from edl_filter.results import Result
from edl_filter.results.postflight import summary, tables


@pytest.fixture(scope="module")
def everything(practice_06):
    derived = derived_quantities(practice_06)
    return Result(practice_06).groups, derived.postflight


def test_every_group_is_there_with_units_and_meanings(everything):
    groups, _ = everything
    below = {path for path in groups if path.startswith("/postflight/")}
    assert {p.removeprefix("/postflight/") for p in below} == {
        "atmosphere/flight", "atmosphere/preflight", "coefficients/flight", "coefficients/preflight_density",
        "coefficients/database", "coefficients/database_preflight", "coefficients/database_measured",
        "combination/forces", "combination/moments", "combination/forces_preflight", "combination/moments_preflight",
        "angles", "motion", "averages", "averages_preflight", "atmosphere_differences", "atmosphere_averages",
        "verdicts", "oscillation",
    }  # fmt: skip
    for path in below:
        for name, variable in groups[path].variables.items():
            assert variable.attrs["long_name"], (path, name)
            assert "units" in variable.attrs or variable.values.dtype == object, (path, name)


def test_root_says_where_the_flight_can_be_used(everything):
    groups, postflight = everything
    root = groups["/postflight"].attrs
    assert root["domain_start"] < root["domain_useful"] < root["domain_end"]
    assert set(json.loads(root["mach_times"])) == {"25", "15", "5"}
    assert root["bandwidth_hz"] == postflight.motion.smoother.bandwidth[root["batch_points"]]
    assert len(json.loads(root["verdicts"])) == len(postflight.verdicts)


def test_tables_say_the_same_as_the_result(everything):
    _, postflight = everything
    csv_texts = tables(postflight)
    rows = list(csv.DictReader(io.StringIO(csv_texts["average_differences.csv"])))
    assert len(rows) == len(postflight.flight.differences) + len(postflight.preflight.differences)
    assert [r["atmosphere"] for r in rows] == sorted(r["atmosphere"] for r in rows)
    assert float(rows[0]["mean"]) == pytest.approx(postflight.flight.differences[0].mean, rel=1e-4)
    verdicts = list(csv.DictReader(io.StringIO(csv_texts["verdicts.csv"])))
    assert [v["sentence"] for v in verdicts] == [v.sentence for v in postflight.verdicts]
    assert float(verdicts[0]["rms"]) == pytest.approx(postflight.verdicts[0].rms, rel=1e-4)
    levels = list(csv.DictReader(io.StringIO(csv_texts["atmosphere.csv"])))
    density = np.array([float(r["density [kg/m^3]"]) for r in levels])
    altitude = np.array([float(r["altitude [m]"]) for r in levels])
    assert np.all(np.diff(altitude) == -1000.0)
    low = altitude < 60e3
    assert np.all(np.diff(density[low]) > 0.0)
    k = int(np.flatnonzero(postflight.flight.atmosphere.altitude < 30e3)[0])
    assert density[altitude == 30e3][0] == pytest.approx(postflight.flight.atmosphere.density[k], rel=0.01)


def test_the_choice_of_atmosphere_is_in_the_result(everything):
    """Percent of the database's 3 sigma; the largest value of a window is that of the group."""
    groups, postflight = everything
    group = groups["/postflight/atmosphere_differences"]
    flight, preflight = (postflight.flight.coefficients.value, postflight.preflight.coefficients.value)
    for name in ("CA", "CN", "CY", "Cl", "Cm", "Cn"):
        expected = 100.0 * (flight[name] - preflight[name]) / postflight.flight.database.three_sigma[name]
        np.testing.assert_allclose(group.variables[f"{name}_flight"].values, expected)
        assert group.variables[f"{name}_flight"].attrs["units"] == "%"
    rows = list(csv.DictReader(io.StringIO(tables(postflight)["atmosphere_differences.csv"])))
    assert len(rows) == len(postflight.windows) * (2 + 5 + 6)
    window = postflight.windows[-1]
    row = next(r for r in rows if (r["window"], r["of"], r["quantity"]) == (window.name, "database", "CN"))
    inside = group.variables["CN_database"].values[window.mask(postflight.time)]
    assert abs(float(row["largest"])) == pytest.approx(np.nanmax(np.abs(inside)), rel=1e-5)


def test_summary_has_what_a_person_asks_first(everything):
    content = summary(everything[1])
    assert abs(content["rolling_moment_coefficient_110_140_s"]) < 1e-7
    assert set(content["force_less_moment_angle_last_20_s_deg"]) == {"alpha", "beta"}
    assert content["averages"][0]["samples"] > 0


def test_stated_windows_replace_the_computed_ones(practice_06):
    windows = "postflight.windows=[{name: mine, start_s: 150, end_s: 160}]"
    flight = reconstruct(Mission.load(shipped_mission("practice_mer"), [windows, "constraints.altimeter=null"]))
    postflight = derived_quantities(flight).postflight
    assert [(w.name, w.start, w.end) for w in postflight.windows] == [("mine", 150.0, 160.0)]
    assert {d.window for d in postflight.flight.differences} == {"mine"}


def test_without_a_database_nothing_is_derived(practice_06):
    flight = reconstruct(
        Mission.load(shipped_mission("practice_mer"), ["aerodynamics=null", "constraints.altimeter=null"])
    )
    derived = derived_quantities(flight)
    assert derived.postflight is None
    assert "/postflight" not in Result(flight).groups


@pytest.mark.parametrize(
    ("override", "message"),
    [
        ("aerodynamics.family=Viking", "aerodynamics.family"),
        ("aerodynamics.continuum=nowhere.csv", "aerodynamics.continuum: found .*nowhere.csv"),
        ("aerodynamics.continuum=builtin:nothing", "builtin:nothing"),
        ("aerodynamics.continuum_limit=0", "aerodynamics.continuum_limit"),
        ("vehicle.inertia=null", "vehicle.inertia: found nothing"),
        ("postflight.windows=[{name: a, start_s: 10, end_s: 5}]", "end_s"),
        ("postflight.windows=[{name: late, start_s: 400, end_s: 500}]", "'late', 400 to 500 s, holds no sample"),
        (
            "postflight.windows=[{name: a, start_s: 60, end_s: 70}, {name: a, start_s: 80, end_s: 90}]",
            "two windows are called 'a'",
        ),
    ],
)
def test_wrong_aerodynamics_is_named(override, message, practice_06):
    with pytest.raises(InputError, match=message):
        mission = Mission.load(shipped_mission("practice_mer"), [override])
        derive_flight(replace(practice_06, mission=mission), derived_quantities(practice_06).air)


KNUDSEN = "knudsen,alpha_deg,CA,CN,Cm"


def rarefied(path, *rows):
    path.write_text("\n".join((KNUDSEN, *rows)) + "\n", encoding="utf-8")
    return f"aerodynamics.rarefied={path}"


def test_a_brought_rarefied_table_switches_unless_the_mission_says_otherwise(tmp_path):
    grid = [f"{kn},{a},{1.7 + 0.1 * i},{0.002 * a},{-0.002 * a}" for i, kn in enumerate((1e-3, 1.0)) for a in (0, 20)]
    override = rarefied(tmp_path / "kn.csv", *grid)
    mission = Mission.load(shipped_mission("practice_mer"), [override, "aerodynamics.join=null"])
    database = database_of(mission)
    assert database.join == "switch" and database.lookup(28.0, 1.0, 0.0).ca == pytest.approx(1.8)
    with pytest.raises(InputError, match=r"hole|grid"):
        broken = Mission.load(shipped_mission("practice_mer"), [rarefied(tmp_path / "hole.csv", *grid[:-1])])
        database_of(broken)


def test_a_body_stated_by_its_geometry():
    """Newtonian continuum and free-molecular panels of the stated forebody, with Viking's base pressure."""
    shape = "aerodynamics.forebody={nose_radius: 0.6, shoulder_radius: 0.03, cone_half_angle_deg: 60}"
    stated = [
        "aerodynamics.continuum=builtin:newtonian", "aerodynamics.rarefied=builtin:free_molecular",
        "aerodynamics.join=null", shape,
    ]  # fmt: skip
    body = SphereCone(2.65, 0.6, 0.03, np.radians(60.0))

    def look_up(*overrides):
        mission = Mission.load(shipped_mission("practice_mer"), [*stated, *overrides])
        return database_of(mission).lookup([2.0, 20.0, 20.0], [1e-6, 1e-6, 20.0], 0.1)

    plain, with_base = look_up(), look_up("aerodynamics.base_pressure=true")
    peak = [rayleigh_pitot_cp_max(2.0, 1.33), 1.94]
    np.testing.assert_allclose(plain.ca[:2], newtonian_coefficients(body, 0.1, peak)[0], rtol=1e-4)
    np.testing.assert_allclose(plain.ca[2], free_molecular_coefficients(body, 0.1)[0], rtol=1e-4)
    np.testing.assert_allclose(with_base.ca - plain.ca, [0.2244, 0.0, 0.0], atol=1e-4)
    np.testing.assert_allclose(with_base.cm_nose, plain.cm_nose, atol=1e-12)
    with pytest.raises(InputError, match=r"aerodynamics\.base_pressure: builtin:continuum_grid has the base pressure"):
        look_up("aerodynamics.base_pressure=true", "aerodynamics.continuum=builtin:continuum_grid")
    with pytest.raises(InputError, match=r"aerodynamics\.forebody: the nose and the shoulder overlap"):
        look_up("aerodynamics.forebody.nose_radius=2.9")


def test_a_printed_table_with_its_own_moment_point_is_the_same_database(practice_06, tmp_path):
    """The shipped grid with moments moved to 0.253 D and back (eq. 11.1)."""
    shipped = database_of(practice_06.mission)
    grid = shipped.continuum
    rows = ["mach,alpha_total_deg,CA,CN,Cm"]
    for i, mach in enumerate(grid.nodes):
        for k, alpha in enumerate(np.degrees(grid.alpha)):
            ca, cn, cm = float(grid.CA[i, k]), float(grid.CN[i, k]), float(grid.Cm[i, k])
            rows.append(",".join(map(repr, (float(mach), float(alpha), ca, cn, cm + 0.253 * cn))))
    path = tmp_path / "printed.csv"
    path.write_text("\n".join(rows) + "\n", encoding="utf-8")
    overrides = [f"aerodynamics.continuum={path}", "aerodynamics.continuum_moment_point=0.253"]
    mission = Mission.load(shipped_mission("practice_mer"), overrides)
    brought = database_of(mission).lookup([18.0, 2.0], 1e-5, [0.03, 0.1])
    expected = shipped.lookup([18.0, 2.0], 1e-5, [0.03, 0.1])
    np.testing.assert_allclose(brought.cm_nose, expected.cm_nose, atol=1e-12)
    with pytest.raises(InputError, match="header"):
        database_of(Mission.load(shipped_mission("practice_mer"), overrides[:1]))
    alone = Mission.load(shipped_mission("practice_mer"), overrides[1:])
    with pytest.raises(InputError, match=r"aerodynamics\.continuum_moment_point is for a CSV"):
        database_of(alone)
