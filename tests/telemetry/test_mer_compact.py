"""The rovers' tables as the package ships them: the archive's numbers to the bit, their origin, and damaged files."""

import hashlib
import shutil
from dataclasses import fields
from pathlib import Path

import h5py
import numpy as np
import pytest
from mer_volume import contents, shipped_file, write_volume

from edl_filter.errors import InputError
from edl_filter.mission import Mission
from edl_filter.pipeline.load import read_telemetry
from edl_filter.telemetry.fetch import REGISTRY
from edl_filter.telemetry.mer_archive import read_mer_tables
from edl_filter.telemetry.mer_compact import FILE_NAMES, read_compact_table, write_compact
from edl_filter.telemetry.pds3 import read_table

ROVERS = {2: "mer_a", 1: "mer_b"}
#: Greatest size of a file that is shipped, bytes.
LARGEST = 1_000_000

rovers = pytest.mark.parametrize("spacecraft", ROVERS, ids=ROVERS.values())


@pytest.fixture
def spirit_file(tmp_path):
    """A copy of Spirit's file, to be damaged."""
    return Path(shutil.copy(shipped_file(2), tmp_path / "spirit.h5"))


@pytest.fixture(params=["written from the package", "originals"])
def volume(request):
    """Folder of the volume: the text written from the package's numbers, and the originals where they are at hand."""
    return request.getfixturevalue("mer_originals" if request.param == "originals" else "written_volume")


@pytest.fixture(scope="session")
def written_volume(tmp_path_factory):
    return write_volume(tmp_path_factory.mktemp("written") / "volume")


def arrays(record):
    """Arrays of a dataclass by name, as bytes: equal only if the numbers are equal to the bit, NaN included."""
    values = {field.name: getattr(record, field.name) for field in fields(record)}
    return {name: (v.dtype, v.shape, v.tobytes()) for name, v in values.items() if isinstance(v, np.ndarray)}


# --- equality with the archive


def test_the_archives_tables_follow_from_the_shipped_numbers_to_the_byte(written_volume):
    names = [name for name in REGISTRY if name.endswith(".TAB")]
    assert len(names) == 4
    for name in names:
        assert hashlib.sha256((written_volume / name).read_bytes()).hexdigest() == REGISTRY[name], name


@rovers
def test_columns_are_those_of_the_text_to_the_bit(spacecraft, volume):
    for product in ("TRANSFORMED", "HIGHRATE"):
        text = read_table(volume / "DATA" / f"{spacecraft}{product}.LBL")
        compact = read_compact_table(shipped_file(spacecraft), f"{spacecraft}{product}")
        assert list(compact.columns) == list(text.columns) and compact.units == text.units
        for name, values in text.columns.items():
            assert compact.columns[name].tobytes() == values.tobytes(), name
        keywords = {key: value for key, value in text.label.items() if key[0].isalpha() and key != "TABLE"}
        assert compact.label == keywords


@rovers
def test_volume_and_compact_form_give_the_same_tables(spacecraft, volume):
    text, compact = read_mer_tables(volume, spacecraft), read_mer_tables(shipped_file(spacecraft), spacecraft)
    assert arrays(compact.transformed) == arrays(text.transformed) and len(arrays(text.transformed)) == 8
    assert arrays(compact.highrate) == arrays(text.highrate) and len(arrays(text.highrate)) == 5
    assert compact.notes[1:] == text.notes


@rovers
def test_volume_and_compact_form_give_the_same_samples(spacecraft, volume):
    name = ROVERS[spacecraft]
    text = read_telemetry(Mission.load(f"builtin:{name}", [f"telemetry.path={volume}"]))
    compact = read_telemetry(Mission.load(f"builtin:{name}", [f"telemetry.path=builtin:{name}"]))
    assert len(compact.driving.time) > 4500 and len(compact.checking) == 1
    for ours, theirs in zip(
        (compact.driving, *compact.checking, compact.attitude), (text.driving, *text.checking, text.attitude),
        strict=True,
    ):  # fmt: skip
        assert arrays(ours) == arrays(theirs)


@rovers
def test_the_checksums_of_a_result_are_those_of_the_originals(spacecraft):
    """A result of one source can be diagnosed with the other."""
    names = [f"DATA/{spacecraft}{product}.{kind}" for product in ("TRANSFORMED", "HIGHRATE") for kind in ("LBL", "TAB")]
    assert read_mer_tables(shipped_file(spacecraft), spacecraft).files == {name: REGISTRY[name] for name in names}


# --- origin and size


@rovers
def test_attributes_state_the_origin(spacecraft):
    members = contents(shipped_file(spacecraft))
    root, _ = members[""]
    assert root["volume_id"] == "MERIMU_1001" and root["volume_url"].endswith("/merimu_1001/")
    assert root["command"] == "edl-filter fetch mer-imu --compact FOLDER"
    assert root["citation"].startswith("Kass, Schofield")
    for product in (f"{spacecraft}TRANSFORMED", f"{spacecraft}HIGHRATE"):
        attributes, _ = members[product]
        assert attributes["PRODUCT_ID"] == product and attributes["DATA_SET_ID"] == "MER1/MER2-M-IMU-4-EDL-V1.0"
        for kind, suffix in (("label", "LBL"), ("table", "TAB")):
            assert attributes[f"{kind}_file"] == f"DATA/{product}.{suffix}"
            assert attributes[f"{kind}_sha256"] == REGISTRY[f"DATA/{product}.{suffix}"]


