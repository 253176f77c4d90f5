"""Components of the total coefficients in the pitch and yaw planes, and transfer of moments to the centre of mass.

Input: total coefficients, which act in the plane of the total angle of attack, and the lateral air-relative velocity
(v, w), whose direction defines that plane. Output: coefficients in body axes.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from edl_filter.types import Array


def _direction(v: ArrayLike, w: ArrayLike) -> tuple[Array, Array]:
    """Sine and cosine of the lateral flow's direction; (0, 1) where the lateral flow is zero or denormal."""
    v, w = np.broadcast_arrays(np.asarray(v, float), np.asarray(w, float))
    speed = np.hypot(v, w)
    zero = speed < np.finfo(float).tiny
    divisor = np.where(zero, 1.0, speed)
    return v / divisor, np.where(zero, 1.0, w / divisor)


def split(cnt: ArrayLike, cmt: ArrayLike, v: ArrayLike, w: ArrayLike) -> tuple[Array, Array, Array, Array]:
    """Components of total coefficients in the pitch and yaw planes, by the direction of the lateral flow.

    Parameters
    ----------
    cnt, cmt : (...) arrays
        Coefficients of the total normal force and of the total pitching moment.
    v, w : (...) arrays
        Air-relative velocity along body y and z, in any common unit. Where both vanish, the components in the yaw plane
        are zero.

    Returns
    -------
    cn, cy, cm, cn_yaw : (...) arrays
        ``CN = CNT w/√(v²+w²)``, ``CY = −CNT v/√(…)``, ``Cm = CmT w/√(…)``, ``Cn = −CmT v/√(…)``.
    """
    sine, cosine = _direction(v, w)
    cnt, cmt = np.asarray(cnt, float), np.asarray(cmt, float)
    return cnt * cosine, -cnt * sine, cmt * cosine, -cmt * sine


def moments_at_cm(
    forces: tuple[ArrayLike, ArrayLike, ArrayLike],
    moments_nose: tuple[ArrayLike, ArrayLike, ArrayLike],
    cm_over_d: tuple[ArrayLike, ArrayLike, ArrayLike],
) -> tuple[Array, Array, Array]:
    """Transfer the three moment coefficients from the nose to the centre of mass.

    Parameters
    ----------
    forces : tuple of (...) arrays
        CA, CY, CN (along −x, +y, −z).
    moments_nose : tuple of (...) arrays
        Cl, Cm, Cn about the nose.
    cm_over_d : tuple of float or (...) array
        Position of the centre of mass: behind the nose, to the right (+y) and down (+z), in diameters.

    Returns
    -------
    cl, cm, cn : (...) arrays
        ``Cl + y CN + z CY``, ``Cm + x CN + z CA``, ``Cn + x CY − y CA``.
    """
    ca, cy, cn = (np.asarray(f, float) for f in forces)
    cl, cm, cn_yaw = (np.asarray(m, float) for m in moments_nose)
    x, y, z = (np.asarray(p, float) for p in cm_over_d)
    return cl + y * cn + z * cy, cm + x * cn + z * ca, cn_yaw + x * cy - y * ca
