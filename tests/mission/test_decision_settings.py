"""Settings of the diagnosis: defaults, bounds, how they are set and recorded, and that each of them is used."""

import ast
import json
import math
from pathlib import Path

import pytest
from annotated_types import Ge, Le, MinLen

import edl_filter
from edl_filter import InputError, Mission
from edl_filter.diagnosis.diagnosis import diagnose
from edl_filter.diagnosis.linear_model.flight_case import load_case
from edl_filter.mission.decision_settings import DecisionSettings
from edl_filter.mission.validators import Within

FIELDS = DecisionSettings.model_fields

#: Values on which the published rates of identification (docs/identification.md) depend.
DEFAULTS = {
    "bin_length_s": 0.1, "excluded_end_bins": 3, "parachute_margin_s": 0.3, "linear_attitude_sigma_rad": 0.05,
    "discrepancy_range": 4.0, "discrepancy_sigma": 0.7,
    "minimum_density_sigma": 1e-4, "numerical_error_memory_s": 20.0, "relative_prediction_error": 2e-4,
    "noise_piece_s": 10.0, "excess_variance_sigmas": 4.0,
    "excess_memories_s": (0.1, 0.2, 0.4, 0.8, 1.6, 3.2, 6.4, 12.8, 25.6),
    "excess_colour_factors": (0.5, 1.0, 2.0, 4.0, 8.0), "variance_iterations": 10, "variance_convergence_nats": 2.0,
    "variance_convergence_share": 1e-4,
    "variance_step_power": 1.5, "variance_step_power_max": 3.0, "negligible_variance_share": 1e-6, "holds_share": 0.02,
    "unmodelled_memories_s": (0.5, 10.0), "unmodelled_forces": (3e-3, 3e-2, 0.3),
    "unmodelled_moments": (1e-3, 1e-2, 0.1),
    "unmodelled_factors": (1e-4, 1e-3, 1e-2, 0.1, 1.0), "unmodelled_factor_memories_s": (20.0,),
    "unmodelled_force_drifts": (1e-4, 1e-3, 1e-2, 0.1), "unmodelled_rate_drifts": (1e-6, 1e-5, 1e-4, 1e-3),
    "unmodelled_drift_memories_s": (60.0,),
    "linearization_iterations": 6, "iterated_excess_share": 0.2, "linearization_tolerance_sigmas": 0.1,
    "linearization_convergence_nats": 2.0, "state_limit_sigmas": 100.0,
    "log_density_limit": 0.9, "alternative_iterations": 4, "alternative_progress": 0.8,
    "least_progress": 0.02, "credible_nuisance_sigmas": 5.0,
    "scan_start_pressure_pa": 1.0, "altitude_scan_top_m": 70e3, "altitude_scan_below_m": 3e3, "shortlist_size": 4,
    "starting_places": 3, "distinct_correlation": 0.7, "minimum_screening_gain": 0.0, "place_refinements": 6,
    "altitude_step_m": 4e3,
    "fit_iterations": 12, "comparison_fit_iterations": 6, "polish_fit_iterations": 3, "null_fit_iterations": 3,
    "shortest_step": 0.02, "nuisance_iterations": 4, "fit_convergence_nats": 0.05,
    "time_scan_step_s": 0.1, "outer_iterations": 3,
    "outer_tolerance_sigmas": 0.3,
    "solved_share": 0.1, "promising_share": 0.7, "rival_gain_share": 0.25, "relinearized_hypotheses": 3,
    "held_out_block_s": 5.0, "held_out_folds": 5,
    "named_gain_nats": 6.0, "named_gain_in_excess_noise_nats": 25.0, "approximation_error": 0.02,
    "decided_probability": 0.8, "excess_noise_nats": 10.0,
    "named_explained_share": 0.4, "complemented_explained_share": 0.2,
    "sufficient_share": 0.9, "explained_share_shape": 10.0, "same_correlation": 0.9, "separable_gain_nats": 6.0,
    "constraint_improvement": 10.0,
    "cell_fails_sigmas": 5.0, "cell_minimum_rms": 1.1,
    "abrupt_changes": 8, "abrupt_change_spacing_s": 2.0, "onset_samples": 10, "onset_nats": 12.0,
    "unexplained_piece_s": 2.5, "line_power_share": 0.3, "line_cycles": 3.0, "follows_correlation": 0.5,
    "max_effects": 12,
}  # fmt: skip

#: Unit that a suffix of a setting's name stands for.
UNITS = {"_s": "s", "_m": "m", "_rad": "rad", "_pa": "Pa", "_nats": "nats", "_sigmas": "sigmas"}


def mission_with(*changes):
    return Mission.load("builtin:practice_mer", [f"diagnosis.{change}" for change in changes])


def test_defaults():
    assert DecisionSettings().model_dump() == DEFAULTS
    assert mission_with().diagnosis == DecisionSettings()


@pytest.mark.parametrize("name", FIELDS)
def test_every_setting_has_reason_source_and_unit(name):
    field = FIELDS[name]
    assert len(field.description) > 15 and len(field.json_schema_extra["source"]) > 10
    units = {unit for suffix, unit in UNITS.items() if name.endswith(suffix)}
    units |= {m.unit for m in field.metadata if isinstance(m, Within) and m.unit}
    assert len(units) <= 1  # name, bounds and description agree
    assert all(field.description.startswith((f"{unit}:", f"{unit} ")) for unit in units), field.description
    schema = DecisionSettings.model_json_schema()["properties"][name]
    assert schema["source"] == field.json_schema_extra["source"] and schema["description"] == field.description


