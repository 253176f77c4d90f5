"""Schema of ``summary.json``: the main results of a run, `Summary`."""

from __future__ import annotations

from typing import Literal

from edl_filter.results.schema.fields import Content, Number, NumberVector, key, optional
from edl_filter.telemetry.record import KINDS


class EventState(Content):
    """State at one event; velocities are air-relative."""

    time_s: float = key("time since the epoch, s")
    sclk: Number = optional("spacecraft clock, s; absent without one")
    utc: str = key("UTC, ISO 8601")
    altitude_m: Number = key("areodetic altitude, m")
    altitude_sigma_m: Number = key("1 sigma of the altitude, m")
    height_above_site_m: Number = optional(
        "distance from the planet's centre minus the landing site's, m; absent without a site"
    )
    velocity_m_s: Number = key("air-relative speed, m/s")
    velocity_sigma_m_s: Number = key("1 sigma of the speed, m/s")
    mach: Number = key("Mach number with the preflight atmosphere, in the gas of the mission")
    dynamic_pressure_pa: Number = key("dynamic pressure with the preflight density, Pa")
    flight_path_deg: Number = key("air-relative flight-path angle, deg, positive up")
    alpha_total_deg: Number = key("total angle of attack, deg")
    alpha_total_sigma_deg: Number = key("1 sigma of the total angle of attack, deg")
    acceleration_m_s2: Number = optional(
        "largest axial deceleration, mean of two successive samples, m/s^2; peak_deceleration only"
    )
    acceleration_single_m_s2: Number = optional(
        "largest axial deceleration of one sample, m/s^2; peak_deceleration only"
    )
    east_m: Number = optional("position east of the landing site, m; absent without a site")
    north_m: Number = optional("position north of the landing site, m; absent without a site")
    up_m: Number = optional("position above the landing site, m; absent without a site")
    velocity_east_m_s: Number = optional("velocity relative to the ground, towards east, m/s; absent without a site")
    velocity_north_m_s: Number = optional("velocity relative to the ground, towards north, m/s; absent without a site")
    velocity_up_m_s: Number = optional("velocity relative to the ground, upwards, m/s; absent without a site")


class LeftOutLanding(Content):
    """Leave-one-out prediction of the landing: distance from the site, with the sigmas of prediction and site."""

    miss_m: Number = key("horizontal distance from the site, m")
    sigma_m: Number = key("root of the sum of the horizontal variances, m")
    miss_east_m: Number = key("distance towards east, m")
    sigma_east_m: Number = key("1 sigma of it, m")
    miss_north_m: Number = key("distance towards north, m")
    sigma_north_m: Number = key("1 sigma of it, m")
    miss_up_m: Number = key("distance upwards, m")
    sigma_up_m: Number = key("1 sigma of it, m")
    nis: Number = key("normalised innovation squared")
    dof: int = key("degrees of freedom of nis")


class Landing(Content):
    """Landing position of the trajectory, and its distance from the site."""

    landed: bool = key("whether the vehicle landed within the record; false: the position is that at its end")
    time_s: float = key("time since the epoch, s")
    lat_deg: Number = key("areocentric latitude, deg, north positive")
    lon_deg: Number = key("longitude, deg, east positive, 0 to 360")
    radius_m: Number = key("distance from the planet's centre, m")
    miss_m: Number = key("horizontal distance from the site, m; null without a site or a landing")
    sigma_m: Number = key("root of the sum of the horizontal variances of the trajectory, m")
    miss_east_m: Number = optional("distance from the site towards east, m; absent without a site")
    sigma_east_m: Number = optional("1 sigma of it, m; absent without a site")
    miss_north_m: Number = optional("distance from the site towards north, m; absent without a site")
    sigma_north_m: Number = optional("1 sigma of it, m; absent without a site")
    miss_up_m: Number = optional("distance from the site upwards, m; absent without a site")
    sigma_up_m: Number = optional("1 sigma of it, m; absent without a site")
    site_lat_deg: Number = optional("areocentric latitude of the site, deg, north positive; absent without a site")
    site_lon_deg: Number = optional("longitude of the site, deg, east positive; absent without a site")
    site_radius_m: Number = optional("distance of the site from the planet's centre, m; absent without a site")
    left_out: LeftOutLanding | None = optional(
        "prediction of the landing from all other constraints; absent where the site is no constraint"
    )


