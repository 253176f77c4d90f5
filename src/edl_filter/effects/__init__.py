"""Physical effects: what they are (`effect`), the catalogue (one file per family), and the world they act in (`world`).

Forms, parameters and plausible sizes are those of the project's list of effects; every effect is off at zero.
"""
