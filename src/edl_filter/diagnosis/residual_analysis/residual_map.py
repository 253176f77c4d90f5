"""Normalised residuals of the channels: against time, their RMS over the flight, and in every flight regime.

A residual is measured minus predicted, after the nuisance parameters have been estimated from all earlier residuals: an
innovation of the Kalman filter at the noise that the residuals show (`noise.variance_components`), so that one failure
does not spread over other channels. It is normalised by its one sigma at the stated noise, so that the failure remains
visible. If the model holds, the normalised RMS is one. All normalised RMS of a model are of these residuals; those of
the navigation filter's innovations (`results.summary`) are about the reconstruction, which does not use the model.

Output: the content of ``residuals.nc`` (`residual_series`), and the residual map, a list of cells: every channel in
every flight regime, and every constraint.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from scipy.special import chdtri, ndtr

from edl_filter.aero.regimes import BOUNDARY_MACH, DYNAMIC_INSTABILITY_MACH, FREE_MOLECULAR_KNUDSEN
from edl_filter.diagnosis.linear_model.linear_model import LinearizedModel, rows_by_constraint
from edl_filter.diagnosis.prediction.dead_reckoning import NODES_PER_BIN
from edl_filter.mission.decision_settings import DecisionSettings
from edl_filter.navigation.constraints import Constraint
from edl_filter.results.groups import Group, Groups
from edl_filter.types import AXES, Array, BoolArray

#: Least number of rows of a cell: the sigma by chance of the mean square of fewer exceeds 0.7.
LEAST_ROWS = 5
#: Mach numbers between the continuum regimes.
MACH = (*BOUNDARY_MACH, DYNAMIC_INSTABILITY_MACH)
#: Regime of the map under which the constraints stand, and the key of the whole flight among the regimes.
CONSTRAINTS, OVERALL = "constraints", "overall"


def channels(model: LinearizedModel) -> list[tuple[str, str]]:
    """Names and units of the bins' channels, in the order of their rows."""
    names = [(f"force_{a}", "m/s^2") for a in AXES] + [(f"moment_{a}", "rad/s^2") for a in AXES]
    for record in model.inputs.checking:
        names += [(f"{record.name}_force_{a}", "m/s^2") for a in AXES]
        names += [(f"{record.name}_rate_{a}", "rad/s") for a in AXES]
    return names


def normalised_innovations(model: LinearizedModel) -> Array:
    """Those of the model at the fitted noise ``(R,)``: `LinearizedModel.normalised_innovations`."""
    whiten = model.fitted_noise_filter
    return model.normalised_innovations(whiten, model.white_residuals(whiten))


def rms_by_channel(model: LinearizedModel, normalised: Array) -> dict[str, float]:
    """Channel → RMS over the flight of normalised innovations ``(R,)``."""
    by_channel = {}
    for c, (name, _) in enumerate(channels(model)):
        rows = model.index.bin_rows[:, c]
        by_channel[name] = _rms(normalised[rows[rows >= 0]])
    return by_channel


def rms_by_constraint(model: LinearizedModel, normalised: Array) -> dict[str, float]:
    """Constraint → RMS over all its uses of normalised innovations ``(R,)``."""
    return {name: _rms(normalised[rows]) for name, rows in rows_by_constraint(model).items()}


def model_rms(model: LinearizedModel) -> dict[str, float]:
    """Channel or constraint → normalised RMS of a model."""
    normalised = normalised_innovations(model)
    return rms_by_channel(model, normalised) | rms_by_constraint(model, normalised)


