"""The accessors ``result.plot`` and ``diagnosis.plot``: axes with labels, shown by pyplot."""

import inspect

import matplotlib as mpl
import pytest
from matplotlib import pyplot as plt
from matplotlib.axes import Axes

from edl_filter import InputError, diagnose
from edl_filter.results import Result

mpl.use("agg")


@pytest.fixture(autouse=True)
def _closed():
    plt.close("all")
    yield
    plt.close("all")


@pytest.fixture(scope="module")
def flight(practice_06):
    return Result(practice_06)


@pytest.fixture(scope="module")
def diagnosis(flight):
    return diagnose(flight, [])


def test_panels_give_axes_with_units_on_a_figure_that_is_shown(flight):
    for name in ("altitude", "velocity", "deceleration", "angle_of_attack"):
        ax = getattr(flight.plot, name)()
        assert isinstance(ax, Axes) and "(" in ax.get_ylabel() and "(s)" in ax.get_xlabel(), name
        assert plt.gcf() is ax.figure


def test_figures_give_arrays_of_axes(flight):
    for draw, count in (("trajectory", 3), ("atmosphere", 4), ("angles", 4)):
        assert getattr(flight.plot, draw)().shape == (count,)
    assert flight.plot.coefficients("moments").shape == (4,)


def test_labels_of_events_beyond_the_axes_need_no_room(flight):
    ax = flight.plot.velocity()
    width = ax.figure.get_tightbbox().width
    ax.set_xlim(190.0, 250.0)
    assert ax.figure.get_tightbbox().width < 1.1 * width


def test_a_panel_draws_on_axes_that_are_given(flight, diagnosis):
    _, (left_axes, right_axes) = plt.subplots(1, 2)
    assert (
        flight.plot.altitude(left_axes) is left_axes and diagnosis.plot.residual("moment_y", right_axes) is right_axes
    )
    assert len(plt.get_fignums()) == 1 and left_axes.lines and right_axes.lines


def test_every_method_takes_axes(flight, diagnosis):
    for plots in (flight.plot, diagnosis.plot):
        for name in (n for n in dir(plots) if n[0] != "_"):
            names = inspect.signature(getattr(plots, name)).parameters
            assert {"ax", "axes"} & names.keys(), name


def test_figures_draw_on_axes_that_are_given(flight, diagnosis):
    for draw, count in ((flight.plot.trajectory, 3), (flight.plot.coefficients, 4), (diagnosis.plot.heatmap, 2)):
        axes = plt.subplots(count)[1]
        figures = len(plt.get_fignums())
        assert list(draw(axes=axes)) == list(axes) and len(plt.get_fignums()) == figures
        assert all(ax.lines or ax.patches or ax.images for ax in axes)
    _, (left_axes, right_axes) = plt.subplots(1, 2)
    assert (
        diagnosis.plot.ranking(left_axes) is left_axes and diagnosis.plot.fall(diagnosis, ax=right_axes) is right_axes
    )
    with pytest.raises(InputError, match="found 2 axes; expected 3, one for each panel"):
        flight.plot.trajectory([left_axes, right_axes])


def test_a_residual_has_its_band_and_unit(diagnosis):
    ax = diagnosis.plot.residual("moment y")
    assert "rad/s²" in ax.get_ylabel() and "±2 sigma stated" in [t.get_text() for t in ax.get_legend().get_texts()]


def test_the_fall_needs_an_earlier_diagnosis(diagnosis):
    assert len(diagnosis.plot.fall(diagnosis).get_xticks()) == 2
    with pytest.raises(InputError, match="found no earlier diagnosis"):
        diagnosis.plot.fall()


@pytest.mark.parametrize(
    ("call", "message"),
    [
        (lambda r, d: r.plot.figure("nothing"), "found no data for 'nothing'; this flight has: altitude_velocity"),
        (lambda r, d: r.plot.coefficients("lift"), "found 'lift'; accepted: forces, moments"),
        (lambda r, d: d.plot.residual("moment_q"), "found 'moment_q'; accepted: force_x"),
        (lambda r, d: d.plot.missing(), "found the verdict 'clean'"),
    ],
)
def test_a_missing_quantity_is_named(flight, diagnosis, call, message):
    with pytest.raises(InputError, match=message):
        call(flight, diagnosis)
