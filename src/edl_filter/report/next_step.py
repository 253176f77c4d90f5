"""The next step after a diagnosis, as a sentence and the commands to type."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from shlex import quote

from edl_filter.results.schema import DiagnosisContent


@dataclass(frozen=True)
class NextStep:
    """What to do next.

    Attributes
    ----------
    sentence : str
        What the commands do; empty where nothing is to be done.
    commands : tuple of str
    """

    sentence: str = ""
    commands: tuple[str, ...] = ()


def next_step(diagnosis: DiagnosisContent, mission: str, folder: Path) -> NextStep:
    """The next step after a diagnosis.

    Parameters
    ----------
    diagnosis : DiagnosisContent
        The diagnosis.
    mission : str
        The mission as a command takes it, not quoted.
    folder : Path
        Folder of the result.
    """
    if diagnosis.verdict == "clean":
        return NextStep()
    if diagnosis.verdict == "unknown" or not diagnosis.ranking:
        return NextStep(
            "Next: write what is left as an effect of your own (docs/effects.md), and try it:",
            (f"edl-filter diagnose {quote(str(folder))} --file my_effect.py",),
        )
    first = diagnosis.ranking[0]
    built_in = mission.startswith("builtin:")
    stem = f"{mission.removeprefix('builtin:') if built_in else Path(mission).stem}+{first.effect}"
    extended = f"{stem}.yaml" if built_in else str(Path(mission).with_name(f"{stem}.yaml"))
    add = f"edl-filter add {quote(mission)} {first.effect} --from {quote(str(folder))}"
    add += f" --imu {quote(first.imu)}" if first.imu else ""
    add += diagnosis.file_option(first.effect)
    output = folder.parent / f"{folder.name}+{first.effect}"
    sentence = f"Next: add {first.label} to the model and refit it:"
    if diagnosis.verdict == "undecided":
        sentence = f"Next: refit {first.label}, the most probable effect, and compare:"
    return NextStep(sentence, (add, f"edl-filter run {quote(extended)} -o {quote(str(output))}"))
