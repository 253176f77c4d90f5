"""Schema of ``diagnosis.json``: what a diagnosis determines, `DiagnosisContent`."""

from __future__ import annotations

from shlex import quote

from edl_filter.mission.decision_settings import DecisionSettings
from edl_filter.results.schema.fields import Content, Number, NumberVector, key, optional
from edl_filter.results.verdicts import Form, VerdictName


class Estimate(Content):
    """Estimate of one parameter; SI units, angles in rad."""

    estimate: Number = key("estimate, in unit")
    sigma: Number = key("1 sigma, in unit; null where it was not estimated")
    unit: str = key("unit")


class ScreenedEstimate(Content):
    """Estimate of one size in the screening, in the unit of the effect's declaration."""

    estimate: Number = key("estimate")
    sigma: Number = key("1 sigma")
    data_share: Number = key("share of the data in the estimate, the rest being the prior's")
    plausible: Number = key("plausible size: 1 sigma of its prior")
    smallest: Number = key("smallest size whose expected gain is required_gain; null where no size has it")


class MapCell(Content):
    """One cell of the residual map: a channel in a flow regime, or a constraint."""

    channel: str = key("channel, or name of a constraint")
    regime: str = key("flow regime, or constraints")
    t0_s: float = key("beginning, s since the epoch")
    t1_s: float = key("end, s since the epoch")
    normalised_rms: Number = key("normalised RMS, 1 where the model holds")
    bias: Number = key("mean, in sigmas of one sample")
    autocorrelation: Number = key("autocorrelation of the normalised innovations at lag one")
    excess_rms: Number = key("RMS beyond the stated noise, in unit")
    unit: str = key("unit of the channel")
    over_database_sigma: Number = key("excess_rms over the database's 1 sigma; null where that does not apply")
    count: int = key("number of samples")
    limit_rms: Number = key("normalised RMS that chance allows for so many samples")
    fails: bool = key("whether the model fails in this cell: normalised_rms exceeds limit_rms")
    sentence: str = key("the cell as text")


class Alternative(Content):
    """An effect that the flight does not distinguish from the first of its hypothesis."""

    parameters: dict[str, Estimate] = key("parameter → estimate")


class RankedHypothesis(Content):
    """One hypothesis: an effect that may be missing, with those that the flight does not distinguish from it."""

    effect: str = key("name of the effect")
    imu: str | None = key("IMU of a sensor effect; null: the driving one, or no sensor effect")
    label: str = key("effect and imu as text: name, or name in IMU")
    same_as: tuple[str, ...] = key("labels of effects that the flight does not distinguish from it")
    alternatives: dict[str, Alternative] = key("the same effects with their estimates")
    discriminated_by: dict[str, str] = key(
        "label of each of these effects → the measurement that would distinguish it, as text"
    )
    probability: Number = key("posterior probability")
    gain: Number = key("log Bayes factor over the model without it, nats")
    score_gain: Number = key("held-out log predictive density over the model without it, nats")
    at_noise_floor: bool = key("whether the residuals are at their noise with it")
    explained_share: Number = key(
        "share of the log-likelihood between the failing model and the stated noise that it gains; 0 where the model "
        "does not fail, or the effect was not fitted about its own reconstruction"
    )
    complemented: bool | None = key(
        "whether a second effect explains what this one leaves; null where that was not asked: this one explains less "
        "than complemented_explained_share or at least sufficient_share, or leaves hardly any excess variance"
    )
    parameters: dict[str, Estimate] = key("parameter → estimate")
    correlations: dict[str, Number] = key("pair of parameters → posterior correlation")
    error_before: Number = key("normalised RMS of channel without it")
    error_after: Number = key("normalised RMS of channel with it")
    channel: str = key("channel that it reduces most")
    errors_after: dict[str, Number] = key("channel → normalised RMS with it")
    cells_after: int = key("number of cells of the residual map with it")
    cells_failing_after: int = key("number of these cells that fail")


class SomethingElse(Content):
    """The hypothesis that something is missing which is no effect of the catalogue."""

    probability: Number = key("posterior probability")
    gain: Number = key(
        "gain with which an effect is as probable, nats: required_gain if a sigma is not what is stated, else "
        "unmodelled_gain unless the evidence against a stated sigma is larger"
    )
    unmodelled_gain: Number = key("log Bayes factor of an unmodelled force and moment, nats")
    form: Form = key("fixed to the body, proportional to angular rate or angle of attack, or an error of one IMU")
    force_m_s2: Number = key("largest 1 sigma of the unmodelled specific force, or of the error, m/s^2")
    angular_acceleration_rad_s2: Number = key("largest 1 sigma of the unmodelled angular acceleration, rad/s^2")
    rate_rad_s: Number = key("largest 1 sigma of the error of the gyros, rad/s")
    correlation_time_s: Number = key("correlation time of both, s")
    with_dynamic_pressure: bool = key("whether both are proportional to the dynamic pressure")


class ScreenedEffect(Content):
    """Result of the screening of one effect."""

    gain: Number = key("log Bayes factor in the screening, nats")
    parameters: dict[str, ScreenedEstimate] = key("size → estimate")


class RemainderContent(Content):
    """The channel with the largest unexplained residuals."""

    channel: str = key("channel")
    t0_s: float = key("beginning, s since the epoch")
    t1_s: float = key("end, s since the epoch")
    normalised_rms: Number = key("normalised RMS")
    size: Number = key("RMS, in unit")
    unit: str = key("N or N m")
    frequency_hz: Number = key("frequency of a spectral line, Hz; null where there is none")
    follows: dict[str, float] = key("quantity of the flight → correlation with it")
    companions: tuple[str, ...] = key("other channels with unexplained residuals at the same time")
    description: str = key("the remainder as text")