def residual_series(model: LinearizedModel) -> Groups:
    """Groups of ``residuals.nc``.

    Returns
    -------
    dict of Group
        Root: ``time`` (bins' middles, s), ``channel``, ``unit`` (text by channel), ``residual`` and ``sigma``
        ``(channel, time)`` in the channel's unit, and ``normalised``, their ratio; NaN where nothing is compared.
    """
    index, bins = model.index, model.bins
    normalised, stated = normalised_innovations(model), model.stated_noise_sigma
    named = channels(model)
    ratio, sigma = (np.full((len(named), len(bins.interval)), np.nan) for _ in range(2))
    for c in range(len(named)):
        used = np.flatnonzero(index.bin_rows[:, c] >= 0)
        rows = index.bin_rows[used, c]
        scale = 1.0 / bins.interval[used] if 3 <= c < 6 else 1.0  # steps of the rate, as accelerations
        ratio[c, used], sigma[c, used] = normalised[rows], stated[rows] * scale
    group = Group()
    group.add("time", ("time",), bins.middle, "s", "time since the epoch, middle of the bin")
    group.label("channel", [name for name, _ in named], "what is compared")
    group.text("unit", "channel", [unit for _, unit in named], "unit of residual and sigma")
    dims = ("channel", "time")
    group.add(
        "residual", dims, ratio * sigma, "1", "measured less predicted, nuisance parameters estimated, in its unit"
    )
    group.add("sigma", dims, sigma, "1", "one sigma of the residual as stated, in its unit")
    group.add("normalised", dims, ratio, "1", "residual over sigma")
    return {"/": group}


@dataclass(frozen=True)
class Cell:
    """A channel in a regime.

    Attributes
    ----------
    channel, regime : str
    t0, t1 : float
        s.
    rms : float
        Normalised RMS: 1 if the model holds.
    bias : float
        Mean, in sigmas of one sample.
    autocorrelation : float
        Of the normalised innovations at lag one.
    physical : float
        RMS beyond the stated noise, in the channel's unit; zero where only samples with a small sigma exceed it.
    unit : str
    over_database_sigma : float
        The same over the database's one sigma; NaN where the database does not concern the channel.
    count : int
    limit : float
        Normalised RMS that chance allows for so many numbers.
    fails : bool
        Whether `rms` exceeds `limit`.
    """

    channel: str
    regime: str
    t0: float
    t1: float
    rms: float
    bias: float
    autocorrelation: float
    physical: float
    unit: str
    over_database_sigma: float
    count: int
    limit: float
    fails: bool

    @property
    def sentence(self) -> str:
        """The cell in words."""
        begin, end = f"{self.t0:.0f}", f"{self.t1:.0f}"
        place = self.channel if self.regime == CONSTRAINTS else f"{self.channel} in {self.regime}"
        text = f"{place} ({begin if begin == end else f'{begin} to {end}'} s): {self.rms:.3g} times its sigma"
        if self.physical > 0.0:
            size = f"{self.physical:.2g}" if self.physical < 100.0 else f"{self.physical:.0f}"
            text += f", {size} {self.unit} beyond noise"
        if self.physical > 0.0 and np.isfinite(self.over_database_sigma):
            text += f", {self.over_database_sigma:.2g} of the database's sigma"
        return text + "."


