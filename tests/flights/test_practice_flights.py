"""Shipped practice flights: they are what the documented commands write, and can be solved as the pages say."""

import re
from importlib.resources import files
from pathlib import Path

import h5py
import numpy as np
import pytest
from compress_flights import copy_compressed
from practice_flights import SOLUTIONS, commands, simulate
from typer.testing import CliRunner

from edl_filter.cli import app
from edl_filter.mission.shipped import SHIPPED_FLIGHTS, flight_command
from edl_filter.results.files import read_diagnosis

DATA = Path(str(files("edl_filter") / "data"))
NAMES = sorted(set(SHIPPED_FLIGHTS) - {"practice_06"})


def tree(path):
    """Arrays and attributes of an HDF5 file by name."""
    contents = {}
    with h5py.File(path) as file:
        contents.update({f"@{key}": value for key, value in file.attrs.items()})

        def add(name, node):
            contents.update({f"{name}@{key}": value for key, value in node.attrs.items()})
            if isinstance(node, h5py.Dataset):
                contents[name] = node[()]

        file.visititems(add)
    return contents


def test_the_page_has_the_command_of_every_flight():
    assert sorted(commands()) == NAMES and len(NAMES) >= 3


@pytest.mark.parametrize("name", NAMES)
def test_a_flight_is_small_and_does_not_contain_its_solution(name):
    path = DATA / f"{name}.h5"
    assert path.stat().st_size < 400_000
    effects = set(re.findall(r"name: (\w+), parameters", SOLUTIONS.read_text()))
    assert effects
    for key in tree(path):
        assert not key.startswith("truth")
    raw = path.read_bytes()  # gyro_scale_sigma is a sigma of every IMU
    assert not any(re.search(rf"{effect}(?!_sigma)".encode(), raw) for effect in effects)


@pytest.mark.parametrize("name", [NAMES[0], *(pytest.param(n, marks=pytest.mark.slow) for n in NAMES[1:])])
def test_a_flight_is_what_its_command_writes(name, tmp_path):
    copy_compressed(simulate(name, tmp_path), tmp_path / "copy.h5", without=("truth",))
    shipped, simulated = tree(DATA / f"{name}.h5"), tree(tmp_path / "copy.h5")
    assert shipped.keys() == simulated.keys()
    for key, value in shipped.items():
        if isinstance(value, str):
            assert simulated[key] == value
        else:  # velocity increments have counts of 1e-4 m/s at most: rounding may move one sample by one count
            np.testing.assert_allclose(simulated[key], value, rtol=1e-9, atol=1e-3, err_msg=key)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("name", "effect", "values"),
    [
        ("unknown_1", "gyro_scale", {"sx": 0.0015, "sy": -0.003}),
        ("unknown_2", "com_offset", {"dy": 0.004, "dz": -0.003}),
        ("unknown_3", "pitching_moment_scale", {"k": 0.15}),
    ],
)
def test_the_first_diagnosis_is_that_of_the_page(name, effect, values, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    run = CliRunner().invoke(app, [*flight_command(name).split()[1:], "--no-figures"])
    assert run.exit_code in (0, 3), run.output
    assert CliRunner().invoke(app, ["diagnose", f"results/{name}"]).exit_code == 0
    diagnosis = read_diagnosis(Path("results") / name)
    assert (diagnosis.verdict, diagnosis.ranking[0].effect) == ("missing", effect)
    for parameter, true in values.items():
        estimate = diagnosis.ranking[0].parameters[parameter]
        assert abs(estimate.estimate - true) < 4.0 * estimate.sigma
        assert str(true).rstrip("0") in SOLUTIONS.read_text()
