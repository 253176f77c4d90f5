"""Learn the database's increments on one flight and predict the other: what both flights say is aerodynamics.

    python benchmarks/studies/cross_prediction.py [FIRST.yaml SECOND.yaml] [--estimate] [--sensitivity]

The missions are Spirit's and Opportunity's without arguments. Each flight is linearised as a diagnosis does, with the
effects of its mission and everything else that it states as uncertain marginalised. The tables have the gain in
log-likelihood of the second flight's residuals by the increments that the first gives, over the prior database, by
channel and regime of the flow, nats. With ``--estimate`` the first flight also gives the scale of the database's error,
by marginal likelihood; its own gain is that of the second flight's prior with this scale over that with the stated one.
With ``--sensitivity`` the gain is computed with other settings of the excess noise and about the first linearisation
point as well.

Two flights of one vehicle meet the same error of the database, and nothing else is common to them: air, path, IMU and
its errors differ. Increments that are learned from one flight must therefore raise the probability of the other one's
forces and moments over that under the prior database (held-out predictive density: Gelman et al., Bayesian Data
Analysis, 3rd ed. 2013, ch. 7). With one prior the gain of all rows is the same in both directions, the logarithm of
p(y1, y2) / (p(y1) p(y2)): the Bayes factor of one database for both flights over a database for each. Only its parts by
channel and regime differ.

The field passes from flight to flight by variables z at knots that both flights have flown over: principal modes over
the angle by the Cholesky factor along the flow, so that z ~ N(0, 1) a priori in either flight. With V the whitened
covariance of a flight's rows with z and e its white residuals, the first flight gives z ~ N(Vᵀe, 1 - VᵀV); the white
residuals of the second are N(V μ, 1 - V (1 - C) Vᵀ) then, with μ and C from the first. Their density is the product of
those of each row given all earlier rows, so that the gain over the prior divides into rows exactly.
"""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from scipy.linalg import solve_triangular

from edl_filter.aero.discrepancy import FIELD_COEFFICIENTS, AngleModes, DiscrepancyPrior
from edl_filter.aero.increments import REGIMES, SYMBOLS
from edl_filter.diagnosis.jacobians.coefficient_errors import interpolated_angles
from edl_filter.diagnosis.linear_model.credible_model import with_estimated_discrepancy
from edl_filter.diagnosis.linear_model.flight_case import load_case
from edl_filter.diagnosis.linear_model.linear_model import LinearizedModel
from edl_filter.diagnosis.linear_model.linearization import linearize
from edl_filter.diagnosis.residual_analysis.database_update import (
    FLOW_SPACING,
    estimate_database_update,
    knot_angles,
)
from edl_filter.diagnosis.residual_analysis.field_posterior import (
    FlownPath,
    amplitude_covariance,
    knot_coordinates,
)
from edl_filter.diagnosis.residual_analysis.residual_map import channels, flow_regimes
from edl_filter.errors import InputError
from edl_filter.estimation.kalman import WhiteningFilter
from edl_filter.estimation.matern import matern32_correlation
from edl_filter.mission import Mission, shipped_mission
from edl_filter.types import Array

#: Key of the scale of the database's error.
SCALE = "coefficient_sigma"
#: Channels of the driving IMU; the others compare two IMUs.
CHANNELS = ("force_x", "force_y", "force_z", "moment_x", "moment_y", "moment_z")
#: Angles of the figure, deg.
FIGURE_ANGLES = (2.0, 4.0)
#: Settings whose influence on the gain is computed: factors of two of those of the excess noise, and the first point.
SENSITIVITY = (
    "noise_piece_s=5",
    "noise_piece_s=20",
    "excess_variance_sigmas=2",
    "excess_variance_sigmas=8",
    "excess_colour_factors=[1]",
    "linearization_iterations=1",
)
#: Eigenvalue of the covariance over the angle, relative to the largest, below which a principal mode is left out.
_NEGLIGIBLE_MODE = 1e-8
#: Information about a combination of z below which it is left out.
_NEGLIGIBLE_INFORMATION = 1e-12


@dataclass(frozen=True)
class CellGain:
    """Gain of one channel in one regime of the flow, nats, with the number of its rows."""

    channel: str
    regime: str
    gain: float
    count: int


@dataclass(frozen=True)
class CrossPrediction:
    """How much better one flight is predicted with the increments that another one gives.

    Attributes
    ----------
    row_gains : (R,) array
        Log predictive density of each row, given all earlier rows, over that under the prior, nats.
    cells : tuple of CellGain
        Channels by regime.
    """

    row_gains: Array
    cells: tuple[CellGain, ...]

    @property
    def total(self) -> float:
        """Gain of all rows, nats."""
        return float(np.sum(self.row_gains))


