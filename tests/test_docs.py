"""README and docs: valid command lines and links, and references with every key, command and effect."""

import re
import shlex
from pathlib import Path

import pytest
import yaml
from command_pages import command_tree, commands_text
from effect_pages import effects_text
from file_pages import file_text, schema_file, write_schemas
from generated import fill
from mission_keys import keys_text

ROOT = Path(__file__).parents[1]

PAGES = [
    ROOT / "README.md", ROOT / "CONTRIBUTING.md", ROOT / "CHANGELOG.md",
    *sorted(p for p in (ROOT / "docs").rglob("*.md") if "_build" not in p.parts),
]  # fmt: skip
BLOCK = re.compile(r"^ *```(?:sh|console)\n(.*?)^ *```", re.MULTILINE | re.DOTALL)
LINK = re.compile(r"\[[^\]]*\]\(([^)\s]+)\)")


def page_name(page):
    return str(page.relative_to(ROOT))


def commands_of(text):
    """Command lines of edl-filter in the shell blocks of a page, as lists of words after the program's name."""
    commands = []
    for block in BLOCK.findall(text):
        for line in block.replace("\\\n", " ").splitlines():
            words = shlex.split(line.strip().removeprefix("$ "), comments=True) if "edl-filter" in line else []
            if words and Path(words[0]).name == "edl-filter":
                commands.append(words[1:])
    return commands


def usage_error(words):
    """Error of a command line; None if it is valid."""
    tree = command_tree()
    if not words or words[0] not in tree.commands:
        return f"no such command: {words[:1]}"
    command = tree.commands[words[0]]
    try:
        command.make_context(words[0], list(words[1:]))
    except Exception as error:  # typer brings its own click, whose exceptions have no public name
        return None if type(error).__name__ == "Exit" else error.format_message()  # Exit: --help
    return None


def broken_links(page, text):
    """Relative links of a page to files that do not exist."""
    links = [link.split("#")[0] for link in LINK.findall(text) if not re.match(r"[a-z]+:|#", link)]
    return [link for link in links if link and not (page.parent / link).exists()]


@pytest.mark.parametrize("page", PAGES, ids=page_name)
def test_command_lines_are_valid(page):
    errors = {" ".join(w): usage_error(w) for w in commands_of(page.read_text(encoding="utf-8"))}
    assert not {line: error for line, error in errors.items() if error}


@pytest.mark.parametrize("page", PAGES, ids=page_name)
def test_links_are_valid(page):
    assert broken_links(page, page.read_text(encoding="utf-8")) == []


def test_the_tutorial_uses_every_step_of_the_diagnosis():
    used = [w[0] for w in commands_of((ROOT / "docs" / "tutorial.md").read_text(encoding="utf-8"))]
    assert {"simulate", "run", "diagnose", "add", "compare", "improve"} <= set(used)


def test_the_checks_find_errors():
    page = "```sh\nedl-filter run m.yaml --sett a=1\nedl-filter rum m.yaml\nedl-filter add m.yaml   # no effect\n```\n"
    first, second, third = (usage_error(w) for w in commands_of(page))
    assert "--sett" in first and "no such command" in second and "effect" in third
    assert broken_links(ROOT / "README.md", "[a](docs/nothing.md) [b](README.md#x) [c](https://x.org)") == [
        "docs/nothing.md"
    ]


@pytest.mark.parametrize("name", command_tree().commands)
def test_each_command_has_a_valid_example(name):
    epilog = command_tree().commands[name].epilog or ""
    assert epilog.startswith(f"Example: edl-filter {name} "), epilog
    assert usage_error(shlex.split(epilog)[2:]) is None


def test_the_program_itself_has_an_example():
    example = shlex.split(command_tree().epilog or "")
    assert example[:2] == ["Example:", "edl-filter"]
    assert usage_error(example[2:]) is None


def test_every_command_is_in_the_reference():
    text = commands_text()
    for name, command in command_tree().commands.items():
        assert f"## `{name}`" in text
        for parameter in command.params:
            assert any(f"`{word}" in text or f", {word}" in text for word in (*parameter.opts, parameter.name.upper()))


