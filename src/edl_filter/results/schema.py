"""Schemas of the JSON files in a result folder: every key with its type, unit and meaning.

`Summary` is ``summary.json``, `DiagnosisContent` is ``diagnosis.json``, `LedgerLine` one line of ``ledger.jsonl``. Keys
carry their unit at the end of the name or in the description. `edl_filter.results.files` reads the files through these
models, and ``docs/reference/result-files.md`` publishes them as tables and as JSON Schema (`json_schemas`).

A key without a default is always in the file. A number that may be null is null where it is not finite.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, Literal, Self

from pydantic import BaseModel, ConfigDict, Field, TypeAdapter

from edl_filter.mission.decision_settings import DecisionSettings

#: A number, or null where it is not finite.
Number = float | None
Vector = tuple[float, float, float]
NumberVector = tuple[Number, Number, Number]


class Content(BaseModel):
    """A part of a file: frozen, and without any other key."""

    model_config = ConfigDict(extra="forbid", frozen=True, strict=True)

    @classmethod
    def of(cls, content: Self | Mapping[str, Any]) -> Self:
        """Model of plain data, in which tuples may be lists; a model is returned as it is."""
        return content if isinstance(content, cls) else cls.model_validate(content, strict=False)


def _key(description: str, **more: Any) -> Any:
    return Field(description=description, **more)


def _optional(description: str) -> Any:
    """A key that may be absent."""
    return Field(default=None, description=description)


# summary.json


class EventState(Content):
    """State at one event; velocities are air-relative."""

    time_s: float = _key("time since the epoch, s")
    sclk: Number = _optional("spacecraft clock, s; absent without one")
    utc: str = _key("UTC, ISO 8601")
    altitude_m: Number = _key("areodetic altitude, m")
    altitude_sigma_m: Number = _key("1 sigma of the altitude, m")
    height_above_site_m: Number = _optional(
        "distance from the planet's centre minus the landing site's, m; absent without a site"
    )
    velocity_m_s: Number = _key("air-relative speed, m/s")
    velocity_sigma_m_s: Number = _key("1 sigma of the speed, m/s")
    mach: Number = _key("Mach number with the preflight atmosphere, in the gas of the mission")
    dynamic_pressure_pa: Number = _key("dynamic pressure with the preflight density, Pa")
    flight_path_deg: Number = _key("air-relative flight-path angle, deg, positive up")
    alpha_total_deg: Number = _key("total angle of attack, deg")
    alpha_total_sigma_deg: Number = _key("1 sigma of the total angle of attack, deg")
    acceleration_m_s2: Number = _optional(
        "largest axial deceleration, mean of two successive samples, m/s^2; peak_deceleration only"
    )
    acceleration_single_m_s2: Number = _optional(
        "largest axial deceleration of one sample, m/s^2; peak_deceleration only"
    )
    east_m: Number = _optional("position east of the landing site, m; absent without a site")
    north_m: Number = _optional("position north of the landing site, m; absent without a site")
    up_m: Number = _optional("position above the landing site, m; absent without a site")
    velocity_east_m_s: Number = _optional("velocity relative to the ground, towards east, m/s; absent without a site")
    velocity_north_m_s: Number = _optional("velocity relative to the ground, towards north, m/s; absent without a site")
    velocity_up_m_s: Number = _optional("velocity relative to the ground, upwards, m/s; absent without a site")


class LeftOutLanding(Content):
    """Leave-one-out prediction of the landing: distance from the site, with the sigmas of prediction and site."""

    miss_m: Number = _key("horizontal distance from the site, m")
    sigma_m: Number = _key("root of the sum of the horizontal variances, m")
    miss_east_m: Number = _key("distance towards east, m")
    sigma_east_m: Number = _key("1 sigma of it, m")
    miss_north_m: Number = _key("distance towards north, m")
    sigma_north_m: Number = _key("1 sigma of it, m")
    miss_up_m: Number = _key("distance upwards, m")
    sigma_up_m: Number = _key("1 sigma of it, m")
    nis: Number = _key("normalised innovation squared")
    dof: int = _key("degrees of freedom of nis")


class Landing(Content):
    """Landing position of the trajectory, and its distance from the site."""

    time_s: float = _key("time since the epoch, s")
    lat_deg: Number = _key("areocentric latitude, deg, north positive")
    lon_deg: Number = _key("longitude, deg, east positive, 0 to 360")
    radius_m: Number = _key("distance from the planet's centre, m")
    miss_m: Number = _key("horizontal distance from the site, m; null without a site")
    sigma_m: Number = _key("root of the sum of the horizontal variances of the trajectory, m")
    miss_east_m: Number = _optional("distance from the site towards east, m; absent without a site")
    sigma_east_m: Number = _optional("1 sigma of it, m; absent without a site")
    miss_north_m: Number = _optional("distance from the site towards north, m; absent without a site")
    sigma_north_m: Number = _optional("1 sigma of it, m; absent without a site")
    miss_up_m: Number = _optional("distance from the site upwards, m; absent without a site")
    sigma_up_m: Number = _optional("1 sigma of it, m; absent without a site")
    site_lat_deg: Number = _optional("areocentric latitude of the site, deg, north positive; absent without a site")
    site_lon_deg: Number = _optional("longitude of the site, deg, east positive; absent without a site")
    site_radius_m: Number = _optional("distance of the site from the planet's centre, m; absent without a site")
    left_out: LeftOutLanding | None = _optional(
        "prediction of the landing from all other constraints; absent where the site is no constraint"
    )


class ConstraintSummary(Content):
    """One constraint over all its uses; components have the units that their names state."""

    source: str = _key("where the constraint's values come from")
    components: tuple[str, ...] = _key("names of the components with their units")
    uses: int = _key("number of uses")
    accepted_uses: int = _key("number of uses that passed the gate")
    accepted: bool = _key("whether all uses passed the gate")
    time_s: float = _key("time of the first use since the epoch, s")
    innovation: tuple[Number, ...] = _key("measured minus predicted in the forward pass, mean over the uses")
    innovation_sigma: tuple[Number, ...] = _key("root mean square of the innovations' 1 sigma")
    nis: Number = _key("normalised innovation squared, sum over the uses")
    dof: int = _key("degrees of freedom of nis")
    nis_interval_99_9: tuple[float, float] | None = _key("interval that contains nis with 99.9 %; null where dof is 0")
    consistent: bool | None = _key("whether nis is in the interval; null where dof is 0")
    left_out: tuple[Number, ...] = _key("measured minus predicted from all other constraints")
    left_out_sigma: tuple[Number, ...] = _key("1 sigma of left_out")
    left_out_nis: Number = _key("normalised square of left_out")
    left_out_dof: int = _key("degrees of freedom of left_out_nis")
    information_nats: Number = _key(
        "information gain over all measurements before it, sum over the uses, nats; null for the entry state"
    )
    left_out_information_nats: Number = _key(
        "information gain over all other constraints, nats; a lower bound for the entry state"
    )


class StateEstimate(Content):
    """Estimate of one error state of the entry."""

    estimate: tuple[Number, ...] = _key("estimate, in unit")
    sigma: tuple[Number, ...] = _key("1 sigma, in unit")
    unit: str = _key("unit")


class EntryState(Content):
    """Correction of the entry state, smoothed minus stated, and the rotation of its frame that is nearest to it."""

    position_change_m: NumberVector = _key("change of the position, m, inertial axes")
    position_sigma_m: NumberVector = _key("1 sigma of the smoothed position, m, inertial axes")
    velocity_change_m_s: NumberVector = _key("change of the velocity, m/s, inertial axes")
    velocity_sigma_m_s: NumberVector = _key("1 sigma of the smoothed velocity, m/s, inertial axes")
    attitude_change_deg: NumberVector = _key("change of the attitude, rotation vector, deg, body axes")
    attitude_sigma_deg: NumberVector = _key("1 sigma of the smoothed attitude, deg, body axes")
    rotation_deg: Number = _key("angle of the rotation nearest to the change of position and velocity, deg")
    rotation_inertial_deg: NumberVector = _key("that rotation as a rotation vector, deg, inertial axes")
    rotation_j2000_deg: NumberVector | None = _key(
        "that rotation as a rotation vector, deg, J2000 axes; null where the mission has no J2000 frame"
    )
    rotation_leaves_m: NumberVector = _key("change of the position minus that of the rotation, m, inertial axes")
    rotation_leaves_m_s: NumberVector = _key("change of the velocity minus that of the rotation, m/s, inertial axes")
    states: dict[str, StateEstimate] = _key("estimated errors of the entry epoch and frame, by name")


class ImuFit(Content):
    """Fit of a checking IMU's lateral specific force against the driving one's, along body y and z."""

    start_s: float = _key("beginning of the window, s since the epoch")
    end_s: float = _key("end of the window, s since the epoch")
    misalignment_deg: tuple[Number, Number] = _key("lateral difference per axial force, deg")
    misalignment_sigma_deg: tuple[Number, Number] = _key("1 sigma of the misalignment, deg")
    bias_difference_m_s2: tuple[Number, Number] = _key("lateral difference without axial force, m/s^2")
    bias_difference_sigma_m_s2: tuple[Number, Number] = _key("1 sigma of the bias difference, m/s^2")
    residual_rms_m_s2: tuple[Number, Number] = _key("root mean square of the residuals, m/s^2")
    samples: int = _key("number of common samples")


class ImuComparison(Content):
    """A checking IMU against the driving one."""

    all: ImuFit = _key("over all windows")
    windows: tuple[ImuFit, ...] = _key("in each window")


class ImuCalibration(Content):
    """A checking IMU against the driving one by least squares, body axes."""

    start_s: float = _key("beginning of the window, s since the epoch")
    end_s: float = _key("end of the window, s since the epoch")
    samples: int = _key("number of common samples")
    stated_lever_arm_m: NumberVector = _key("its place from the driving IMU by telemetry or mission, m")
    lever_arm_m: NumberVector = _key("the same, estimated, m")
    lever_arm_sigma_m: NumberVector = _key("1 sigma of the lever arm, m")
    rate_alignment_deg: NumberVector = _key("rotation of its gyros beyond the stated mounting, deg")
    rate_alignment_sigma_deg: NumberVector = _key("1 sigma of it, deg")
    force_alignment_deg: NumberVector = _key("rotation of its accelerometers beyond the stated mounting, deg")
    force_alignment_sigma_deg: NumberVector = _key("1 sigma of it, deg")
    axial_scale: float = _key("difference of the accelerometers' scale errors along x")
    axial_scale_sigma: float = _key("1 sigma of it")
    force_bias_m_s2: NumberVector = _key("difference of the accelerometers' biases, m/s^2")
    force_bias_sigma_m_s2: NumberVector = _key("1 sigma of it, m/s^2")
    rate_bias_rad_s: NumberVector = _key("difference of the gyros' biases, rad/s")
    rate_bias_sigma_rad_s: NumberVector = _key("1 sigma of it, rad/s")
    delay_s: float = _key("by how much its readings are late against the driving IMU's, s")
    delay_sigma_s: float = _key("1 sigma of the delay, s")
    force_rms_m_s2: NumberVector = _key("root mean square of the residuals of the forces, m/s^2")
    rate_rms_rad_s: NumberVector = _key("root mean square of the residuals of the rates, rad/s")
    stated_lever_arm_sigma_m: float | None = _key("1 sigma of the stated place, m; null where the mission has none")
    stated_alignment_sigma_deg: float | None = _key("1 sigma of the stated axes, deg; null where the mission has none")


class PreEntryBias(Content):
    """Accelerometer bias before entry, body axes."""

    slope: NumberVector = _key("slope of the velocity before entry (thesis), m/s^2")
    slope_sigma: NumberVector = _key("1 sigma of the slope, m/s^2")
    filter: NumberVector | None = _optional("the filter's estimate, m/s^2; absent where the bias is no state")
    filter_sigma: NumberVector | None = _optional("1 sigma of it, m/s^2; absent where the bias is no state")


class EffectParameter(Content):
    """One parameter of an effect in the model; SI units, angles in rad."""

    estimate: Number = _key("estimate, in unit; null where it is infinite, as the end of an effect that does not end")
    sigma: Number = _key("1 sigma, in unit; null where the parameter was not refitted")
    unit: str = _key("unit")
    start: Number = _key("value that the mission states, in unit; null where it is infinite or not stated")


class ModelEffect(Content):
    """One effect in the model."""

    imu: str | None = _key("IMU of a sensor effect; null: the driving one, or no sensor effect")
    fixed: bool = _key("whether it is held at its values instead of being refitted")
    parameters: dict[str, EffectParameter] = _key("parameters by name")


class Domain(Content):
    """The part of the flight in which coefficients are defined."""

    threshold: Number = _key("least deceleration, m/s^2")
    start: Number = _key("time from which the deceleration stays above it, s since the epoch")
    useful: Number = _key("time from which the noise of the force coefficients is below a third of the 3 sigma, s")
    end: Number = _key("last time that is used, s since the epoch")


class AngleAgreement(Content):
    """Angle from forces minus angle from moments."""

    mean: Number = _key("mean, deg")
    mean_absolute: Number = _key("mean of the magnitude, deg")
    rms: Number = _key("root mean square, deg")


class AngleAgreements(Content):
    """Angle of attack and sideslip from forces minus those from moments."""

    alpha: AngleAgreement = _key("angle of attack")
    beta: AngleAgreement = _key("sideslip angle")


class Instabilities(Content):
    """Begin and end of the two static instabilities; null where there is none."""

    first: tuple[Number, Number] | None = _key("begin and end of the first, s since the epoch")
    second: tuple[Number, Number] | None = _key("begin and end of the second, s since the epoch")


class InstabilitySources(Content):
    """Criterion by which each instability was identified; absent where there is none."""

    first: Literal["database", "alpha_total"] | None = _optional("criterion of the first")
    second: Literal["database", "alpha_total"] | None = _optional("criterion of the second")


class AverageDifference(Content):
    """Mean difference of coefficients over a window, with the flight's atmosphere (thesis tables 7.1 to 7.6)."""

    window: str = _key("name of the window")
    coefficient: str = _key("CN, CY, Cl, Cm or Cn")
    pair: str = _key("what minus what: IMU is the database at the reconstructed angles, accels and gyros the flight")
    mean: Number = _key("mean of the difference")
    mean_sigma: Number = _key("1 sigma of the mean")
    rms: Number = _key("root mean square of the difference")
    three_sigma: Number = _key("the database's 3 sigma, mean over the window")
    percent: Number = _key("mean in percent of three_sigma")
    samples: int = _key("number of samples in the mean")


