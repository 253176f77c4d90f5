"""Schema of ``ledger.jsonl``: one line for each step of an improvement, `LedgerLine`."""

from __future__ import annotations

from edl_filter.results.schema.diagnosis import Estimate
from edl_filter.results.schema.fields import Content, Number, key


class ErrorChange(Content):
    """Normalised RMS of one channel."""

    before: Number = key("without the added effect")
    after: Number = key("with it; null where nothing was added, or the channel is no longer compared")


class LedgerStep(Content):
    """A line of ``ledger.jsonl``: an effect that was added."""

    step: int = key("number of the step, from 0")
    mission: str = key("name of the mission")
    model: tuple[str, ...] = key("labels of the effects in the model that was diagnosed")
    added: str = key("name of the effect that was added")
    imu: str | None = key("IMU of a sensor effect; null: the driving one, or no sensor effect")
    same_as: tuple[str, ...] = key("labels of effects that the flight does not distinguish from it")
    parameters: dict[str, Estimate] = key("parameter → estimate")
    removed: tuple[str, ...] = key("labels of effects of earlier steps that the next model does not need")
    gain: Number = key("log Bayes factor, nats")
    held_out_score: Number = key("held-out log predictive density, nats")
    errors: dict[str, ErrorChange] = key("channel → normalised RMS before and after")

    @property
    def label(self) -> str:
        """Label of the effect that was added: its name, or its name in its IMU."""
        return self.added if self.imu is None else f"{self.added} in {self.imu}"


class LedgerEnd(Content):
    """The last line of ``ledger.jsonl``: nothing was added."""

    step: int = key("number of the step, from 0")
    mission: str = key("name of the mission")
    model: tuple[str, ...] = key("labels of the effects in the final model")
    added: None = key("null: nothing was added")
    why: str = key("why the improvement ended")
    errors: dict[str, ErrorChange] = key("channel → normalised RMS of the final model; after is null")


LedgerLine = LedgerStep | LedgerEnd