def predictive_log_likelihood(learned: LinearizedModel, predicted: LinearizedModel) -> CrossPrediction:
    """Log likelihood of a flight with the increments that another flight gives, over that with the prior database.

    Parameters
    ----------
    learned, predicted : LinearizedModel
        Of the flight that gives the increments, and of the one that is predicted: with one prior of one database.

    Raises
    ------
    InputError
        A database that is exact or not the same in both, or flights that have no flow in common.
    """
    prior = learned.case.uncertainty.discrepancy
    families = [m.inputs.forward_model.database.family for m in (learned, predicted)]
    if learned.field is None or predicted.field is None:
        raise InputError(
            "aerodynamics.coefficient_sigma: found 0, an exact database; expected one with errors to learn."
        )
    if predicted.case.uncertainty.discrepancy != prior or families[0] != families[1]:
        raise InputError(
            "aerodynamics: found two databases or two priors of their error; expected one in both missions."
        )
    paths = [FlownPath.of(m) for m in (learned, predicted)]
    coordinates = common_knots(paths[0], paths[1], prior)
    alpha = knot_angles(paths[0], prior, interpolated_angles(learned.inputs.forward_model.database.continuum))
    evidence = []
    for model, path in zip((learned, predicted), paths, strict=True):
        distance = np.concatenate([path.distance_at(regime, c) for regime, c in coordinates.items()])
        whiten, modes = model.fitted_noise_filter, _modes(model)
        columns = knot_columns(whiten, model.nuisance.fields, path.row_distance, prior, modes, distance, alpha)
        evidence.append((columns, model.white_residuals(whiten)))
    gains = row_gains(*evidence[0], *evidence[1])
    return CrossPrediction(gains, cell_gains(predicted, gains))


def _modes(model: LinearizedModel) -> dict[str, AngleModes]:
    assert model.field is not None
    return model.field.modes


def common_knots(first: FlownPath, second: FlownPath, prior: DiscrepancyPrior) -> dict[str, Array]:
    """Regime → coordinates of knots ``(K,)`` in the range over which both flights have flown.

    Raises
    ------
    InputError
        There is no such range.
    """
    out = {}
    for regime in REGIMES:
        ranges = [path.flown_range(regime) for path in (first, second)]
        if ranges[0] is None or ranges[1] is None:
            continue
        low, high = max(r[0] for r in ranges if r), min(r[1] for r in ranges if r)
        if low < high:
            length = prior.log_mach_length if regime == "mach" else prior.log_knudsen_length
            out[regime] = knot_coordinates(low, high, length, FLOW_SPACING)
    if not out:
        raise InputError(
            "cross prediction: found flights without a common Mach or Knudsen number; expected an overlap."
        )
    return out


def knot_columns(
    whiten: WhiteningFilter,
    fields: dict[str, slice],
    row_distance: Array,
    prior: DiscrepancyPrior,
    modes: dict[str, AngleModes],
    distance: Array,
    alpha: Array,
) -> Array:
    """Whitened covariance V of a flight's rows with the variables z at knots.

    Parameters
    ----------
    whiten : WhiteningFilter
        Of a model with the fields' amplitudes among its states.
    fields : dict
        Coefficient → places of its amplitudes.
    row_distance : (R,) array
        Places of the rows along the flow, in correlation lengths.
    prior : DiscrepancyPrior
        Of the fields.
    modes : dict
        Coefficient → modes over the angle.
    distance : (K,) array
        Places of the knots along the flow.
    alpha : (A,) array
        Angles that determine the principal modes, rad; those of the continuum table where it is linear between them.

    Returns
    -------
    (R, Z) array
    """
    factor = np.linalg.cholesky(matern32_correlation(np.subtract.outer(distance, distance))[..., 0])
    blocks = []
    for name in FIELD_COEFFICIENTS:
        covariance = amplitude_covariance(whiten.model.design, fields[name], row_distance, distance)
        size, vectors = np.linalg.eigh(prior.angle_kernel(name, alpha, alpha))
        significant = size > _NEGLIGIBLE_MODE * size[-1]
        principal = (
            modes[name].at(alpha, np.zeros(len(alpha), bool)).T @ vectors[:, significant] / np.sqrt(size[significant])
        )
        at_knots = np.moveaxis(covariance @ principal, 1, 0)
        independent = solve_triangular(factor, at_knots.reshape(len(distance), -1), lower=True)
        blocks.append(np.moveaxis(independent.reshape(at_knots.shape), 0, 1).reshape(len(row_distance), -1))
    columns = np.concatenate(blocks, axis=1)
    return whiten(columns, np.zeros((0, columns.shape[1])))