def keys_in(data, path=""):
    """Section and key of every entry of a file, with N for indices of lists."""
    for key, value in data.items() if isinstance(data, dict) else [("N", v) for v in data]:
        yield (path, key)
        if isinstance(value, dict) or (isinstance(value, list) and value and isinstance(value[0], dict)):
            yield from keys_in(value, f"{path}.{key}".strip("."))


@pytest.mark.parametrize("file", sorted((ROOT / "missions").rglob("*.yaml")), ids=page_name)
def test_every_key_of_the_shipped_files_is_in_the_reference(file):
    from edl_filter.mission import Mission
    from edl_filter.simulation import Scenario
    from edl_filter.simulation.campaign_config import Campaign

    models = {"scenarios": Scenario, "campaigns": Campaign}
    text = keys_text(models.get(file.parent.name, Mission))
    for path, key in keys_in(yaml.safe_load(file.read_text(encoding="utf-8"))):
        named = re.sub(r"(vehicle\.events|imus|flights|dispersions)\.\w+", r"\1.NAME", path)
        if re.search(r"(vehicle\.events|imus|flights|dispersions)$", named) or key == "N":
            continue  # a name chosen by the user
        title = f"`{named}`" if named else "At the top of the file"
        sections = [s for s in text.split("## ") if s.startswith(title)]
        assert any(f"| `{key}` |" in s for s in sections), f"{named}.{key}"


def test_the_reference_has_unit_range_and_default():
    from edl_filter.mission import Mission

    text = keys_text(Mission)
    assert "| `mass` | kg between 1 and 100000 | **required** | mass at entry, kg |" in text
    assert "| `density_correlation_m` | m between 10 and 200000 | `10000.0` |" in text
    assert "## `telemetry` (format: mer-imu)" in text and "## `telemetry` (format: flight-file)" in text
    assert "`MER` or `Phoenix`" in text
    assert "|  |" not in text and "numberss" not in text  # every key has a value, a default and a meaning


def test_every_effect_is_in_the_reference():
    from edl_filter.effects.registry import catalogue

    text = effects_text()
    for name, effect in catalogue().items():
        (section,) = [s for s in text.split("### ") if s.startswith(f"`{name}`")]
        assert all(f"| `{q.name}` |" in section for q in effect.parameters)


def keys_of_schema(node):
    """Keys of a JSON Schema and of all its definitions, but for the settings, which have a page of their own."""
    definitions = [d for name, d in node.get("$defs", {}).items() if name != "DecisionSettings"]
    return {key for part in (node, *definitions) for key in part.get("properties", {})}


@pytest.mark.parametrize("stem", ["summary", "diagnosis", "ledger"])
def test_every_key_of_a_results_files_is_in_the_reference(stem):
    from edl_filter.results.schema import MODELS, json_schemas

    (file,) = [name for name in MODELS if Path(name).stem == stem]
    text, keys = file_text(stem), keys_of_schema(json_schemas()[file])
    assert len(keys) > 10
    for key in keys:
        assert f"| `{key}` | " in text, key
    assert "|  |" not in text  # every key has a value and a meaning


def test_the_json_schemas_that_the_reference_links_are_written(tmp_path):
    import json

    names = {path.name: json.loads(path.read_text(encoding="utf-8")) for path in write_schemas(tmp_path / "schemas")}
    assert set(names) == {"summary.schema.json", "diagnosis.schema.json", "ledger.schema.json"}
    page = fill((ROOT / "docs/reference/result-files.md").read_text(encoding="utf-8"), "page")
    for name, written in names.items():
        assert f'href="../schemas/{name}"' in page
        assert schema_file(written["title"]) == name and written["$schema"].endswith("2020-12/schema")


def test_an_unknown_placeholder_is_refused():
    with pytest.raises(
        ValueError, match="page: found 'generated: nonsense'; accepted are campaign, commands, effects, file"
    ):
        fill("<!-- generated: nonsense -->", "page")


def test_the_citation_has_the_version():
    from edl_filter import __version__

    cited = yaml.safe_load((ROOT / "CITATION.cff").read_text(encoding="utf-8"))
    assert cited["cff-version"] == "1.2.0" and str(cited["version"]) == __version__
    assert {"message", "title", "authors"} <= set(cited)
