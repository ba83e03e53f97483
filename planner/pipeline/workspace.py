"""Workspace: a fold's directory as typed values, written so that it is consistent at any time.

Each file is written aside and renamed, so that a file that is there is whole. Results of an attempt
are in a folder of their own until the fold is over: ``planner.pipeline.fold_layout``. Of attempts
that are over the one that came farthest stays, of verified plans the one that serves the fold's
preference best.
"""

from __future__ import annotations

import json
from collections.abc import Collection, Sequence
from dataclasses import dataclass
from math import inf, isfinite
from pathlib import Path as FilePath
from shutil import rmtree
from typing import Any, Final

from foldback.planner.certificate.certificate import Certificate
from foldback.planner.chain.chain import Chain
from foldback.planner.chain.chain_attributes import chain_attributes, chain_from_attributes
from foldback.planner.explosion.diagnosis import stopped
from foldback.planner.exports import mjcf
from foldback.planner.motion.record import Record
from foldback.planner.pipeline import fold_layout as layout
from foldback.planner.pipeline.attempt import Attempt, Candidates
from foldback.planner.pipeline.fold_layout import last_frame
from foldback.planner.pipeline.preference import COMPUTING, Preference, Rank, judgement, rank
from foldback.planner.pipeline.request import PATH_SEED_MODULUS, FoldRequest
from foldback.planner.pipeline.retry_policy import RetryPolicy
from foldback.planner.pipeline.search import FoldSpec, Result, Search, share_bent
from foldback.planner.plan.plan import Plan
from foldback.planner.plan.prepared_chains import PreparedChains, key_of
from foldback.planner.playback.playback import Playback
from foldback.planner.playback.unfolding import Unfolding
from foldback.planner.storage import file_names as names
from foldback.planner.storage.files import write_json, write_whole

MAX_PLANS_BYTES: Final = 64 * 2**20
"""Maximum size, in bytes, of all stored plans of one fold that were not chosen; plans beyond it are
removed, and the web page cannot play them."""
_REMOVAL_PREFIX: Final = "unwanted-"
"""Prefix that a directory gets before it is removed, so that a partly removed one is not mistaken
for an attempt after a crash."""