class ConstraintSummary(Content):
    """One constraint over all its uses; components have the units that their names state."""

    source: str = key("where the constraint's values come from")
    components: tuple[str, ...] = key("names of the components with their units")
    uses: int = key("number of uses")
    accepted_uses: int = key("number of uses that passed the gate")
    accepted: bool = key("whether all uses passed the gate")
    time_s: float = key("time of the first use since the epoch, s")
    innovation: tuple[Number, ...] = key("measured minus predicted in the forward pass, mean over the uses")
    innovation_sigma: tuple[Number, ...] = key("root mean square of the innovations' 1 sigma")
    nis: Number = key("normalised innovation squared, sum over the uses")
    dof: int = key("degrees of freedom of nis")
    nis_interval_99_9: tuple[float, float] | None = key("interval that contains nis with 99.9 %; null where dof is 0")
    consistent: bool | None = key("whether nis is in the interval; null where dof is 0")
    left_out: tuple[Number, ...] = key("measured minus predicted from all other constraints")
    left_out_sigma: tuple[Number, ...] = key("1 sigma of left_out")
    left_out_nis: Number = key("normalised square of left_out")
    left_out_dof: int = key("degrees of freedom of left_out_nis")
    information_nats: Number = key(
        "information gain over all measurements before it, sum over the uses, nats; null for the entry state"
    )
    left_out_information_nats: Number = key(
        "information gain over all other constraints, nats; a lower bound for the entry state"
    )


class StateEstimate(Content):
    """Estimate of one error state of the entry."""

    estimate: tuple[Number, ...] = key("estimate, in unit")
    sigma: tuple[Number, ...] = key("1 sigma, in unit")
    unit: str = key("unit")


class EntryState(Content):
    """Correction of the entry state, smoothed minus stated, and the rotation of its frame that is nearest to it."""

    position_change_m: NumberVector = key("change of the position, m, inertial axes")
    position_sigma_m: NumberVector = key("1 sigma of the smoothed position, m, inertial axes")
    velocity_change_m_s: NumberVector = key("change of the velocity, m/s, inertial axes")
    velocity_sigma_m_s: NumberVector = key("1 sigma of the smoothed velocity, m/s, inertial axes")
    attitude_change_deg: NumberVector = key("change of the attitude, rotation vector, deg, body axes")
    attitude_sigma_deg: NumberVector = key("1 sigma of the smoothed attitude, deg, body axes")
    rotation_deg: Number = key("angle of the rotation nearest to the change of position and velocity, deg")
    rotation_inertial_deg: NumberVector = key("that rotation as a rotation vector, deg, inertial axes")
    rotation_j2000_deg: NumberVector | None = key(
        "that rotation as a rotation vector, deg, J2000 axes; null where the mission has no J2000 frame"
    )
    rotation_leaves_m: NumberVector = key("change of the position minus that of the rotation, m, inertial axes")
    rotation_leaves_m_s: NumberVector = key("change of the velocity minus that of the rotation, m/s, inertial axes")
    states: dict[str, StateEstimate] = key("estimated errors of the entry epoch and frame, by name")


class ImuFit(Content):
    """Fit of a checking IMU's lateral specific force against the driving one's, along body y and z."""

    start_s: float = key("beginning of the window, s since the epoch")
    end_s: float = key("end of the window, s since the epoch")
    misalignment_deg: tuple[Number, Number] = key("lateral difference per axial force, deg")
    misalignment_sigma_deg: tuple[Number, Number] = key("1 sigma of the misalignment, deg")
    bias_difference_m_s2: tuple[Number, Number] = key("lateral difference without axial force, m/s^2")
    bias_difference_sigma_m_s2: tuple[Number, Number] = key("1 sigma of the bias difference, m/s^2")
    residual_rms_m_s2: tuple[Number, Number] = key("root mean square of the residuals, m/s^2")
    samples: int = key("number of common samples")


class ImuComparison(Content):
    """A checking IMU against the driving one."""

    all: ImuFit = key("over all windows")
    windows: tuple[ImuFit, ...] = key("in each window")


