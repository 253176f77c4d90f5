"""Aerodynamic database of a Mars entry vehicle: coefficients over Mach number, Knudsen number and angle of attack.

In: names of built-in tables or CSV files, the geometry of a forebody, the vehicle family of the uncertainties. Out:
`database.Database`, which gives CA, CN and Cm with three sigma at given flow conditions, and the inverse look-up
(`inverse`), which gives angles of attack from measured coefficients. Nothing depends on a mission.

The thesis collects the tables of all Mars missions (appendices B to G) under the name MEVAD. Its printed numbers are
not public in machine-readable form. The package has a smooth surrogate of the Phoenix table, exactly symmetric,
computes free-molecular panels with a bridge to them and modified Newtonian flow, and reads any CSV of the user.
``docs/how-to/own-database.md`` lists what replaces each table of the thesis.

Conventions
    alpha is the total angle of attack, acos(u/V), in rad and ≥ 0; only the inverse look-up gives it a sign.
    CA and CN act along −x and −z (CN > 0 for alpha > 0) and are total coefficients, in the plane of alpha.
    Cm is about the **nose** inside the database, nose-up positive; a negative slope is stable.
    The reference area is pi D²/4, the reference length D. Knudsen numbers are based on D.
    A centre of mass on the axis is ``x_over_d`` behind the nose, in D: ``Cm_cm = Cm_nose + x_over_d CN``.
    Outside a table its value at the edge is used, and the sample is flagged.

Read in this order
    CSV ─ tables ─► grid (one table) ─┐
    33 × 9 numbers ─► surrogate ──────┤ continuum
    body ─► newtonian, base_pressure ─┤
                                      ├─► database ─► coefficients, with 3 sigma of uncertainty
    body ─► free_molecular ───────────┤ rarefied │        └─► planes (CN, CY, Cm, Cn)
            └─► transition ───────────┘          └─► inverse (alpha from CN or Cm)

    `conventions` (reference area, angles of the flow), `regimes` (limits of the flow regimes), `tables` (CSV) and
    `grid` (one table, with `pchip` for monotone interpolation), `surrogate` (33 × 9 numbers); `body` (forebody),
    `newtonian`, `base_pressure`, `free_molecular`, `transition` (from the continuum to free molecules); `uncertainty`
    (3 sigma), `discrepancy` (the error as a random field), `increments`, `increments_file` and `increment_tables`
    (corrections of the tables by a flight); `database` (all of it); `planes` (components in the pitch and yaw planes),
    `inverse`; `damping` (table of pitch and yaw damping, which is not part of the database).
"""
