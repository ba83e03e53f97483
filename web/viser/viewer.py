"""Viewer: a fold in a viser server of its own, with poses streamed frame by frame.

It is meant for programs: it uses viser's public names only, and a program can add to the server's
scene. The pages of the service play folds in the browser instead.
"""

from __future__ import annotations

import atexit
import errno
import html
import ipaddress
import socket
import threading
import time
import webbrowser
from collections.abc import Callable
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Final

import numpy as np
from numpy.typing import NDArray

from foldback.planner.chain.chain import Chain
from foldback.planner.errors import InputError, TimelineError
from foldback.web.palette import SELECTED_RGB, error_colours, ramp_colours
from foldback.web.timeline.view import MotionSource, Snapshot
from foldback.web.viser.cameras import Cameras
from foldback.web.viser.scene import Scene
from foldback.web.viser.scene_bundle import quiet

if TYPE_CHECKING:
    import viser

SPEEDS: Final = {"0.25×": 0.25, "0.5×": 0.5, "1×": 1.0, "2×": 2.0, "4×": 4.0}
NO_MODULE_TEXT: Final = "Click on a module."
COLOUR_BY_ERROR: Final = "Joint error"
COLOUR_ALONG_CHAIN: Final = "Along the chain"
MAX_PORT: Final = 65_535
"""Largest TCP port number (RFC 9293)."""


@dataclass(slots=True, kw_only=True)
class _Playhead:
    """Position of the playback.

    Attributes:
        follows: True to go to new frames as they arrive.
        playing: True while it plays.
        frame: Displayed frame.
        place: Exact position in frames while it plays.
        last: Last existing frame; −1 without frames.
    """

    follows: bool
    playing: bool = False
    frame: int = 0
    place: float = 0.0
    last: int = -1


class _Controls:
    """Controls beside the view.

    Attributes:
        heading: Text above the figures of the frame. It must not hold text from files, because
            viser renders it as Markdown.
        figures: Figures of the frame.
    """

    def __init__(self, gui: viser.GuiApi) -> None:
        gui.configure_theme(show_share_button=False)
        gui.main_panel.dock_right()  # beside the chain, not in front of it
        self.heading, self.figures = "", "Nothing to show yet."
        self.text = gui.add_markdown(self.figures)
        self.slider = gui.add_slider("Frame", min=1, max=2, step=1, initial_value=1)
        self.button = gui.add_button("Play")
        self.speed = gui.add_dropdown("Speed", tuple(SPEEDS), initial_value="1×")
        self.colours = gui.add_dropdown(
            "Colours", (COLOUR_BY_ERROR, COLOUR_ALONG_CHAIN), initial_value=COLOUR_BY_ERROR
        )
        self.follow = gui.add_checkbox(
            "Follow", True, hint="Keep the chain in view for all viewers."
        )
        self.module = gui.add_markdown(NO_MODULE_TEXT)

    def write(self) -> None:
        """Write the heading and the figures if they have changed."""
        text = f"{self.heading}\n\n{self.figures}" if self.heading else self.figures
        if text != self.text.content:
            self.text.content = text


