"""The chain with other effects than the ground's: only what they touch is computed again."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace

from edl_filter.diagnosis.comparison import Differences, Frame, Setup, compare, predicted
from edl_filter.effects.effect import Active, Effect

#: From effects to the model and the measurements as it understands them.
Arrange = Callable[[Sequence[Active]], Setup]

#: Hooks that change the path, or what was measured along it.
READING_HOOKS = ("imu", "corrected", "imu_position", "vehicle")
PATH_HOOKS = (*READING_HOOKS, "gravity", "entry_state")
AIR_HOOKS = ("atmosphere_rate", "wind", "density")


def moves_path(effect: Effect) -> bool:
    """Whether an effect changes the path, or what was measured along it."""
    return any(effect.acts(hook) for hook in PATH_HOOKS)


def moves_air(effect: Effect) -> bool:
    """Whether an effect changes the air that is met."""
    return any(effect.acts(hook) for hook in AIR_HOOKS)


def compared(
    frame: Frame, arrange: Arrange, known: tuple[Setup, Differences], effects: Sequence[Active]
) -> tuple[Setup, Differences]:
    """Compare with other effects.

    Parameters
    ----------
    frame : Frame
    arrange : callable
    known : (Setup, Differences)
        The comparison with some effects, those of its world: `arrange` and `compare` of them.
    effects : sequence of Active
    """
    setup, found = known
    before = setup.world.effects
    changed = [a for a in (*before, *effects) if not (a in before and a in effects)]
    if any(moves_path(a.effect) for a in changed):
        other = arrange(effects)
        return other, compare(frame, other)
    world, flow, tables = setup.world.having(effects), found.flow, found.tables
    if any(moves_air(a.effect) for a in changed):
        nodes = found.nodes
        flow = world.flow(nodes.time, nodes.nav[:, :3], nodes.nav[:, 3:6], nodes.nav[:, 6:], nodes.rate)
        tables = world.looked_up(flow)
    felt, step = predicted(world, frame.bins, flow, tables)
    return replace(setup, world=world), replace(
        found,
        force=found.force + found.felt - felt,
        turn=found.turn + found.stepped - step,
        felt=felt,
        stepped=step,
        flow=flow,
        tables=tables,
    )