def test_files_are_small():
    package = shipped_file(1).parent
    tests = Path(__file__).parents[1] / "data"
    sizes = {path: path.stat().st_size for folder in (package, tests) for path in folder.rglob("*.h5")}
    assert len(sizes) >= 10
    assert {path.name: size for path, size in sizes.items() if size > LARGEST} == {}


def test_the_writer_repeats_the_shipped_numbers(written_volume, tmp_path):
    """All but the checksums of the labels, which are shorter here than in the archive."""
    paths = write_compact(written_volume, tmp_path / "compact")
    assert [path.name for path in paths] == ["mer_a.h5", "mer_b.h5"]
    for spacecraft, name in FILE_NAMES.items():
        expected, members = contents(shipped_file(spacecraft)), contents(tmp_path / "compact" / name)
        for attributes in (*(m[0] for m in expected.values()), *(m[0] for m in members.values())):
            attributes.pop("label_sha256", None)
        assert members == expected


# --- bad input


def test_a_damaged_file_is_refused(spirit_file):
    content = bytearray(spirit_file.read_bytes())
    with h5py.File(spirit_file) as file:
        chunk = file["2HIGHRATE/ROVER_IMU_RATES_X"].id.get_chunk_info(0)
    content[chunk.byte_offset + chunk.size // 2] ^= 1
    spirit_file.write_bytes(content)
    with pytest.raises(InputError, match=r"spirit.h5: this is no HDF5 file, or a damaged one; a file with the tables"):
        read_compact_table(spirit_file, "2HIGHRATE")


@pytest.mark.parametrize("content", [b"text", None], ids=["no HDF5", "truncated"])
def test_another_file_is_refused(spirit_file, content):
    spirit_file.write_bytes(spirit_file.read_bytes()[:200_000] if content is None else content)
    with pytest.raises(InputError, match=r"spirit.h5: this is no HDF5 file, or a damaged one"):
        read_mer_tables(spirit_file, 2)


def test_a_changed_number_is_refused(spirit_file):
    with h5py.File(spirit_file, "a") as file:
        file["2TRANSFORMED/BACKSHELL_IMU_ACCEL_Z"][4000] += 1
    with pytest.raises(InputError, match=r"the numbers of 2TRANSFORMED differ from their checksum; the file was"):
        read_mer_tables(spirit_file, 2)


def test_a_file_without_a_column_or_of_another_version_is_refused(spirit_file):
    with h5py.File(spirit_file, "a") as file:
        del file["2HIGHRATE/ROVER_IMU_RATES_X"]
    with pytest.raises(InputError, match=r"spirit.h5: this is no HDF5 file, or a damaged one"):
        read_mer_tables(spirit_file, 2)
    with h5py.File(spirit_file, "a") as file:
        file.attrs["version"] = 2
    with pytest.raises(InputError, match=r"spirit.h5: attribute version is 2; version 1 is read"):
        read_mer_tables(spirit_file, 2)


def test_an_unknown_spacecraft_and_the_other_rovers_file_are_refused(spirit_file):
    with pytest.raises(InputError, match=r"spacecraft is 3; 1 \(MER-B Opportunity\) and 2"):
        read_mer_tables(spirit_file, 3)
    with pytest.raises(
        InputError, match=r"has the tables 2HIGHRATE, 2TRANSFORMED \(MER-A Spirit.*\), not 1TRANSFORMED; telemetry.path"
    ):
        read_mer_tables(spirit_file, 1)


def test_a_number_with_more_decimals_is_not_written(written_volume, tmp_path):
    volume = shutil.copytree(written_volume, tmp_path / "volume")
    label = volume / "DATA" / "2HIGHRATE.LBL"
    label.write_bytes(label.read_bytes().replace(b'"F9.6"', b'"F9.5"', 1))
    with pytest.raises(InputError, match=r"2HIGHRATE.TAB, row \d+, column ROVER_IMU_RATES_X: .* is not F9.5"):
        write_compact(volume, tmp_path / "compact")
    assert not (tmp_path / "compact" / "mer_a.h5").exists()
    label.write_bytes(label.read_bytes().replace(b'"F9.5"', b'"E9.2"', 1))
    with pytest.raises(InputError, match=r"column ROVER_IMU_RATES_X has FORMAT 'E9.2'; Fw.d is needed"):
        write_compact(volume, tmp_path / "compact")
    label.unlink()
    with pytest.raises(InputError, match=r"2HIGHRATE.LBL is not there; the folder of volume merimu_1001 is needed"):
        write_compact(volume, tmp_path / "compact")