def outside(name):
    """Values just below and above the bounds of a setting, each with the bound that a message must state."""
    metadata = FIELDS[name].metadata
    limits = [m for m in metadata if isinstance(m, Within)]
    if limits:
        (within,) = limits
        low = within.low if within.above else math.nextafter(within.low, -math.inf)
        high = within.high if within.below else math.nextafter(within.high, math.inf)
        return [(low, within.expected), (high, within.expected)]
    low = [(m.ge - 1, str(m.ge)) for m in metadata if isinstance(m, Ge)]
    high = [(m.le + 1, str(m.le)) for m in metadata if isinstance(m, Le)]
    return low + high


def is_list(name):
    return any(isinstance(m, MinLen) for m in FIELDS[name].metadata)


@pytest.mark.parametrize("name", [n for n in FIELDS if not is_list(n)])
def test_a_value_outside_the_bounds_is_refused(name):
    values = outside(name)
    assert len(values) == 2
    for value, bound in values:
        with pytest.raises(InputError) as error:
            mission_with(f"{name}={value!r}")
        message = str(error.value)
        assert message.startswith(f"--set diagnosis.{name}: found {value!r}; expected "), message
        assert bound in message.partition("; expected ")[2], message


@pytest.mark.parametrize("name", [n for n in FIELDS if is_list(n)])
def test_a_list_needs_at_least_one_positive_number(name):
    assert getattr(mission_with(f"{name}=[2.5]").diagnosis, name) == (2.5,)
    for value, key in (("[]", ""), ("[0.0]", ".0"), ("[1.0, -1.0]", ".1"), ("[1e5]", ".0"), ("3.0", "")):
        with pytest.raises(InputError, match=rf"^--set diagnosis\.{name}{key.replace('.', '[.]')}: found "):
            mission_with(f"{name}={value}")


@pytest.mark.parametrize("value", ["abc", "true", ".inf", ".nan", "[1.0]"])
def test_only_numbers_are_accepted(value):
    with pytest.raises(InputError, match=r"^--set diagnosis\.named_gain_nats: found .*expected a .*number"):
        mission_with(f"named_gain_nats={value}")
    with pytest.raises(InputError, match=r"^--set diagnosis\.onset_samples: found"):
        mission_with(f"onset_samples={value}")


def test_an_unknown_setting_is_refused_and_the_nearest_named():
    with pytest.raises(InputError, match=r"named_gain: found an unknown key; nearest accepted: .*named_gain_nats"):
        mission_with("named_gain=3.0")


def another_value(name):
    """A valid value that is not the default, as YAML."""
    if is_list(name):
        return [0.25, 4.0]
    default = getattr(DecisionSettings(), name)
    if isinstance(default, int):
        return default + 1
    within = next(m for m in FIELDS[name].metadata if isinstance(m, Within))
    return 0.5 * (default + within.high)


@pytest.mark.parametrize("name", FIELDS)
def test_every_setting_can_be_set(name):
    value = another_value(name)
    settings = mission_with(f"{name}={json.dumps(value)}").diagnosis
    expected = tuple(value) if isinstance(value, list) else value
    assert getattr(settings, name) == expected != DEFAULTS[name]
    assert settings.model_dump() == DEFAULTS | {name: expected}


def test_settings_are_a_section_of_the_mission_file():
    mission = mission_with("onset_samples=20", "holds_share=0.05")
    reread = Mission.from_text(mission.text, "reread", mission.source)
    assert reread.diagnosis == mission.diagnosis
    assert (reread.diagnosis.onset_samples, reread.diagnosis.holds_share) == (20, 0.05)


def test_settings_are_recorded_in_the_diagnosis():
    """All of them, as JSON, with the values that were used."""
    mission = mission_with("held_out_folds=7", "unmodelled_memories_s=[1.0]")
    content = diagnose(load_case(mission), []).content()
    recorded = json.loads(json.dumps(content["settings"], allow_nan=False))
    assert recorded == json.loads(json.dumps(mission.diagnosis.model_dump()))
    assert recorded["held_out_folds"] == 7 and recorded["unmodelled_memories_s"] == [1.0]
    assert DecisionSettings(**{k: tuple(v) if isinstance(v, list) else v for k, v in recorded.items()}) == (
        mission.diagnosis
    )


def settings_read_in_the_package():
    """Names of attributes that are read from ``settings``, ``s`` or ``….diagnosis`` in any module of the package."""
    names = set()
    for path in Path(edl_filter.__file__).parent.rglob("*.py"):
        if path.name == "decision_settings.py":
            continue
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
            if isinstance(node, ast.Attribute) and isinstance(node.ctx, ast.Load):
                owner = node.value
                owner_name = owner.attr if isinstance(owner, ast.Attribute) else getattr(owner, "id", "")
                if owner_name in ("settings", "s", "diagnosis"):
                    names.add(node.attr)
    return names


def test_every_setting_is_used():
    assert set(FIELDS) - settings_read_in_the_package() == set()
