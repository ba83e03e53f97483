"""Player: one visitor's playhead over a film, and the scene that shows it.

The page's timeline bar drives it with JSON messages and is told back what is shown. A message in
has one verb, ``do``:

| message | meaning |
|---|---|
| ``{"do": "play"}``, ``"pause"``, ``"toggle"`` | run or stop; ``play`` at the end starts over |
| ``{"do": "seek", "frame": 12.0}`` or ``"percent": 40`` | go there and stop |
| ``{"do": "step", "by": -1}`` | whole frames back or forward, and stop |
| ``{"do": "set", "speed": 2, "loop": true, "reverse": false, "follow": true, "turn": false,
    "live": true}`` | any of them: speed 0.05–20, camera following and turning, live tail |
| ``{"do": "set", "aspect": 1.6}`` | width by height of the window that a sketch is drawn in |
| ``{"do": "select", "module": 17}`` | highlight a module and tell about it; null for none |

A message out has one noun, ``is``:

| message | when |
|---|---|
| ``state``: frame, frames, time_s, phase, error_rad, playing, speed, loop, reverse, follow, live,
    growing | whenever any of them changes |
| ``outline``: frames, phases, errors, error_scale_rad, end_s, growing, modules, joints | at first,
    and while the timeline grows |
| ``module``: index, modules, cell, joints [{name, angle_rad, target_rad, error_rad}], error_rad;
    index null for none | on selection, and while it moves |
| ``waiting`` | there is no timeline yet |
| ``viewing`` | there is a timeline, and a browser has connected to its scene |
| ``problem``: detail | a message that could not be understood |
"""

from __future__ import annotations

import math
import threading
from collections.abc import Callable
from dataclasses import asdict, dataclass, replace
from typing import Final

import viser

from planner.chain import Chain
from planner.errors import TimelineError
from web.film import Film, Snapshot
from web.following import Following
from web.scene import Scene
from web.sketch import Watcher, sketch_frame, sketch_outline
from web.telling import Message, module_of, moment_of, outline_of

Listener = Callable[[Message], None]
FilmSource = Callable[[], Film | None]

SPEEDS: Final = (0.05, 20.0)
ASPECTS: Final = (0.2, 8.0)
WHOLE_FILM_S: Final = 20.0
SLOWEST_FPS: Final = 12.0
CATCH_UP_S: Final = 0.4
HOLD_S: Final = 1.2
LONGEST_TICK_S: Final = 0.2
LOOK_EVERY_S: Final = 0.15


@dataclass(frozen=True, slots=True, kw_only=True)
class Playhead:
    """Where a visitor is and how it moves."""

    frame: float = 0.0
    playing: bool = False
    speed: float = 1.0
    loop: bool = False
    reverse: bool = False
    follow: bool = True
    turn: bool = False
    live: bool = False


