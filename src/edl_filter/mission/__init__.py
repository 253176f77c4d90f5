"""Mission files: the model of one entry, read from YAML, checked and completed with defaults.

In: a mission file and ``KEY=VALUE`` overrides. Out: a `Mission`, frozen, in SI units, angles in radians where the name
does not end in ``_deg``. Every error of the input raises one `InputError` that names file and key. No other package
reads the YAML of a mission.

Read in this order: `mission` (the whole), then the sections `world`, `measurements`, `estimation`, `aerodynamics` and
`effects` and `decision_settings` (thresholds of the diagnosis), their building blocks `fields` and `validators`, and
the checks between sections in `cross_checks`; `yaml_text` (text to data), `error_messages` (pydantic's errors to one
message) and `problems` (all errors of a file); `shipped` and `files` (which files a mission has); last `yaml_edit` and
`edit_effects` (missions with further effects) and `new_mission` (a mission from another one or from a template).
"""

from edl_filter.mission.mission import Mission
from edl_filter.mission.shipped import shipped_mission

__all__ = ["Mission", "shipped_mission"]
