"""Every key of the JSON files in a result folder, from their schemas: tables, and JSON Schema."""

from __future__ import annotations

import json
from pathlib import Path
from types import NoneType
from typing import Any, get_args

from mission_keys import Part, kind, parts
from pydantic import BaseModel


def schema_file(file: str) -> str:
    """Name of the file with the JSON Schema of `file`."""
    return f"{Path(file).stem}.schema.json"


def file_text(stem: str) -> str:
    """Markdown of the file called `stem` without its ending: a table for each part, and a link to its JSON Schema."""
    from edl_filter.results.schema import MODELS

    (file,) = [name for name in MODELS if Path(name).stem == stem]
    tables = [_table(equal_parts) for model in MODELS[file] for equal_parts in _by_model(model)]
    # HTML, since Sphinx would check a Markdown link before `build_finished` writes the file
    return "\n\n".join([f'JSON Schema: <a href="../schemas/{schema_file(file)}">{schema_file(file)}</a>', *tables])


def _by_model(model: type[BaseModel]) -> list[list[Part]]:
    """Parts of a file, grouped by model; the settings of a diagnosis are on the page of the mission."""
    from edl_filter.results.schema import Content

    by_model: dict[type[BaseModel], list[Part]] = {}
    for part in parts(Part("", model)):
        if issubclass(part.model, Content):
            by_model.setdefault(part.model, []).append(part)
    return list(by_model.values())


def _table(equal_parts: list[Part]) -> str:
    part, paths = equal_parts[0], dict.fromkeys(p.path for p in equal_parts)
    doc = (part.model.__doc__ or "").strip().split("\n\n")[0]
    rows = ["| key | value | what it is |", "|---|---|---|"]
    for key, field in part.model.model_fields.items():
        value = kind(field.annotation, field.metadata) or "null"
        if value != "null" and NoneType in get_args(field.annotation):
            value += " or null"
        if not field.is_required():
            value += "; may be absent"
        cells = (f"`{key}`", value, field.description)
        rows.append("| " + " | ".join(cell.replace("|", "\\|") for cell in cells) + " |")
    title = f"### {', '.join(f'`{path}`' for path in paths)}\n\n" if part.path else ""
    return f"{title}{doc}\n\n" + "\n".join(rows)


def write_schemas(folder: Path) -> list[Path]:
    """Write the JSON Schema of each file into a folder."""
    from edl_filter.results.schema import json_schemas

    folder.mkdir(parents=True, exist_ok=True)
    written = []
    for file, schema in json_schemas().items():
        path = folder / schema_file(file)
        path.write_text(json.dumps(schema, indent=2, ensure_ascii=False) + "\n", encoding="utf-8")
        written.append(path)
    return written


def build_finished(app: Any, error: Exception | None) -> None:
    """Write the schemas into the folder of the pages."""
    if error is None and app.builder.format == "html":
        write_schemas(Path(app.outdir) / "schemas")