class Player:
    """See the module's description. Safe to use from several threads."""

    def __init__(self, server: viser.ViserServer, film_source: FilmSource) -> None:
        self._server = server
        self._film_source = film_source
        self._lock = threading.RLock()
        self._listeners: list[Listener] = []
        self._watchers: list[Watcher] = []
        self._head = Playhead()
        self._following: Following | None = None
        self._film: Film | None = None
        self._chain: Chain | None = None
        self._scene: Scene | None = None
        self._shown: Snapshot | None = None
        self._seen_version = -1
        self._told: Message = {}
        self._clock: float | None = None
        self._next_look = 0.0
        self._hold_until = 0.0
        self._coarse = False
        self._connections = 0
        self._gliding = False
        self._aspect: float | None = None
        self._sketch_due = False
        server.on_client_connect(self._connected)

    @property
    def head(self) -> Playhead:
        """Where the visitor is."""
        return self._head

    @property
    def snapshot(self) -> Snapshot | None:
        """What is shown."""
        return self._shown

    @property
    def busy(self) -> bool:
        """True while time changes what is shown."""
        film = self._film
        return film is None or film.growing or self._head.playing or self._head.turn

    def subscribe(self, listener: Listener) -> Callable[[], None]:
        """Sends every message out to ``listener`` too, beginning with how things are."""
        with self._lock:
            self._listeners.append(listener)
            if self._film is None:
                listener({"is": "waiting"})
            else:
                listener(outline_of(self._film))
                listener(self._state())
                if self._connections:
                    listener({"is": "viewing"})
                if self._scene is not None and self._scene.selected is not None:
                    listener(self._module())

        def leave() -> None:
            with self._lock:
                if listener in self._listeners:
                    self._listeners.remove(listener)

        return leave

    def watch(self, watcher: Watcher) -> Callable[[], None]:
        """Sends a sketch of what is shown to ``watcher`` too; see ``web.sketch``."""
        with self._lock:
            self._watchers.append(watcher)
            if self._film is not None:
                watcher(sketch_outline(self._film.chain.module, len(self._film.chain)))
                self._sketch_due = True
                self._sketch()

        def leave() -> None:
            with self._lock:
                if watcher in self._watchers:
                    self._watchers.remove(watcher)

        return leave

    def handle(self, message: Message) -> None:
        """Does what a message says; tells ``problem`` when it makes no sense."""
        with self._lock:
            try:
                with self._server.atomic():
                    self._do(message)
                self._server.flush()
                self._sketch()
            except TimelineError:
                self._lose_film()
            except (KeyError, TypeError, ValueError, OverflowError) as error:
                self._tell({"is": "problem", "detail": f"got {str(message)[:200]}: {error}"})

    def tick(self, now: float) -> None:
        """Lets time pass up to ``now`` (s, any steady clock)."""
        with self._lock:
            before = self._clock if self._clock is not None else now
            self._clock = now
            passed = min(now - before, LONGEST_TICK_S)
            try:
                if self._film is not None:
                    self._go_on(self._film, passed, now)
                elif now >= self._next_look:
                    self._next_look = now + LOOK_EVERY_S
                    self._find_film()
            except TimelineError:
                self._lose_film()

    # What a message does.

    def _do(self, message: Message) -> None:
        verb = message["do"]
        if verb in ("play", "pause", "toggle"):
            self._run(not self._head.playing if verb == "toggle" else verb == "play")
        elif verb == "seek":
            last = self._last_frame()
            if "percent" in message:
                frame = _number(message["percent"]) / 100.0 * last
            else:
                frame = _number(message["frame"])
            self._head = replace(
                self._head, frame=min(max(frame, 0.0), last), playing=False, live=False
            )
        elif verb == "step":
            by = round(_number(message["by"]))
            here = self._head.frame
            start = math.floor(here + 1e-9) if by > 0 else math.ceil(here - 1e-9)
            frame = float(min(max(start + by, 0), self._last_frame()))
            self._head = replace(self._head, frame=frame, playing=False, live=False)
        elif verb == "set":
            self._set(message)
        elif verb == "select":
            self._select(message["module"])
        elif verb != "ping":
            raise ValueError(f"expected a known verb, not {verb!r}")
        self._show()

    def _run(self, playing: bool) -> None:
        frame = self._head.frame
        last = self._last_frame()
        if playing and not self._head.reverse and frame >= last - 1e-6 and not self._growing():
            frame = 0.0
        if playing and self._head.reverse and frame <= 1e-6:
            frame = last
        self._hold_until = 0.0
        self._head = replace(self._head, playing=playing, frame=frame, live=False)

    def _set(self, message: Message) -> None:
        head = self._head
        if "speed" in message:
            head = replace(head, speed=min(max(_number(message["speed"]), SPEEDS[0]), SPEEDS[1]))
        for name in ("loop", "reverse", "follow", "turn", "live"):
            if name in message:
                if not isinstance(message[name], bool):
                    raise TypeError(f"expected true or false for {name}")
                head = replace(head, **{name: message[name]})
        if "aspect" in message:
            self._aspect = min(max(_number(message["aspect"]), ASPECTS[0]), ASPECTS[1])
            if self._following is not None:
                self._following.window(self._aspect)
        if head.live and not self._head.live:
            head = replace(head, playing=False)
        if head.follow and not self._head.follow and self._following is not None:
            self._following.take_over()
        self._head = head
        self._aim()

    def _select(self, module: object) -> None:
        if self._scene is None or self._film is None:
            return
        if module is None:
            self._scene.select(None)
        else:
            index = int(_number(module))
            if not 0 <= index < len(self._film.chain):
                raise ValueError(f"expected a module from 0 to {len(self._film.chain) - 1}")
            self._scene.select(index)
        self._tell(self._module())

    def _picked(self, module: int | None) -> None:
        with self._lock:
            if module is None and (self._scene is None or self._scene.selected is None):
                return
            again = self._scene is not None and self._scene.selected == module
            self._select(None if again else module)

    # What time does.

    def _go_on(self, film: Film, passed: float, now: float) -> None:
        film.refresh()
        if film.chain is not self._chain:
            raise TimelineError(f"{film.path} was begun anew.")
        if film.version != self._seen_version:
            self._grew()
        resting = not (self._gliding or self._head.playing or self._head.live)
        if resting and not self._head.turn and now < self._next_look:
            return
        # A window that changes its shape is noticed even when nothing moves.
        self._next_look = now + LOOK_EVERY_S
        with self._server.atomic():
            self._advance(passed, now)
            self._settle(passed)
        self._server.flush()
        self._sketch()

    def _lose_film(self) -> None:
        """Waits for the film of a timeline that was begun anew; what was shown stays until then."""
        selected = self._scene is not None and self._scene.selected is not None
        self._film = self._scene = self._shown = self._following = None
        self._told = {}
        if selected:
            self._tell(self._module())
        self._tell({"is": "waiting"})

    def _find_film(self) -> None:
        film = self._film_source()
        if film is None or not len(film):
            return
        self._film, self._chain = film, film.chain
        self._scene = Scene(self._server, film.chain)
        self._scene.on_pick(self._picked)
        self._following = Following(self._server, film, self._scene)
        if self._aspect is not None:
            self._following.window(self._aspect)
        if film.growing:
            self._head = replace(self._head, live=True, frame=self._last_frame())
        self._head = replace(self._head, frame=min(self._head.frame, self._last_frame()))
        self._seen_version = film.version
        self._show()
        self._tell(outline_of(self._film))
        if self._connections:
            self._tell({"is": "viewing"})
        outline = sketch_outline(film.chain.module, len(film.chain))
        for watcher in self._watchers:
            watcher(outline)
        self._sketch()

    def _grew(self) -> None:
        assert self._film is not None
        self._seen_version = self._film.version
        if self._head.frame > self._last_frame():
            self._head = replace(self._head, frame=self._last_frame())
        self._tell(outline_of(self._film))
        self._show(again=True)

    def _advance(self, passed: float, now: float) -> None:
        head = self._head
        last = self._last_frame()
        if head.live:
            gap = last - head.frame
            frame = last if gap < 0.6 else head.frame + gap * (1 - math.exp(-passed / CATCH_UP_S))
            head = replace(head, frame=frame)
            if not self._growing() and frame >= last:
                head = replace(head, live=False)
        elif head.playing and now >= self._hold_until:
            rate = max(SLOWEST_FPS, (last + 1) / WHOLE_FILM_S) * head.speed
            head = self._run_on(head, passed * rate, last, now)
        if head != self._head:
            self._head = head
            self._show()

    def _run_on(self, head: Playhead, by: float, last: float, now: float) -> Playhead:
        frame = head.frame + (-by if head.reverse else by)
        if 0.0 <= frame <= last:
            self._coarse = by >= 1.0
            return replace(head, frame=frame)
        end = 0.0 if head.reverse else last
        if not head.loop:
            return replace(head, frame=end, playing=self._growing() and not head.reverse)
        if head.frame != end:
            self._hold_until = now + HOLD_S
            return replace(head, frame=end)
        return replace(head, frame=last - end)

    def _show(self, *, again: bool = False) -> None:
        film, scene = self._film, self._scene
        if film is None or scene is None:
            return
        # Frames that pass faster than they can be shown need no in-betweens.
        whole = self._coarse and self._head.playing
        frame = float(round(self._head.frame)) if whole else self._head.frame
        moved = self._shown is None or self._shown.frame != frame
        if moved or again:
            self._shown = film.snapshot(frame)
            scene.show(self._shown, scale_rad=film.error_scale_rad)
            self._aim()
            self._gliding = self._sketch_due = True
        if moved and scene.selected is not None:
            self._tell(self._module())
        state = self._state()
        if state != self._told:
            self._told = state
            self._tell(state)

    def _settle(self, passed: float) -> None:
        """Lets camera and ground glide on; rests when they have arrived."""
        scene, shown, head = self._scene, self._shown, self._head
        if scene is None or shown is None:
            return
        gliding = scene.move_ground(passed)
        if head.follow and self._following is not None:
            gliding |= self._following.move(passed, shown, turn=head.turn)
        self._gliding = gliding
        self._sketch_due |= gliding

    def _connected(self, client: viser.ClientHandle) -> None:
        with self._lock:
            self._connections += 1
            if self._following is not None:
                self._following.begin(client)
                self._aim()
                self._tell({"is": "viewing"})

    def _aim(self) -> None:
        if self._following is not None and self._shown is not None and self._head.follow:
            self._following.aim(self._shown, turn=self._head.turn)
            self._gliding = True

    # What is told.

    def _sketch(self) -> None:
        """Sends those who watch a sketch of what is shown, if it has changed."""
        due, self._sketch_due = self._sketch_due, False
        scene, shown, following = self._scene, self._shown, self._following
        if not due or not self._watchers or scene is None or shown is None or following is None:
            return
        view = following.view
        if view is None:
            return
        colours = scene.colours(shown)
        frame = sketch_frame(shown, colours, view, pitch=scene.pitch, ground=scene.ground)
        for watcher in self._watchers:
            watcher(frame)

    def _tell(self, message: Message) -> None:
        for listener in list(self._listeners):
            listener(message)

    def _state(self) -> Message:
        return {
            "is": "state",
            **asdict(self._head),
            "frame": round(self._head.frame, 3),
            "frames": len(self._film) if self._film is not None else 0,
            "growing": self._growing(),
            **moment_of(self._shown),
        }

    def _module(self) -> Message:
        film, scene, shown = self._film, self._scene, self._shown
        if film is None or scene is None or shown is None or scene.selected is None:
            return {"is": "module", "index": None}
        return module_of(film, shown, scene.selected)

    def _growing(self) -> bool:
        return self._film is not None and self._film.growing

    def _last_frame(self) -> float:
        return float(max(len(self._film) - 1, 0)) if self._film is not None else 0.0


def _number(value: object) -> float:
    if isinstance(value, bool) or not isinstance(value, int | float) or not math.isfinite(value):
        raise TypeError(f"expected a number, not {value!r}")
    return float(value)


__all__ = ["Listener", "Message", "Player", "Playhead"]
