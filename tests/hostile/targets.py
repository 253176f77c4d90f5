"""Readers of files from unknown sources, and mutations of valid files.

A reader may return or raise `InputError`; anything else is a fault, and so is a memory peak beyond ten times the file
or a call that does not end. `seeds` gives valid files; `READERS` reads one.
"""

from __future__ import annotations

import json
import signal
import tracemalloc
from contextlib import contextmanager
from importlib.resources import files
from pathlib import Path
from shutil import copyfile

import contents
import h5py
import numpy as np

from edl_filter.errors import InputError
from edl_filter.mission import Mission
from edl_filter.results.files import read_diagnosis, read_ledger, read_summary
from edl_filter.results.netcdf import load
from edl_filter.results.reader import ResultReader
from edl_filter.results.reopen import reopen
from edl_filter.telemetry.csv_log import convert
from edl_filter.telemetry.flight_file import read_flight_file
from edl_filter.telemetry.mer_compact import read_compact_table
from edl_filter.telemetry.pds3 import read_table

ROOT = Path(__file__).parents[2]
#: Longest time of one call, s, and memory: ten times the file, above what the code itself needs. PyYAML needs some
#: hundred bytes for a number of its text, which has at most 256 KiB.
LONGEST_S, EXPANSION, OWN_MEMORY = 20.0, 10, 48 << 20
LABEL = """PDS_VERSION_ID = PDS3
RECORD_BYTES = 16
FILE_RECORDS = 3
^TABLE = "T.TAB"
OBJECT = TABLE
  INTERCHANGE_FORMAT = ASCII
  ROWS = 3
  COLUMNS = 2
  ROW_BYTES = 16
  OBJECT = COLUMN
    NAME = SCLK
    DATA_TYPE = ASCII_REAL
    START_BYTE = 1
    BYTES = 6
    UNIT = "S"  /* seconds */
  END_OBJECT = COLUMN
  OBJECT = COLUMN
    NAME = X
    DATA_TYPE = ASCII_INTEGER
    START_BYTE = 8
    BYTES = 7
  END_OBJECT = COLUMN
END_OBJECT = TABLE
END
"""
TABLE = "1.0000      12\r\n2.0000      13\r\n3.0000      14\r\n"


def _read_label(path: Path) -> None:
    path.with_name("T.TAB").write_bytes(TABLE.encode())
    read_table(path)


def _read_pds_table(path: Path) -> None:
    (path.parent / "T.LBL").write_text(LABEL)
    read_table(path.parent / "T.LBL")


def _convert_log(path: Path) -> None:
    convert(path, ROOT / "docs/examples/imu_log.spec.yaml", path.with_name("flight.h5"))


def _convert_spec(path: Path) -> None:
    convert(ROOT / "docs/examples/imu_log.csv", path, path.with_name("flight.h5"))


def _read_result(path: Path) -> None:
    load(path)
    reopen(path)
    with ResultReader.open(path) as reader:
        for group in reader.groups.values():
            for variable in group.variables.values():
                _ = variable.values, variable.attrs, variable.dims


#: Kind of file → its name, and how it is read.
READERS = {
    "mission": ("mission.yaml", Mission.load),
    "label": ("T.LBL", _read_label),
    "table": ("T.TAB", _read_pds_table),
    "log": ("log.csv", _convert_log),
    "log specification": ("spec.yaml", _convert_spec),
    "flight": ("flight.h5", read_flight_file),
    "compact": ("mer.h5", lambda path: read_compact_table(path, "2HIGHRATE")),
    "result": ("result.nc", _read_result),
    "summary": ("summary.json", read_summary),
    "diagnosis": ("diagnosis.json", read_diagnosis),
    "ledger": ("ledger.jsonl", read_ledger),
}


def seeds(folder: Path) -> dict[str, bytes]:
    """A valid file of each kind as bytes; small ones, so that mutations hit what matters."""
    missions = ROOT / "missions"
    log = (ROOT / "docs/examples/imu_log.csv").read_text().splitlines(keepends=True)
    flight = folder / "seed.h5"
    short_flight(flight)
    result = folder / "seed.nc"
    with h5py.File(result, "w") as file:
        file.attrs.update({
            "format": "edl-result", "format_version": 2, "edl_filter_version": _version(), "effects": "{}",
            "residuals": "{}", "input_sha256": "{}", "trust": '{"headline": null}',
            "mission_yaml": (missions / "practice_mer.yaml").read_text(),
        })  # fmt: skip
        time = file.create_dataset("trajectory/time", data=np.arange(8.0))
        time.make_scale("time")
        height = file.create_dataset("trajectory/altitude", data=np.arange(8.0))
        height.dims[0].attach_scale(time)
    return {
        "mission": (missions / "mer_a.yaml").read_bytes(),
        "label": LABEL.encode(),
        "table": TABLE.encode(),
        "log": "".join(log[:12]).encode(),
        "log specification": (ROOT / "docs/examples/imu_log.spec.yaml").read_bytes(),
        "flight": flight.read_bytes(),
        "compact": _small_compact(folder / "compact.h5"),
        "result": result.read_bytes(),
        "summary": b'{"events": {}, "trustworthy": true, "landing": null, "constraints": {}}',
        "diagnosis": json.dumps(contents.diagnosis()).encode(),
        "ledger": (json.dumps(contents.ledger_step()) + "\n" + json.dumps(contents.ledger_end()) + "\n").encode(),
    }


