"""Settings of the diagnosis: every threshold on which a ranking or a verdict depends, with its reason and its source.

They stand under ``diagnosis:`` in a mission and are recorded whole in ``diagnosis.json``, so that a ranking can be
reproduced and its sensitivity to each of them studied (``make study-thresholds``).
"""

from __future__ import annotations

from typing import Annotated, Any

from pydantic import Field

from edl_filter.mission.fields import Section
from edl_filter.mission.validators import Number, Within

#: Sources of the values.
CHANCE = "quantile of the normal or chi-square distribution"
EVIDENCE = "scale of evidence of Kass and Raftery, JASA 90 (1995) 773"
NUMERICS = "convergence of the computation on simulated flights"
STUDY = "study of simulated flights (docs/identification.md)"

Positive = Annotated[Number, Within("", 0.0, 1e4, above=True)]


def _setting(default: Any, description: str, source: str) -> Any:
    """A field with its default, unit and reason, and the source of the value."""
    return Field(default=default, description=description, json_schema_extra={"source": source})


class DecisionSettings(Section):
    """Thresholds of the diagnosis."""

    # prediction
    bin_length_s: Annotated[Number, Within("s", 0.0, 2.0, above=True)] = _setting(
        0.1,
        "s: length that time bins approach; ten in a period of 1 Hz, the fastest oscillation of a blunt body",
        NUMERICS,
    )
    excluded_end_bins: Annotated[int, Field(strict=True, ge=0, le=100)] = _setting(
        3, "bins at both ends that are not compared: interpolation has neighbours on one side only", NUMERICS
    )
    parachute_margin_s: Annotated[Number, Within("s", 0.0, 60.0)] = _setting(
        0.3, "s before the parachute that are not compared: the mortar's recoil and samples that contain it", STUDY
    )
    linear_attitude_sigma_rad: Annotated[Number, Within("rad", 0.0, 3.0, above=True)] = _setting(
        0.05,
        "rad: 1 sigma of the attitude's error by filled rates from which constraints are not compared: a linear model "
        "of twice this error is wrong by 0.5 % of the velocity that is gained afterwards",
        NUMERICS,
    )

    # nuisance parameters
    discrepancy_range: Annotated[Number, Within("", 1.0, 100.0, above=True)] = _setting(
        4.0,
        "factor up and down within which scale and correlation lengths of the database's error are estimated: the "
        "increments of Spirit's proxy table reach five sigmas",
        STUDY,
    )
    discrepancy_sigma: Annotated[Number, Within("", 0.0, 10.0, above=True)] = _setting(
        0.7, "1 sigma of the prior of its logarithm: a factor of two", STUDY
    )
    minimum_density_sigma: Annotated[Number, Within("", 0.0, 0.1, above=True)] = _setting(
        0.0001, "least relative sigma of the preflight density, for a regular covariance", NUMERICS
    )
    numerical_error_memory_s: Annotated[Number, Within("s", 0.0, 10000.0, above=True)] = _setting(
        20.0, "s: correlation time of the prediction's numerical error", STUDY
    )
    relative_prediction_error: Annotated[Number, Within("", 0.0, 0.1, above=True)] = _setting(
        0.0002, "relative sigma of a prediction from exact tables: sampling, interpolation, small angles", NUMERICS
    )

    # excess variance
    noise_piece_s: Annotated[Number, Within("s", 0.0, 1000.0, above=True)] = _setting(
        10.0, "s: length of the intervals in which a channel's excess variance is estimated", STUDY
    )
    excess_variance_sigmas: Annotated[Number, Within("", 0.0, 20.0, above=True)] = _setting(
        4.0,
        "sigmas of chance beyond which the mean square of an interval is excessive: about 100 intervals are tested",
        CHANCE,
    )
    excess_memories_s: Annotated[tuple[Positive, ...], Field(min_length=1)] = _setting(
        (0.1, 0.2, 0.4, 0.8, 1.6, 3.2, 6.4, 12.8, 25.6),
        "s: correlation times of the excess variance that are compared with white noise; in the ratio of the factors, "
        "since the likelihood has a ridge where both increase together",
        STUDY,
    )
    excess_colour_factors: Annotated[tuple[Positive, ...], Field(min_length=1)] = _setting(
        (0.5, 1.0, 2.0, 4.0, 8.0), "factors on the white excess variance that are tried where it is correlated", STUDY
    )
    variance_iterations: Annotated[int, Field(strict=True, ge=1, le=100)] = _setting(
        10, "largest number of iterations of the variances", NUMERICS
    )
    variance_convergence_nats: Annotated[Number, Within("nats", 0.0, 100.0, above=True)] = _setting(
        2.0, "nats: gain in likelihood below which the iteration of the variances ends", NUMERICS
    )
    variance_convergence_share: Annotated[Number, Within("", 0.0, 0.1)] = _setting(
        1e-4,
        "the same as a share of the gain over the stated noise: where a model fails by a million nats, its noise need "
        "not be known to one",
        NUMERICS,
    )
    variance_step_power: Annotated[Number, Within("", 1.0, 3.0)] = _setting(
        1.5, "power of the ratio by which a variance is multiplied where no secant is known", NUMERICS
    )
    variance_step_power_max: Annotated[Number, Within("", 1.0, 6.0)] = _setting(
        3.0, "largest power: larger ones were seen to oscillate", NUMERICS
    )
    negligible_variance_share: Annotated[Number, Within("", 0.0, 0.1, above=True)] = _setting(
        1e-06, "share of a residual's variance, all others given, that counts as none", NUMERICS
    )
    holds_share: Annotated[Number, Within("", 0.0, 1.0)] = _setting(
        0.02, "share of the rows that may have excess variance where a model holds", STUDY
    )

    # unmodelled acceleration
    unmodelled_memories_s: Annotated[tuple[Positive, ...], Field(min_length=1)] = _setting(
        (0.5, 10.0), "s: correlation times that are tried, within an oscillation and over many", STUDY
    )
    unmodelled_forces: Annotated[tuple[Positive, ...], Field(min_length=1)] = _setting(
        (0.003, 0.03, 0.3),
        "m/s^2: amplitudes of the specific force that are tried, from the accelerometers' noise up",
        STUDY,
    )
    unmodelled_moments: Annotated[tuple[Positive, ...], Field(min_length=1)] = _setting(
        (0.001, 0.01, 0.1), "rad/s^2: amplitudes of the angular acceleration that are tried", STUDY
    )
    unmodelled_factors: Annotated[tuple[Positive, ...], Field(min_length=1)] = _setting(
        (0.0001, 0.001, 0.01, 0.1, 1.0),
        "SI: amplitudes that are tried of the factor between rate or angle of attack and force or moment",
        STUDY,
    )
    unmodelled_factor_memories_s: Annotated[tuple[Positive, ...], Field(min_length=1)] = _setting(
        (20.0,), "s: correlation times of this factor that are tried, many oscillations", STUDY
    )
    unmodelled_force_drifts: Annotated[tuple[Positive, ...], Field(min_length=1)] = _setting(
        (0.0001, 0.001, 0.01, 0.1), "m/s^2: amplitudes that are tried of a drift of one IMU's accelerometers", STUDY
    )
    unmodelled_rate_drifts: Annotated[tuple[Positive, ...], Field(min_length=1)] = _setting(
        (1e-06, 1e-05, 0.0001, 0.001), "rad/s: amplitudes that are tried of a drift of one IMU's gyros", STUDY
    )
    unmodelled_drift_memories_s: Annotated[tuple[Positive, ...], Field(min_length=1)] = _setting(
        (60.0,), "s: correlation times of this drift that are tried", STUDY
    )

    # linearisation point
    linearization_iterations: Annotated[int, Field(strict=True, ge=1, le=20)] = _setting(
        6, "largest number of linearisation points of the model that is diagnosed", NUMERICS
    )
    iterated_excess_share: Annotated[Number, Within("", 0.0, 1.0)] = _setting(
        0.2,
        "share of the rows with excess variance beyond which the point is not moved: a wrong model moves it away",
        STUDY,
    )
    linearization_tolerance_sigmas: Annotated[Number, Within("", 0.0, 10.0, above=True)] = _setting(
        0.1, "sigmas: change of the point at which it has converged", NUMERICS
    )
    linearization_convergence_nats: Annotated[Number, Within("nats", -100.0, 100.0)] = _setting(
        2.0, "nats: gain in likelihood below which the point has converged", NUMERICS
    )
    state_limit_sigmas: Annotated[Number, Within("", 1.0, 1000000.0, above=True)] = _setting(
        100.0, "sigmas of what is stated beyond which a point is not credible", STUDY
    )
    log_density_limit: Annotated[Number, Within("", 0.0, 10.0, above=True)] = _setting(
        0.9, "log of the density's factor beyond which a point is not credible", STUDY
    )
    alternative_iterations: Annotated[int, Field(strict=True, ge=1, le=20)] = _setting(
        4, "linearisation points at which a failing model may come to hold", NUMERICS
    )
    alternative_progress: Annotated[Number, Within("", 0.0, 1.0, above=True)] = _setting(
        0.8, "share of the excess variance that an iteration towards that point may leave", NUMERICS
    )
    least_progress: Annotated[Number, Within("", 0.0, 1.0)] = _setting(
        0.02,
        "share of the log-likelihood between a failing model and one that holds that an effect must gain about its own "
        "reconstruction; otherwise it is not iterated",
        NUMERICS,
    )
    credible_nuisance_sigmas: Annotated[Number, Within("", 0.0, 100.0, above=True)] = _setting(
        5.0, "sigmas by which a nuisance parameter may credibly be off: 6e-7 by chance", CHANCE
    )

    # screening
    scan_start_pressure_pa: Annotated[Number, Within("Pa", 0.0, 1000.0, above=True)] = _setting(
        1.0,
        "Pa: dynamic pressure from which times are scanned: the deceleration, about 0.01 m/s^2, exceeds the noise",
        STUDY,
    )
    altitude_scan_top_m: Annotated[Number, Within("m", 0.0, 200000.0, above=True)] = _setting(
        70000.0, "m: altitude above which no layer is scanned, the air being too thin", STUDY
    )
    altitude_scan_below_m: Annotated[Number, Within("m", 0.0, 50000.0)] = _setting(
        3000.0, "m below the end of the comparison at which the scan of altitudes begins", STUDY
    )
    shortlist_size: Annotated[int, Field(strict=True, ge=1, le=50)] = _setting(
        4, "leading effects of each screening that are fitted", STUDY
    )
    starting_places: Annotated[int, Field(strict=True, ge=1, le=50)] = _setting(
        3, "dissimilar places from which a fit starts", STUDY
    )
    distinct_correlation: Annotated[Number, Within("", 0.0, 1.0, above=True)] = _setting(
        0.7, "correlation of explained residuals below which two places or two effects are dissimilar", STUDY
    )
    minimum_screening_gain: Annotated[Number, Within("nats", -100.0, 100.0)] = _setting(
        0.0, "nats: linear gain that an effect must exceed to be fitted", EVIDENCE
    )
    place_refinements: Annotated[int, Field(strict=True, ge=0, le=30)] = _setting(
        6, "halvings of the scan grid's spacing before a fit", NUMERICS
    )
    altitude_step_m: Annotated[Number, Within("m", 0.0, 50000.0, above=True)] = _setting(
        4000.0, "m: spacing of altitudes before the first halving", NUMERICS
    )

    # fits
    fit_iterations: Annotated[int, Field(strict=True, ge=1, le=100)] = _setting(
        12, "largest number of Gauss-Newton steps of a final fit", NUMERICS
    )
    comparison_fit_iterations: Annotated[int, Field(strict=True, ge=1, le=100)] = _setting(
        6, "the same while effects are compared", NUMERICS
    )
    polish_fit_iterations: Annotated[int, Field(strict=True, ge=1, le=100)] = _setting(
        3, "the same at another noise", NUMERICS
    )
    null_fit_iterations: Annotated[int, Field(strict=True, ge=1, le=100)] = _setting(
        3, "the same for the model without a further effect, whose effects were fitted when added", NUMERICS
    )
    shortest_step: Annotated[Number, Within("", 0.0, 1.0, above=True, below=True)] = _setting(
        0.02, "part of a Gauss-Newton step that is not shortened", NUMERICS
    )
    nuisance_iterations: Annotated[int, Field(strict=True, ge=1, le=20)] = _setting(
        4, "linearisation points at each value of the effects", NUMERICS
    )
    fit_convergence_nats: Annotated[Number, Within("nats", 0.0, 10.0, above=True)] = _setting(
        0.05, "nats: gain below which a fit has converged", NUMERICS
    )
    time_scan_step_s: Annotated[Number, Within("s", 0.0, 10.0, above=True)] = _setting(
        0.1,
        "s: step of the scan of a fitted time where the model still fails, no longer than a time bin of the flights",
        NUMERICS,
    )
    outer_iterations: Annotated[int, Field(strict=True, ge=1, le=20)] = _setting(
        3, "largest number of reconstructions about which effects are fitted", NUMERICS
    )
    outer_tolerance_sigmas: Annotated[Number, Within("", 0.0, 10.0, above=True)] = _setting(
        0.3, "sigmas: change of a parameter from one reconstruction to the next at which it has converged", NUMERICS
    )

    # hypotheses
    solved_share: Annotated[Number, Within("", 0.0, 1.0, above=True)] = _setting(
        0.1, "share of the model's excess variance below which an effect has explained it", STUDY
    )
    promising_share: Annotated[Number, Within("", 0.0, 1.0, above=True)] = _setting(
        0.7, "the same by moments, above which the noise that an effect leaves is not estimated", STUDY
    )
    rival_gain_share: Annotated[Number, Within("", 0.0, 1.0)] = _setting(
        0.25, "share of the leader's gain from which another effect is fitted about its own reconstruction", STUDY
    )
    relinearized_hypotheses: Annotated[int, Field(strict=True, ge=1, le=50)] = _setting(
        3, "effects that are fitted about their own reconstruction", STUDY
    )
    held_out_block_s: Annotated[Number, Within("s", 0.0, 1000.0, above=True)] = _setting(
        5.0, "s: length of the blocks that are held out, several oscillations", STUDY
    )
    held_out_folds: Annotated[int, Field(strict=True, ge=2, le=100)] = _setting(
        5, "folds of the cross-validation", "Hastie et al. (2009), section 7.10"
    )

    # decision
    named_gain_nats: Annotated[Number, Within("nats", 0.0, 100.0)] = _setting(
        6.0,
        "nats: prior cost of an effect and gain from which it is detectable: odds of 400 to 1",
        EVIDENCE,
    )
    named_gain_in_excess_noise_nats: Annotated[Number, Within("nats", 0.0, 200.0)] = _setting(
        25.0, "nats: the same where the noise is not what is stated and its form not known", STUDY
    )
    approximation_error: Annotated[Number, Within("", 0.0, 0.5)] = _setting(
        0.02, "share of flights in which the linearised evidence is wrong: divided equally among the hypotheses", STUDY
    )
    decided_probability: Annotated[Number, Within("", 0.5, 1.0)] = _setting(
        0.8, "probability from which a verdict is given; below it, the verdict is undecided", STUDY
    )
    named_explained_share: Annotated[Number, Within("", 0.0, 1.0)] = _setting(
        0.4,
        "share of the log-likelihood between a failing model and one that holds below which a second effect must leave "
        "hardly any excess variance; above it, one that explains `sufficient_share` of the rest is sufficient: the "
        "first of two hidden effects explains about a half or more",
        STUDY,
    )
    complemented_explained_share: Annotated[Number, Within("", 0.0, 1.0)] = _setting(
        0.2,
        "the same share from which a second effect is sought: of two effects in the same cells each explains less than "
        "a half, since the other one's excess noise remains there",
        STUDY,
    )
    sufficient_share: Annotated[Number, Within("", 0.0, 1.0)] = _setting(
        0.9,
        "the same share below which a leading effect needs a second one that explains as much of what it leaves: "
        "correct leading effects of two explained 0.51 to 0.97, and incorrect ones up to 0.40, and 0.83 once",
        STUDY,
    )
    explained_share_shape: Annotated[Number, Within("", 1.0, 1000.0)] = _setting(
        10.0,
        "shape k of the distribution Beta(k, 1) of that share for a correct leading effect without a second one; that "
        "of an incorrect effect is uniform. The maximum-likelihood estimate of k from 81 correct effects of a study, "
        "whose least share was 0.87, is 230; a smaller k allows for three missing effects, of which one explains less",
        STUDY,
    )
    excess_noise_nats: Annotated[Number, Within("nats", 0.0, 200.0)] = _setting(
        10.0,
        "nats: prior cost of noise that is larger than stated; with as much evidence it is as probable as not",
        EVIDENCE,
    )
    same_correlation: Annotated[Number, Within("", 0.0, 1.0, above=True)] = _setting(
        0.9,
        "correlation of explained residuals from which two names are one hypothesis",
        "Klein and Morelli (2006), section 5.5",
    )
    separable_gain_nats: Annotated[Number, Within("nats", 0.0, 100.0)] = _setting(
        6.0, "nats: evidence that distinguishes two names", EVIDENCE
    )
    constraint_improvement: Annotated[Number, Within("", 1.0, 10000.0, above=True)] = _setting(
        10.0, "factor by which a constraint is improved to see what it would distinguish", STUDY
    )

    # residual map and remainder
    cell_fails_sigmas: Annotated[Number, Within("", 0.0, 30.0, above=True)] = _setting(
        5.0, "sigmas of chance beyond which a cell of the residual map fails", CHANCE
    )
    cell_minimum_rms: Annotated[Number, Within("", 1.0, 10.0)] = _setting(
        1.1, "normalised RMS that a failing cell exceeds: a tenth more than the noise", STUDY
    )
    abrupt_changes: Annotated[int, Field(strict=True, ge=0, le=100)] = _setting(
        8,
        "times of the largest innovations at which an effect that begins at a time is screened as well as on its scan",
        NUMERICS,
    )
    abrupt_change_spacing_s: Annotated[Number, Within("s", 0.0, 100.0, above=True)] = _setting(
        2.0, "s: least distance between two of these times, within which innovations follow one change", NUMERICS
    )
    onset_samples: Annotated[int, Field(strict=True, ge=2, le=1000)] = _setting(
        10, "samples on either side of a change point", NUMERICS
    )
    onset_nats: Annotated[Number, Within("nats", 0.0, 200.0)] = _setting(
        12.0, "nats: evidence that a change point needs, some hundred times being tried", EVIDENCE
    )
    unexplained_piece_s: Annotated[Number, Within("s", 0.0, 100.0, above=True)] = _setting(
        2.5, "s: length of the pieces in which the remainder is tested", STUDY
    )
    line_power_share: Annotated[Number, Within("", 0.0, 1.0, above=True)] = _setting(
        0.3, "share of the power in one spectral line from which the remainder oscillates", STUDY
    )
    line_cycles: Annotated[Number, Within("", 0.0, 100.0, above=True)] = _setting(
        3.0, "cycles within the span from which a line is not a trend", STUDY
    )
    follows_correlation: Annotated[Number, Within("", 0.0, 1.0, above=True)] = _setting(
        0.5, "correlation from which the remainder follows a quantity", STUDY
    )

    # forward selection
    max_effects: Annotated[int, Field(strict=True, ge=1, le=100)] = _setting(
        12, "effects at which forward selection ends, for a person to judge", STUDY
    )
