"""The store: values at their place, chunks, lazy reading, and replacement in one step."""

import numpy as np
import pytest

from edl_filter.errors import InputError
from edl_filter.results.campaign_store import CHUNK, open_store, write_store

GROUPS = [("a", "x"), ("b", "x")]


def record(number, **values):
    return {"case": number, "values": {"trustworthy": 1.0} | values, "seconds": 0.5}


def written(folder, records, total, failed=()):
    done, failures = np.zeros(total, bool), np.zeros(total, bool)
    done[[r["case"] for r in records]], failures[list(failed)] = True, True
    shards = [[r for r in records if r["case"] // CHUNK == k] for k in range((total - 1) // CHUNK + 1)]
    return write_store(folder / "results.zarr", lambda: iter(shards), GROUPS, done, failures, {"title": "t"})


def test_values_are_at_their_case_and_labels(tmp_path):
    records = [
        record(0, event_time={"landing": 10.0}, nees={"rest": {"all": 9.0}}),
        record(3, event_time={"landing": 13.0, "peak": 5.0}, landing_sigma=None),
        record(CHUNK + 1, event_time={"peak": 6.0}),
    ]
    data = open_store(written(tmp_path, records, CHUNK + 4, failed=[1]))
    assert data["event_time"].sel(event="landing").values[[0, 3]].tolist() == [10.0, 13.0]
    assert data["event_time"].sel(event="peak").values[[3, CHUNK + 1]].tolist() == [5.0, 6.0]
    assert np.isfinite(data["event_time"].values).sum() == 4
    assert float(data["nees"].sel(phase="rest", part="all")[0]) == 9.0
    assert np.isnan(data["landing_sigma"].values).all()
    assert data["outcome"].values[:4].tolist() == [0, 1, 2, 0]
    assert data["flight"].values[:3].tolist() == ["a", "b", "a"] and data["case"].values[0] == 0
    assert data["event_time"].attrs["units"] == "s" and data.attrs["title"] == "t"
    assert data["event_time"].chunks[0] == (CHUNK, 4)  # dask arrays: nothing is loaded before it is used


def test_a_new_store_replaces_the_earlier_one(tmp_path):
    written(tmp_path, [record(0)], 2)
    data = open_store(written(tmp_path, [record(0), record(1, landing_sigma=2.0)], 2))
    assert data["landing_sigma"].values[1] == 2.0
    assert [p.name for p in tmp_path.iterdir()] == ["results.zarr"]


def test_without_a_store_the_message_names_the_command(tmp_path):
    with pytest.raises(InputError, match="found no store; 'edl-filter campaign"):
        open_store(tmp_path)