class Shown:
    """A fold in a viser server of its own; ``web.viser.show`` creates it.

    All clients share one playhead, because the server belongs to one program. A notebook displays
    the view if it is the last expression of a cell. Close it, or use it in a ``with`` block.

    Attributes:
        server: viser server, to whose scene and controls a program can add.
        url: Address of the view.
    """

    def __init__(
        self,
        moments: Callable[[], MotionSource | None],
        on_table: Callable[[], bool],
        *,
        host: str,
        port: int,
        open_browser: bool,
        follows: bool = False,
    ) -> None:
        """Start the server.

        Args:
            moments: Returns the current motion; None while there is none.
            on_table: Returns True if the chain of the current motion is on a table.
            host, port, open_browser: Same as for ``web.viser.show``.
            follows: True to start at the last frame and to follow new ones.

        Raises:
            InputError: ``no-such-address``.
        """
        self._find, self._on_table = moments, on_table
        self._playhead = _Playhead(follows=follows)
        self._lock = threading.RLock()
        self._wake = threading.Event()
        self._closed = False
        self._moments: MotionSource | None = None
        self._id = ""
        self._selected: int | None = None
        self._scene: Scene | None = None
        self.server: viser.ViserServer = _server(host, port)
        self.url = _url(host, self.server.get_port())
        self._cameras = Cameras(self.server)
        self._controls = _Controls(self.server.gui)
        self._listen()
        with self._lock:
            self._look()
        self._thread = threading.Thread(target=self._run, name="foldback-show", daemon=True)
        self._thread.start()
        atexit.register(self.close)
        if open_browser:
            threading.Thread(target=webbrowser.open, args=(self.url,), daemon=True).start()

    def __enter__(self) -> Shown:
        return self

    def __exit__(self, *error: object) -> None:
        self.close()

    def __repr__(self) -> str:
        return f"<{type(self).__name__} at {self.url}>"

    def _repr_html_(self) -> str:
        """Return the HTML of the view for a notebook."""
        address = html.escape(self.url, quote=True)
        return (
            f'<iframe src="{address}" title="A fold in viser" width="100%" height="480" '
            'style="border: 0"></iframe>'
        )

    @property
    def frame(self) -> int:
        """Displayed frame, from 0; setting it displays the nearest existing frame."""
        return self._playhead.frame

    @frame.setter
    def frame(self, frame: int) -> None:
        with self._lock:
            self._seek(frame)

    def play(self) -> None:
        """Play from the displayed frame, or from the first one if it is the last."""
        with self._lock:
            if self._playhead.frame >= self._playhead.last and not self._growing:
                self._go(0)
            self._set_playing(True)

    def pause(self) -> None:
        """Stop at the displayed frame."""
        with self._lock:
            self._set_playing(False)

    def close(self) -> None:
        """Stop the server and free its port; further calls do nothing."""
        with self._lock:
            if self._closed:
                return
            self._closed = True
        atexit.unregister(self.close)
        self._wake.set()
        self._thread.join()
        with quiet():
            self.server.stop()

    def _listen(self) -> None:
        """React to the controls."""
        controls = self._controls

        @controls.slider.on_update
        def _(event: viser.GuiEvent[Any]) -> None:
            if event.client is None:
                return  # moved by the program, not by a client
            with self._lock:
                self._set_playing(False)
                self._seek(controls.slider.value - 1)

        @controls.button.on_click
        def _(_event: viser.GuiEvent[Any]) -> None:
            (self.pause if self._playhead.playing else self.play)()

        def draw(_event: viser.GuiEvent[Any]) -> None:
            with self._lock:
                self._draw()

        controls.colours.on_update(draw)

        @controls.follow.on_update
        def _(event: viser.GuiEvent[Any]) -> None:
            self._cameras.following = controls.follow.value
            draw(event)

    def _run(self) -> None:
        """Play and read new frames until the view is closed."""
        drawn = time.monotonic()
        while not self._closed:
            self._wake.wait(1 / 30 if self._playhead.playing else 0.1)
            self._wake.clear()
            now = time.monotonic()
            with self._lock:
                if not self._closed:
                    self._look()
                    self._play_on(now - drawn)
                    self._controls.write()
            drawn = now

    def _look(self) -> None:
        """Read new frames."""
        source = self._find()
        if source is None or not len(source):
            return
        is_same, last = source is self._moments, len(source) - 1
        self._moments = source
        if source.id != self._id:
            self._id, self._selected = source.id, None
            self.server.gui.set_panel_label(source.chain.name)
            if self._scene is not None:
                self._scene.remove_table()
            table = source.table() if self._on_table() else None
            self._scene = Scene(self.server, source.chain, stretch=source.stretch, table=table)
            self._scene.on_click(self._select)
        elif is_same and last == self._playhead.last:
            return
        self._playhead.last = last
        self._controls.slider.max = max(last, 1) + 1
        self._go(last if self._playhead.follows else self._playhead.frame)

    @property
    def _growing(self) -> bool:
        return self._moments is None or self._moments.growing

    def _play_on(self, passed_s: float) -> None:
        head = self._playhead
        if not head.playing:
            return
        # 20 s, but few frames do not stutter, and many can be followed
        per_second = min(max(head.last / 20.0, 12.0), 240.0)
        head.place += passed_s * per_second * SPEEDS.get(self._controls.speed.value, 1.0)
        if (frame := min(int(head.place), head.last)) != head.frame:
            self._go(frame)
        if frame >= head.last:
            head.follows = self._growing
            self._set_playing(False)

    def _set_playing(self, playing: bool) -> None:
        self._playhead.playing, self._playhead.place = playing, float(self._playhead.frame)
        self._controls.button.label = "Pause" if playing else "Play"
        self._wake.set()

    def _seek(self, frame: int) -> None:
        """Go to a requested frame; at the end of a growing timeline, follow it."""
        self._go(frame)
        head = self._playhead
        head.place = float(head.frame)
        head.follows = self._growing and head.frame >= head.last

    def _go(self, frame: int) -> None:
        head = self._playhead
        head.frame = min(max(int(frame), 0), max(head.last, 0))
        self._draw()

    def _select(self, module: int) -> None:
        with self._lock:
            self._selected = None if module == self._selected else module
            self._draw()

    def _draw(self) -> None:
        moments, scene = self._moments, self._scene
        if moments is None or scene is None:
            return
        try:
            snapshot = moments.snapshot(self._playhead.frame)
        except TimelineError:
            return  # the timeline is being replaced; keep the current display
        with self.server.atomic():
            scene.show(snapshot, self._painted(snapshot, moments.error_scale_rad))
            scene.move_ground(10.0)  # longer than it takes to settle
            self._controls.slider.value = self._playhead.frame + 1
            self._controls.figures = _told(snapshot, self._playhead.last, moments.error_scale_rad)
            self._controls.write()
            if self._selected is not None:
                self._controls.module.content = _told_of(moments.chain, self._selected, snapshot)
            else:
                self._controls.module.content = NO_MODULE_TEXT
        self._cameras.keep_in_view(scene.points(snapshot), scene.radius)

    def _painted(self, snapshot: Snapshot, scale_rad: float) -> NDArray[np.uint8]:
        if self._controls.colours.value == COLOUR_ALONG_CHAIN:
            colours = ramp_colours(np.linspace(0.0, 1.0, len(snapshot.positions)))
        else:
            colours = error_colours(snapshot.module_error_rad, scale_rad)
        if self._selected is not None:
            colours[self._selected] = SELECTED_RGB
        return colours


