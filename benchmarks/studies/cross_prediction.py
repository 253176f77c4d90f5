"""Learn the database's increments on one flight and predict the other: what both flights say is aerodynamics.

    python benchmarks/studies/cross_prediction.py [FIRST.yaml SECOND.yaml] [--estimate]

The missions are Spirit's and Opportunity's without arguments. Each flight is linearised as a diagnosis does, with the
effects of its mission and everything else that it states as uncertain marginalised. The tables have the gain in
log-likelihood of the second flight's residuals by the increments that the first gives, over the prior database, by
channel and regime of the flow, nats (`edl_filter.diagnosis.residual_analysis.cross_prediction`). With ``--estimate``
the first flight also gives the scale of the database's error, by marginal likelihood; its own gain is that of the
second flight's prior with this scale over that with the stated one.
"""

from __future__ import annotations

import argparse
from pathlib import Path

from edl_filter.diagnosis.linear_model.discrepancy_estimate import with_estimated_discrepancy
from edl_filter.diagnosis.linear_model.flight_case import load_case
from edl_filter.diagnosis.linear_model.linear_model import LinearizedModel
from edl_filter.diagnosis.linear_model.linearization import linearize
from edl_filter.diagnosis.residual_analysis.cross_prediction import CrossPrediction, predictive_log_likelihood
from edl_filter.mission import Mission, shipped_mission

#: Key of the scale of the database's error.
SCALE = "coefficient_sigma"
#: Channels of the driving IMU; the others compare two IMUs.
CHANNELS = ("force_x", "force_y", "force_z", "moment_x", "moment_y", "moment_z")


def linear_model(mission: Mission) -> LinearizedModel:
    """The linear model of a flight about its most probable nuisance parameters."""
    case = load_case(mission)
    settings = case.settings
    # a failing model is iterated as well: increments of several sigmas are far from linear in attitude and density
    return linearize(case, settings.linearization_iterations, least_iterations=settings.linearization_iterations)


def table(prediction: CrossPrediction) -> str:
    """Gains by channel and regime, with sums."""
    regimes = list(dict.fromkeys(cell.regime for cell in prediction.cells))
    gains = {(cell.channel, cell.regime): cell.gain for cell in prediction.cells}
    lines = [f"{'':10}" + "".join(f"{r:>16}" for r in (*regimes, "all"))]
    for channel in CHANNELS:
        row = [gains.get((channel, regime), 0.0) for regime in regimes]
        lines.append(f"{channel:10}" + "".join(f"{v:16.1f}" for v in (*row, sum(row))))
    sums = [sum(gains.get((channel, regime), 0.0) for channel in CHANNELS) for regime in regimes]
    lines.append(f"{'all':10}" + "".join(f"{v:16.1f}" for v in (*sums, sum(sums))))
    rest = prediction.total - sum(sums)
    lines.append(f"All rows: {prediction.total:.1f} nats (comparisons of IMUs and constraints: {rest:.1f}).")
    return "\n".join(lines)


def with_scale(mission: Mission, scale: float) -> Mission:
    """The mission with another scale of the database's error."""
    assert mission.aerodynamics is not None
    aerodynamics = mission.aerodynamics.with_discrepancy({SCALE: scale})
    return mission.model_copy(update={"aerodynamics": aerodynamics})


def estimated_scale(mission: Mission) -> float:
    """The scale of the database's error that a flight makes most probable, within the bounds of its settings."""
    assert mission.aerodynamics is not None
    asked = mission.aerodynamics.discrepancy.model_copy(update={"estimate": (SCALE,)})
    aerodynamics = mission.aerodynamics.model_copy(update={"discrepancy": asked})
    case = with_estimated_discrepancy(load_case(mission.model_copy(update={"aerodynamics": aerodynamics})))
    assert case.mission.aerodynamics is not None
    return case.mission.aerodynamics.coefficient_sigma


def main() -> None:
    """Print both tables."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("missions", nargs="*", type=Path, help="two missions of one vehicle")
    parser.add_argument("--estimate", action="store_true", help="estimate the scale on the flight that is learned from")
    a = parser.parse_args()
    if len(a.missions) not in (0, 2):
        parser.error("two missions or none")
    files = a.missions or [shipped_mission(name) for name in ("mer_a", "mer_b")]
    missions = [Mission.load(file) for file in files]
    stated = [linear_model(mission) for mission in missions]
    names = [mission.title or mission.name for mission in missions]
    for first, second in ((0, 1), (1, 0)):
        models = stated
        print(f"\nLearned on {names[first]}, predicted: {names[second]}; gain over the prior database, nats")
        if a.estimate:
            scale = estimated_scale(missions[first])
            models = [linear_model(with_scale(mission, scale)) for mission in missions]
            gain = models[second].log_likelihood - stated[second].log_likelihood
            print(f"Scale {scale:.2f} in stated sigmas: {gain:.1f} nats. Increments:")
        print(table(predictive_log_likelihood(models[first], models[second])), flush=True)


if __name__ == "__main__":
    main()
