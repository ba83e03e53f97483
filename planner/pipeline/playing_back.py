"""Playing back: record → playback, floating or on a table."""

from __future__ import annotations

from collections.abc import Callable, Generator
from contextlib import contextmanager
from dataclasses import replace
from functools import partial
from pathlib import Path as FilePath
from typing import Final

from foldback.planner.certificate.table_certificate import table_certificate
from foldback.planner.chain.chain import Chain
from foldback.planner.motion.motion import Motion
from foldback.planner.motion.record import Record
from foldback.planner.motion.timeline import TimelineWriter
from foldback.planner.parameters.explosion import TableParameters
from foldback.planner.parameters.parameters import Parameters
from foldback.planner.pipeline.search import FoldSpec, Search, Watch, is_smoothing
from foldback.planner.playback.playback import Playback
from foldback.planner.playback.playback import play_back as simulate_playback
from foldback.planner.playback.table_playback import play_on_table
from foldback.planner.playback.unfolding import Unfolding
from foldback.planner.progress import Progress

TABLE_MOTOR_RESERVE: Final = 1.5
"""Torque limit of the simulated motors on a table, as a multiple of the largest static torque in
the recorded motion."""
MIN_SIZING_TORQUE_WP: Final = 1.0
"""Minimum static torque from which the torque limit of the motors on a table is computed, in w·p
(module weight × pitch)."""
Sink = Callable[[Motion], None]


def with_playback(
    fold_spec: FoldSpec, search: Search, watch: Watch, *, finer: int, patience: int
) -> Search:
    """Return the search after a playback of its current record.

    Args:
        fold_spec: Request, candidates and limits of the fold.
        search: Attempts so far.
        watch: Channels to the observer.
        finer: Factor on the number of frames.
        patience: Level of slowness near straight, see ``PlayBack``.
    """
    result = search.current
    playback = play_back(
        result.chain,
        result.record,
        fold_spec.parameters(result.record),
        watch,
        seed=fold_spec.request.seed,
        finer=finer,
        patience=patience,
        unfolding=fold_spec.unfolding,
    )
    result = replace(result, playback=playback, certificate=None)
    return search.with_current(result, replace(search.history[search.latest], played=True))


def play_back(
    chain: Chain,
    record: Record | None,
    parameters: Parameters,
    watch: Watch,
    *,
    seed: int,
    finer: int = 1,
    patience: int = 0,
    unfolding: Unfolding | None = None,
) -> Playback | None:
    """Return the playback of a record; None when the chain was not straight after the explosion.

    Args:
        chain: Chain that is folded.
        record: Record of its explosion; None where nothing explodes.
        parameters: Parameters of the fold.
        watch: Channels to whoever follows.
        seed: Seed of the robots.
        finer: Factor of the number of frames.
        patience: Level of slowness near straight, see ``PlayBack``.
        unfolding: Way of a refold to straight; None for other folds.
    """
    if record is not None and record.status != "straight":
        return None
    if record is not None and record.table is not None:
        return _play_on_table(chain, record, parameters.table, watch)
    # A refold's timeline goes from one shape to the other; a smoothed one only folds.
    at_once = unfolding is not None or is_smoothing(record)
    start_s, frames = 0.0, 0
    if record is not None and not at_once:
        start_s, frames = float(record.frames.time_s[-1]), len(record.frames)
    if watch.timeline is not None and at_once:
        TimelineWriter.create(watch.timeline, chain)
    with _sink(watch.timeline, partial(TimelineWriter.reopen, frames=frames)) as sink:
        return simulate_playback(
            chain,
            record,
            parameters.playback,
            module_size=parameters.module_size,
            sink=sink,
            progress=watch.progress,
            cancelled=watch.cancelled,
            start_s=start_s,
            finer=finer,
            patience=patience,
            unfolding=unfolding,
            seed=seed,
        )


def _play_on_table(chain: Chain, record: Record, table: TableParameters, watch: Watch) -> Playback:
    """Fold the chain on the table, with motors slightly stronger than standing needs."""
    assert record.frames.is_windowed
    assert record.table is not None
    # Its frames are of all angles, the record's of windows: one timeline holds frames of one kind.
    exploded = record.frames.dense(chain)
    watch.progress(
        Progress(stage="play_back", fraction=0.0, message="computing the torques in each frame")
    )
    standing = table_certificate(
        chain,
        record.frames[::-1],
        friction=table.table_friction,
        base=table.table_base,
        on_table=True,
        height=chain.table_height,
    )
    torque = record.table.bound if standing.torque is None else standing.torque
    with _sink(watch.timeline, partial(TimelineWriter.create, chain=chain)) as sink:
        if sink is not None:
            sink(exploded)
        playback = play_on_table(
            chain,
            record.frames,
            torque_limit_wp=TABLE_MOTOR_RESERVE * max(torque, MIN_SIZING_TORQUE_WP),
            friction=table.table_friction,
            clamped=table.held,
            start_s=float(exploded.time_s[-1]),
            progress=watch.progress,
            cancelled=watch.cancelled,
        ).as_playback(chain.pitch_m)
        if sink is not None:
            sink(playback.frames)
    return playback


@contextmanager
def _sink(
    timeline: FilePath | None, opened: Callable[[FilePath], TimelineWriter]
) -> Generator[Sink | None]:
    """Yield what takes the frames of a playback; None where nobody follows."""
    if timeline is None:
        yield None
        return
    with opened(timeline) as writer:
        yield writer.append
