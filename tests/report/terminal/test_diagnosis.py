"""A diagnosis on the terminal and as figures, from plain data."""

import json

import pytest

from edl_filter.report.diagnosis import draw_diagnosis, heatmap, ledger_figure, missing, ranking
from edl_filter.report.terminal import with_sigma
from edl_filter.report.terminal.diagnosis import chance, number, parameters_text, print_diagnosis, where_table


def cell(channel, regime, rms, **more):
    return {"channel": channel, "regime": regime, "t0_s": 10.0, "t1_s": 90.0, "normalised_rms": rms, "bias": 0.0,
            "autocorrelation": 0.9, "beyond_noise": 0.05, "unit": "rad/s^2", "over_database_sigma": 0.5, "count": 99,
            "fails": rms > 1.1} | more  # fmt: skip


def content(verdict="missing", rms=880.0):
    """What a diagnosis.json holds, made by hand."""
    cells = [cell(f"moment_{a}", f"Mach {m}", rms / (k + 1)) for k, a in enumerate("xyz") for m in (25, 15, 5, 3)]
    cells.append(cell("landing", "constraints", 0.8, unit="m", over_database_sigma=None))
    parameters = {
        "Cm": {"estimate": 1.75e-3, "sigma": 1e-6, "unit": ""},
        "t0": {"estimate": 129.0, "sigma": 0.1, "unit": "s"},
        "t1": {"estimate": None, "sigma": 0.0, "unit": "s"},
    }
    return {
        "verdict": verdict,
        "sentence": "Missing: remnant_torque (gain 16713 nats).",
        "effects": ["mass"],
        "where": [c for c in cells if c["fails"]],
        "map": cells,
        "ranking": [
            {"effect": "remnant_torque", "same_as": ["com_offset"], "probability": 0.9999, "gain": 16713.1,
             "score_gain": 6.4e7, "parameters": parameters, "error_before": rms, "error_after": 0.91,
             "channel": "moment_x", "parted_by": {"com_offset": "knowing the mass would part them by 41 nats"}},
        ],
        "none": 0.0,
        "something_else": {"probability": 1e-9, "score_gain": 4839.6},
        "remainder": None,
        "latent": None,
        "onsets": [{"channel": "moment_y", "time_s": 129.04, "gain": 812.0}],
        "failed": {"mine": "effect 'mine': its hook wind raised ZeroDivisionError: [division] by zero."},
    }  # fmt: skip


def test_a_diagnosis_says_what_a_person_wants_to_read(capsys):
    print_diagnosis(content(), ["out/diagnosis.json"], ["edl-filter add m.yaml remnant_torque --from out"])
    told = capsys.readouterr().out
    for part in (
        "Missing: remnant_torque (gain 16713 nats).",
        "In the model: mass.",
        "Where it fails (the worst 8 of 12)",
        "0.05 rad/s^2",
        "remnant_torque or com_offset",
        "> 0.999",
        "Cm (1.7500 ± 0.0010)e-3",
        "moment x 880 → 0.91",
        "It begins: moment y from 129.0 s.",
        "remnant_torque or com_offset: knowing the mass would part them by 41 nats.",
        "nothing is missing",
        "[division] by zero",
        "Written: out/diagnosis.json",
        "  edl-filter add m.yaml remnant_torque --from out",
    ):
        assert part in told, part
    assert "t1" not in told and "\x1b" not in told


def test_what_is_left_is_told_when_nothing_explains_it(capsys):
    left = {"remainder": {"description": "force_y from 63 to 164 s; it oscillates at 0.679 Hz."}}
    print_diagnosis(content("unknown") | left, [], [])
    told = capsys.readouterr().out
    assert "What is left: force_y from 63 to 164 s; it oscillates at 0.679 Hz." in told
    assert "diagnose with --file" in told and "Next" not in told


