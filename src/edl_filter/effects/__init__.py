"""Physical effects: what they are (`effect`), the catalogue (one file per family), and the world they act in (`world`).

Forms, parameters and plausible sizes are those of the project's list of effects; every effect is off at zero. Users'
own come from files and packages (`loading`); a user's file imports what it needs from here.
"""

from edl_filter.effects.effect import Active, Body, Effect, Flow, Parameter, Totals

__all__ = ["Active", "Body", "Effect", "Flow", "Parameter", "Totals"]