def _told(snapshot: Snapshot, last: int, scale_rad: float) -> str:
    """Return the figures of a frame, as Markdown."""
    finite_errors = np.abs(snapshot.joint_error_rad[np.isfinite(snapshot.joint_error_rad)])
    error = (
        f"Largest joint error {finite_errors.max():.2g} rad (modules are fully red at "
        f"{scale_rad:g} rad)"
        if len(finite_errors)
        else "The joint error was not recorded"
    )
    at = f"**Frame {snapshot.frame + 1:.0f} of {last + 1}**"
    return f"{at}, {snapshot.phase}, {snapshot.time_s:.2f} s\n\n{error}"


def _told_of(chain: Chain, module: int, snapshot: Snapshot) -> str:
    """Return the figures of a module, as Markdown."""
    joint = chain.module.joint_after(module)
    title = f"**Module {module + 1}** of {len(chain)}"
    if not 0 <= joint < chain.joint_count:
        return f"{title}, without a joint of its own"
    for hinge in chain.hinges_of(joint).tolist():
        angle, error = snapshot.joint_angles_rad[hinge], snapshot.joint_error_rad[hinge]
        title += f"\n\n{chain.joint_names[hinge]}: {np.rad2deg(angle):.1f}°"
        title += f", error {abs(error):.2g} rad" if np.isfinite(error) else ""
    return title


def _server(host: str, port: int) -> viser.ViserServer:
    """Return a viser server at an address, or the next free port.

    Raises:
        InputError: ``no-such-address``, for which viser itself would wait forever.
    """
    import viser  # imported late, because the import is slow

    try:
        kind, _, _, _, (address, *_) = socket.getaddrinfo(host, port, type=socket.SOCK_STREAM)[0]
        return viser.ViserServer(host, _free(kind, str(address), port), verbose=False)
    except (OSError, OverflowError, UnicodeError) as error:
        raise InputError(
            "no-such-address",
            f"got the address {host!r:.80} and the port {port}, expected an address of this "
            f"machine and a port of 0 to {MAX_PORT}, such as 127.0.0.1 and 8080 ({error}).",
        ) from error


def _free(kind: socket.AddressFamily, address: str, port: int) -> int:
    """Return the first free port from ``port`` on; 0 for 0.

    Raises:
        OSError: If there is none, or the address is not of this machine.
    """
    while True:
        with socket.socket(kind, socket.SOCK_STREAM) as probe:
            probe.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
            try:
                probe.bind((address, port))
                return port
            except OSError as error:
                if error.errno != errno.EADDRINUSE or not 0 < port < MAX_PORT:
                    raise
        port += 1


def _url(host: str, port: int) -> str:
    try:
        address = ipaddress.ip_address(host)
    except ValueError:
        return f"http://{host}:{port}"
    if address.is_unspecified:  # it stands for all addresses; loopback is always among them
        address = ipaddress.ip_address("127.0.0.1" if address.version == 4 else "::1")
    return f"http://[{address}]:{port}" if address.version == 6 else f"http://{address}:{port}"