class Smoothing(Content):
    """Smoothing of forces and rates at the end of the domain."""

    batch_points: int = _key("samples in a batch of the second-order polynomial")
    low_pass_hz: Number = _key("half-power frequency of one pass of the low-pass before the batches, Hz; null: none")
    bandwidth_hz: Number = _key("frequency at which forces and rates pass half the power, Hz")
    acceleration_bandwidth_hz: Number = _key("the same of the angular acceleration, Hz")


class PostflightSummary(Content):
    """Main results of the post-flight layer."""

    domain_s: Domain = _key("part of the flight in which coefficients are defined")
    smoothing: Smoothing | None = _optional("smoothing of forces and rates")
    mach_times_s: dict[str, Number] = _key("Mach number → last time at which the flight falls below it, s")
    instabilities_s: Instabilities = _key("intervals of the static instabilities, s since the epoch")
    instabilities_found_by: InstabilitySources = _key("criterion by which each instability was identified")
    rolling_moment_coefficient_110_140_s: Number = _key("mean Cl between 110 and 140 s")
    force_less_moment_angle_last_20_s_deg: AngleAgreements = _key(
        "angles from forces minus angles from moments over the last 20 s, deg"
    )
    averages: tuple[AverageDifference, ...] = _key("average differences by window, coefficient and pair")
    verdicts: tuple[str, ...] = _key("judgement of the database's uncertainty, one sentence per window and coefficient")


