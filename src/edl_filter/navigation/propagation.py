"""Propagation of full states over samples: the strapdown kernel, and the attitude that was computed on board."""

from __future__ import annotations

import numpy as np

from edl_filter import rotations
from edl_filter.navigation import strapdown
from edl_filter.navigation.increments import Samples
from edl_filter.navigation.layout import Layout, sensor_maps
from edl_filter.navigation.noise import net_rotation, onboard_rotation
from edl_filter.planet import Planet
from edl_filter.types import Array


def propagate_states(layout: Layout, planet: Planet, samples: Samples, nav: Array, errors: Array) -> None:
    """Propagate full states over `samples`, in place; an attitude computed on board turns as the gyros read.

    Parameters
    ----------
    layout : Layout
        Of the filter's vector.
    planet : Planet
        Gravity and rotation.
    samples : Samples
        Of the driving instrument.
    nav : (10 or 14, S) array, changed in place
        As `State.nav`, one state per column; S a multiple of `strapdown.LANES`.
    errors : (n, S) array
        As `State.errors`.
    """
    if len(nav) == 14:
        net, correction = onboard_steps(layout, samples, errors)
        nav[10:] = rotations.multiply(rotations.multiply(nav[10:].T, net), correction).T
    force_map, rate_map = sensor_maps(layout, errors)
    strapdown.propagate(
        nav[:10],
        force_map,
        rate_map,
        samples.interval,
        samples.force,
        samples.rate,
        planet.mu,
        planet.j2,
        planet.gravity_radius,
    )


def onboard_steps(layout: Layout, samples: Samples, errors: Array) -> tuple[Array, Array]:
    """Turn over `samples` of attitudes that were computed on board.

    Parameters
    ----------
    layout : Layout
        Of the filter's vector.
    samples : Samples
        Of the driving instrument.
    errors : (n, S) array
        As `State.errors`.

    Returns
    -------
    net : (4,) array
        Turn as the gyros read.
    correction : (S, 4) array
        Turn that follows it: the effect of the rates and the mounting that the on-board computation used.
    """
    net, jacobians = onboard_jacobians(layout, samples)
    correction = np.zeros((3, errors.shape[1]))
    for name, jacobian in jacobians.items():
        correction = correction + jacobian @ errors[layout[name]]
    return net, rotations.from_rotation_vector(correction.T)


def onboard_jacobians(layout: Layout, samples: Samples) -> tuple[Array, dict[str, Array]]:
    """Turn over `samples` of an attitude that was computed on board, and its derivatives.

    Parameters
    ----------
    layout : Layout
        Of the filter's vector.
    samples : Samples
        Of the driving instrument.

    Returns
    -------
    net : (4,) array
        Turn as the gyros read.
    jacobians : dict of str to (3, 3) array
        State of the layout → rotation vector (rad), in the body axes of the end, that follows the turn per unit of the
        state (rad/s, rad).
    """
    names = [n for n in ("onboard_rate", "onboard_mounting") if n in layout]
    jacobians = dict(zip(("onboard_rate", "onboard_mounting"), onboard_rotation(samples), strict=True)) if names else {}
    return net_rotation(samples), {name: jacobians[name] for name in names}