def flow_regimes(model: LinearizedModel) -> list[tuple[str, BoolArray]]:
    """Regimes of the flight and the bins ``(B,)`` in them, in order of time.

    Flow is transitional where the database uses its rarefied table.
    """
    flow, continuum_limit = model.residuals.flow, model.inputs.forward_model.database.continuum_limit
    middle = slice(NODES_PER_BIN // 2, None, NODES_PER_BIN)
    mach, knudsen = flow.mach[middle], flow.knudsen[middle]
    free_molecular = knudsen >= FREE_MOLECULAR_KNUDSEN
    transitional = ~free_molecular & (knudsen > continuum_limit)
    regimes = [("free-molecular flow", free_molecular), ("transitional flow", transitional)]
    continuum = ~free_molecular & ~transitional
    for high, low in pairwise((np.inf, *MACH, 0.0)):
        name = f"Mach {high:g} to {low:g}" if np.isfinite(high) else f"Mach above {low:g}"
        inside = continuum & (mach < high) & (mach >= low)
        regimes.append((name if low > 0.0 else f"Mach below {high:g}", inside))
    return [(name, inside) for name, inside in regimes if inside.any()]


def residual_map(model: LinearizedModel, normalised: Array | None = None) -> list[Cell]:
    """All cells: the bins' channels by regime, then the constraints by name.

    Parameters
    ----------
    model : LinearizedModel
        The model.
    normalised : (R,) array, optional
        Normalised innovations with another effect in the model, instead of the model's own.
    """
    normalised = normalised_innovations(model) if normalised is None else normalised
    sigma = model.stated_noise_sigma
    index, bins, settings = model.index, model.bins, model.settings
    limits = _database_sigma(model)
    cells = []
    for regime, inside in flow_regimes(model):
        for c, (channel, unit) in enumerate(channels(model)):
            used = np.flatnonzero(inside & (index.bin_rows[:, c] >= 0))
            if len(used) < LEAST_ROWS:
                continue
            rows = index.bin_rows[used, c]
            scale = 1.0 / bins.interval[used] if 3 <= c < 6 else np.ones(len(used))
            cells.append(
                _cell(
                    channel, regime, (bins.edges[used[0]], bins.edges[used[-1] + 1]), normalised[rows],
                    sigma[rows] * scale, unit, limits[used, c] if c < 6 else None, settings,
                )
            )  # fmt: skip
    for name, rows in rows_by_constraint(model).items():
        first = next(c for c in model.inputs.problem.constraints if c.name == name)
        cells.append(
            _cell(
                name, CONSTRAINTS, (index.time[rows[0]], index.time[rows[-1]]), normalised[rows], sigma[rows],
                _unit(first), None, settings,
            )
        )  # fmt: skip
    return cells


def failing_cells(cells: list[Cell]) -> list[Cell]:
    """Cells that fail, largest normalised RMS first."""
    return sorted((c for c in cells if c.fails), key=lambda c: -c.rms)


def rms_by_regime(model: LinearizedModel) -> dict[str, dict[str, float]]:
    """Channel → `OVERALL` and every regime → normalised RMS, those of `residual_map`; a constraint has no regime."""
    by_channel = {name: {OVERALL: rms} for name, rms in model_rms(model).items()}
    for cell in residual_map(model):
        if cell.regime != CONSTRAINTS:
            by_channel[cell.channel][cell.regime] = cell.rms
    return by_channel


def _rms(values: Array) -> float:
    return float(np.sqrt(np.mean(np.square(values)))) if len(values) else float("nan")


def _unit(constraint: Constraint) -> str:
    """Unit of a constraint, with which its components' names end in brackets."""
    return constraint.components[0].rpartition("(")[2].rstrip(")")


def _cell(
    channel: str,
    regime: str,
    span: tuple[float, float],
    normalised: Array,
    sigma: Array,
    unit: str,
    database_sigma: Array | None,
    settings: DecisionSettings,
) -> Cell:
    n = len(normalised)
    square = float(np.mean(normalised**2))
    rms = np.sqrt(square)
    physical = float(np.sqrt(max(float(np.mean((normalised * sigma) ** 2 - sigma**2)), 0.0)))
    autocorrelation = float(np.mean(normalised[1:] * normalised[:-1])) / max(square, 1e-30) if n > 2 else 0.0
    chance = float(np.sqrt(chdtri(n, ndtr(-settings.cell_fails_sigmas)) / n))
    limit = max(chance, settings.cell_minimum_rms)
    return Cell(
        channel=channel,
        regime=regime,
        t0=float(span[0]),
        t1=float(span[1]),
        rms=float(rms),
        bias=float(np.mean(normalised)),
        autocorrelation=autocorrelation,
        physical=physical,
        unit=unit,
        over_database_sigma=(
            physical / float(np.sqrt(np.mean(database_sigma**2))) if database_sigma is not None else float("nan")
        ),
        count=n,
        limit=limit,
        fails=bool(rms > limit),
    )


def _database_sigma(model: LinearizedModel) -> Array:
    """The database's one sigma in the first six channels, ``(B, 6)``: m/s² and rad/s²."""
    forward_model, flow = model.inputs.forward_model, model.residuals.flow
    m = slice(NODES_PER_BIN // 2, None, NODES_PER_BIN)
    limit = forward_model.database.lookup(flow.mach[m], flow.knudsen[m], flow.alpha_total[m], flow.speed[m]).three_sigma
    load = flow.dynamic_pressure[m] * forward_model.area
    force = load[:, None] * np.stack((limit.ca, limit.cn, limit.cn), axis=1)
    moment = load[:, None] * forward_model.diameter * np.stack((limit.cl, limit.cm, limit.cm), axis=1)
    for part, body in forward_model.bodies(flow.time[m]):
        force[part] /= body.mass
        moment[part] /= np.diag(body.inertia)
    return np.maximum(np.concatenate((force, moment), axis=1) / 3.0, 1e-30)
