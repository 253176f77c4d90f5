"""Figures of a diagnosis, from plain data."""

import json

from diagnoses import content

from edl_filter.report.diagnosis import draw_diagnosis, ledger_figure, missing, model_change, ranking
from edl_filter.report.matplotlib_renderer import draw
from edl_filter.results.schema import DiagnosisContent


def test_what_is_left_is_drawn_with_bands(tmp_path):
    time = [float(k) for k in range(5)]
    pair = {"force_N": [[1.0, 2.0, 3.0]] * 5, "moment_N_m": [[0.0, 4.0, 0.0]] * 5}
    sigma = {"force_sigma_N": [[0.1] * 3] * 5, "moment_sigma_N_m": [[0.5] * 3] * 5}
    onsets = [{"channel": "moment_y", "time_s": 2.5, "gain": 812.0}]
    diagnosis = content("unknown", onsets=onsets, latent={"time_s": time} | pair | sigma)
    model = DiagnosisContent.of(diagnosis)
    force, moment = draw(missing(model.latent, model.onsets, "flight")).axes
    assert [ax.get_ylabel() for ax in (force, moment)] == ["unexplained force (N)", "unexplained moment (N m)"]
    band = moment.collections[1].get_paths()[0].vertices[:, 1]
    assert band.min() == 3.0 and band.max() == 5.0
    for ax in (force, moment):
        assert [line.get_xdata()[0] for line in ax.lines if line.get_gid() == "event"] == [2.5]
    assert "onset moment y" in [text.get_text() for text in force.texts]
    assert [p.stem for p in draw_diagnosis(diagnosis, "flight", tmp_path)][-1] == "diagnosis_missing"


def test_the_ranking_shows_gain_and_held_out_gain():
    ax = draw(ranking(content(), "flight")).axes[0]
    assert [round(p.get_width(), 1) for p in ax.patches] == [16713.1, 4839.6, 6.4e7]
    assert [t.get_text() for t in ax.get_yticklabels()] == ["remnant_torque\nor com_offset", "something else"]


def test_the_ledger_shows_every_step_and_figures_are_written(tmp_path):
    errors = [{"force_y": 90.0, "landing": 0.5}, {"force_y": 1.01, "landing": 0.6}]
    ax = draw(ledger_figure(errors, [model_change("wind")], 1.01, 1.1, "flight")).axes[0]
    assert [t.get_text() for t in ax.get_xticklabels()] == ["as stated", "+ wind"]
    assert [line.get_label() for line in ax.lines] == ["force y", "noise"]
    ax = draw(ledger_figure(errors, [model_change("wind")], 1.01, 90.0, "flight")).axes[0]
    assert [line.get_label() for line in ax.lines] == ["noise"]  # no channel exceeds the limit of these settings
    changes = [model_change("wind"), model_change("gyro_bias in rover", ["wind"])]
    ax = draw(ledger_figure([*errors, errors[1]], changes, 1.01, 1.1, "flight")).axes[0]
    assert [t.get_text() for t in ax.get_xticklabels()][2] == "+ gyro_bias in rover − wind"
    names = [p.name for p in draw_diagnosis(json.loads(json.dumps(content())), "flight", tmp_path)]
    assert names == ["diagnosis_heatmap.png", "diagnosis_ranking.png"]
    assert all((tmp_path / n).stat().st_size > 5000 for n in names)
