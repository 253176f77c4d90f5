"""Mission files: the model of one entry, read from YAML, checked and completed.

In: a mission file and ``KEY=VALUE`` changes. Out: a `Mission`, frozen, SI units, angles in radians where the
name does not end in ``_deg``. Every fault of the input is one `InputError` that names file and key.
Nothing outside this folder knows the file's form or reads YAML.
"""

from edl_filter.mission.mission import Mission, shipped_mission

__all__ = ["Mission", "shipped_mission"]