class GasSummary(Content):
    """Gas in which Mach numbers, Knudsen numbers and temperatures are meant."""

    name: str = _key("name: thesis, Martian air, mixture or stated constants")
    constant: Number = _key("specific gas constant, J/(kg K)")
    heat_capacity_ratio_200_k: Number = _key("ratio of specific heats at 200 K")
    heat_capacity_ratio_300_k: Number = _key("ratio of specific heats at 300 K")
    description: str = _key("all this in words, with the composition")


class SampleFindingSummary(Content):
    """Missing or bad samples of one IMU, and what was done about them."""

    imu: str = _key("name of the IMU")
    channel: str = _key("force or rate, with the axis of the IMU where one is at fault; all: both triads")
    start_s: float = _key("beginning of the first sample, s since the epoch")
    end_s: float = _key("end of the last sample, s since the epoch")
    samples: int = _key("number of samples")
    kind: str = _key(
        "missing, not_finite, out_of_range, all_zero, stuck, saturated, spike, duplicated, reordered, clock_jump or "
        "dead"
    )
    repair: str = _key("what was done")


class CauseSummary(Content):
    """One hypothesis on why the measurements contradict the reconstruction."""

    kind: Literal["units", "axes", "sign", "clock", "gap", "entry_state", "process_noise", "measurement"] = _key(
        "kind of the fault"
    )
    sentence: str = _key("what is wrong")
    gain: Number = _key("gain in log likelihood of the constraints with its repair, nats")
    consistent: bool = _key("whether no constraint is rejected with its repair")


