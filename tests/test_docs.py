"""README and docs: command lines that exist, links that lead somewhere, references that miss no key and no command."""

import re
import shlex
from pathlib import Path

import pytest
import yaml
from command_pages import command_tree, commands_text
from effect_pages import effects_text
from generated import fill
from mission_keys import keys_text

ROOT = Path(__file__).parents[1]

PAGES = [
    ROOT / "README.md", ROOT / "CONTRIBUTING.md", ROOT / "CHANGELOG.md",
    *sorted(p for p in (ROOT / "docs").rglob("*.md") if "_build" not in p.parts),
]  # fmt: skip
BLOCK = re.compile(r"^ *```(?:sh|console)\n(.*?)^ *```", re.MULTILINE | re.DOTALL)
LINK = re.compile(r"\[[^\]]*\]\(([^)\s]+)\)")


def name_of(page):
    return str(page.relative_to(ROOT))


def commands_of(text):
    """Command lines of edl-filter in the shell blocks of a page, as lists of words after the program's name."""
    found = []
    for block in BLOCK.findall(text):
        for line in block.replace("\\\n", " ").splitlines():
            words = shlex.split(line.strip().removeprefix("$ "), comments=True) if "edl-filter" in line else []
            if words and Path(words[0]).name == "edl-filter":
                found.append(words[1:])
    return found


def complaint(words):
    """What is wrong with a command line; None if it parses."""
    tree = command_tree()
    if not words or words[0] not in tree.commands:
        return f"no such command: {words[:1]}"
    command = tree.commands[words[0]]
    try:
        command.make_context(words[0], list(words[1:]))
    except Exception as error:  # typer brings its own click, whose exceptions have no public name
        return None if type(error).__name__ == "Exit" else error.format_message()  # Exit: --help
    return None


def broken(page, text):
    """Relative links of a page to files that are not there."""
    links = [link.split("#")[0] for link in LINK.findall(text) if not re.match(r"[a-z]+:|#", link)]
    return [link for link in links if link and not (page.parent / link).exists()]


@pytest.mark.parametrize("page", PAGES, ids=name_of)
def test_command_lines_are_real(page):
    wrong = {" ".join(w): complaint(w) for w in commands_of(page.read_text(encoding="utf-8"))}
    assert not {line: why for line, why in wrong.items() if why}


@pytest.mark.parametrize("page", PAGES, ids=name_of)
def test_links_lead_somewhere(page):
    assert broken(page, page.read_text(encoding="utf-8")) == []


def test_the_tutorial_has_the_whole_loop():
    used = [w[0] for w in commands_of((ROOT / "docs" / "tutorial.md").read_text(encoding="utf-8"))]
    assert {"simulate", "run", "diagnose", "add", "compare", "improve"} <= set(used)


def test_the_checks_can_fail():
    page = "```sh\nedl-filter run m.yaml --sett a=1\nedl-filter rum m.yaml\nedl-filter add m.yaml   # one short\n```\n"
    first, second, third = (complaint(w) for w in commands_of(page))
    assert "--sett" in first and "no such command" in second and "effect" in third
    assert broken(ROOT / "README.md", "[a](docs/nothing.md) [b](README.md#x) [c](https://x.org)") == ["docs/nothing.md"]


@pytest.mark.parametrize("name", command_tree().commands)
def test_each_command_has_an_example_that_is_real(name):
    epilog = command_tree().commands[name].epilog or ""
    assert epilog.startswith(f"Example: edl-filter {name} "), epilog
    assert complaint(shlex.split(epilog)[2:]) is None


def test_the_program_itself_has_an_example():
    example = shlex.split(command_tree().epilog or "")
    assert example[:2] == ["Example:", "edl-filter"]
    assert complaint(example[2:]) is None


def test_every_command_is_in_the_reference():
    text = commands_text()
    for name, command in command_tree().commands.items():
        assert f"## `{name}`" in text
        for parameter in command.params:
            assert any(f"`{word}" in text or f", {word}" in text for word in (*parameter.opts, parameter.name.upper()))


def keys_in(data, path=""):
    """Dotted keys of a file's mappings, numbers of lists as N."""
    for key, value in data.items() if isinstance(data, dict) else [("N", v) for v in data]:
        yield (path, key)
        if isinstance(value, dict) or (isinstance(value, list) and value and isinstance(value[0], dict)):
            yield from keys_in(value, f"{path}.{key}".strip("."))


@pytest.mark.parametrize("file", sorted((ROOT / "missions").rglob("*.yaml")), ids=name_of)
def test_every_key_of_the_shipped_files_is_in_the_reference(file):
    from edl_filter.mission import Mission
    from edl_filter.simulation import Scenario

    text = keys_text(Scenario if file.parent.name == "scenarios" else Mission)
    for path, key in keys_in(yaml.safe_load(file.read_text(encoding="utf-8"))):
        named = re.sub(r"(vehicle\.events|imus)\.\w+", r"\1.NAME", path)
        if re.search(r"(vehicle\.events|imus)$", named) or key == "N":
            continue  # a name of the user's own
        title = f"`{named}`" if named else "At the top of the file"
        sections = [s for s in text.split("## ") if s.startswith(title)]
        assert any(f"| `{key}` |" in s for s in sections), f"{named}.{key}"


def test_the_reference_tells_unit_range_and_default():
    from edl_filter.mission import Mission

    text = keys_text(Mission)
    assert "| `mass` | kg between 1 and 100000 | **required** | mass at entry, kg |" in text
    assert "| `density_correlation_m` | m between 10 and 200000 | `10000.0` |" in text
    assert "## `telemetry` (format: mer-imu)" in text and "## `telemetry` (format: flight-file)" in text
    assert "`MER` or `Phoenix`" in text
    assert "|  |" not in text and "numberss" not in text  # every key has a value, a default and a meaning


def test_every_effect_is_in_the_reference():
    from edl_filter.effects.catalogue import catalogue

    text = effects_text()
    for name, effect in catalogue().items():
        (section,) = [s for s in text.split("### ") if s.startswith(f"`{name}`")]
        assert all(f"| `{q.name}` |" in section for q in effect.parameters)


def test_a_place_for_something_unknown_is_refused():
    with pytest.raises(ValueError, match="page: found 'generated: nonsense'; accepted are commands, effects, mission"):
        fill("<!-- generated: nonsense -->", "page")


def test_the_citation_has_the_version():
    from edl_filter import __version__

    cited = yaml.safe_load((ROOT / "CITATION.cff").read_text(encoding="utf-8"))
    assert cited["cff-version"] == "1.2.0" and str(cited["version"]) == __version__
    assert {"message", "title", "authors"} <= set(cited)
