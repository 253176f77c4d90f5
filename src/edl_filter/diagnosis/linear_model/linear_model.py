"""The linearised model of a flight: residuals, Jacobians and noise about one point."""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np

from edl_filter.diagnosis.jacobians.nuisance import NuisanceLayout
from edl_filter.diagnosis.jacobians.prediction_jacobian import PredictionJacobian
from edl_filter.diagnosis.jacobians.state_space import stated_initial_error
from edl_filter.diagnosis.linear_model.flight_case import FlightCase
from edl_filter.diagnosis.linear_model.linearization_point import (
    LinearizationPoint,
    deviation_offset,
    distance_from_stated,
    nuisance_offset,
)
from edl_filter.diagnosis.noise.excess_colour import (
    ExcessColour,
    colour_penalty,
    filter_at_excess,
    most_likely_colour,
)
from edl_filter.diagnosis.noise.unmodelled_acceleration import UnmodelledAcceleration, augment
from edl_filter.diagnosis.noise.variance_components import (
    ColourPlaces,
    ExcessVariance,
    add_variance,
    estimate_variance_components,
)
from edl_filter.diagnosis.prediction.residuals import (
    ModelInputs,
    PathReference,
    Residuals,
    RowIndex,
    compute_residuals,
    with_predictions,
)
from edl_filter.diagnosis.prediction.time_bins import TimeBins
from edl_filter.effects.base import EffectInstance, model_effects
from edl_filter.effects.perturbation import CoefficientUnits, FieldPerturbation
from edl_filter.estimation.kalman import Whitening, WhiteningFilter, whitening_filter
from edl_filter.estimation.linear_state_space import LinearStateSpace
from edl_filter.mission.decision_settings import DecisionSettings
from edl_filter.types import Array, IntArray


