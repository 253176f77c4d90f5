"""A diagnosis on the terminal, from plain data."""

import contents
from diagnoses import content

from edl_filter.report.next_step import NextStep
from edl_filter.report.terminal.diagnosis import print_diagnosis, where_table
from edl_filter.results.schema import DiagnosisContent


def test_a_diagnosis_says_what_a_person_wants_to_read(capsys):
    step = NextStep("Next: add it:", ("edl-filter add m.yaml remnant_torque --from out",))
    print_diagnosis(content(), ["out/diagnosis.json"], step, ["The landing was rejected."])
    output = capsys.readouterr().out
    for part in (
        "12 of 13 cells of the residual map fail. Missing: remnant_torque (gain 16713 nats).",
        "With it no cell fails.",
        "In the model: mass.",
        "Where it fails (the worst 8 of 12)",
        "Hypotheses (gains in nats, 12 needed; held-out: on data that were not fitted)\n",
        "0.05 rad/s^2",
        "remnant_torque or com_offset",
        "> 0.999",
        "Cm (1.7500 ± 0.0010)e-3",
        "moment x 880 → 0.91",
        "Residuals grow: moment y from 129.0 s.",
        "remnant_torque or com_offset: knowing the mass would part them by 41 nats.",
        "nothing is missing",
        "[division] by zero",
        "Written: out/diagnosis.json",
        "  edl-filter add m.yaml remnant_torque --from out",
    ):
        assert part in output, part
    assert "t1" not in output and "\x1b" not in output
    assert output.startswith("The landing was rejected.\n12 of 13 cells")  # doubts first, then how much fails


def test_the_remainder_is_stated_when_nothing_explains_it(capsys):
    text = "force_y from 63 to 164 s; it oscillates at 0.679 Hz."
    remainder = {"remainder": contents.unknown()["remainder"] | {"description": text}}
    print_diagnosis(content("unknown") | remainder, [], NextStep())
    output = capsys.readouterr().out
    assert "What is left: force_y from 63 to 164 s; it oscillates at 0.679 Hz." in output
    assert "Next" not in output


def test_a_clean_flight_has_no_table_of_failures(capsys):
    print_diagnosis(content("clean", 1.0) | {"failed": {}, "effects": []}, [], NextStep())
    assert "No channel fails in any regime." in capsys.readouterr().out


def test_at_most_eight_rows():
    assert len(where_table(DiagnosisContent.of(content())).rows) == 8