class RecoverySummary(Content):
    """A contradiction between the filter's state and its measurements, and what was added to the model since."""

    time_s: float = _key("time of the contradiction, s since the epoch")
    constraints: tuple[str, ...] = _key("names of the constraints that contradict the state")
    readings: int = _key("number of their readings that agree with each other")
    nis: Number = _key("normalised innovation squared of these readings")
    free_nis: Number = _key("the same with position and velocity unknown; 0 where each constraint is used once")
    directions: int = _key("degrees of freedom of nis - free_nis")
    cause: Literal["gap", "entry_state", "process_noise"] | None = _key(
        "what has more noise: samples in place of lost ones, the entry state, or all samples before the contradiction; "
        "null: nothing removes the contradiction"
    )
    size: Number = _key(
        "share of the variation of force and rate that was added to the samples, or factor of the entry state's sigmas"
    )
    force_noise_m_s2: Number = _key("noise added to the specific force of one sample, m/s^2")
    rate_noise_rad_s: Number = _key("noise added to the angular rate of one sample, rad/s")
    start_s: Number = _key("first time that has it, s since the epoch; null where nothing was added")
    end_s: Number = _key("last time that has it, s since the epoch; null where nothing was added")
    gain_nats: Number = _key("change of the log likelihood of the constraints, nats")


