"""The main job with the mission's own effects: refitted, reconstructed with, and compared with the model."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import replace

from edl_filter.mission import Mission
from edl_filter.reconstruction import Reconstruction, reconstruct
from edl_filter.results.effects import Judged


def reconstruct_and_judge(
    mission: Mission, refit: bool = True, progress: Callable[[str], None] = lambda _: None
) -> tuple[Reconstruction, Judged]:
    """Reconstruct an entry with its effects at their most probable values.

    A mission without effects is reconstructed and no more: to compare it with its model takes longer than that,
    and `edl-filter diagnose` does it.

    Parameters
    ----------
    mission : Mission
    refit : bool
        Without it effects stay at their values, and nothing is compared.
    progress : callable
        Told what is being done.

    Returns
    -------
    Reconstruction, Judged
        The second is empty where there are no effects, or no aerodynamic database with which to predict.

    Raises
    ------
    InputError
        As `reconstruct`.
    """
    if not refit or not mission.effects or mission.aerodynamics is None or mission.vehicle.inertia is None:
        return reconstruct(mission), Judged()
    from edl_filter.diagnosis.residuals import residuals
    from edl_filter.diagnosis.settle import can_settle, settle

    if can_settle(mission):
        settled = settle(mission, progress)
        reconstruction, sigma = settled.reconstruction, settled.sigma
    else:
        reconstruction, sigma = reconstruct(mission), {}
    progress("comparing model and measurements")
    begin = time.perf_counter()
    found = residuals(reconstruction)
    timing = reconstruction.timing | {"residuals": time.perf_counter() - begin}
    return replace(reconstruction, timing=timing), Judged(sigma, found)