def _version() -> str:
    from edl_filter import __version__

    return __version__


def _small_compact(path: Path) -> bytes:
    with h5py.File(path, "w") as file:
        file.attrs.update({"format": "edl-mer-tables", "version": 1, "title": "x"})
        group = file.create_group("2HIGHRATE")
        group.attrs["columns"] = ["A", "B"]
        for name in ("A", "B"):
            group.create_dataset(name, data=np.arange(32)).attrs.update({"decimals": 2, "unit": "s"})
        group.attrs.update({"values_sha256": "0", "label_file": "a", "label_sha256": "b", "table_file": "c"})
    return path.read_bytes()


def short_flight(path: Path, samples: int = 200) -> None:
    """The shipped flight with its first samples only, and no truth."""
    copyfile(str(files("edl_filter") / "data" / "practice_06.h5"), path.with_suffix(".long"))
    with h5py.File(path.with_suffix(".long"), "r") as long, h5py.File(path, "w") as file:
        for name in ("imu", "initial", "events", "constraints", "altimeter"):
            long.copy(name, file)
        file.attrs.update(dict(long.attrs))
        for imu in file["imu"].values():
            for key in ("time", "specific_force", "angular_rate"):
                values = imu[key][:samples]
                del imu[key]
                imu[key] = values
        del file["constraints/landing"], file["constraints/parachute"], file["altimeter"]


@contextmanager
def _ends():
    def stop(_signal, _frame):
        raise TimeoutError(f"not finished after {LONGEST_S:g} s")

    before = signal.signal(signal.SIGALRM, stop)
    signal.setitimer(signal.ITIMER_REAL, LONGEST_S)
    try:
        yield
    finally:
        signal.setitimer(signal.ITIMER_REAL, 0.0)
        signal.signal(signal.SIGALRM, before)


def read(kind: str, data: bytes, folder: Path, memory: bool = True) -> str:
    """Read bytes as a file of a kind; ``read``, or the message of the refusal.

    Raises
    ------
    AssertionError
        The reader needed more memory than the file justifies, or refused without a sentence that names the file.
    Exception
        A fault of the reader.
    """
    name, reader = READERS[kind]
    path = folder / name
    path.write_bytes(data)
    outcome = "read"
    if memory:
        tracemalloc.start()
    try:
        with _ends():
            reader(path)
    except InputError as error:
        outcome = str(error)
        assert outcome.strip(), f"{kind}: refused without a message"
        assert len(outcome) < 4000, f"{kind}: a message of {len(outcome)} characters"
    finally:
        if memory:
            peak = tracemalloc.get_traced_memory()[1]
            tracemalloc.stop()
    if memory:
        assert peak <= EXPANSION * len(data) + OWN_MEMORY, f"{kind}: {peak} bytes for a file of {len(data)}"
    return outcome


#: Pieces that parsers stumble over.
TOKENS = (
    b"", b"\x00", b"\xff\xfe", b"\xef\xbb\xbf", b"&a ", b"*a", b"<<: ", b"!!python/object:os.system ", b"[" * 2000,
    b"{" * 2000, b"- " * 500, b"9" * 5000, b"1e999", b"-1e999", b".nan", b".inf", b"nan", b"-0", b"null", b"~",
    b"0x" + b"f" * 400, b"0", b"-1", b"1.5", b"true", b"''", b'"', b"'", b":", b"\n", b"\r\n", b"\t", b"#", b",",
    b"../../../etc/passwd", b"/dev/zero", b"()", b"END", b"END_OBJECT = TABLE\n", b"OBJECT = TABLE\n",
    b"OBJECT = COLUMN\n", b"TABLE = 1\n", b"COLUMN = 1\n", b"\xe2\x88\x92", b"\xed\xa0\x80", b"{}", b"[]",
    b"a: b: c", b"? x", b"|\n", b"%YAML 9.9\n", b"---\n", b"...\n",
)  # fmt: skip


def mutated(data: bytes, changes: list[tuple[int, float, float, int]]) -> bytes:
    """Bytes after changes (kind of the change, place, length, number of a token or bit)."""
    for kind, place, length, number in changes:
        at = int(place * len(data))
        end = min(len(data), at + 1 + int(length**3 * 64))
        token = TOKENS[number % len(TOKENS)]
        if kind == 0:  # a bit
            if data:
                at = min(at, len(data) - 1)
                data = data[:at] + bytes([data[at] ^ (1 << number % 8)]) + data[at + 1 :]
        elif kind == 1:
            data = data[:at] + token + data[at:]
        elif kind == 2:
            data = data[:at] + token + data[end:]
        elif kind == 3:
            data = data[:at] + data[end:]
        elif kind == 4:
            data = data[:end] + data[at:]
        else:
            data = data[:at]
    return data