class FilterSummary(Content):
    """Settings of the filter, as the section ``filter`` of a mission states them."""

    alpha: float = _key("spread of the sigma points")
    beta: float = _key("shape of the prior; 2: Gaussian")
    kappa: float = _key("secondary spread of the sigma points")
    longest_interval: float = _key("longest time between fusion epochs, s")
    gate_probability: float = _key("probability with which a good measurement passes its gate")
    method: str = _key("ukf: unscented Kalman filter; ekf: extended")
    robust: str = _key("update with a measurement: none (Gaussian), huber or student_t")
    engine: str = _key("implementation of the unscented filter and the smoother: compiled or filterpy")


class Summary(Content):
    """``summary.json``: the main results of a run."""

    trustworthy: bool = _key(
        "false: landing, rest or most altimeter readings were rejected, or the state contradicted its measurements and "
        "no lost samples explain it (exit code 3)"
    )
    headline: str | None = _key("why the result is not trustworthy, with the likeliest cause; null where it is")
    causes: tuple[CauseSummary, ...] = _key("likeliest causes, consistent ones first; empty where it is trustworthy")
    recovery: RecoverySummary | None = _key(
        "contradiction of state and measurements that the filter has met; null where there was none"
    )
    mission: str = _key("name of the mission")
    title: str = _key("name for people")
    edl_filter_version: str = _key("version of the program")
    epoch_utc: str = _key("UTC of the epoch, ISO 8601")
    filter: FilterSummary | None = _optional("settings of the filter")
    gas: GasSummary | None = _optional("gas of the atmosphere")
    events: dict[str, EventState] = _key("state at every event, by name, in order of time")
    landing: Landing = _key("landing position and its distance from the site")
    constraints: dict[str, ConstraintSummary] = _key("constraints by name")
    entry_state: EntryState = _key("correction of the entry state")
    imu_comparison: dict[str, ImuComparison] = _key(
        "checking IMUs against the driving one by the thesis's projection of the axial force, by name"
    )
    imu_calibration: dict[str, ImuCalibration] = _key("checking IMUs against the driving one, by name")
    pre_entry_bias_m_s2: PreEntryBias | None = _key("accelerometer bias before entry; null where it is not estimated")
    residuals: dict[str, dict[str, Number]] = _key(
        "channel → overall and every flow regime → normalised RMS, 1 where the model holds; channels with a colon are "
        "the filter's innovations"
    )
    postflight: PostflightSummary | None = _key("post-flight layer; null without an aerodynamic database")
    effects: dict[str, ModelEffect] = _key(
        "label of each effect in the model (its name, or its name in its IMU) → its parameters"
    )
    sample_findings: tuple[SampleFindingSummary, ...] = _key(
        "missing and bad samples of the IMUs, and how they were repaired, in order of time", default=()
    )
    notes: tuple[str, ...] = _key("notes of the telemetry's reader")
    timing_s: dict[str, float] = _key("stage → elapsed time, s")


