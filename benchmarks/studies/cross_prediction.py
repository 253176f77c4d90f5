"""Learn the database's increments on one flight and predict the other: what both flights say is aerodynamics.

    python benchmarks/studies/cross_prediction.py [FIRST.yaml SECOND.yaml]

The missions are Spirit's and Opportunity's without arguments. Each flight is linearised as a diagnosis does, with the
effects of its mission and everything else that it states as uncertain marginalised. The tables have the gain in
log-likelihood of the second flight's residuals by the increments that the first gives, over the prior database, by
channel and regime of the flow, nats (`edl_filter.diagnosis.residual_analysis.cross_prediction`).
"""

from __future__ import annotations

import sys
from pathlib import Path

from edl_filter.diagnosis.linear_model.flight_case import load_case
from edl_filter.diagnosis.linear_model.linear_model import LinearizedModel
from edl_filter.diagnosis.linear_model.linearization import linearize
from edl_filter.diagnosis.residual_analysis.cross_prediction import CrossPrediction, predictive_log_likelihood
from edl_filter.mission import Mission, shipped_mission

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


def main(arguments: list[str]) -> None:
    """Print both tables."""
    if len(arguments) not in (0, 2):
        raise SystemExit(__doc__)
    files = [Path(a) for a in arguments] or [shipped_mission(name) for name in ("mer_a", "mer_b")]
    missions = [Mission.load(file) for file in files]
    models = [linear_model(mission) for mission in missions]
    names = [mission.title or mission.name for mission in missions]
    for first, second in ((0, 1), (1, 0)):
        prediction = predictive_log_likelihood(models[first], models[second])
        print(f"\nLearned on {names[first]}, predicted: {names[second]}; gain over the prior database, nats")
        print(table(prediction), flush=True)


if __name__ == "__main__":
    main(sys.argv[1:])
