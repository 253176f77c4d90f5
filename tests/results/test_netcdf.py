"""`result.nc`: reading returns what was written, a failure leaves no file, and what is no result is refused."""

import h5py
import numpy as np
import pytest
import xarray as xr
from trees import same

import edl_filter
from edl_filter import results
from edl_filter.errors import InputError
from edl_filter.results import Result, netcdf


def test_the_file_comes_back_whole(written, tree):
    same(results.read(written["result"]), tree)
    same(edl_filter.read_result(written["result"].parent), tree)


def test_other_libraries_read_it_alike(written, tree):
    with xr.open_datatree(written["result"], engine="h5netcdf", decode_timedelta=False) as opened:
        same(opened.load(), tree)
    with h5py.File(written["result"]) as file:
        assert file["trajectory/position"].dims[0].keys() == ["time"]
        assert file["trajectory/utc"].dtype == np.int64
        assert file.attrs["format"] == "edl-result"


def test_a_changed_tree_can_be_written_too(tree, tmp_path):
    path = results.write(tree, tmp_path / "again.nc")
    same(results.read(path), tree, attributes=False)


def test_nothing_is_left_of_a_failure(practice_06, tmp_path, monkeypatch):
    def broken(*_):
        raise RuntimeError("disk")

    monkeypatch.setattr("edl_filter.results.hdf5._write_group", broken)
    with pytest.raises(RuntimeError, match="disk"):
        results.write(Result(practice_06).groups, tmp_path / "result.nc")
    assert list(tmp_path.iterdir()) == []


def test_a_folder_that_cannot_be_created(practice_06, tmp_path):
    (tmp_path / "file").write_text("")
    with pytest.raises(InputError, match="cannot be written"):
        results.write(Result(practice_06).groups, tmp_path / "file" / "result.nc")


def test_what_is_no_result(tmp_path, builtin_flight, written):
    with pytest.raises(InputError, match="no such result"):
        results.read(tmp_path / "none.nc")
    (tmp_path / "text.nc").write_text("text")
    with pytest.raises(InputError, match="no HDF5 file"):
        results.read(tmp_path / "text.nc")
    with pytest.raises(InputError, match="format is 'edl-flight'"):
        results.read(builtin_flight)
    old = tmp_path / "old.nc"
    old.write_bytes(written["result"].read_bytes())
    with h5py.File(old, "a") as file:
        file.attrs["format_version"] = 99
    with pytest.raises(InputError, match="version 99"):
        results.read(old)
    with h5py.File(old, "a") as file:
        file.attrs["format_version"] = netcdf.FORMAT_VERSION
        del file["trajectory"]
    with pytest.raises(InputError, match=r"old\.nc: the group /trajectory is missing"):
        results.read(old)