class ImuCalibration(Content):
    """A checking IMU against the driving one by least squares, body axes."""

    start_s: float = key("beginning of the window, s since the epoch")
    end_s: float = key("end of the window, s since the epoch")
    samples: int = key("number of common samples")
    stated_lever_arm_m: NumberVector = key("its position relative to the driving IMU by telemetry or mission, m")
    lever_arm_m: NumberVector = key("the same, estimated, m")
    lever_arm_sigma_m: NumberVector = key("1 sigma of the lever arm, m")
    rate_alignment_deg: NumberVector = key("rotation of its gyros beyond the stated mounting, deg")
    rate_alignment_sigma_deg: NumberVector = key("1 sigma of it, deg")
    force_alignment_deg: NumberVector = key("rotation of its accelerometers beyond the stated mounting, deg")
    force_alignment_sigma_deg: NumberVector = key("1 sigma of it, deg")
    axial_scale: float = key("difference of the accelerometers' scale errors along x")
    axial_scale_sigma: float = key("1 sigma of it")
    force_bias_m_s2: NumberVector = key("difference of the accelerometers' biases, m/s^2")
    force_bias_sigma_m_s2: NumberVector = key("1 sigma of it, m/s^2")
    rate_bias_rad_s: NumberVector = key("difference of the gyros' biases, rad/s")
    rate_bias_sigma_rad_s: NumberVector = key("1 sigma of it, rad/s")
    delay_s: float = key("by how much its readings are late against the driving IMU's, s")
    delay_sigma_s: float = key("1 sigma of the delay, s")
    force_rms_m_s2: NumberVector = key("root mean square of the residuals of the forces, m/s^2")
    rate_rms_rad_s: NumberVector = key("root mean square of the residuals of the rates, rad/s")
    stated_lever_arm_sigma_m: float | None = key("1 sigma of the stated place, m; null where the mission has none")
    stated_alignment_sigma_deg: float | None = key("1 sigma of the stated axes, deg; null where the mission has none")


class PreEntryBias(Content):
    """Accelerometer bias before entry, body axes."""

    slope: NumberVector = key("slope of the velocity before entry (thesis), m/s^2")
    slope_sigma: NumberVector = key("1 sigma of the slope, m/s^2")
    filter: NumberVector | None = optional("the filter's estimate, m/s^2; absent where the bias is no state")
    filter_sigma: NumberVector | None = optional("1 sigma of it, m/s^2; absent where the bias is no state")


class EffectParameter(Content):
    """One parameter of an effect in the model; SI units, angles in rad."""

    estimate: Number = key("estimate, in unit; null where it is infinite, as the end of an effect that does not end")
    sigma: Number = key("1 sigma, in unit; null where the parameter was not refitted")
    unit: str = key("unit")
    start: Number = key("value that the mission states, in unit; null where it is infinite or not stated")


class ModelEffect(Content):
    """One effect in the model."""

    imu: str | None = key("IMU of a sensor effect; null: the driving one, or no sensor effect")
    fixed: bool = key("whether it is held at its values instead of being refitted")
    parameters: dict[str, EffectParameter] = key("parameters by name")


class Domain(Content):
    """The part of the flight in which coefficients are defined."""

    threshold: Number = key("least deceleration, m/s^2")
    start: Number = key("time from which the deceleration stays above it, s since the epoch")
    useful: Number = key("time from which the noise of the force coefficients is below a third of the 3 sigma, s")
    end: Number = key("last time that is used, s since the epoch")


class AngleAgreement(Content):
    """Angle from forces minus angle from moments."""

    mean: Number = key("mean, deg")
    mean_absolute: Number = key("mean of the magnitude, deg")
    rms: Number = key("root mean square, deg")


class AngleAgreements(Content):
    """Angle of attack and sideslip from forces minus those from moments."""

    alpha: AngleAgreement = key("angle of attack")
    beta: AngleAgreement = key("sideslip angle")


class Instabilities(Content):
    """Start and end of the two static instabilities; null where there is none."""

    first: tuple[Number, Number] | None = key("start and end of the first, s since the epoch")
    second: tuple[Number, Number] | None = key("start and end of the second, s since the epoch")