def row_gains(learned: Array, learned_white: Array, predicted: Array, predicted_white: Array) -> Array:
    """Gain of each row of the second flight, given its earlier rows, by what the first one says of z.

    Parameters
    ----------
    learned, predicted : (Q, Z), (R, Z) arrays
        V of both flights.
    learned_white, predicted_white : (Q,), (R,) arrays
        White residuals of both.

    Returns
    -------
    (R,) array
        nats.
    """
    information, vectors = np.linalg.eigh(learned.T @ learned)
    informative = information > _NEGLIGIBLE_INFORMATION
    design = predicted @ (vectors[:, informative] * np.sqrt(information[informative]))
    expected = predicted @ (learned.T @ learned_white)
    # the covariance 1 - G Gᵀ is that of noise and a state of covariance -1: the Kalman filter's algebra holds as well
    covariance, state = -np.eye(design.shape[1]), np.zeros(design.shape[1])
    out = np.empty(len(predicted_white))
    for i, row in enumerate(design):
        gain = covariance @ row
        variance = 1.0 + row @ gain
        innovation = predicted_white[i] - expected[i] - row @ state
        out[i] = 0.5 * (predicted_white[i] ** 2 - innovation**2 / variance - np.log(variance))
        state = state + gain * (innovation / variance)
        covariance -= np.outer(gain, gain / variance)
    return out


def cell_gains(model: LinearizedModel, gains: Array) -> tuple[CellGain, ...]:
    """Gains of rows ``(R,)``, nats, by channel and regime of a flight."""
    cells, regimes = [], flow_regimes(model)
    for c, (channel, _) in enumerate(channels(model)):
        for regime, inside in regimes:
            rows = model.index.bin_rows[inside, c]
            rows = rows[rows >= 0]
            if len(rows):
                cells.append(CellGain(channel, regime, float(np.sum(gains[rows])), len(rows)))
    return tuple(cells)


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


def draw_increments(models: Sequence[LinearizedModel], path: Path) -> None:
    """Figure of the increments that each flight gives in continuum flow, at the tables' angles of `FIGURE_ANGLES`.

    Parameters
    ----------
    models : sequence of LinearizedModel
        Of the flights.
    path : Path
        PNG file.
    """
    import matplotlib.pyplot as plt  # imported on use: the tables need none

    figure, axes = plt.subplots(
        3, len(FIGURE_ANGLES), figsize=(9.0, 7.5), sharex=True, sharey="row", layout="constrained"
    )
    for model, colour in zip(models, ("tab:blue", "tab:orange"), strict=True):
        mission = model.case.mission
        update = estimate_database_update(model)
        assert update is not None
        regime = next(r for r in update.regimes if r.regime == "mach")
        for c, row in enumerate(axes):
            for ax, angle in zip(row, FIGURE_ANGLES, strict=True):
                a = int(np.argmin(np.abs(regime.alpha - np.radians(angle))))
                mean, sigma = regime.increment[c][:, a], regime.sigma[c][:, a]
                flown = regime.bins[:, a] > 0
                ax.fill_between(
                    regime.nodes, mean - 2.0 * sigma, mean + 2.0 * sigma, color=colour, alpha=0.2, linewidth=0
                )
                ax.plot(regime.nodes, mean, color=colour, label=mission.title or mission.name)
                ax.plot(regime.nodes[flown], mean[flown], "o", color=colour, markersize=3)
                ax.axhline(0.0, color="grey", linewidth=0.8)
                ax.set_xscale("log")
                ax.set_title(f"{np.degrees(regime.alpha[a]):.3g} deg" if c == 0 else "")
            row[0].set_ylabel(f"Δ{SYMBOLS[FIELD_COEFFICIENTS[c]]}")
    for ax in axes[-1]:
        ax.set_xlabel("Mach number")
        ax.set_xticks([2, 5, 10, 20], ["2", "5", "10", "20"])
        ax.minorticks_off()
    axes[0, 0].legend(fontsize="small", title="bands: 2 sigma; circles: flown", title_fontsize="small")
    figure.savefig(path, dpi=100)
    plt.close(figure)


def sensitivity(files: Sequence[Path]) -> str:
    """Gains with other settings, one line for each of `SENSITIVITY`."""
    lines = ["\nGain with other settings in both directions, nats"]
    for setting in SENSITIVITY:
        models = [linear_model(Mission.load(file, [f"diagnosis.{setting}"])) for file in files]
        gains = [predictive_log_likelihood(models[i], models[1 - i]).total for i in (0, 1)]
        lines.append(f"{setting:32}{gains[0]:8.1f}{gains[1]:8.1f}")
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
    parser.add_argument("--sensitivity", action="store_true", help="gains with other settings of the diagnosis, too")
    parser.add_argument("--figure", type=Path, help="PNG file of the increments of both flights")
    a = parser.parse_args()
    if len(a.missions) not in (0, 2):
        parser.error("two missions or none")
    files = a.missions or [shipped_mission(name) for name in ("mer_a", "mer_b")]
    missions = [Mission.load(file) for file in files]
    stated = [linear_model(mission) for mission in missions]
    if a.figure:
        draw_increments(stated, a.figure)
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
    if a.sensitivity:
        print(sensitivity(files), flush=True)


if __name__ == "__main__":
    main()