class LatentContent(Content):
    """Unmodelled force and moment against time, body axes."""

    time_s: tuple[float, ...] = key("time since the epoch, s")
    force_N: tuple[NumberVector, ...] = key("force, N")
    force_sigma_N: tuple[NumberVector, ...] = key("1 sigma of the force, N")
    moment_N_m: tuple[NumberVector, ...] = key("moment about the centre of mass, N m")
    moment_sigma_N_m: tuple[NumberVector, ...] = key("1 sigma of the moment, N m")


class OnsetContent(Content):
    """Time at which a channel begins to fail."""

    channel: str = key("channel")
    time_s: float = key("time since the epoch, s")
    gain: Number = key("log-likelihood over constant noise, nats")


class LargestIncrementContent(Content):
    """The largest increment of one coefficient of the database, in sigmas of the database."""

    sigmas: Number = key("increment over the database's own 1 sigma")
    increment: Number = key("increment, in units of the coefficient")
    sigma: Number = key("1 sigma of the increment, given the flight")
    mach: Number = key("Mach number; null in rarefied flow")
    knudsen: Number = key("Knudsen number based on the diameter; null in continuum flow")
    alpha_deg: float = key("total angle of attack, deg")


class DatabaseUpdateContent(Content):
    """What the flight says of the aerodynamic database."""

    file: str = key("name of the file with all increments and their covariance, in the result folder")
    cells: int = key("number of pairs of a Mach or Knudsen number and an angle")
    largest: dict[str, LargestIncrementContent] = key("CA, CN and Cm → the largest increment")


class EstimatedQuantityContent(Content):
    """A quantity of the prior of the database's error that was estimated by marginal likelihood."""

    stated: float = key("value in the mission, in its unit")
    estimate: float = key("estimate")
    low: float = key("lower bound")
    high: float = key("upper bound")
    at_bound: bool = key("whether the estimate is at one of its bounds")


class DiscrepancyContent(Content):
    """What of the prior of the database's error was estimated."""

    gain: Number = key("gain in log posterior density over the stated values, nats")
    quantities: dict[str, EstimatedQuantityContent] = key("key of the mission → its estimate")


class NuisanceContent(Content):
    """A nuisance parameter that the flight moves by more than 2 sigma from what the mission states."""

    name: str = key("name; the database's increments are database CA, database CN, database Cm")
    sigmas: Number = key("shift over the stated 1 sigma; where it varies during the flight, the largest")
    value: Number = key("shift, in unit; relative where that is empty")
    unit: str = key("unit")


class DiagnosisContent(Content):
    """``diagnosis.json``: where a model fails, which effect is missing, and what remains unexplained."""

    verdict: VerdictName = key("verdict")
    sentence: str = key("the verdict as text")
    state: tuple[str, ...] = key(
        "the state of the flight, one sentence each: how much fails, the verdict, what the leading effect reduces, why "
        "a clean flight has a large normalised RMS, and whether the database is a proxy"
    )
    database_proxy: str | None = key("for what the aerodynamic database is a proxy; null: it is the vehicle's own")
    mission: str = key("name of the mission")
    effects: tuple[str, ...] = key("labels of the effects in the model")
    where: tuple[MapCell, ...] = key("cells of the residual map that fail, worst first")
    map: tuple[MapCell, ...] = key("all cells of the residual map")
    ranking: tuple[RankedHypothesis, ...] = key("hypotheses, most probable first")
    required_gain: Number = key("gain that an effect needs to be named, in sample and held out, nats")
    none: Number = key("probability that nothing is missing")
    none_gain: Number = key("log evidence of the model at its stated noise, relative to that at its own noise, nats")
    something_else: SomethingElse = key("the hypothesis that something outside the catalogue is missing")
    screening: dict[str, ScreenedEffect] = key(
        "label of the effect → result of the screening, all effects that were considered"
    )
    remainder: RemainderContent | None = key("description of what remains; null unless the verdict is unknown")
    latent: LatentContent | None = key("unmodelled force and moment; null unless the verdict is unknown")
    onsets: tuple[OnsetContent, ...] = key("times at which channels begin to fail, clearest first")
    failed: dict[str, str] = key("effect of a user whose hooks fail → message")
    errors: dict[str, Number] = key("channel → normalised RMS over the flight")
    noise_floor: float = key("97.5 % quantile of the normalised RMS of a model that holds")
    database_update: DatabaseUpdateContent | None = key("increments of the database; null with an exact database")
    discrepancy_estimate: DiscrepancyContent | None = key(
        "scale and lengths of the database's error where the mission asks to estimate them; otherwise null"
    )
    nuisances: tuple[NuisanceContent, ...] = key("nuisance parameters that the flight moves, farthest first")
    own_effects: dict[str, str] | None = optional("ranked effect of the user → its Python file, as `--file` named it")
    settings: DecisionSettings = key("thresholds of the diagnosis")

    def file_option(self, effect: str) -> str:
        """Option of ``edl-filter add`` that names the file of an effect of the user, with a space before it."""
        file = (self.own_effects or {}).get(effect)
        return f" --file {quote(file)}" if file else ""

    def hypotheses(self) -> dict[str, RankedHypothesis | Alternative]:
        """All ranked effects by label, including those that the flight does not distinguish from another."""
        alternatives = {label: a for h in self.ranking for label, a in h.alternatives.items()}
        return {**alternatives, **{h.label: h for h in self.ranking}}