@dataclass(frozen=True, slots=True)
class Workspace:
    """Files of one fold.

    Attributes:
        directory: Directory of the fold, or folder of one of its attempts.
    """

    directory: FilePath

    # What is asked for.

    def write_request(
        self,
        request: FoldRequest,
        data: bytes,
        *,
        start: Plan | None = None,
        recorded: Plan | None = None,
    ) -> None:
        """Write a request and its input.

        Args:
            request: The request.
            data: Bytes of the shape.
            start: Plan that a refold begins with; None for other folds.
            recorded: Plan that is smoothed; None for other folds.
        """
        if start is not None:
            self.write_start(start)
        if recorded is not None:
            recorded.save_npz(self.directory / names.RECORDED_PLAN)
        write_whole(self.directory / names.INPUT, data)
        write_json(self.directory / names.REQUEST, request.to_json())

    def read_request(self) -> FoldRequest:
        """Return the request."""
        return FoldRequest.from_json(self._json(names.REQUEST))

    def read_input(self) -> bytes:
        """Return the bytes of the shape."""
        return (self.directory / names.INPUT).read_bytes()

    def write_start(self, start: Plan) -> None:
        """Write the plan that a refold begins with."""
        self.write_start_chain(start.chain)
        start.save_npz(self.directory / names.START_PLAN)

    def write_start_chain(self, chain: Chain) -> None:
        """Write only the chain that a refold begins with, which is enough to read the shape."""
        write_json(self.directory / names.START_CHAIN, chain_attributes(chain))

    def read_start(self, request: FoldRequest) -> Chain | None:
        """Return the chain as it is folded at the beginning of a refold; None for other folds."""
        return chain_from_attributes(self._json(names.START_CHAIN)) if request.refold else None

    def read_unfolding(self, request: FoldRequest) -> Unfolding | None:
        """Return the way of a refold to straight; None for other folds."""
        return Plan.load(self.directory / names.START_PLAN).unfolding() if request.refold else None

    def read_recorded(self) -> Plan:
        """Return the plan that is smoothed: the fold's input, or that of one of its attempts."""
        return Plan.load(self._result(names.RECORDED_PLAN))

    def drop_recorded(self) -> None:
        """Remove the plan that an earlier fold with a preference has smoothed."""
        self._drop(names.RECORDED_PLAN)

    def read_prepared(self, request: FoldRequest, data: bytes) -> PreparedChains | None:
        """Return the chains that the preview of this request has found; None without one."""
        if not (self.directory / names.PREPARED).exists():  # spares the digest of a large input
            return None
        seed = request.seed % PATH_SEED_MODULUS
        key = key_of(data, request.filename, request.path_options(), seed)
        return PreparedChains.load(self.directory, key)

    def drop_prepared(self) -> None:
        """Remove the chains of the preview, which the candidates repeat."""
        self._drop(names.PREPARED)

    def read_fold_spec(self) -> FoldSpec:
        """Return what is known of the fold before it is computed."""
        request, candidates = self.read_request(), self.read_candidates()
        policy, start = RetryPolicy.of(request, candidates), self.read_start(request)
        return FoldSpec(request=request, candidates=candidates, policy=policy, start=start)

    # What may be tried, and what was.

    def write_candidates(self, candidates: Candidates) -> None:
        """Write the chains that may be folded; the first is the fold's."""
        write_json(self.directory / names.CANDIDATES, candidates.as_dict())
        self._write_chain(candidates.chains[0])

    def read_candidates(self) -> Candidates:
        """Return the chains that may be folded."""
        return Candidates.from_values(self._json(names.CANDIDATES))

    def write_history(self, history: Sequence[Attempt]) -> None:
        """Write the attempts so far."""
        values = [attempt.as_dict() for attempt in history if attempt.status != "none"]
        write_json(self.directory / names.ATTEMPTS, values)

    def read_history(self) -> tuple[Attempt, ...]:
        """Return the attempts so far."""
        if not (self.directory / names.ATTEMPTS).exists():
            return ()
        return tuple(Attempt.from_dict(values) for values in self._json(names.ATTEMPTS))

    # Results: of the latest attempt, or of the fold when it is over.

    @property
    def attempt(self) -> Workspace:
        """Folder of the latest attempt; the fold's directory when there is none."""
        return Workspace(layout.latest_attempt_dir(self.directory))

    def attempt_of(self, number: int) -> Workspace:
        """Return the folder of an attempt."""
        return Workspace(layout.attempt_dir(self.directory, number))

    @property
    def number(self) -> int | None:
        """Number of the latest attempt that has a folder; None when there is none."""
        numbers = layout.attempt_numbers(self.directory)
        return numbers[-1] if numbers else None

    @property
    def timeline(self) -> FilePath:
        """Path of the timeline in this very directory."""
        return self.directory / names.TIMELINE

    def read_chain(self) -> Chain:
        """Return the chain that is folded."""
        return chain_from_attributes(json.loads(self._result(names.CHAIN).read_bytes()))

    def write_explosion(self, result: Result, *, frames: bool) -> None:
        """Write the record of an explosion or smoothing, and the plan that was smoothed.

        Args:
            result: The result.
            frames: False if the record's frames are in the timeline, and will stay there.
        """
        if result.recorded is not None:
            result.recorded.save_npz(self.directory / names.RECORDED_PLAN)
        if result.record is not None:
            result.record.save(self.directory / names.RECORD, frames=frames)

    def read_record(self) -> Record | None:
        """Return the record; None where nothing has exploded."""
        path = self._result(names.RECORD)
        return Record.load(path, self._result(names.TIMELINE)) if path.exists() else None

    def write_playback(self, playback: Playback) -> None:
        """Write a playback whose frames are in the timeline."""
        playback.save(self.directory / names.PLAYBACK, frames=False)

    def drop_playback(self) -> None:
        """Remove the playback, which is about to be made anew."""
        self._drop(names.PLAYBACK)

    def read_playback(self) -> Playback | None:
        """Return the playback; None where there is none."""
        path = self._result(names.PLAYBACK)
        return Playback.load(path, self._result(names.TIMELINE)) if path.exists() else None

    def write_judgement(self, result: Result) -> None:
        """Write a certificate, after the curves that belong to it."""
        if result.forces is not None:
            result.forces.save(self.directory / names.FORCES)
        assert result.certificate is not None
        write_json(self.directory / names.CERTIFICATE, result.certificate.as_dict())

    def drop_curves(self) -> None:
        """Remove the curves of a certificate, which is about to be made anew."""
        self._drop(names.FORCES)

    def read_certificate(self) -> Certificate | None:
        """Return the certificate; None where there is none."""
        path = self._result(names.CERTIFICATE)
        if not path.exists():
            return None
        return Certificate.from_dict(json.loads(path.read_bytes()))

    def read_result(self) -> Result:
        """Return what has been computed of the latest attempt, or of the fold when it is over."""
        return Result(
            chain=self.read_chain(),
            record=self.read_record(),
            playback=self.read_playback(),
            certificate=self.read_certificate(),
        )

    def read_search(self, fold_spec: FoldSpec) -> Search:
        """Return the attempts so far, with the results of the latest."""
        history = self.read_history()
        if not history:  # nothing explodes
            first = fold_spec.policy.next_attempt(())
            assert first is not None
            history = (Attempt(spec=first, status="none"),)
        last = max((k for k, attempt in enumerate(history) if not attempt.repeats), default=0)
        number = last if self.number is None else self.number
        return Search(history=history, results={number: self.read_result()})

    def read_plan(self) -> Plan:
        """Return the plan of a fold that is over, with the joint errors that its file omits."""
        plan = Plan.load(self.directory / names.PLAN)
        return plan.with_joint_errors_of(self.read_playback())

    def write_plan(self, plan: Plan, playback: Playback | None) -> None:
        """Write the plan of a fold, and its model if the chain is not too long.

        The file of its playback then leaves out the reference, which is the plan's motion. Both
        are flushed to the disk: neither can be computed again without the other.
        """
        if len(plan.chain) <= mjcf.MAX_MODEL_MODULES:
            write_whole(self.directory / names.MODEL, mjcf.write(plan))
        else:
            self._drop(names.MODEL)
        plan.save_npz(self.directory / names.PLAN, durable=True)
        if playback is not None:
            path = self.directory / names.PLAYBACK
            playback.save(path, frames=False, reference=False, durable=True)

    def drop_manifest(self) -> None:
        """Remove the digests of files that are about to change."""
        self._drop(names.MANIFEST)

    def settle(self) -> dict[str, Any]:
        """Keep the attempt of an unfinished fold that came farthest, and return where it was.

        Nothing computes the fold any more.

        Returns:
            ``stuck``, as of ``Plan.summary``; of a plan that its certificate refuses ``explosion``
            and ``certificate``. Empty when nothing was recorded.
        """
        has_request = (self.directory / names.REQUEST).exists()
        self.publish(self.read_request().prefer if has_request else COMPUTING)
        certificate = layout.certificate_values(self.directory / names.CERTIFICATE)
        verified, clearance = judgement(certificate)
        if isfinite(clearance) and not verified:
            record = self.read_record()
            return {"explosion": record and record.summary(), "certificate": certificate}
        return self.stopped_where()

    def stopped_where(self) -> dict[str, Any]:
        """Return where a fold ends that came to no plan, as ``settle`` does; changes nothing."""
        last = last_frame(self._result(names.TIMELINE))
        return {} if last is None else {"stuck": stopped(*last).as_dict()}

    # Moves.

    def begin(self, number: int, chain: Chain) -> Workspace:
        """Make the folder of an attempt, with its chain.

        Folders that an earlier run made from there on are removed.
        """
        place = self.attempt_of(number)
        self._remove([n for n in layout.attempt_numbers(self.directory) if n >= number])
        place.directory.mkdir(parents=True)
        place._write_chain(chain)
        return place

    def clear(self) -> None:
        """Remove all that earlier attempts have made: a fold begins anew."""
        # The chain is the first candidate's.
        self._drop(names.ATTEMPTS_DIR, names.PLANS_DIR, names.ATTEMPTS, *names.RESULT_FILES[1:])

    def drop_derived(self) -> None:
        """Remove what was derived from an earlier fold in this directory."""
        self._drop(names.PICTURE, *names.LATER_FILES)

    def keep_explosions(self, numbers: Collection[int]) -> None:
        """Remove the explosions that no certificate has judged, except for some."""
        self._remove(
            [
                number
                for number in layout.attempt_numbers(self.directory)
                if number not in numbers
                and not (self.attempt_of(number).directory / names.CERTIFICATE).exists()
            ]
        )

    def keep_best(self, prefer: Preference = COMPUTING) -> int | None:
        """Keep the best attempt: a verified plan, the clearest one, or the straightest explosion.

        Args:
            prefer: Decides which of several verified plans is the best; the earliest of equal ones.

        Returns:
            Its number; None when there is none.
        """
        self._keep_best(layout.attempt_numbers(self.directory), prefer)
        return next(iter(layout.attempt_numbers(self.directory)), None)

    def publish(self, prefer: Preference = COMPUTING) -> None:
        """Move the best attempt's files to the fold's directory; one that was cut off goes on."""
        self.keep_best(prefer)
        place = layout.latest_attempt_dir(self.directory)
        if place == self.directory:
            return
        for name in (*names.RESULT_FILES, names.RECORDED_PLAN):
            target = place / name
            if target.is_dir():
                rmtree(self.directory / name, ignore_errors=True)
            if target.exists():
                target.replace(self.directory / name)
        rmtree(self.directory / names.ATTEMPTS_DIR)

    def _keep_best(self, among: Sequence[int], prefer: Preference = COMPUTING) -> None:
        if len(among) > 1:
            best = max(among, key=lambda number: self._rank(number, prefer))
            unwanted = [number for number in among if number != best]
            if prefer != COMPUTING:
                unwanted = [number for number in unwanted if not self._moved_to_plans(number)]
            self._remove(unwanted)

    def _moved_to_plans(self, number: int) -> bool:
        """Move a verified plan to ``PLANS_DIR`` if there is room; return True if it was moved."""
        place = layout.attempt_dir(self.directory, number)
        if not judgement(layout.certificate_values(place / names.CERTIFICATE))[0]:
            return False
        for path in place.iterdir():
            if path.name not in names.PLAYABLE:
                path.unlink()
        plans = self.directory / names.PLANS_DIR
        files = [path for root in (plans, place) for path in root.rglob("*") if path.is_file()]
        if sum(path.stat().st_size for path in files) > MAX_PLANS_BYTES:
            return False
        plans.mkdir(exist_ok=True)
        place.rename(plans / str(number))
        return True

    def _rank(self, number: int, prefer: Preference) -> Rank:
        """Return how far an attempt came, from its files: it may have been cut off."""
        place = layout.attempt_dir(self.directory, number)
        attempts: list[dict[str, Any]] = self._json(names.ATTEMPTS)
        last = last_frame(place / names.TIMELINE)
        return rank(
            layout.certificate_values(place / names.CERTIFICATE),
            straight=number < len(attempts) and attempts[number]["status"] == "straight",
            bent=inf if last is None else share_bent(*last),
            number=number,
            prefer=prefer,
        )

    def _remove(self, unwanted: Sequence[int]) -> None:
        folders = self.directory / names.ATTEMPTS_DIR
        for number in unwanted:
            (folders / str(number)).rename(folders / f"{_REMOVAL_PREFIX}{number}")
        for path in folders.glob(f"{_REMOVAL_PREFIX}*"):
            rmtree(path)

    def _write_chain(self, chain: Chain) -> None:
        write_json(self.directory / names.CHAIN, chain_attributes(chain))

    def _drop(self, *unwanted: str) -> None:
        for name in unwanted:
            path = self.directory / name
            if path.is_dir():
                rmtree(path, ignore_errors=True)
            else:
                path.unlink(missing_ok=True)

    def _result(self, name: str) -> FilePath:
        return layout.result_path(self.directory, name)

    def _json(self, name: str) -> Any:
        return json.loads((self.directory / name).read_bytes())
