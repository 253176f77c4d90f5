"""What the refit of effects needs, and its iteration; refits of flights are in tests/workflow and tests/flights."""

from dataclasses import dataclass, replace
from types import SimpleNamespace

import numpy as np
import pytest

from edl_filter import Mission
from edl_filter.diagnosis.selection import outer_loop
from edl_filter.diagnosis.selection.map_fit import MapFit
from edl_filter.diagnosis.selection.outer_loop import can_fit_effects, fit_effects, iterate_to_convergence
from edl_filter.effects.base import EffectInstance
from edl_filter.effects.registry import find_effect
from edl_filter.errors import InputError
from edl_filter.mission.decision_settings import DecisionSettings

SETTINGS = DecisionSettings()


@pytest.mark.parametrize(
    ("changes", "expected"),
    [
        (["effects=[{name: mass}]"], True),
        (["effects=[{name: mass, fixed: true}]"], False),
        ([], False),
        (["effects=[{name: mass}]", "aerodynamics=null"], False),
    ],
)
def test_what_is_needed_to_fit_effects(changes, expected):
    assert can_fit_effects(Mission.load("builtin:practice_mer", changes)) == expected


def test_an_effect_that_stands_twice_is_refused():
    mission = Mission.load("builtin:practice_mer", ["effects=[{name: gyro_bias}, {name: gyro_bias, imu: primary}]"])
    with pytest.raises(InputError, match="found gyro_bias twice"):
        fit_effects(mission)


# --- the iteration, with constructed models -------------------------------------------------------------------------

SIGMA = 1e-5
BIAS = find_effect("gyro_bias")


def bias(*values, **options):
    return EffectInstance(BIAS, dict(zip(("bx", "by", "bz"), values, strict=False)), **options)


def fit_of(effects, sigma=SIGMA, point="point"):
    """A fit at the values of effects, whose free parameters have one posterior sigma; the prior is ten times wider."""
    names = tuple((a.key, q.name) for a in effects for q in a.fitted)
    width = len(names)
    return MapFit(
        effects=tuple(effects), names=names, covariance=sigma**2 * np.eye(width), evidence=0.0,
        residual_vector=np.zeros(0), initial_mean=np.zeros(0), white=np.ones(3), columns=np.zeros((3, width)),
        sigma=np.full(width, 10.0 * sigma), point=point,
    )  # fmt: skip


AT_ZERO = (bias(0.0, 0.0, 0.0),)


@pytest.fixture
def loop(monkeypatch):
    """Iterate with given results of the fits; the fits, the points of linearisation, and what was reported."""

    def run(estimates, iterations=None, no_excess=True, first=None, shifts=(), initial=AT_ZERO):
        scans = [*shifts, *[0.0] * 20]
        queue, record = list(estimates), SimpleNamespace(fits=[], points=[], options=None, messages=[])

        def model_about(case, number):
            excess = SimpleNamespace(is_zero=no_excess)
            return SimpleNamespace(
                release=lambda: None,
                number=number, case=case, fitted_noise_filter="whiten", excess_variance=excess,
                failing_excess=f"excess {number}", point="point",
            )  # fmt: skip

        def linearize(case, **options):
            record.options = options
            return model_about(case, 0)

        def linearize_at(case, point, excess):
            record.points.append((point, excess))
            return model_about(case, len(record.points))

        def fit_map(model, effects, whiten, moving=False):
            assert whiten == "whiten" and moving
            record.fits.append(effects)
            return fit_of(queue.pop(0))

        def scan_times(model, effects, whiten):
            shift = scans.pop(0)
            return tuple(
                replace(a, values=a.values | {n: v + shift for n, v in a.values.items() if n == "t0"}) for a in effects
            )

        def case_with(effects):
            return SimpleNamespace(effects=tuple(effects), settings=SETTINGS, reconstruct_with=case_with)

        monkeypatch.setattr(outer_loop, "linearize", linearize)
        monkeypatch.setattr(outer_loop, "linearize_at", linearize_at)
        monkeypatch.setattr(outer_loop, "fit_map", fit_map)
        monkeypatch.setattr(outer_loop, "scan_times", scan_times)
        monkeypatch.setattr(outer_loop, "most_probable_point", lambda model, fit: f"point {model.number}")
        case = case_with(initial)
        record.case, record.model, record.fit = iterate_to_convergence(
            case, iterations, record.messages.append, first=first
        )
        return record

    return run


def sigmas(*values):
    return [bias(*(SIGMA * v for v in values))]


def test_fits_are_repeated_about_the_estimates_until_no_parameter_changes(loop):
    """The largest change counts, in sigmas: the limit is 0.3."""
    estimates = [sigmas(5.0, 0.0, 0.0), sigmas(5.0, 0.4, 0.1), sigmas(5.0, 0.4, -0.15), sigmas(9.0, 9.0, 9.0)]
    result = loop(estimates, iterations=10, first="smoothed")
    assert result.fits == [tuple(e) for e in ([bias(0.0, 0.0, 0.0)], *estimates[:2])]
    assert result.fit.effects == tuple(estimates[2])
    assert result.case.effects == tuple(estimates[1]) and result.model.case is result.case
    assert result.points == [("point 0", "excess 0"), ("point 1", "excess 1")]
    assert result.messages == [f"refitting the effects, iteration {i}" for i in (1, 2, 3)]
    assert result.options == {
        "iterations": SETTINGS.linearization_iterations, "max_excess_share": SETTINGS.iterated_excess_share,
        "least_iterations": 2, "first": "smoothed",
    }  # fmt: skip


