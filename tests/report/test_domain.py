"""Panels over the validation domain, from a domain by hand."""

from types import SimpleNamespace

import numpy as np
import pytest

from edl_filter.errors import InputError
from edl_filter.report.description import Axis, Span
from edl_filter.report.domain import LEGEND_ROOM, DomainView, instability_spans

TIME = np.arange(0.0, 201.0, 10.0)


def view(parachute=None, all_air=False, **changes):
    """Of a flight that is measurable from 20 s, significant from 50 s, and ends at 180 s."""
    domain = SimpleNamespace(
        time=TIME, start=20.0, useful=50.0, end=180.0, instabilities=((30.0, 70.0), (100.0, 120.0)),
        mach_times={"10": 150.0, "20": 80.0}, significant=(TIME >= 50.0) & (TIME < 180.0),
    )  # fmt: skip
    events = {"landing": 300.0, "entry_interface": 0.0} | ({} if parachute is None else {"parachute_deploy": parachute})
    reader = SimpleNamespace(domain=domain, events=events, title="flight", epoch_utc="")
    return DomainView(SimpleNamespace(**(vars(reader) | changes)), all_air)


def test_instabilities_are_shaded_within_the_time_axis():
    domain = view().domain
    spans = [(s.low, s.high) for s in instability_spans(domain, 50.0, 110.0)]
    assert spans == [(50.0, 70.0), (100.0, 110.0)]
    assert instability_spans(domain, 70.0, 100.0) == ()  # both only touch it
    assert [s.note for s in instability_spans(domain, 0.0, note=False)] == ["", ""]


def test_the_axis_begins_where_the_deceleration_is_measurable_or_the_coefficients_are_significant():
    assert (view().begin, view(all_air=True).begin) == (50.0, 20.0)
    assert TIME[view().inside].tolist() == TIME[5:19].tolist()
    assert TIME[view(all_air=True).inside].tolist() == TIME[2:19].tolist()


@pytest.mark.parametrize(("parachute", "end"), [(180.5, 180.5), (181.5, 180.0), (179.5, 180.0), (None, 180.0)])
def test_the_axis_ends_with_the_parachute_if_that_is_near(parachute, end):
    assert view(parachute).end == end


def test_events_are_the_parachute_and_the_mach_numbers_in_order_of_time():
    assert list(view(180.5).events.items()) == [("Mach 20", 80.0), ("Mach 10", 150.0), ("parachute_deploy", 180.5)]


def test_curves_and_bands_have_the_samples_of_the_axis():
    curve, band = view().curve(2.0 * TIME, "blue", "a", 1.5, "Pa"), view().band(TIME, TIME + 1.0, "blue-band", "b")
    np.testing.assert_array_equal(curve.y, 2.0 * TIME[5:19])
    assert (curve.label, curve.colour, curve.unit, curve.width) == ("a", "blue", "Pa", 1.5)
    np.testing.assert_array_equal(band.high, TIME[5:19] + 1.0)
    np.testing.assert_array_equal(band.position, TIME[5:19])


def test_the_range_is_that_of_significant_samples_with_room_for_a_legend():
    wild = np.where(TIME == 180.0, 1e3, TIME / 100.0)  # the last sample of the axis is not significant
    low, high = view().limits(wild, outside=0.0)
    assert (low, high) == pytest.approx((0.5 - 0.12, 1.7 + 0.12))  # a tenth of the range of 1.2 on either side
    assert view().limits(wild, outside=0.0, everywhere=True)[1] > 1e3
    assert view().limits(wild, outside=0.0, legend=True)[1] == pytest.approx(high + LEGEND_ROOM * (high - low))


def test_only_the_first_panel_of_a_figure_names_the_instabilities():
    v = view(180.5)
    curve = v.curve(TIME, "blue")
    figure = v.figure("angles", [v.panel(Axis("a"), (curve,)), v.panel(Axis("b"), (curve,))], (1.0, 2.0))
    notes = [[e.note for e in panel.elements if isinstance(e, Span)] for panel in figure.panels]
    assert notes == [["unstable", "unstable"], ["", ""]]
    assert figure.title == "flight: angles" and figure.heights == (1.0, 2.0)
    assert all(p.x.range == (50.0, 180.5) and p.x.text == "time since the epoch (s)" for p in figure.panels)


def test_a_result_without_post_flight_groups_is_refused():
    with pytest.raises(InputError, match="flight: found no post-flight groups; they need an aerodynamic database"):
        _ = view(domain=None).domain
