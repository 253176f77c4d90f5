"""A Python file with an effect of a user."""

BUMP = """
from edl_filter.effects import Effect, Parameter

class Bump(Effect):
    name = "bump"
    parameters = (Parameter("a", "m/s^2", "amplitude", 0.1, low=-1.0, high=1.0),)
"""
