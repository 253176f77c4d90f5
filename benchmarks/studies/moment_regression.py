"""Which moment is it that a model of a flight lacks: shares of the residuals that candidate moments explain.

    python benchmarks/studies/moment_regression.py [MISSION.yaml ...]

The missions are Spirit's and Opportunity's without arguments. Each flight is linearised as a diagnosis does, with the
effects of its mission and everything that it states as uncertain marginalised. What remains of the lateral angular
accelerations is regressed by least squares on pairs of candidate moments whose coefficients are linear between knots of
time, so that all candidates have the same number of free coefficients. The table has the share of the mean square that
each pair explains. The regression does not use the state-space model, whose result it checks.
"""

from __future__ import annotations

import argparse
from pathlib import Path

import numpy as np

from edl_filter.diagnosis.linear_model.credible_model import credible_model
from edl_filter.diagnosis.linear_model.flight_case import load_case
from edl_filter.diagnosis.linear_model.linear_model import LinearizedModel
from edl_filter.diagnosis.residual_analysis.residual_map import normalised_innovations
from edl_filter.mission import Mission
from edl_filter.types import Array

#: Channels of the steps of the lateral rates in a bin.
LATERAL = (4, 5)
#: Distances of the knots, s.
SPACINGS = (20.0, 5.0)
#: s before the end of the comparison that are left out: the parachute's shock is near.
MARGIN_S = 1.0

#: Two moments, each with its component about y and about z ``(N,)``.
Pair = tuple[tuple[Array, Array], tuple[Array, Array]]


def lateral_residuals(model: LinearizedModel) -> tuple[Array, Array, Array]:
    """Times of bins' ends ``(N,)`` (s), residual angular accelerations ``(N, 2)`` (rad/s²) there, and these bins."""
    normalised, rows = normalised_innovations(model), model.index.bin_rows[:-1, LATERAL]
    used = np.flatnonzero(np.all(rows >= 0, axis=1))
    between = 0.5 * (model.bins.edges[2:] - model.bins.edges[:-2])  # a step is between the middles of two bins
    steps = normalised[rows[used]] * model.stated_noise_sigma[rows[used]]
    time = model.bins.edges[1:-1][used]
    kept = time < model.bins.edges[-1] - MARGIN_S
    return time[kept], (steps / between[used, None])[kept], used[kept]


def candidates(model: LinearizedModel, time: Array, bins: Array) -> dict[str, Pair]:
    """Pairs of candidate moments at the bins' ends, as angular accelerations in any unit."""
    flow, forward = model.residuals.flow, model.inputs.forward_model

    def at(values: Array) -> Array:
        return np.asarray(np.interp(time, flow.time, values), float)

    pressure = at(flow.dynamic_pressure)
    damping = at(flow.dynamic_pressure / flow.speed) * forward.diameter
    # direction cosines of the lateral flow: the moment of a stable vehicle is along (w, -v)
    y, z = (at(flow.velocity_body[:, i] / flow.speed) for i in (2, 1))
    z = -z
    square = y**2 + z**2
    zero, q, r = np.zeros_like(pressure), at(flow.rate[:, 1]), at(flow.rate[:, 2])
    columns = model.jacobian.columns
    east, north = (model.jacobian.rate_step[bins, :, columns[n]][:, 1:, 0] for n in ("wind_east", "wind_north"))
    return {
        "function of the flow: slope in the angle and its cube": (
            (pressure * y, pressure * z),
            (pressure * square * y, pressure * square * z),
        ),
        "damping, and a moment across the rate": ((damping * q, damping * r), (damping * r, -damping * q)),
        "moment along and across the plane of the angle": ((pressure * y, pressure * z), (pressure * z, -pressure * y)),
        "moment fixed to the body": ((pressure, zero), (zero, pressure)),
        "wind": ((east[:, 0], east[:, 1]), (north[:, 0], north[:, 1])),
    }


def explained_share(time: Array, residuals: Array, pair: Pair, spacing: float) -> float:
    """Share of the mean square of the residuals that a pair explains.

    Parameters
    ----------
    time : (N,) array
        s.
    residuals : (N, 2) array
        About y and z.
    pair : pair of pairs of (N,) arrays
        Both moments.
    spacing : float
        Distance of the knots between which the coefficients are linear, s.
    """
    knots = np.arange(time[0], time[-1] + spacing, spacing)
    hats = np.maximum(1.0 - np.abs(time[:, None] - knots) / spacing, 0.0)
    design = np.concatenate([np.concatenate((hats * a[:, None], hats * b[:, None])) for a, b in pair], axis=1)
    scale = np.sqrt(np.mean(design**2, axis=0))
    design = design / np.where(scale > 0.0, scale, 1.0)
    target = residuals.T.ravel()
    remaining = target - design @ np.linalg.lstsq(design, target, rcond=1e-8)[0]
    return 1.0 - float(np.mean(remaining**2) / np.mean(target**2))


def main() -> None:
    """Print a table for each flight."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("missions", nargs="*", default=["builtin:mer_a", "builtin:mer_b"])
    parser.add_argument("--set", action="append", default=[], help="KEY=VALUE of the missions")
    arguments = parser.parse_args()
    for name in arguments.missions:
        mission = Mission.load(name if name.startswith("builtin:") else Path(name), arguments.set)
        model = credible_model(load_case(mission))[0]
        time, residuals, bins = lateral_residuals(model)
        size = np.sqrt(np.mean(residuals**2))
        print(f"\n{mission.name}: {size:.4f} rad/s² RMS, {time[0]:.0f} to {time[-1]:.0f} s")
        print(f"{'share of the mean square, knots every':<56}" + "".join(f"{s:>7.0f} s" for s in SPACINGS))
        for what, pair in candidates(model, time, bins).items():
            shares = (explained_share(time, residuals, pair, spacing) for spacing in SPACINGS)
            print(f"{what:<56}" + "".join(f"{share:>9.2f}" for share in shares))


if __name__ == "__main__":
    main()
