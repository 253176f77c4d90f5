"""The practice flights of tests/data and of the package: their origin, and equality with the originals."""

import hashlib

import h5py
import numpy as np
import pytest
from compress_flights import NUMBERS, TABLES, compress
from mer_volume import contents


@pytest.mark.parametrize("number", NUMBERS)
def test_attributes_state_the_original_and_the_command(practice, number):
    with h5py.File(practice(number)) as file:
        assert len(file.attrs["original_sha256"]) == 64
        assert file.attrs["command"] == "python tests/data/compress_flights.py FOLDER"
        assert file.attrs["name"] == f"practice_{number:02d}"


def test_compression_is_without_loss(builtin_flight, tmp_path):
    compress(builtin_flight, tmp_path / "copy.h5")
    original, copy = contents(builtin_flight), contents(tmp_path / "copy.h5")
    assert copy[""][0].pop("original_sha256") == hashlib.sha256(builtin_flight.read_bytes()).hexdigest()
    copy[""][0].pop("command")
    assert copy == original
    assert (tmp_path / "copy.h5").stat().st_size < 0.7 * builtin_flight.stat().st_size


@pytest.mark.parametrize("number", [*NUMBERS, 6])
def test_numbers_are_those_of_the_originals(practice, practice_originals, number):
    path = practice_originals / f"practice_{number:02d}.h5"
    copy, original = contents(practice(number)), contents(path)
    sha256 = hashlib.sha256(path.read_bytes()).hexdigest()
    if number == 6:
        assert hashlib.sha256(practice(6).read_bytes()).hexdigest() == sha256
    else:
        assert copy[""][0].pop("original_sha256") == sha256
        copy[""][0].pop("command")
    assert copy == original
    assert np.sum([values is not None for _, values in copy.values()]) > 10


@pytest.mark.parametrize("name", TABLES)
def test_tables_are_the_originals(practice, practice_originals, name):
    assert practice(1).with_name(name).read_bytes() == (practice_originals / name).read_bytes()
