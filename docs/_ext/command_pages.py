"""Every command with its arguments and options, from the commands themselves."""

from __future__ import annotations

from typing import Any


def commands_text() -> str:
    """Markdown of all commands: description, arguments and options, example."""
    group = command_tree()
    top = _table(_rows(group))
    return "\n\n".join([f"{group.help}\n\n{top}", *(_command(name, c) for name, c in group.commands.items())])


def command_tree() -> Any:
    """The commands as a tree of click commands."""
    import typer

    from edl_filter.cli import app

    return typer.main.get_command(app)


def _command(name: str, command: Any) -> str:
    example = (command.epilog or "").removeprefix("Example: ")
    usage = f"```console\n$ {example}\n```" if example else ""
    return "\n\n".join(filter(None, [f"## `{name}`", command.help, usage, _table(_rows(command))]))


def _rows(command: Any) -> list[tuple[str, str, str]]:
    rows = []
    for parameter in command.params:
        if "--help" in parameter.opts:
            continue
        is_option = parameter.param_type_name == "option"
        name = ", ".join(parameter.opts) if is_option else parameter.name.upper()
        takes = f" {parameter.metavar or parameter.name.upper()}" if is_option and not parameter.is_flag else ""
        rows.append((f"`{name}{takes}`", "required" if parameter.required else "", parameter.help or ""))
    return rows


def _table(rows: list[tuple[str, str, str]]) -> str:
    lines = ["| argument or option | | what it does |", "|---|---|---|"]
    return "\n".join(lines + ["| " + " | ".join(cell.replace("|", "\\|") for cell in row) + " |" for row in rows])
