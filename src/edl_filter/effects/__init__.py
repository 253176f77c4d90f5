"""Physical effects, the catalogue of built-in ones, and the forward model that composes them with the mission's models.

In: declarations of effects and the mission's planet, atmosphere, database and vehicle. Out: the catalogue, and the
models with effects in them, for prediction, simulation, filter and post-flight layer. Forms, parameters and plausible
sizes are those of the project's list of effects; every effect is off at zero.

Read in this order: `types` (flow, coefficients, rigid body), `parameters` and `base` (`Effect`, its hooks, and
`EffectInstance`, an effect that is switched on), the families `sensors`, `vehicle`, `gravity`, `atmosphere`,
`aerodynamics` and `initial_state`, then `registry` (effects by name, from the catalogue, files and packages),
`instances` and `hook_validation`. `forward_model` composes effects, with `perturbation` for the differences of one
flight from its mission; `adapters` gives composed tables to other layers, and `sensor_chain` applies sensor effects to
records. `tables` has the declarations as text.

A user's file imports the names below from this package.
"""

from edl_filter.effects.base import Effect, EffectInstance
from edl_filter.effects.parameters import Parameter
from edl_filter.effects.types import AeroCoefficients, Body, FlightCondition

__all__ = ["AeroCoefficients", "Body", "Effect", "EffectInstance", "FlightCondition", "Parameter"]