# diagnosis.json


class Estimate(Content):
    """Estimate of one parameter; SI units, angles in rad."""

    estimate: Number = _key("estimate, in unit")
    sigma: Number = _key("1 sigma, in unit; null where it was not estimated")
    unit: str = _key("unit")


class ScreenedEstimate(Content):
    """Estimate of one size in the screening, in the unit of the effect's declaration."""

    estimate: Number = _key("estimate")
    sigma: Number = _key("1 sigma")
    data_share: Number = _key("share of the data in the estimate, the rest being the prior's")
    plausible: Number = _key("plausible size: 1 sigma of its prior")
    smallest: Number = _key("smallest size whose expected gain is required_gain; null where no size has it")


class MapCell(Content):
    """One cell of the residual map: a channel in a flow regime, or a constraint."""

    channel: str = _key("channel, or name of a constraint")
    regime: str = _key("flow regime, or constraints")
    t0_s: float = _key("beginning, s since the epoch")
    t1_s: float = _key("end, s since the epoch")
    normalised_rms: Number = _key("normalised RMS, 1 where the model holds")
    bias: Number = _key("mean, in sigmas of one sample")
    autocorrelation: Number = _key("autocorrelation of the normalised innovations at lag one")
    excess_rms: Number = _key("RMS beyond the stated noise, in unit")
    unit: str = _key("unit of the channel")
    over_database_sigma: Number = _key("excess_rms over the database's 1 sigma; null where that does not apply")
    count: int = _key("number of samples")
    fails: bool = _key("whether the model fails in this cell")
    sentence: str = _key("the cell as text")


class Alternative(Content):
    """An effect that the flight does not distinguish from the first of its hypothesis."""

    parameters: dict[str, Estimate] = _key("parameter → estimate")


class RankedHypothesis(Content):
    """One hypothesis: an effect that may be missing, with those that the flight does not distinguish from it."""

    effect: str = _key("name of the effect")
    imu: str | None = _key("IMU of a sensor effect; null: the driving one, or no sensor effect")
    label: str = _key("effect and imu as text: name, or name in IMU")
    same_as: tuple[str, ...] = _key("labels of effects that the flight does not distinguish from it")
    alternatives: dict[str, Alternative] = _key("the same effects with their estimates")
    discriminated_by: dict[str, str] = _key(
        "label of each of these effects → the measurement that would distinguish it, as text"
    )
    probability: Number = _key("posterior probability")
    gain: Number = _key("log Bayes factor over the model without it, nats")
    score_gain: Number = _key("held-out log predictive density over the model without it, nats")
    at_noise_floor: bool = _key("whether the residuals are at their noise with it")
    explained_share: Number = _key(
        "share of the log-likelihood between the failing model and the stated noise that it gains; 0 where the model "
        "does not fail, or the effect was not fitted about its own reconstruction"
    )
    parameters: dict[str, Estimate] = _key("parameter → estimate")
    correlations: dict[str, Number] = _key("pair of parameters → posterior correlation")
    error_before: Number = _key("normalised RMS of channel without it")
    error_after: Number = _key("normalised RMS of channel with it")
    channel: str = _key("channel that it reduces most")
    errors_after: dict[str, Number] = _key("channel → normalised RMS with it")


