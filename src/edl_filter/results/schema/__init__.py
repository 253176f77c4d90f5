"""Schemas of the JSON files in a result folder: every key with its type, unit and meaning.

In: the content of a JSON file. Out: the same as a checked model with attributes, and JSON Schema (`json_schemas`).
`edl_filter.results.files` reads the files through these models, and ``docs/reference/result-files.md`` publishes them
as tables and as JSON Schema.

Read in this order: `fields` (what all schemas share), `summary` (`Summary` is ``summary.json``), `diagnosis`
(`DiagnosisContent` is ``diagnosis.json``), `ledger` (`LedgerLine` is one line of ``ledger.jsonl``).

Keys carry their unit at the end of the name or in the description. A key without a default is always in the file. A
number that may be null is null where it is not finite.
"""

from __future__ import annotations

from typing import Any

from pydantic import TypeAdapter

from edl_filter.results.schema.diagnosis import DiagnosisContent
from edl_filter.results.schema.fields import Content
from edl_filter.results.schema.ledger import LedgerEnd, LedgerLine, LedgerStep
from edl_filter.results.schema.summary import Summary

__all__ = [
    "MODELS", "Content", "DiagnosisContent", "LedgerEnd", "LedgerLine", "LedgerStep", "Summary", "json_schemas",
]  # fmt: skip

#: File → models of its contents; the ledger has two kinds of line.
MODELS: dict[str, tuple[type[Content], ...]] = {
    "summary.json": (Summary,),
    "diagnosis.json": (DiagnosisContent,),
    "ledger.jsonl": (LedgerStep, LedgerEnd),
}


def json_schemas() -> dict[str, dict[str, Any]]:
    """JSON Schema (draft 2020-12) of each file, that of the ledger for one line."""
    dialect = {"$schema": "https://json-schema.org/draft/2020-12/schema"}
    schemas = {
        "summary.json": Summary.model_json_schema(),
        "diagnosis.json": DiagnosisContent.model_json_schema(),
        "ledger.jsonl": TypeAdapter(LedgerLine).json_schema(),
    }
    return {
        file: dialect | {"title": file} | {k: v for k, v in s.items() if k != "title"} for file, s in schemas.items()
    }