@dataclass(frozen=True)
class LinearizedModel:
    """Residuals and state-space model about a linearisation point.

    Attributes
    ----------
    case : FlightCase
    effects : tuple of EffectInstance
        In the model.
    point : LinearizationPoint
    reference : PathReference
    inputs : ModelInputs
    residuals : Residuals
    jacobian : PredictionJacobian
    index : RowIndex
    nuisance : NuisanceLayout
    units : CoefficientUnits
        One sigma of the coefficients' numerical errors.
    field : FieldPerturbation or None
        Modes and one sigma of the database's discrepancy; None with an exact database.
    state_space : LinearStateSpace
        At the stated noise; the constant nuisance parameters are its last states.
    constant_columns : (R, c) array
        Derivatives of the predictions with respect to the constant nuisance parameters.
    initial_excess : ExcessVariance or None
        Start of the estimation of the excess variance: `failing_excess` of a similar model.
    computed_jacobians : dict
        Jacobians of effects about the point that `effect_jacobian` has computed; shared by the models about it.
    """

    case: FlightCase
    effects: tuple[EffectInstance, ...]
    point: LinearizationPoint
    reference: PathReference
    inputs: ModelInputs
    residuals: Residuals
    jacobian: PredictionJacobian
    index: RowIndex
    nuisance: NuisanceLayout
    units: CoefficientUnits
    field: FieldPerturbation | None
    state_space: LinearStateSpace
    constant_columns: Array
    initial_excess: ExcessVariance | None = None
    computed_jacobians: dict[Any, tuple[Array, Array]] = dataclasses.field(
        default_factory=dict, repr=False, compare=False
    )

    @property
    def bins(self) -> TimeBins:
        """The time bins."""
        return self.case.bins

    @property
    def settings(self) -> DecisionSettings:
        """Thresholds of the diagnosis."""
        return self.case.settings

    def model_inputs(self, effects: Sequence[EffectInstance]) -> ModelInputs:
        """Model and measurements with other effects, at the point's nuisance parameters."""
        return perturbed(self.case.model_inputs((*effects, *self.point.constants)), self.point)

    def denoised_inputs(self, effects: Sequence[EffectInstance]) -> ModelInputs:
        """The same with denoised readings."""
        return perturbed(self.case.denoised_inputs((*effects, *self.point.constants)), self.point)

    def initial_mean_of(self, inputs: ModelInputs) -> Array:
        """What inputs state of the states at the beginning, as an error about the point ``(n,)``."""
        out = np.zeros(self.nuisance.size)
        out[: inputs.problem.layout.size] = stated_initial_error(inputs, self.point.start)
        return out

    @cached_property
    def residual_vector(self) -> Array:
        """Residuals ``(R,)``, the point's nuisance parameters and errors of the path added to them again."""
        residuals = self.index.stack(self.residuals) + self.constant_columns @ self.constant_values
        if self.point.bin_states is not None:
            residuals = residuals + nuisance_offset(self.index, self.state_space.design, self.point.bin_states)
        if self.point.deviation is not None:
            residuals = residuals + deviation_offset(self.index, self.bins, self.jacobian, self.point.deviation)
        return residuals

    @property
    def constant_values(self) -> Array:
        """Constant nuisance parameters at the point ``(c,)``."""
        pairs = zip(self.point.constants, self.case.constants, strict=True)
        return np.array([instance.values[name] for instance, stated in pairs for name in stated.sigma], float)

    @cached_property
    def initial_mean(self) -> Array:
        """What the mission states of the states at the beginning, as an error about the point ``(n,)``."""
        return self.initial_mean_of(self.inputs)

    def with_effects(self, effects: Sequence[EffectInstance]) -> LinearizedModel:
        """The same Jacobians about the same point, with the residuals of other effects.

        Only what the changed effects act on is computed again.
        """
        before = self.effects
        changed = [a for a in (*before, *effects) if not (a.is_zero or (a in before and a in effects))]
        if any(a.effect.changes_path for a in changed):
            inputs = self.model_inputs(effects)
            residuals = compute_residuals(self.reference, inputs)
        else:
            acting = model_effects((*effects, *self.point.constants))
            inputs = replace(self.inputs, forward_model=self.inputs.forward_model.with_effects(acting))
            changed_air = any(a.effect.changes_air for a in changed)
            residuals = with_predictions(self.residuals, self.bins, inputs.forward_model, changed_air)
        return replace(self, effects=tuple(effects), inputs=inputs, residuals=residuals)

    def at_point(self, point: LinearizationPoint, effects: Sequence[EffectInstance]) -> LinearizedModel:
        """The same Jacobians with the residuals about another point and with other effects."""
        reference = replace(self.reference, start=point.start.nav[:10], errors=point.errors, deviation=point.deviation)
        displaced = replace(self, effects=tuple(effects), reference=reference, point=point, computed_jacobians={})
        inputs = displaced.model_inputs(effects)
        return replace(displaced, inputs=inputs, residuals=compute_residuals(reference, inputs))

    @cached_property
    def stated_noise_filter(self) -> WhiteningFilter:
        """Whitening filter at the stated noise."""
        return whitening_filter(self.state_space)

    @cached_property
    def excess_variance(self) -> ExcessVariance:
        """Variance of the residuals beyond the stated noise."""
        excess, whiten = estimate_variance_components(
            self.stated_noise_filter,
            self.index,
            self.residual_vector,
            self.initial_mean,
            self.settings,
            self.initial_excess,
        )
        self.__dict__["white_excess_filter"] = whiten  # the estimation ends with it
        return excess

    @cached_property
    def white_excess_filter(self) -> WhiteningFilter:
        """Whitening filter with the excess variance as white noise."""
        excess = self.excess_variance
        if "white_excess_filter" in self.__dict__:
            return self.__dict__["white_excess_filter"]
        if excess.is_zero:
            return self.stated_noise_filter
        return whitening_filter(add_variance(self.state_space, self.index, excess))

    def release_filters(self) -> None:
        """Drop the filters, which have tens of megabytes each.

        What was estimated with them is kept, so that a filter is computed again by one run of the covariance recursion.
        """
        for name in ("stated_noise_filter", "white_excess_filter", "fitted_noise_filter"):
            self.__dict__.pop(name, None)

    def release(self) -> None:
        """Drop the filters, and the Jacobians of effects about the point: of a model that is set aside."""
        self.release_filters()
        self.computed_jacobians.clear()

    @cached_property
    def stated_noise_sigma(self) -> Array:
        """Standard deviation of each innovation at the stated noise ``(R,)``."""
        return self.stated_noise_filter.innovation_sigma

    @cached_property
    def white_excess_log_likelihood(self) -> float:
        """Log marginal likelihood of the residuals with white excess variance, nats."""
        whiten = self.white_excess_filter
        return whiten.log_likelihood(self.white_residuals(whiten))

    @property
    def white_excess_log_evidence(self) -> float:
        """The same less the penalty of the excess variance, nats, by which linearisation points are compared."""
        return self.white_excess_log_likelihood - self.excess_variance.penalty

    @property
    def holding_log_likelihood(self) -> float:
        """Log marginal likelihood expected at the stated noise of a model that holds, nats.

        The mean square of the white residuals is taken from the rows without excess variance, at most one: the stated
        noise is an upper bound where numerical errors are smaller than allowed for.
        """
        stated, excess = self.stated_noise_filter, self.excess_variance
        white = self.white_residuals(self.white_excess_filter)[~excess.significant]
        mean_square = min(float(np.mean(white**2)), 1.0) if len(white) else 1.0
        return -0.5 * mean_square * len(self.residual_vector) - 0.5 * stated.log_determinant

    @cached_property
    def excess_colour(self) -> ExcessColour | None:
        """Most likely correlation of the excess variance in time; None without excess variance."""
        similar, likelihood = self._places_of_colour, self.white_excess_log_likelihood
        if not self.excess_variance.is_zero:  # the filter at white excess variance would be kept with the fitted one
            self.__dict__.pop("white_excess_filter", None)
        return most_likely_colour(
            likelihood, self.state_space, self.index, self.excess_variance, self.residual_vector, self.initial_mean,
            self.settings, similar,
        )  # fmt: skip

    @cached_property
    def fitted_noise_filter(self) -> WhiteningFilter:
        """Whitening filter at the noise that the residuals show: white beyond the stated, or correlated in time."""
        colour = self.excess_colour
        if colour is None or not colour.is_correlated:
            return self.white_excess_filter
        return filter_at_excess(self.state_space, self.index, self.excess_variance, colour, self.settings)

    @property
    def holds(self) -> bool:
        """Whether hardly any row has excess variance: the model agrees with the measurements about this point."""
        return self.excess_variance.share <= self.settings.holds_share

    @property
    def failing_excess(self) -> ExcessVariance | None:
        """Excess variance with which the estimation for a similar model starts; None if the model holds."""
        return None if self.holds else replace(self.excess_variance, colour=self._places_of_colour)

    @property
    def _places_of_colour(self) -> ColourPlaces | None:
        """Places of the most likely colour of the excess variance, or those of the similar model until it is known."""
        if "excess_colour" not in self.__dict__:
            return None if self.initial_excess is None else self.initial_excess.colour
        return None if self.excess_colour is None else self.excess_colour.places

    def white_residuals(self, whiten: Whitening) -> Array:
        """Residuals whitened by a filter ``(R,)``."""
        return whiten(self.residual_vector[:, None], self.initial_mean[:, None])[:, 0]

    def normalised_innovations(self, whiten: WhiteningFilter, white: Array) -> Array:
        """Measurements less what the model predicts from the ones before, over the sigma at the stated noise ``(R,)``.

        Excess variance that is correlated in time has states of its own, which follow what the model lacks from one
        bin to the next. They are noise, not the model's prediction, and stay in these innovations: without them a force
        that is missing for longer than their correlation time would hardly be seen.

        Parameters
        ----------
        whiten : WhiteningFilter
            Of the model at any noise.
        white : (R,) array
            White residuals under it.
        """
        innovations, count = whiten.innovations(white), whiten.model.size - self.state_space.size
        if count:
            innovations = innovations + whiten.predictions_of_last_states(white, count)
        return np.asarray(innovations / self.stated_noise_sigma, float)

    @cached_property
    def log_likelihood(self) -> float:
        """Log marginal likelihood of the residuals at the noise that they show, nats."""
        whiten = self.fitted_noise_filter
        return whiten.log_likelihood(self.white_residuals(whiten))

    @property
    def noise_penalty(self) -> float:
        """Cost in evidence of the noise that the residuals show: of its variances and of its colour, nats."""
        colour = self.excess_colour
        is_correlated = colour is not None and colour.is_correlated
        return self.excess_variance.penalty + (colour_penalty(self.settings) if is_correlated else 0.0)

    @property
    def log_evidence(self) -> float:
        """Log marginal likelihood at the noise that the residuals show, less the penalty of that noise, nats."""
        return self.log_likelihood - self.noise_penalty

    @property
    def largest_nuisance_sigmas(self) -> float:
        """Distance of the point from what the mission states, in sigmas of the nuisance parameter farthest off."""
        size = self.nuisance.layout.size
        prior = np.sqrt(np.diag(self.state_space.initial_covariance)[:size])
        start = float(np.max(np.abs(self.initial_mean[:size]) / np.where(prior > 0.0, prior, np.inf)))
        sigma = [s for c in self.case.constants for s in c.sigma.values()]
        constant = float(np.max(np.abs(self.constant_values) / np.array(sigma), initial=0.0)) if sigma else 0.0
        stated = self.case.uncertainty.sigma
        return max(start, constant, distance_from_stated(self.point.perturbation, self.residuals.flow, stated))

    def state_space_with_unmodelled(self, unmodelled: UnmodelledAcceleration) -> LinearStateSpace:
        """State-space model at the stated noise that allows for an unmodelled acceleration."""
        return augment(self.state_space, self.index, self.bins, self.residuals.flow, unmodelled)


def perturbed(inputs: ModelInputs, point: LinearizationPoint) -> ModelInputs:
    """Inputs whose forward model has the perturbation of a point."""
    return replace(inputs, forward_model=replace(inputs.forward_model, perturbation=point.perturbation))


def rows_by_constraint(model: LinearizedModel) -> dict[str, IntArray]:
    """Constraint → rows ``(K,)`` of all its uses, in the order of the first uses."""
    rows: dict[str, list[IntArray]] = {}
    for constraint, part in zip(model.inputs.problem.constraints, model.index.constraint_rows, strict=True):
        rows.setdefault(constraint.name, []).append(np.arange(part.start, part.stop))
    return {name: np.concatenate(parts) for name, parts in rows.items()}
