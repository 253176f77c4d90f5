"""Total coefficients and their two planes; moments from the nose to the centre of mass.

The total coefficients act in the plane of the total angle; the direction of the lateral flow (v, w) splits
them into the body's planes.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from edl_filter.aero.grid import Array


def _direction(v: ArrayLike, w: ArrayLike) -> tuple[Array, Array]:
    """Sine and cosine of the lateral flow's direction; (0, 1) without lateral flow, or next to none."""
    v, w = np.broadcast_arrays(np.asarray(v, float), np.asarray(w, float))
    size = np.hypot(v, w)
    still = size < np.finfo(float).tiny
    safe = np.where(still, 1.0, size)
    return v / safe, np.where(still, 1.0, w / safe)


def split(cnt: ArrayLike, cmt: ArrayLike, v: ArrayLike, w: ArrayLike) -> tuple[Array, Array, Array, Array]:
    """Split total coefficients by the lateral flow.

    Parameters
    ----------
    cnt, cmt : array_like
        Total normal force and total pitching moment.
    v, w : array_like
        Air-relative velocity along body y and z; any common scale. Where both vanish, all is in the pitch plane.

    Returns
    -------
    cn, cy, cm, cn_yaw : arrays
        ``CN = CNT w/√(v²+w²)``, ``CY = −CNT v/√(…)``, ``Cm = CmT w/√(…)``, ``Cn = −CmT v/√(…)``.
    """
    sine, cosine = _direction(v, w)
    cnt, cmt = np.asarray(cnt, float), np.asarray(cmt, float)
    return cnt * cosine, -cnt * sine, cmt * cosine, -cmt * sine


def total_from_planes(
    cn: ArrayLike, cy: ArrayLike, cm: ArrayLike, cn_yaw: ArrayLike, v: ArrayLike, w: ArrayLike
) -> tuple[Array, Array]:
    """Total normal force and pitching moment: the planes' parts along the lateral flow.

    The inverse of `split`; what a measurement has across the flow is not in it.
    """
    sine, cosine = _direction(v, w)
    cn, cy, cm, cn_yaw = (np.asarray(x, float) for x in (cn, cy, cm, cn_yaw))
    return cn * cosine - cy * sine, cm * cosine - cn_yaw * sine


def moments_at_cm(
    forces: tuple[ArrayLike, ArrayLike, ArrayLike],
    moments_nose: tuple[ArrayLike, ArrayLike, ArrayLike],
    cm_over_d: tuple[float, float, float],
) -> tuple[Array, Array, Array]:
    """Move the three moments from the nose to the centre of mass.

    Parameters
    ----------
    forces : tuple
        CA, CY, CN (along −x, +y, −z).
    moments_nose : tuple
        Cl, Cm, Cn about the nose.
    cm_over_d : tuple of float
        Centre of mass in diameters: behind the nose, to the right (+y) and down (+z).

    Returns
    -------
    cl, cm, cn : arrays
        ``Cl + y CN + z CY``, ``Cm + x CN + z CA``, ``Cn + x CY − y CA``.
    """
    ca, cy, cn = (np.asarray(f, float) for f in forces)
    cl, cm, cn_yaw = (np.asarray(m, float) for m in moments_nose)
    x, y, z = cm_over_d
    return cl + y * cn + z * cy, cm + x * cn + z * ca, cn_yaw + x * cy - y * ca