def test_what_is_left_is_drawn_with_bands(tmp_path):
    time = [float(k) for k in range(5)]
    pair = {"force_N": [[1.0, 2.0, 3.0]] * 5, "moment_N_m": [[0.0, 4.0, 0.0]] * 5}
    sigma = {"force_sigma_N": [[0.1] * 3] * 5, "moment_sigma_N_m": [[0.5] * 3] * 5}
    told = content("unknown") | {"latent": {"time_s": time} | pair | sigma}
    force, moment = missing(told, "flight").axes
    assert [ax.get_ylabel() for ax in (force, moment)] == ["missing force (N)", "missing moment (N m)"]
    band = moment.collections[1].get_paths()[0].vertices[:, 1]
    assert band.min() == 3.0 and band.max() == 5.0
    assert moment.lines[-1].get_xdata()[0] == 129.04 and len(force.lines) == 3  # the onset is a moment's
    assert [p.stem for p in draw_diagnosis(told, "flight", tmp_path)][-1] == "diagnosis_missing"


def test_a_clean_flight_has_no_table_of_failures(capsys):
    print_diagnosis(content("clean", 1.0) | {"failed": {}, "effects": []}, [], [])
    assert "No channel fails in any regime." in capsys.readouterr().out


def test_at_most_eight_rows():
    assert where_table(content()).row_count == 8


@pytest.mark.parametrize(
    ("estimate", "sigma", "text"),
    [
        (129.00042, 0.013, "129.000 ± 0.013"),
        (128.9714, 0.013, "128.971 ± 0.013"),
        (1.753e-3, 2e-7, "(1.75300 ± 0.00020)e-3"),
        (3.0, None, "3"),
        (0.01, 5.0, "0.0 ± 5.0"),
        (0.011241, 1e-4, "0.01124 ± 0.00010"),
        (-12345.6, 132.3, "-12346 ± 132"),
        (4.2828e13, 2e9, "(4.28280 ± 0.00020)e13"),
        (129.0, 1e-12, "129 ± 1e-12"),
    ],
)
def test_estimates_have_the_digits_that_they_deserve(estimate, sigma, text):
    assert with_sigma(estimate, sigma) == text


def test_numbers_for_people():
    assert [number(x) for x in (0.91234, 1073.4, 6.4e7, None, float("nan"))] == ["0.912", "1073", "6.4e+07", "–", "–"]
    assert [chance(x) for x in (1.0, 0.25, 1e-7)] == ["> 0.999", "0.250", "< 0.001"]
    assert parameters_text({"a": {"estimate": None, "sigma": 0.0, "unit": "s"}}) == ""


def test_the_heat_map_outlines_what_fails():
    told = content()
    left, right = heatmap(told, "flight").axes[:2]
    assert len(left.patches) == sum(c["fails"] for c in told["map"]) and len(right.patches) == 0
    assert sorted(t.get_text() for t in right.texts) == ["0.8"]
    assert {t.get_text() for t in left.get_yticklabels()} == {"moment x", "moment y", "moment z"}
    assert left.images[0].get_cmap().name == "cividis"


def test_the_ranking_shows_gain_and_held_out_gain():
    ax = ranking(content(), "flight").axes[0]
    assert [round(p.get_width(), 1) for p in ax.patches] == [16713.1, 6.4e7, 4839.6]
    assert [t.get_text() for t in ax.get_yticklabels()] == ["remnant_torque\nor com_offset", "something else"]


def test_the_ledger_shows_every_step_and_figures_are_written(tmp_path):
    lines = [
        {"added": "wind", "errors": {"force_y": {"before": 90.0}, "landing": {"before": 0.5}}},
        {"added": None, "errors": {"force_y": {"before": 1.01}, "landing": {"before": 0.6}}},
    ]
    ax = ledger_figure(lines, 1.01, "flight").axes[0]
    assert [t.get_text() for t in ax.get_xticklabels()] == ["as stated", "+ wind"]
    assert [line.get_label() for line in ax.lines] == ["force y", "noise"]
    names = [p.name for p in draw_diagnosis(json.loads(json.dumps(content())), "flight", tmp_path)]
    assert names == ["diagnosis_heatmap.png", "diagnosis_ranking.png"]
    assert all((tmp_path / n).stat().st_size > 5000 for n in names)