class SomethingElse(Content):
    """The hypothesis that something is missing which is no effect of the catalogue."""

    probability: Number = _key("posterior probability")
    score_gain: Number = _key("log Bayes factor of an unmodelled force and moment, nats")
    force_m_s2: Number = _key("1 sigma of the unmodelled specific force, m/s^2")
    angular_acceleration_rad_s2: Number = _key("1 sigma of the unmodelled angular acceleration, rad/s^2")
    correlation_time_s: Number = _key("correlation time of both, s")
    with_dynamic_pressure: bool = _key("whether both are proportional to the dynamic pressure")


class ScreenedEffect(Content):
    """Result of the screening of one effect."""

    gain: Number = _key("log Bayes factor in the screening, nats")
    parameters: dict[str, ScreenedEstimate] = _key("size → estimate")


class RemainderContent(Content):
    """The channel with the largest unexplained residuals."""

    channel: str = _key("channel")
    t0_s: float = _key("beginning, s since the epoch")
    t1_s: float = _key("end, s since the epoch")
    normalised_rms: Number = _key("normalised RMS")
    size: Number = _key("RMS, in unit")
    unit: str = _key("N or N m")
    frequency_hz: Number = _key("frequency of a spectral line, Hz; null where there is none")
    follows: dict[str, float] = _key("quantity of the flight → correlation with it")
    companions: tuple[str, ...] = _key("other channels with unexplained residuals at the same time")
    description: str = _key("the remainder as text")


class LatentContent(Content):
    """Unmodelled force and moment against time, body axes."""

    time_s: tuple[float, ...] = _key("time since the epoch, s")
    force_N: tuple[NumberVector, ...] = _key("force, N")
    force_sigma_N: tuple[NumberVector, ...] = _key("1 sigma of the force, N")
    moment_N_m: tuple[NumberVector, ...] = _key("moment about the centre of mass, N m")
    moment_sigma_N_m: tuple[NumberVector, ...] = _key("1 sigma of the moment, N m")


class OnsetContent(Content):
    """Time at which a channel begins to fail."""

    channel: str = _key("channel")
    time_s: float = _key("time since the epoch, s")
    gain: Number = _key("log-likelihood over constant noise, nats")


class LargestIncrementContent(Content):
    """The largest increment of one coefficient of the database, in sigmas of the database."""

    sigmas: Number = _key("increment over the database's own 1 sigma")
    increment: Number = _key("increment, in units of the coefficient")
    sigma: Number = _key("1 sigma of the increment, given the flight")
    mach: Number = _key("Mach number; null in rarefied flow")
    knudsen: Number = _key("Knudsen number based on the diameter; null in continuum flow")
    alpha_deg: float = _key("total angle of attack, deg")


class DatabaseUpdateContent(Content):
    """What the flight says of the aerodynamic database."""

    file: str = _key("name of the file with all increments and their covariance, in the result folder")
    cells: int = _key("number of pairs of a Mach or Knudsen number and an angle")
    largest: dict[str, LargestIncrementContent] = _key("CA, CN and Cm → the largest increment")


class NuisanceContent(Content):
    """A nuisance parameter that the flight moves by more than 2 sigma from what the mission states."""

    name: str = _key("name; the database's increments are database CA, database CN, database Cm")
    sigmas: Number = _key("shift over the stated 1 sigma; where it varies during the flight, the largest")
    value: Number = _key("shift, in unit; relative where that is empty")
    unit: str = _key("unit")