@pytest.mark.parametrize(("iterations", "count"), [(None, SETTINGS.outer_iterations), (1, 1), (5, 5)])
def test_fits_that_do_not_converge_end_at_the_largest_number(loop, iterations, count):
    result = loop([sigmas(10.0 * k) for k in range(1, 9)], iterations)
    assert len(result.fits) == count and result.fit.effects == tuple(sigmas(10.0 * count))


def test_without_free_parameters_one_fit_is_sufficient(loop):
    assert len(loop([[bias(0.0, fixed=True)]] * 3).fits) == 1


def torque(t0):
    return EffectInstance(find_effect("remnant_torque"), {"Cl": 0.0, "Cm": 1e-3, "Cn": 0.0, "t0": t0})


@pytest.mark.parametrize(("no_excess", "fitted"), [(False, 105.0), (True, 100.0)])
def test_times_are_scanned_where_the_model_fails(loop, no_excess, fitted):
    result = loop([[torque(fitted)]], iterations=1, no_excess=no_excess, shifts=[5.0], initial=[torque(100.0)])
    assert result.fits == [(torque(fitted),)]


@pytest.mark.parametrize(
    ("shifts", "count"),
    [
        ([5.0, -9.9], 2),  # within an interval of excess variance
        ([30.0], 3),  # two about the points that follow the move
        ([0.0, 30.0], 4),
        ([30.0, -30.0, 10.1, 0.0], 5),
        ([30.0] * 9, 2 + SETTINGS.outer_iterations),  # a scan that does not converge
    ],
)
def test_iterations_are_counted_anew_where_a_time_is_moved_beyond_an_interval(loop, shifts, count):
    """The most probable point changes with the time: a fit needs its iterations about the points that follow."""
    result = loop([[torque(100.0 + k)] for k in range(20)], 2, False, shifts=shifts, initial=[torque(50.0)])
    assert len(result.fits) == count
    assert result.messages[-1] == f"refitting the effects, iteration {count}"


@pytest.mark.parametrize("moved", [False, True])
@pytest.mark.parametrize("most_probable", ["most probable point", None])
def test_the_next_point_is_the_most_probable_one_with_the_estimates(monkeypatch, moved, most_probable):
    """About the model's own point, or about that to which the fit moved; without one, it is that of the fit."""
    model = SimpleNamespace(
        point="point", fitted_noise_filter="whiten", with_effects=lambda effects: ("stays", effects),
        at_point=lambda point, effects: (point, effects),
    )  # fmt: skip
    fit = fit_of(sigmas(1.0), point="fitted point" if moved else model.point)
    calls = []

    def map_point(about, whiten, white):
        calls.append((about, whiten, white))
        return most_probable

    monkeypatch.setattr(outer_loop, "map_point", map_point)
    assert outer_loop.most_probable_point(model, fit) == (most_probable or fit.point)
    assert calls == [(("fitted point" if moved else "stays", fit.effects), "whiten", fit.white)]


@dataclass(frozen=True)
class FinalReconstruction:
    """What a fit adds to a reconstruction."""

    effects: tuple
    timing: dict


def test_a_fit_ends_with_a_reconstruction_at_the_estimates(monkeypatch):
    """With the sigmas of all free parameters, and gains of the effects that have free sizes."""
    free, held, messages = bias(*(3.0 * SIGMA for _ in range(3))), bias(1e-3, imu="secondary", fixed=True), []
    fit = fit_of([free, held])
    driving = SimpleNamespace(name="primary", unit_of=np.zeros(3, int))
    reconstruction = SimpleNamespace(telemetry=SimpleNamespace(driving=driving), inputs="as read")
    case = SimpleNamespace(mission="mission", effects=(), reconstruction=reconstruction)

    def reconstruct(mission, effects, leave_one_out, inputs):
        assert mission == "mission" and leave_one_out and inputs == "as read"
        return FinalReconstruction(effects, {"filter": 2.0})

    monkeypatch.setattr(outer_loop, "load_case", lambda mission, effects: case)
    monkeypatch.setattr(outer_loop, "iterate_to_convergence", lambda case, progress: (case, None, fit))
    monkeypatch.setattr(outer_loop, "reconstruct", reconstruct)
    fitted = fit_effects("mission", messages.append)
    assert messages == ["reconstructing with the effects as they are stated"]
    assert fitted.reconstruction.effects == fit.effects
    assert fitted.reconstruction.timing["filter"] == 2.0 and 0.0 <= fitted.reconstruction.timing["refit"] < 10.0
    assert fitted.sigma == {"gyro_bias": dict.fromkeys(("bx", "by", "bz"), pytest.approx(SIGMA))}
    # three sizes, each three posterior sigmas from zero, and posterior sigmas of a tenth of the prior ones
    expected = 3.0 * (0.5 * 3.0**2 - np.log(10.0))
    assert fitted.gain_over_zero == {("gyro_bias", None): pytest.approx(expected)}


def test_one_effect_in_two_imus_is_fitted_twice(monkeypatch):
    monkeypatch.setattr(outer_loop, "canonical_key", lambda a, driving: a.key)
    mission = SimpleNamespace(source=None, name="flight")
    effects = [bias(0.0, imu="secondary"), bias(0.0)]
    outer_loop.check_single_instances(mission, effects, None)
    with pytest.raises(InputError, match=r"^flight: effects: found gyro_bias in secondary twice"):
        outer_loop.check_single_instances(mission, [*effects, bias(0.0, imu="secondary")], None)
