"""Shipped missions with overrides, and the error messages of wrong overrides."""

import pytest

from edl_filter.errors import InputError
from edl_filter.mission import Mission
from edl_filter.mission.yaml_text import parse


def load(name="mer_a", *overrides):
    """A shipped mission with overrides."""
    return Mission.load(f"builtin:{name}", overrides)


def error_of(*overrides, name="mer_a"):
    """Message of the InputError that loading a shipped mission with overrides raises."""
    with pytest.raises(InputError) as caught:
        load(name, *overrides)
    return str(caught.value)


def mission_data(name="mer_a"):
    """A shipped mission as plain data."""
    return parse(load(name).text, name)
