"""Contents of a diagnosis for terminal and figures, by hand."""

import contents


def cell(channel, regime, rms, **changes):
    return contents.cell(channel=channel, regime=regime, normalised_rms=rms, over_database_sigma=0.5, fails=rms > 1.1,
                         excess_rms=0.05) | changes  # fmt: skip


def content(verdict="missing", rms=880.0, **changes):
    """Content of a diagnosis.json, by hand."""
    cells = [cell(f"moment_{a}", f"Mach {m}", rms / (k + 1)) for k, a in enumerate("xyz") for m in (25, 15, 5, 3)]
    cells.append(cell("landing", "constraints", 0.8, unit="m", over_database_sigma=None))
    parameters = {
        "Cm": {"estimate": 1.75e-3, "sigma": 1e-6, "unit": ""},
        "t0": {"estimate": 129.0, "sigma": 0.1, "unit": "s"},
        "t1": {"estimate": None, "sigma": 0.0, "unit": "s"},
    }
    hypothesis = contents.hypothesis(
        same_as=["com_offset"], probability=0.9999, gain=16713.1, score_gain=6.4e7, parameters=parameters,
        error_before=rms, error_after=0.91, channel="moment_x",
        discriminated_by={"com_offset": "knowing the mass would part them by 41 nats"},
    )  # fmt: skip
    something = contents.diagnosis()["something_else"] | {"probability": 1e-9, "gain": 4839.6}
    return contents.diagnosis(
        verdict=verdict, sentence="Missing: remnant_torque (gain 16713 nats).", effects=["mass"],
        state=[f"{sum(c['fails'] for c in cells)} of {len(cells)} cells of the residual map fail.",
               "Missing: remnant_torque (gain 16713 nats).", "With it no cell fails."],
        where=[c for c in cells if c["fails"]], map=cells, ranking=[hypothesis], none=0.0, something_else=something,
        onsets=[{"channel": "moment_y", "time_s": 129.04, "gain": 812.0}],
        failed={"mine": "effect 'mine': its hook wind raised ZeroDivisionError: [division] by zero."},
    ) | changes  # fmt: skip
