"""Contents of a diagnosis.json that satisfy the schema, by hand: one hypothesis about one flight."""

from edl_filter.mission.decision_settings import DecisionSettings


def cell(**changes):
    return {
        "channel": "moment_y", "regime": "Mach 15 to 5", "t0_s": 130.0, "t1_s": 180.0, "normalised_rms": 3.0,
        "bias": 0.2, "autocorrelation": 0.4, "excess_rms": 0.02, "unit": "rad/s^2", "over_database_sigma": None,
        "count": 400, "limit_rms": 1.18, "fails": True,
        "sentence": "moment_y in Mach 15 to 5 (130 to 180 s): 3 times its sigma.",
    } | changes  # fmt: skip


def hypothesis(**changes):
    return {
        "effect": "remnant_torque", "imu": None, "label": "remnant_torque",
        "same_as": [], "alternatives": {}, "discriminated_by": {}, "probability": 0.9,
        "gain": 40.0, "score_gain": 35.0, "at_noise_floor": True, "explained_share": 1.0, "complemented": None,
        "parameters": {
            "Cm": {"estimate": 1.5e-3, "sigma": 1e-4, "unit": ""},
            "t0": {"estimate": 183.123456789, "sigma": 2.0, "unit": "s"},
            "t1": {"estimate": None, "sigma": None, "unit": "s"},
        },
        "correlations": {"Cm, t0": 0.1}, "error_before": 3.0, "error_after": 1.0, "channel": "moment_y",
        "errors_after": {"moment_y": 1.0}, "cells_after": 1, "cells_failing_after": 0,
    } | changes  # fmt: skip


def screened(smallest=0.02, plausible=0.05):
    size = {"estimate": 0.0, "sigma": 0.01, "data_share": 0.9, "plausible": plausible, "smallest": smallest}
    return {"gain": -2.0, "parameters": {"k": size}}


def diagnosis(**changes):
    return {
        "verdict": "missing", "sentence": "Missing: remnant_torque.", "mission": "practice_mer",
        "state": ["1 of 1 cells of the residual map fails.", "Missing: remnant_torque."], "database_proxy": None,
        "effects": [], "where": [cell()], "map": [cell()], "ranking": [hypothesis()], "required_gain": 12.0,
        "none": 0.05, "none_gain": -40.0,
        "something_else": {
            "probability": 0.05, "gain": 12.0, "unmodelled_gain": 3.0, "form": "fixed to the body", "force_m_s2": 0.003,
            "rate_rad_s": 0.0,
            "angular_acceleration_rad_s2": 0.001, "correlation_time_s": 10.0, "with_dynamic_pressure": False,
        },
        "screening": {"mass": screened()},
        "remainder": None, "latent": None, "onsets": [{"channel": "moment_y", "time_s": 131.0, "gain": 20.0}],
        "failed": {}, "errors": {"moment_y": 3.0}, "noise_floor": 1.02, "database_update": None,
        "discrepancy_estimate": None, "nuisances": [],
        "settings": DecisionSettings().model_dump(),
    } | changes  # fmt: skip


def unknown():
    """A diagnosis whose verdict is unknown, with the remainder and the unmodelled force."""
    vectors = [[1.0, -2.0, 0.5], [0.5, None, 0.0]]
    return diagnosis(
        verdict="unknown",
        remainder={
            "channel": "moment_y", "t0_s": 62.0, "t1_s": 170.0, "normalised_rms": 4.0, "size": 4.9, "unit": "N m",
            "frequency_hz": 0.68, "follows": {"q": 0.2}, "companions": ["force_z"], "description": "moment_y.",
        },
        latent={
            "time_s": [62.0, 62.1], "force_N": vectors, "force_sigma_N": vectors, "moment_N_m": vectors,
            "moment_sigma_N_m": vectors,
        },
    )  # fmt: skip


def ledger_step(**changes):
    return {
        "step": 0, "mission": "practice_mer", "model": [], "added": "remnant_torque", "imu": None, "same_as": [],
        "parameters": hypothesis()["parameters"], "removed": [], "gain": 40.0,
        "held_out_score": 35.0, "errors": {"moment_y": {"before": 3.0, "after": 1.0}},
    } | changes  # fmt: skip


def ledger_end(**changes):
    return {
        "step": 1, "mission": "practice_mer", "model": ["remnant_torque"], "added": None, "why": "Stopped.",
        "errors": {"moment_y": {"before": 1.0, "after": None}},
    } | changes  # fmt: skip
