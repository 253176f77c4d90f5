"""Files made to do harm: refused with a sentence that names the file and the reason."""

import time

import h5py
import numpy as np
import pytest
import targets

from edl_filter.errors import InputError
from edl_filter.io.yaml_guard import refuse_aliases
from edl_filter.mission import Mission
from edl_filter.mission.yaml_text import parse
from edl_filter.results.netcdf import load
from edl_filter.telemetry.csv_spec import read_spec
from edl_filter.telemetry.fetch import REGISTRY
from edl_filter.telemetry.flight_file import read_flight_file
from edl_filter.telemetry.pds3 import read_table


def contains_itself(file):
    file["imu/again"] = file["imu"]


def external_link(file):
    file["altimeter"] = h5py.ExternalLink("/etc/passwd", "/")


def symbolic_link(file):
    file["altimeter"] = h5py.SoftLink("/altimeter")


def external_storage(file):
    file.create_dataset("imu/primary/more", (4,), dtype="f8", external=[("/etc/passwd", 0, 32)])


def virtual(file):
    layout = h5py.VirtualLayout((4,), "f8")
    layout[:] = h5py.VirtualSource("other.h5", "x", (4,))
    file.create_virtual_dataset("virtual", layout)


def absurd_shape(file):
    del file["imu/primary/specific_force"]
    file.create_dataset("imu/primary/specific_force", (10**12, 3), chunks=(1024, 3), dtype="f8")


def constant_that_compresses(file):
    del file["imu/primary/time"]
    file.create_dataset("imu/primary/time", data=np.zeros(10**7), compression="gzip", chunks=(10**5,))


def many_groups(file):
    for k in range(20_001):
        file.create_group(f"g{k}")


def deep(file):
    file.create_group("/".join(["a"] * 40))


HDF5 = {
    contains_itself: "has another name already",
    external_link: "is a link to another member or file",
    symbolic_link: "is a link to another member or file",
    external_storage: "has its numbers in another file",
    virtual: "has its numbers in another file",
    absurd_shape: r"has shape \(1000000000000, 3\)",
    constant_that_compresses: "more than 10 times as large as the file",
    many_groups: "at most 20000 are read",
    deep: "is deeper than 16 groups",
}


@pytest.mark.parametrize("reader", [read_flight_file, load], ids=["flight", "result"])
@pytest.mark.parametrize("change", HDF5, ids=lambda change: change.__name__)
def test_an_hdf5_file_that_is_no_plain_data_is_refused(change, reader, tmp_path):
    path = tmp_path / "hostile.h5"
    targets.short_flight(path)
    with h5py.File(path, "a") as file:
        change(file)
    begin = time.perf_counter()
    with pytest.raises(InputError, match=rf"hostile\.h5: /.*{HDF5[change]}"):
        reader(path)
    assert time.perf_counter() - begin < 5.0


BOMB = "a: &a [1, 2, 3, 4, 5, 6, 7, 8, 9]\n" + "".join(
    f"{y}: &{y} [{', '.join(9 * ['*' + x])}]\n" for x, y in zip("abcdefgh", "bcdefghi", strict=True)
)


@pytest.mark.parametrize(
    ("text", "reason"),
    [
        (BOMB, "anchors and aliases"),
        ("name: " + "[" * 50_000, "too many levels"),
        ("name: " + "{a: " * 5000, "too many levels"),
        ("name: " + "9" * 5000, "digits"),
        ("name: [" + "1," * 200_000 + "1]", "at most 262144"),
        ("name: !!python/object/apply:os.system [id]", "python/object"),
    ],
    ids=["aliases", "brackets", "braces", "digits", "long", "object"],
)
@pytest.mark.parametrize("reader", [Mission.load, read_spec], ids=["mission", "specification"])
def test_yaml_that_multiplies_or_never_ends_is_refused(text, reason, reader, tmp_path):
    path = tmp_path / "bomb.yaml"
    path.write_text(text)
    begin = time.perf_counter()
    with pytest.raises(InputError, match=rf"(?s)bomb\.yaml.*{reason}"):
        reader(path)
    assert time.perf_counter() - begin < 10.0


@pytest.mark.parametrize(
    "nested",
    [
        lambda levels: "[" * levels + "]" * levels,
        lambda levels: "".join(" " * k + "a:\n" for k in range(levels)),
        lambda levels: "- " * levels + "a",
        lambda levels: "- " * (levels // 2) + "[" * (levels - levels // 2) + "]" * (levels - levels // 2),
    ],
    ids=["brackets", "indented keys", "dashes", "both"],
)
@pytest.mark.parametrize("check", [parse, refuse_aliases])
def test_yaml_has_at_most_64_levels(check, nested):
    """The scanner ends there: a parser would look a thousand characters ahead at each level."""
    check(nested(64), "x.yaml")
    for levels in (65, 500):
        with pytest.raises(InputError, match=r"^x\.yaml: cannot be read as YAML: it has too many levels"):
            check(nested(levels), "x.yaml")


@pytest.mark.parametrize("name", ["../T.TAB", "/etc/passwd", "a/T.TAB", "..", "T" * 5000])
def test_a_label_names_a_table_in_its_own_folder(name, tmp_path):
    (tmp_path / "T.TAB").write_text(targets.TABLE)
    label = tmp_path / "volume" / "T.LBL"
    label.parent.mkdir()
    label.write_text(targets.LABEL.replace("T.TAB", name))
    with pytest.raises(InputError, match=r"the name of a file in its folder is needed|is not in"):
        read_table(label)


@pytest.mark.parametrize("name", ["../../x", "a/b", "/tmp/x", "..", "x\\y", "x\n"])
def test_the_name_of_a_mission_is_no_path(name, tmp_path):
    path = tmp_path / "mission.yaml"
    text = (targets.ROOT / "missions/practice_mer.yaml").read_text().splitlines(keepends=True)
    path.write_text("".join(f"name: {name!r}\n" if line.startswith("name:") else line for line in text))
    with pytest.raises(InputError, match="name"):
        Mission.load(path)


def test_fetch_writes_only_below_its_folder():
    assert all(".." not in name and not name.startswith("/") and "\\" not in name for name in REGISTRY)