class InstabilitySources(Content):
    """Criterion by which each instability was identified; absent where there is none."""

    first: Literal["database", "alpha_total"] | None = optional("criterion of the first")
    second: Literal["database", "alpha_total"] | None = optional("criterion of the second")


class AverageDifference(Content):
    """Mean difference of coefficients over a window, with the flight's atmosphere (thesis tables 7.1 to 7.6)."""

    window: str = key("name of the window")
    coefficient: str = key("CN, CY, Cl, Cm or Cn")
    pair: str = key("what minus what: IMU is the database at the reconstructed angles, accels and gyros the flight")
    mean: Number = key("mean of the difference")
    mean_sigma: Number = key("1 sigma of the mean")
    rms: Number = key("root mean square of the difference")
    three_sigma: Number = key("the database's 3 sigma, mean over the window")
    percent: Number = key("mean in percent of three_sigma")
    samples: int = key("number of samples in the mean")


class Smoothing(Content):
    """Smoothing of forces and rates at the end of the domain."""

    batch_points: int = key("samples in a batch of the second-order polynomial")
    low_pass_hz: Number = key("half-power frequency of one pass of the low-pass before the batches, Hz; null: none")
    bandwidth_hz: Number = key("frequency at which forces and rates pass half the power, Hz")
    acceleration_bandwidth_hz: Number = key("the same of the angular acceleration, Hz")


class PostflightSummary(Content):
    """Main results of the post-flight layer."""

    domain_s: Domain = key("part of the flight in which coefficients are defined")
    smoothing: Smoothing | None = optional("smoothing of forces and rates")
    mach_times_s: dict[str, Number] = key("Mach number → last time at which the flight falls below it, s")
    instabilities_s: Instabilities = key("intervals of the static instabilities, s since the epoch")
    instabilities_found_by: InstabilitySources = key("criterion by which each instability was identified")
    rolling_moment_coefficient_110_140_s: Number = key("mean Cl between 110 and 140 s")
    force_less_moment_angle_last_20_s_deg: AngleAgreements = key(
        "angles from forces minus angles from moments over the last 20 s, deg"
    )
    averages: tuple[AverageDifference, ...] = key("average differences by window, coefficient and pair")
    verdicts: tuple[str, ...] = key("judgement of the database's uncertainty, one sentence per window and coefficient")


class GasSummary(Content):
    """Gas in which Mach numbers, Knudsen numbers and temperatures are meant."""

    name: str = key("name: thesis, Martian air, mixture or stated constants")
    constant: Number = key("specific gas constant, J/(kg K)")
    heat_capacity_ratio_200_k: Number = key("ratio of specific heats at 200 K")
    heat_capacity_ratio_300_k: Number = key("ratio of specific heats at 300 K")
    description: str = key("all this in words, with the composition")


class SampleFindingSummary(Content):
    """Missing or bad samples of one IMU, and what was done about them."""

    imu: str = key("name of the IMU")
    channel: str = key("force or rate, with the axis of the IMU where one is at fault; all: both triads")
    start_s: float = key("beginning of the first sample, s since the epoch")
    end_s: float = key("end of the last sample, s since the epoch")
    samples: int = key("number of samples")
    kind: str = key(f"one of {', '.join(KINDS)}")
    repair: str = key("what was done")


class CauseSummary(Content):
    """One hypothesis on why the measurements contradict the reconstruction."""

    kind: Literal["units", "axes", "sign", "clock", "gap", "entry_state", "process_noise", "measurement"] = key(
        "kind of the fault"
    )
    sentence: str = key("what is wrong")
    gain: Number = key("gain in log likelihood of the constraints with its repair, nats")
    consistent: bool = key("whether no constraint is rejected with its repair")


