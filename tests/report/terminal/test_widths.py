"""Tables and texts at the widths of terminals: no line is too long and no number is cut."""

import re

import contents
import pytest
from diagnoses import content

from edl_filter.report.next_step import NextStep
from edl_filter.report.terminal.console import WIDTH, echo, empty_table, print_paragraph
from edl_filter.report.terminal.diagnosis import print_comparison, print_diagnosis, print_identifiability
from edl_filter.report.terminal.run import print_run

ANSI = re.compile(r"\x1b\[[0-9;]*m")
#: A number, with its sigma's sign, exponent and decimals.
NUMBER = re.compile(r"[-+−]?\d+(?:\.\d+)?(?:e[-+]?\d+)?")
WIDTHS = (80, 100, 140, None)


@pytest.fixture(params=WIDTHS, ids=lambda w: "piped" if w is None else str(w))
def terminal(request, monkeypatch, capsys):
    """Prints on a terminal of a width, or into a pipe; gives the lines."""
    for name in ("COLUMNS", "FORCE_COLOR", "NO_COLOR"):
        monkeypatch.delenv(name, raising=False)
    if request.param is not None:
        monkeypatch.setenv("COLUMNS", str(request.param))
        monkeypatch.setenv("FORCE_COLOR", "1")

    def lines(function, *arguments):
        capsys.readouterr()
        function(*arguments)
        output = capsys.readouterr().out
        assert ("\x1b" in output) <= (request.param is not None)  # a pipe gets plain text
        plain = ANSI.sub("", output).splitlines()
        width = request.param or WIDTH
        tables = [line for line in plain if not re.match(r"  edl-filter|Written|Summary|Report|Figures", line)]
        assert max(map(len, tables)) <= width, max(tables, key=len)
        assert "…" not in output
        return plain

    return lines


def numbers(lines):
    return NUMBER.findall("\n".join(lines))


def check_numbers(lines, expected):
    """All expected numbers stand uncut in the lines."""
    printed = set(numbers(lines))
    missing = [n for n in expected if n not in printed]
    assert not missing, missing


@pytest.fixture(scope="module")
def run_summary(practice_06):
    from edl_filter.results import Result

    return Result(practice_06).summary()


def test_a_run(terminal, run_summary):
    written = {"content": run_summary, "result": "a", "summary": "b", "report": "c", "figures": []}
    lines = terminal(print_run, written)
    expected = []
    for event in run_summary["events"].values():
        expected += [f"{event['time_s']:.2f}", f"{event['altitude_m'] / 1e3:.3f}", f"{event['velocity_m_s']:.1f}"]
    check_numbers(lines, expected)


def test_a_diagnosis(terminal):
    parameters = {f"p{k}": {"estimate": -1234.5678 * 10.0**k, "sigma": 0.01234, "unit": "m/s"} for k in range(4)}
    first = contents.hypothesis(parameters=parameters, label="accelerometer_misalignment in secondary",
                                same_as=["products_of_inertia", "density_scale"], gain=-123456.0)  # fmt: skip
    diagnosis = content() | {"ranking": [first], "none_gain": -1.13e6}
    lines = terminal(
        print_diagnosis, diagnosis, ["out/diagnosis.json"], NextStep("Next:", ("edl-filter add " + 90 * "x",))
    )
    check_numbers(lines, ["-123456", "-1234.568", "-12345.678", "-123456.780", "880", "0.05"])
    assert any("excluded" in line for line in lines) and not any("1.13e" in line for line in lines)
    assert any("1\u202f130\u202f000" in line for line in lines)  # the number stands in the sentence that explains it


@pytest.mark.parametrize("count", [2, 9])
def test_a_comparison(terminal, count):
    mx = {"estimate": -0.0123456, "sigma": 0.0000012, "unit": "rad"}
    effects = {"accelerometer_misalignment": {"parameters": {"mx": mx}}}
    results = [
        {"path": f"results/{k}/result.nc", "headline": None, "verdict": None, "effects": effects, "score_gain": None,
         "residuals": {"secondary_force_x": 123456.0 + k}, "minimum_rms": 1.1,
         "nis_per_dof": {"pre_entry_zero_force": 0.00956}}
        for k in range(count)
    ]  # fmt: skip
    lines = terminal(print_comparison, {"results": results, "fall_percent": {"secondary_force_x": -12.3456}})
    check_numbers(lines, [*(f"{123456 + k}" for k in range(count)), "-12.3", "0.00956", "-1.23456", "0.00012"])


def test_a_fall_below_the_limit_of_a_failing_cell_is_not_printed(terminal):
    """The limit is that of each result: 1.2 is at the noise of settings in which a cell fails from 1.3 on."""
    result = {"path": "a", "headline": None, "verdict": None, "effects": {}, "score_gain": None, "nis_per_dof": {}}
    values = {"force_x": (1.2, 1.05), "force_y": (1.4, 1.05), "force_z": (1.05, 1.2)}
    cases = {(1.1, 1.1): {"12.5", "25.0", "-14.3"}, (1.3, 1.3): {"25.0"}, (1.3, 1.1): {"25.0", "-14.3"}}
    for limits, printed in cases.items():
        results = [
            result | {"residuals": {n: v[k] for n, v in values.items()}, "minimum_rms": limits[k]} for k in range(2)
        ]
        fall = {n: 100.0 * (1.0 - b / a) for n, (a, b) in values.items()}
        lines = terminal(print_comparison, {"results": results, "fall_percent": fall})
        assert {n for n in ("12.5", "25.0", "-14.3") if n in set(numbers(lines))} == printed


def test_an_identifiability_study(terminal):
    value = {"unit": "kg m^2", "smallest": 1.2345e-5, "plausible": 4.5e-4, "ratio": 0.027}
    effect = {"effect": "accelerometer_misalignment", "parameters": {"quadratic": value},
              "confused_with": {f"products_of_inertia_{k}": 0.95 for k in range(8)}}  # fmt: skip
    study = {"required_gain": 6.0, "effects": [effect], "in_model": ["wind"], "failed": {}}
    check_numbers(terminal(print_identifiability, study), ["1.2e-05", "0.00045", "0.027"])


def test_a_paragraph_of_improve_or_validate(terminal):
    text = "Step 0: 53 of 67 cells fail, worst moment_y in Mach 15 to 5 at 36.1 sigmas. " * 3
    assert " ".join(" ".join(terminal(print_paragraph, text)).split()) == text.strip()


def test_columns_are_omitted_in_their_order_and_named(terminal):
    table = empty_table("Title", ("name",), tuple("abcdefgh"), optional=("c", "b"))
    table.add_row("row", *(f"{k}" * 9 for k in range(8)))
    lines = terminal(echo, table)
    omitted = [line for line in lines if "Not shown" in line]
    width = max(map(len, (line for line in lines if line not in omitted)))
    if omitted:
        assert omitted[0].split(": ")[1] in ("c.", "c, b.") and width + 12 > 80
    check_numbers(lines, [f"{k}" * 9 for k in (0, 3, 4, 5, 6, 7)])


def test_a_table_that_cannot_fit_is_stacked(terminal):
    table = empty_table("Title", ("name",), tuple("abcdefghij"))
    table.add_row("row", *(f"{k}" * 30 for k in range(10)))
    lines = terminal(echo, table)
    check_numbers(lines, [f"{k}" * 30 for k in range(10)])
    assert [line.split()[0] for line in lines if line.split()][:3] == ["Title", "row", "a"]
