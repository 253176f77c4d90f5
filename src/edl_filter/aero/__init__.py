"""MEVAD, the Mars entry vehicle aerodynamic database, as data with provenance.

The thesis collects every table that Mars missions used (appendices B to G) under this name. Their printed
numbers are not public in machine form, so three kinds of table live here and `aero.catalogue` says which is
which: *shipped* (a smooth surrogate of the Phoenix table, exact in its symmetry), *computed here*
(free-molecular panels and a bridge to them, modified Newtonian) and *to be brought* (any CSV of the user).

Conventions
    alpha is the total angle of attack, acos(u/V), in rad and ≥ 0; only the inverse look-up gives it a sign.
    CA and CN act along −x and −z (CN > 0 for alpha > 0) and are total: in the plane of alpha.
    Cm is about the **nose** inside the database, nose-up positive; stable is a negative slope.
    Reference area pi D²/4, reference length D. Knudsen numbers are on D.
    A centre of mass lies ``x_over_d`` behind the nose and ``z_over_d`` below the axis, both in D:
    ``Cm_cm = Cm_nose + x_over_d CN + z_over_d CA``.
    Outside a table, the value is held at the edge and flagged.

The way of the data
    CSV ─ tables ─► grid (one table) ─┐
    33 × 9 numbers ─► surrogate ──────┤ continuum
                                      ├─► database ─► coefficients with 3 sigma ─► planes (CN, CY, Cm, Cn)
    body ─► free_molecular, bridge ───┤ rarefied          │
            └─► transition ───────────┘                   └─► inverse (CN or Cm → alpha)
"""