class RecoverySummary(Content):
    """A contradiction between the filter's state and its measurements, and what was added to the model since."""

    time_s: float = key("time of the contradiction, s since the epoch")
    constraints: tuple[str, ...] = key("names of the constraints that contradict the state")
    readings: int = key("number of their readings that agree with each other")
    nis: Number = key("normalised innovation squared of these readings")
    free_nis: Number = key("the same with position and velocity unknown; 0 where each constraint is used once")
    directions: int = key("degrees of freedom of nis - free_nis")
    cause: Literal["gap", "entry_state", "process_noise"] | None = key(
        "what has more noise: samples in place of lost ones, the entry state, or all samples before the contradiction; "
        "null: nothing removes the contradiction"
    )
    size: Number = key(
        "share of the variation of force and rate that was added to the samples, or factor of the entry state's sigmas "
        "or of those of filled samples (where they have any)"
    )
    force_noise_m_s2: Number = key("noise added to the specific force of one sample, rms of those changed, m/s^2")
    rate_noise_rad_s: Number = key("noise added to the angular rate of one sample, rms of those changed, rad/s")
    start_s: Number = key("first time that has it, s since the epoch; null where nothing was added")
    end_s: Number = key("last time that has it, s since the epoch; null where nothing was added")
    gain_nats: Number = key("change of the log likelihood of the constraints, nats")


class FilterSummary(Content):
    """Settings of the filter, as the section ``filter`` of a mission states them."""

    alpha: float = key("spread of the sigma points")
    beta: float = key("shape of the prior; 2: Gaussian")
    kappa: float = key("secondary spread of the sigma points")
    longest_interval: float = key("longest time between fusion epochs, s")
    gate_probability: float = key("probability with which a good measurement passes its gate")
    method: str = key("ukf: unscented Kalman filter; ekf: extended")
    robust: str = key("update with a measurement: none (Gaussian), huber or student_t")
    engine: str = key("implementation of the unscented filter and the smoother: compiled or filterpy")


class Summary(Content):
    """``summary.json``: the main results of a run."""

    trustworthy: bool = key(
        "false: landing, rest or most altimeter readings were rejected, or the state contradicted its measurements and "
        "no lost samples explain it (exit code 3)"
    )
    headline: str | None = key("why the result is not trustworthy, with the likeliest cause; null where it is")
    causes: tuple[CauseSummary, ...] = key("likeliest causes, consistent ones first; empty where it is trustworthy")
    recovery: RecoverySummary | None = key(
        "contradiction of state and measurements that the filter has met; null where there was none"
    )
    mission: str = key("name of the mission")
    title: str = key("name for people")
    edl_filter_version: str = key("version of the program")
    epoch_utc: str = key("UTC of the epoch, ISO 8601")
    filter: FilterSummary | None = optional("settings of the filter")
    gas: GasSummary | None = optional("gas of the atmosphere")
    events: dict[str, EventState] = key("state at every event, by name, in order of time")
    landing: Landing = key("landing position and its distance from the site")
    constraints: dict[str, ConstraintSummary] = key("constraints by name")
    entry_state: EntryState = key("correction of the entry state")
    imu_comparison: dict[str, ImuComparison] = key(
        "checking IMUs against the driving one by the thesis's projection of the axial force, by name"
    )
    imu_calibration: dict[str, ImuCalibration] = key("checking IMUs against the driving one, by name")
    pre_entry_bias_m_s2: PreEntryBias | None = key("accelerometer bias before entry; null where it is not estimated")
    residuals: dict[str, dict[str, Number]] = key(
        "channel → overall and every flow regime, constraint → overall → normalised RMS of measured minus predicted by "
        "the model, the same numbers as in diagnosis.json; empty unless the run refits or keeps effects, since only a "
        "diagnosis computes them otherwise"
    )
    innovation_rms: dict[str, dict[str, Number]] = key(
        "constraint → component with its unit → normalised RMS of the navigation filter's innovations, 1 where they "
        "have their predicted sigma; the model's prediction has no part in it"
    )
    postflight: PostflightSummary | None = key("post-flight layer; null without an aerodynamic database")
    effects: dict[str, ModelEffect] = key(
        "label of each effect in the model (its name, or its name in its IMU) → its parameters"
    )
    sample_findings: tuple[SampleFindingSummary, ...] = key(
        "missing and bad samples of the IMUs, and how they were repaired, in order of time", default=()
    )
    notes: tuple[str, ...] = key("notes of the telemetry's reader")
    timing_s: dict[str, float] = key("stage → elapsed time, s")