class DiagnosisContent(Content):
    """``diagnosis.json``: where a model fails, which effect is missing, and what remains unexplained."""

    verdict: Literal["clean", "missing", "undecided", "unknown"] = _key("verdict")
    sentence: str = _key("the verdict as text")
    mission: str = _key("name of the mission")
    effects: tuple[str, ...] = _key("labels of the effects in the model")
    where: tuple[MapCell, ...] = _key("cells of the residual map that fail, worst first")
    map: tuple[MapCell, ...] = _key("all cells of the residual map")
    ranking: tuple[RankedHypothesis, ...] = _key("hypotheses, most probable first")
    required_gain: Number = _key("gain that an effect needs to be named, in sample and held out, nats")
    none: Number = _key("probability that nothing is missing")
    none_gain: Number = _key("log evidence of the model at its stated noise, relative to that at its own noise, nats")
    something_else: SomethingElse = _key("the hypothesis that something outside the catalogue is missing")
    screening: dict[str, ScreenedEffect] = _key(
        "label of the effect → result of the screening, all effects that were considered"
    )
    remainder: RemainderContent | None = _key("description of what remains; null unless the verdict is unknown")
    latent: LatentContent | None = _key("unmodelled force and moment; null unless the verdict is unknown")
    onsets: tuple[OnsetContent, ...] = _key("times at which channels begin to fail, clearest first")
    failed: dict[str, str] = _key("effect of a user whose hooks fail → message")
    errors: dict[str, Number] = _key("channel → normalised RMS over the flight")
    noise_floor: float = _key("97.5 % quantile of the normalised RMS of a model that holds")
    database_update: DatabaseUpdateContent | None = _key("increments of the database; null with an exact database")
    nuisances: tuple[NuisanceContent, ...] = _key("nuisance parameters that the flight moves, farthest first")
    settings: DecisionSettings = _key("thresholds of the diagnosis")

    def hypotheses(self) -> dict[str, RankedHypothesis | Alternative]:
        """All ranked effects by label, including those that the flight does not distinguish from another."""
        alternatives = {label: a for h in self.ranking for label, a in h.alternatives.items()}
        return {**alternatives, **{h.label: h for h in self.ranking}}


# ledger.jsonl


class ErrorChange(Content):
    """Normalised RMS of one channel."""

    before: Number = _key("without the added effect")
    after: Number = _key("with it; null where nothing was added, or the channel is no longer compared")


class LedgerStep(Content):
    """A line of ``ledger.jsonl``: an effect that was added."""

    step: int = _key("number of the step, from 0")
    mission: str = _key("name of the mission")
    model: tuple[str, ...] = _key("labels of the effects in the model that was diagnosed")
    added: str = _key("name of the effect that was added")
    imu: str | None = _key("IMU of a sensor effect; null: the driving one, or no sensor effect")
    same_as: tuple[str, ...] = _key("labels of effects that the flight does not distinguish from it")
    parameters: dict[str, Estimate] = _key("parameter → estimate")
    gain: Number = _key("log Bayes factor, nats")
    held_out_score: Number = _key("held-out log predictive density, nats")
    errors: dict[str, ErrorChange] = _key("channel → normalised RMS before and after")

    @property
    def label(self) -> str:
        """Label of the effect that was added: its name, or its name in its IMU."""
        return self.added if self.imu is None else f"{self.added} in {self.imu}"


class LedgerEnd(Content):
    """The last line of ``ledger.jsonl``: nothing was added."""

    step: int = _key("number of the step, from 0")
    mission: str = _key("name of the mission")
    model: tuple[str, ...] = _key("labels of the effects in the final model")
    added: None = _key("null: nothing was added")
    why: str = _key("why the improvement ended")
    errors: dict[str, ErrorChange] = _key("channel → normalised RMS of the final model; after is null")


LedgerLine = LedgerStep | LedgerEnd

#: File → models of its contents; the ledger has two kinds of line.
MODELS: dict[str, tuple[type[Content], ...]] = {
    "summary.json": (Summary,),
    "diagnosis.json": (DiagnosisContent,),
    "ledger.jsonl": (LedgerStep, LedgerEnd),
}


def json_schemas() -> dict[str, dict[str, Any]]:
    """JSON Schema (draft 2020-12) of each file, that of the ledger for one line."""
    dialect = {"$schema": "https://json-schema.org/draft/2020-12/schema"}
    schemas = {
        "summary.json": Summary.model_json_schema(),
        "diagnosis.json": DiagnosisContent.model_json_schema(),
        "ledger.jsonl": TypeAdapter(LedgerLine).json_schema(),
    }
    return {
        file: dialect | {"title": file} | {k: v for k, v in s.items() if k != "title"} for file, s in schemas.items()
    }
