"""Strange plans: files that state less than they seem to, or that programs read differently.

``STRANGE`` has a way to write each of them, and what a checker must answer. All are made from
small plans that are true: ``DENSE`` with all angles of all frames, and others by name.
"""

import io
import json
import struct
import zipfile
import zlib
from collections.abc import Callable
from pathlib import Path as FilePath
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from foldback import foldback_check
from foldback.planner.motion.angle_encoding import encode_frames, encode_windows, plane_metadata

Arrays = dict[str, NDArray[Any]]
Meta = dict[str, Any]
Way = Callable[[], bytes]

NO_PLAN: Final = "no plan"
NOT_PROVED: Final = "not proved"
PROVED: Final = "proved"
NOTHING, MODULE, START = (f"proved, but {limit}" for limit in foldback_check.LIMITS)
STILL: Final = f"{NOTHING} and {START.removeprefix('proved, but ')}"
FRAMES: Final = 7
FOLDED: Final = np.array([0.0, 1.0, 0, 0, -1.0, 0, 0, 0, 1.0, 0, 0, 0])
"""Angles of a chain of 8 cubes whose modules stay apart all the way from straight, rad."""
OTHER: Final = np.roll(FOLDED, 1)
HOSTILE: Final = "\x1b[2K\rproved: 8 modules\u202e\n\ud800" + 500 * "x"
"""Text that hides what a terminal has shown before, and more than fits on a line."""


def dense(*, angles: NDArray[Any] | None = None) -> tuple[Arrays, Meta]:
    """Return the arrays and the text of a plan of 8 cubes."""
    q = np.linspace(0.0, 1.0, FRAMES)[:, None] * FOLDED if angles is None else angles
    arrays = {
        "joint_names": np.array([f"joint_{k}{end}" for k in range(1, 7) for end in ("_z", "_y")]),
        "time_s": np.arange(len(q), dtype=float),
        "joint_angles_rad": q,
    }
    meta = {
        "chain": {"module": "cube", "modules": 8, "folded_rad": q[-1].tolist()},
        "claim": {"format": "foldback-claim/1", "module": foldback_check.CUBE},
        "certificate": {
            "verified": True,
            "verdict": "verified (kinematics only)",
            "module_size": 0.95,
            "clearance_bound": 0.01,
            "exempt_pairs": {"rule": "consecutive modules (i, i+1)", "apart": 2, "count": 7},
            "frames": len(q),
        },
    }
    return arrays, json.loads(json.dumps(meta))


def windows() -> tuple[Arrays, Meta]:
    """Return the same plan in windows that hold all hinges."""
    arrays, meta = dense()
    q = arrays.pop("joint_angles_rad")
    arrays |= {
        "first": np.zeros(FRAMES, "i8"),
        "offsets": np.arange(FRAMES + 1) * q.shape[1],
        "angles_rad": q.ravel().astype("f4"),
    }
    return arrays, meta


def planes() -> tuple[Arrays, Meta]:
    """Return a plan whose angles are in planes."""
    step = foldback_check.STEP
    arrays, meta = dense(angles=np.rint(dense()[0]["joint_angles_rad"] / step) * step)
    q = arrays.pop("joint_angles_rad")
    coded = encode_frames(q)
    assert coded is not None
    meta["angles"] = plane_metadata(q.shape, windowed=False)
    return {**arrays, "angle_planes": coded}, meta


def window_planes() -> tuple[Arrays, Meta]:
    """Return a plan in windows whose angles are in planes."""
    step = foldback_check.STEP
    arrays, meta = windows()
    q = (np.rint(arrays.pop("angles_rad").astype(float) / step) * step).astype("f4")
    coded = encode_windows(arrays["first"], arrays["offsets"], q, FOLDED)
    assert coded is not None
    meta["angles"] = plane_metadata(q.shape, windowed=True)
    return {**arrays, "angle_planes": coded}, meta


def refold(*, straight: bool = True) -> tuple[Arrays, Meta]:
    """Return a plan from another shape, by way of the straight chain or directly."""
    ends = (OTHER, np.zeros(12), FOLDED) if straight else (OTHER, FOLDED)
    times = np.linspace(0, len(ends) - 1, FRAMES)
    q = np.stack([np.interp(times, range(len(ends)), column) for column in zip(*ends, strict=True)])
    arrays, meta = dense(angles=q.T)
    return arrays, meta | {"start": {"folded_rad": OTHER.tolist()}}


def still(*, frames: int) -> tuple[Arrays, Meta]:
    """Return a plan that begins folded and does not move."""
    arrays, meta = dense(angles=np.tile(FOLDED, (frames, 1)))
    return arrays, meta | {"start": {"folded_rad": FOLDED.tolist()}}


# Files --------------------------------------------------------------------------------------------


def npy(array: NDArray[Any] | str, header: str | None = None) -> bytes:
    """Return an .npy file, possibly with another header."""
    written = io.BytesIO()
    np.lib.format.write_array(written, np.asarray(array))
    data = written.getvalue()
    if header is None:
        return data
    length = int.from_bytes(data[8:10], "little")
    return (
        data[:8] + struct.pack("<H", len(header)) + header.encode("latin-1") + data[10 + length :]
    )


def members(plan: tuple[Arrays, Meta], text: str | None = None) -> dict[str, bytes]:
    """Return the members of a plan's archive."""
    arrays, meta = plan
    files = {"plan": npy(json.dumps(meta) if text is None else text)}
    files |= {name: npy(array) for name, array in arrays.items()}
    return {f"{name}.npy": data for name, data in files.items()}


def archive(files: dict[str, bytes], method: int = zipfile.ZIP_DEFLATED) -> bytes:
    """Return a zip archive."""
    written = io.BytesIO()
    with zipfile.ZipFile(written, "w", method) as file:
        for name, data in files.items():
            file.writestr(name, data)
    return written.getvalue()


def told(change: Callable[[Arrays, Meta], object], base: Callable[[], Any] = dense) -> Way:
    """Return a way that changes arrays and text of a plan."""

    def way() -> bytes:
        arrays, meta = base()
        change(arrays, meta)
        return archive(members((arrays, meta)))

    return way


def value(path: str, new: Any, base: Callable[[], Any] = dense) -> Way:
    """Return a way that sets a value of the text, such as ``claim.format``; None of it deletes."""

    def change(_: Arrays, meta: Meta) -> None:
        *outer, last = path.split(".")
        for name in outer:
            meta = meta[name]
        meta[last] = new

    return told(change, base)


def failed(verdict: str) -> Way:
    """Return a way that states a failure with this text."""

    def change(_: Arrays, meta: Meta) -> None:
        meta["certificate"] |= {"verified": False, "verdict": verdict}

    return told(change)


def module(name: str, **parts: Any) -> Way:
    """Return a way that gives the modules another name, and other parts."""

    def change(_: Arrays, meta: Meta) -> None:
        meta["chain"]["module"] = name
        meta["claim"]["module"] |= parts

    return told(change)


def text(change: Callable[[str], str]) -> Way:
    """Return a way that changes the JSON text."""
    return lambda: archive(members(dense(), change(json.dumps(dense()[1]))))


def array(name: str, new: Callable[[Any], Any], base: Callable[[], Any] = dense) -> Way:
    """Return a way that changes an array."""
    return told(lambda arrays, _: arrays.update({name: new(arrays[name])}), base)


def member(name: str, new: bytes | Callable[[], bytes]) -> Way:
    """Return a way that puts other bytes into a member, or adds one."""
    return lambda: archive(members(dense()) | {name: new if isinstance(new, bytes) else new()})


def header(change: Callable[[str], str]) -> Way:
    """Return a way that changes the header of the angles."""

    def way() -> bytes:
        q = dense()[0]["joint_angles_rad"]
        plain = npy(q)[10:].split(b"\n")[0].decode() + "\n"
        return archive(members(dense()) | {"joint_angles_rad.npy": npy(q, change(plain))})

    return way


def bytes_of(change: Callable[[bytearray], object], base: Callable[[], bytes] | None = None) -> Way:
    """Return a way that changes bytes of the archive."""

    def way() -> bytes:
        data = bytearray(archive(members(dense())) if base is None else base())
        change(data)
        return bytes(data)

    return way


def twice() -> bytes:
    """Return an archive with two members of each name."""
    archive_members = {name.upper(): data for name, data in members(still(frames=1)).items()}
    data = archive(archive_members | members(dense()))
    for name in archive_members:
        data = data.replace(name.encode(), name.lower().encode())
    return data


def entry(data: bytearray, at: int, form: str, new: int, *, inner: bool = True) -> None:
    """Set a field of the second member in the central directory, or else in its own header."""
    index = data.index(b"PK\x01\x02", data.index(b"PK\x01\x02") + 4)
    if not inner:
        index = struct.unpack_from("<I", data, index + 42)[0]
    struct.pack_into(form, data, index + at, new)


def flagged(bit: int) -> Way:
    """Return a way that sets a flag of a member in both of its headers."""

    def change(data: bytearray) -> None:
        entry(data, 8, "<H", 1 << bit)
        entry(data, 6, "<H", 1 << bit, inner=False)

    return bytes_of(change)


def packed(change: Callable[[bytes], bytes], states: int = 0) -> Way:
    """Return a way that changes the deflated bytes of the angles, and their stated size."""

    def way() -> bytes:
        files = members(dense())
        plain = files.pop("joint_angles_rad.npy")
        squeeze = zlib.compressobj(9, zlib.DEFLATED, -15)
        data = change(squeeze.compress(plain) + squeeze.flush())
        written = io.BytesIO()
        name, crc, size = b"joint_angles_rad.npy", zlib.crc32(plain), len(plain) + states
        local_header = struct.pack("<3HI3I2H", 20, 0, 8, 0, crc, len(data), size, len(name), 0)
        written.write(b"PK\3\4" + local_header + name + data)
        remaining_archive, start = archive(files), written.tell()
        at, count = (
            struct.unpack_from("<I", remaining_archive, len(remaining_archive) - 6)[0],
            len(files),
        )
        written.write(remaining_archive[:at])
        place = written.tell()
        written.write(
            b"PK\1\2" + struct.pack("<H", 20) + local_header + struct.pack("<3H2I", *5 * [0]) + name
        )
        offset = at
        for _ in range(count):
            lengths = struct.unpack_from("<3H", remaining_archive, offset + 28)
            central_header = bytearray(remaining_archive[offset : offset + 46 + sum(lengths)])
            struct.pack_into(
                "<I", central_header, 42, struct.unpack_from("<I", central_header, 42)[0] + start
            )
            written.write(central_header)
            offset += len(central_header)
        size = written.tell() - place
        written.write(
            struct.pack("<4s4H2IH", b"PK\5\6", 0, 0, count + 1, count + 1, size, place, 0)
        )
        return written.getvalue()

    return way


def bomb(shape: str = "(7, 12)", count: int = 2**24) -> bytes:
    """Return an .npy file of zeros that is far larger than its plan needs."""
    head = f"{{'descr': '<f8', 'fortran_order': False, 'shape': {shape}, }}\n"
    return b"\x93NUMPY\1\0" + struct.pack("<H", len(head)) + head.encode() + bytes(count)


def scaled(size: float) -> list[list[float]]:
    """Return corners of a cube that is smaller."""
    return (size * np.array(foldback_check.CUBE["corners"])).tolist()


def wiggle(arrays: Arrays, _: Meta) -> None:
    """Move a hinge a little in the middle of a motion."""
    arrays["joint_angles_rad"][1:-1, 3] += 1e-3


def rod(arrays: Arrays, meta: Meta) -> None:
    """Make the folded shape straight."""
    arrays["joint_angles_rad"][:] = 0.0
    wiggle(arrays, meta)
    meta["chain"]["folded_rad"] = [0.0] * 12


def last_frames(arrays: Arrays, meta: Meta) -> None:
    """Leave out the first frames, and call what they lead to the start."""
    for name in ("time_s", "joint_angles_rad"):
        arrays[name] = arrays[name][-3:]
    meta["certificate"]["frames"] = 3
    meta["start"] = {"folded_rad": arrays["joint_angles_rad"][0].tolist()}


def own_module_and_start(arrays: Arrays, meta: Meta) -> None:
    """Do both."""
    last_frames(arrays, meta)
    meta["chain"]["module"] = "brick"


STRANGE: Final[dict[str, tuple[Way, str]]] = {
    # What is proved is less than it seems
    "another letter in the name": (module("\u0441ube", corners=scaled(0.05)), MODULE),
    "a blank in the name": (module("cube ", corners=scaled(0.2)), MODULE),
    "a capital in the name": (module("Cube"), MODULE),
    "no name": (module("", corners=scaled(0.2)), MODULE),
    "a hostile name": (module(HOSTILE), MODULE),
    "a long name": (module("cube" * 20_000), MODULE),
    "a name that objects have": (module("constructor"), MODULE),
    "a name of prototypes": (module("__proto__"), MODULE),
    "a flat module": (module("cube.", corners=[[0.0, 0.0, 0.0]]), MODULE),
    "one frame, folded": (told(lambda *_: None, lambda: still(frames=1)), STILL),
    "equal frames": (told(lambda *_: None, lambda: still(frames=9)), STILL),
    "a wiggle of the folded shape": (told(wiggle, lambda: still(frames=9)), START),
    "a straight end": (told(rod), NOTHING),
    "the last frames": (told(last_frames), START),
    "a start that is never straight": (
        told(lambda *_: None, lambda: refold(straight=False)),
        START,
    ),
    "own module and start": (
        told(own_module_and_start),
        f"{MODULE} and {START.removeprefix('proved, but ')}",
    ),
    # Texts
    "a hostile verdict": (failed(HOSTILE), NOT_PROVED),
    "a text as verified": (value("certificate.verified", "verified"), NOT_PROVED),
    "a number as verified": (value("certificate.verified", 1), NOT_PROVED),
    "a list as verified": (value("certificate.verified", [True]), NOT_PROVED),
    "a later claim": (value("claim.format", "foldback-claim/9"), NOT_PROVED),
    "a hostile claim": (value("claim.format", HOSTILE), NOT_PROVED),
    "a claim without format": (value("claim.format", None), NOT_PROVED),
    "a number as format": (value("claim.format", 1), NOT_PROVED),
    "an empty claim": (value("claim", {}), NOT_PROVED),
    "a list as claim": (value("claim", []), NO_PLAN),
    "another checksum": (value("claim.angles_sha256", "0" * 64), NOT_PROVED),
    "no text as checksum": (value("claim.angles_sha256", 0), NOT_PROVED),
    "another rule of pairs": (
        value("certificate.exempt_pairs.rule", "all pairs up to 10 apart"),
        NOT_PROVED,
    ),
    "pairs without numbers": (value("certificate.exempt_pairs", {}), NO_PLAN),
    "pairs that are no object": (value("certificate.exempt_pairs", [2, 7]), NO_PLAN),
    "more pairs": (value("certificate.exempt_pairs.count", 28), NOT_PROVED),
    "true for a number of pairs": (value("certificate.exempt_pairs.apart", True), NO_PLAN),
    # Numbers of the text
    "a text as size": (value("certificate.module_size", "0.95"), NO_PLAN),
    "true as size": (value("certificate.module_size", True), NO_PLAN),
    "no number as size": (value("certificate.module_size", float("nan")), NO_PLAN),
    "a size above 1": (value("certificate.module_size", 1.5), NOT_PROVED),
    "true as clearance": (value("certificate.clearance_bound", True), NO_PLAN),
    "no clearance": (value("certificate.clearance_bound", None), NOT_PROVED),
    "true as frames": (value("certificate.frames", True, lambda: still(frames=1)), NO_PLAN),
    "other frames": (value("certificate.frames", 8), NOT_PROVED),
    "a list as step": (value("certificate.max_joint_step_rad", []), NO_PLAN),
    "a small step": (value("certificate.max_joint_step_rad", 0.01), NOT_PROVED),
    "half a module": (value("chain.modules", 8.5), NO_PLAN),
    "a huge number of modules": (value("chain.modules", 10**12), NO_PLAN),
    "an endless number": (value("chain.modules", 10**400), NO_PLAN),
    "one module": (value("chain.modules", 1), NO_PLAN),
    "a number as module": (value("chain.module", 7), NO_PLAN),
    "a text among angles": (value("chain.folded_rad", ["0"] * 12), NO_PLAN),
    "null among angles": (value("chain.folded_rad", [None] * 12), NO_PLAN),
    "nested angles": (value("chain.folded_rad", [[0.0]] * 12), NO_PLAN),
    "too many angles": (value("chain.folded_rad", [0.0] * 13), NO_PLAN),
    "a start without angles": (value("start", {}), NO_PLAN),
    "false as start": (value("start", False), NO_PLAN),
    "a short start": (value("start", {"folded_rad": [0.0]}), NO_PLAN),
    "a start that is not there": (value("start", {"folded_rad": [0.1] * 12}), NOT_PROVED),
    # Modules
    "smaller cubes": (module("cube", corners=scaled(0.5)), NOT_PROVED),
    "a corner more": (module("cube", corners=[*scaled(1.0), [0.0, 0.0, 0.0]]), NOT_PROVED),
    "true as links": (module("cube", rigid_links=True), NO_PLAN),
    "no claim": (value("claim", None), NO_PLAN),
    "no module in the claim": (value("claim.module", None), NO_PLAN),
    "no description": (value("claim.module", None, lambda: (dense()[0], named("brick"))), NO_PLAN),
    "many corners": (module("brick", corners=scaled(1.0) * 13), NO_PLAN),
    "many edges": (module("brick", edges=[[1.0, 0.0, 0.0]] * 20_000), NO_PLAN),
    "no corners": (module("brick", corners=[]), NO_PLAN),
    "many hinges": (module("brick", hinges=["_z"] * 9), NO_PLAN),
    "a long name of a hinge": (module("brick", hinges=["_z", "y" * 99]), NO_PLAN),
    "a hinge without name": (module("brick", hinges=["_z", 2]), NO_PLAN),
    "texts as corners": (module("brick", corners=[["0", "0", "0"]]), NO_PLAN),
    "no number as corner": (module("brick", corners=[[float("nan")] * 3]), NO_PLAN),
    "links without length": (module("brick", offset=[0.0, 0.0, 0.0]), NOT_PROVED),
    "any angle": (module("brick", limit_rad=1e9), NOT_PROVED),
    "pairs of a module": (module("brick", apart=9), NO_PLAN),
    # JSON
    "a name twice": (text(lambda t: t[:-1] + ', "certificate": {}}'), NO_PLAN),
    "a name twice, written otherwise": (text(lambda t: '{"\\u0063laim": {}, ' + t[1:]), NO_PLAN),
    "a name twice inside": (
        text(lambda t: t.replace('"modules": 8', '"modules": 9, "modules": 8')),
        NO_PLAN,
    ),
    "no number where none is read": (text(lambda t: t[:-1] + ', "x": NaN}'), NO_PLAN),
    "infinity where none is read": (text(lambda t: t[:-1] + ', "x": -Infinity}'), NO_PLAN),
    "deep lists": (text(lambda t: f'{t[:-1]}, "x": {"[" * 99}{"]" * 99}}}'), NO_PLAN),
    "bottomless lists": (text(lambda t: f'{t[:-1]}, "x": {"[" * 99_999}{"]" * 99_999}}}'), NO_PLAN),
    "text behind the text": (text(lambda t: t + "{}"), NO_PLAN),
    "a mark before the text": (text(lambda t: "\ufeff" + t), NO_PLAN),
    "a zero in the text": (text(lambda t: t.replace("cube", "cu\0be")), NO_PLAN),
    "half a letter": (text(lambda t: t.replace("cube", "cu\ud800be")), NO_PLAN),
    "a list as text": (text(lambda t: f"[{t}]"), NO_PLAN),
    "no text": (text(lambda t: ""), NO_PLAN),
    "bytes as text": (
        member("plan.npy", lambda: npy(np.array(json.dumps(dense()[1]).encode()))),
        NO_PLAN,
    ),
    "no letters": (
        member("plan.npy", lambda: npy("x").replace(b"x\0\0\0", b"\0\0\x11\0")),
        NO_PLAN,
    ),
    # Angles in planes
    "endless differences": (value("angles.differences", 10**12, planes), NO_PLAN),
    "two differences": (value("angles.differences", 2, planes), NO_PLAN),
    "a text as differences": (value("angles.differences", "3", planes), NO_PLAN),
    "windows' differences": (value("angles.differences", "window", planes), NO_PLAN),
    "frames' differences": (value("angles.differences", 3, window_planes), NO_PLAN),
    "another step": (value("angles.step_rad", 1e-7, planes), NO_PLAN),
    "another shape": (value("angles.shape", [12, 7], planes), NO_PLAN),
    "a huge shape": (value("angles.shape", [2**40, 2**40], planes), NO_PLAN),
    "another encoding": (value("angles.encoding", "plain", planes), NO_PLAN),
    "no description of planes": (value("angles", None, planes), NO_PLAN),
    "three planes": (array("angle_planes", lambda v: v[:3], planes), NO_PLAN),
    "planes that overflow": (array("angle_planes", lambda v: v | 0xFE, planes), NOT_PROVED),
    "angles twice": (
        told(
            lambda arrays, _: arrays.update(joint_angles_rad=dense()[0]["joint_angles_rad"]), planes
        ),
        NO_PLAN,
    ),
    # Types and headers of arrays
    "complex angles": (array("joint_angles_rad", lambda v: v + 1j), NO_PLAN),
    "angles of 80 bits": (array("joint_angles_rad", lambda v: v.astype("g")), NO_PLAN),
    "angles of 16 bits": (array("joint_angles_rad", lambda v: v.astype("f2")), NO_PLAN),
    "angles of 32 bits": (array("joint_angles_rad", lambda v: v.astype("f4")), NO_PLAN),
    "angles that are whole": (array("joint_angles_rad", lambda v: v.astype("i8")), NO_PLAN),
    "angles of other machines": (array("joint_angles_rad", lambda v: v.astype(">f8")), NO_PLAN),
    "angles with names": (array("joint_angles_rad", lambda v: v.astype([("a", "f8")])), NO_PLAN),
    "angles as texts": (array("joint_angles_rad", lambda v: v.astype("U")), NO_PLAN),
    "angles as objects": (
        member("joint_angles_rad.npy", lambda: npy(np.zeros(1)).replace(b"'<f8'", b"'|O' ")),
        NO_PLAN,
    ),
    "a third dimension": (array("joint_angles_rad", lambda v: v[:, :, None]), NO_PLAN),
    "angles without frames": (array("joint_angles_rad", lambda v: v.ravel()), NO_PLAN),
    "order twice": (
        header(lambda h: h.replace("'shape'", "'fortran_order': True, 'shape'")),
        NO_PLAN,
    ),
    "shape twice": (header(lambda h: h.replace("}", "'shape': (12, 7), }")), NO_PLAN),
    "type twice": (header(lambda h: "{'descr': '<i8', " + h[1:]), NO_PLAN),
    "an unknown key": (header(lambda h: h.replace("}", "'x': 1, }")), NO_PLAN),
    "another order of keys": (
        header(lambda _: "{'shape': (7, 12), 'fortran_order': False, 'descr': '<f8', }\n"),
        NO_PLAN,
    ),
    "a comment": (header(lambda h: h.replace("}", "}#")), NO_PLAN),
    "no end of the header": (header(lambda h: h.replace("\n", " ")), NO_PLAN),
    "a huge header": (header(lambda h: h.replace("\n", " " * 60_000 + "\n")), NO_PLAN),
    "a negative shape": (header(lambda h: h.replace("(7, 12)", "(-7, -12)")), NO_PLAN),
    "a larger shape": (header(lambda h: h.replace("(7, 12)", "(8, 12)")), NO_PLAN),
    "a shape with an empty axis": (header(lambda h: h.replace("(7, 12)", "(0, 12)")), NO_PLAN),
    "a shape beyond memory": (header(lambda h: h.replace("7, 12", f"{10**9 - 1}, 12")), NO_PLAN),
    "no array": (member("joint_angles_rad.npy", b"\x93NUMPY"), NO_PLAN),
    "more zeros than stated": (member("joint_angles_rad.npy", bomb), NO_PLAN),
    "as many zeros as stated": (
        member("joint_angles_rad.npy", lambda: bomb(f"(7, {2**20})", 7 * 2**23)),
        NO_PLAN,
    ),
    "more frames than named": (member("time_s.npy", lambda: bomb(f"({2**21},)", 2**24)), NO_PLAN),
    "names with a zero inside": (
        array("joint_names", lambda v: np.char.replace(v, "joint_3", "joint\0003")),
        NOT_PROVED,
    ),
    "names in another order": (array("joint_names", lambda v: v[::-1]), NOT_PROVED),
    "names as bytes": (array("joint_names", lambda v: v.astype("S")), NO_PLAN),
    # Frames and windows
    "no times": (told(lambda arrays, _: arrays.pop("time_s")), NO_PLAN),
    "no frames": (
        told(
            lambda arrays, _: arrays.update(time_s=np.zeros(0), joint_angles_rad=np.zeros((0, 12)))
        ),
        NO_PLAN,
    ),
    "a time that is no number": (array("time_s", lambda v: v + np.nan), NOT_PROVED),
    "times that fall": (array("time_s", lambda v: v[::-1]), NOT_PROVED),
    "an angle that is no number": (array("joint_angles_rad", lambda v: v + np.nan), NOT_PROVED),
    "an endless angle": (array("joint_angles_rad", lambda v: v + np.inf), NOT_PROVED),
    "a huge window": (array("first", lambda v: v + 2**62, windows), NOT_PROVED),
    "a window before the chain": (array("first", lambda v: v - 1, windows), NOT_PROVED),
    "windows that fall": (
        array("offsets", lambda v: v[[0, 2, 1, *range(3, 8)]], windows),
        NOT_PROVED,
    ),
    "windows below 0": (array("offsets", lambda v: np.r_[0, -(2**62), v[2:]], windows), NOT_PROVED),
    "windows beyond the angles": (array("offsets", lambda v: v + v[-1], windows), NOT_PROVED),
    "windows without places": (told(lambda arrays, _: arrays.pop("offsets"), windows), NO_PLAN),
    "windows with all angles": (
        told(lambda arrays, _: arrays.update(joint_angles_rad=arrays.pop("angles_rad")), windows),
        NO_PLAN,
    ),
    # Archives
    "members twice": (twice, NO_PLAN),
    "a member without ending": (member("plan", lambda: npy("{}")), NO_PLAN),
    "a member outside": (member("../x.npy", b""), NO_PLAN),
    "something behind": (bytes_of(lambda data: data.extend(b"\n")), NO_PLAN),
    "something before": (bytes_of(lambda data: data.__setitem__(slice(0, 0), b"x")), NO_PLAN),
    "a comment of the archive": (
        bytes_of(lambda data: data.__setitem__(slice(-2, None), b"\1\0x")),
        NO_PLAN,
    ),
    "another archive behind": (
        bytes_of(lambda data: data.extend(archive(members(still(frames=1))))),
        NO_PLAN,
    ),
    "another name inside": (
        bytes_of(lambda data: entry(data, 30, "<B", 0x70, inner=False)),
        NO_PLAN,
    ),
    "another checksum inside": (
        bytes_of(lambda data: entry(data, 14, "<I", 7, inner=False)),
        NO_PLAN,
    ),
    "another size inside": (bytes_of(lambda data: entry(data, 22, "<I", 7, inner=False)), NO_PLAN),
    "another method inside": (bytes_of(lambda data: entry(data, 8, "<H", 0, inner=False)), NO_PLAN),
    "long sizes": (bytes_of(lambda data: entry(data, 24, "<I", 2**32 - 1)), NO_PLAN),
    "a member at another place": (bytes_of(lambda data: entry(data, 42, "<I", 0)), NO_PLAN),
    "more members than there are": (bytes_of(lambda data: data.__setitem__(-12, 9)), NO_PLAN),
    "fewer members": (
        bytes_of(lambda data: data.__setitem__(slice(-14, -10), b"\3\0\3\0")),
        NO_PLAN,
    ),
    "encrypted": (flagged(0), NO_PLAN),
    "sizes behind the data": (flagged(3), NO_PLAN),
    "packed by bzip2": (lambda: archive(members(dense()), zipfile.ZIP_BZIP2), NO_PLAN),
    "packed by LZMA": (lambda: archive(members(dense()), zipfile.ZIP_LZMA), NO_PLAN),
    "a changed byte": (packed(lambda data: data[:60] + bytes([data[60] ^ 1]) + data[61:]), NO_PLAN),
    "a part of the data": (packed(lambda data: data[:-9]), NO_PLAN),
    "bytes behind the data": (packed(lambda data: data + b"junk"), NO_PLAN),
    "the data twice": (packed(lambda data: data + data), NO_PLAN),
    "less data than stated": (packed(lambda data: data, 8), NO_PLAN),
    "more data than stated": (packed(lambda data: data, -8), NO_PLAN),
    "half of the file": (
        bytes_of(lambda data: data.__delitem__(slice(len(data) // 2, None))),
        NO_PLAN,
    ),
    "an empty archive": (lambda: archive({}), NO_PLAN),
    "an empty file": (lambda: b"", NO_PLAN),
    "JSON": (lambda: json.dumps(dense()[1]).encode(), NO_PLAN),
}
"""Ways to write a strange plan by name, and the verdict that it must get."""


def named(kind: str) -> Meta:
    """Return the text of a plan with modules of another name."""
    meta = dense()[1]
    meta["chain"]["module"] = kind
    return meta


TRUE: Final[dict[str, Way]] = {
    "all angles": told(lambda *_: None),
    "windows": told(lambda *_: None, windows),
    "planes": told(lambda *_: None, planes),
    "planes of windows": told(lambda *_: None, window_planes),
    "a refold": told(lambda *_: None, refold),
    "small modules": value("certificate.module_size", 0.05),
    "columns of angles": array("joint_angles_rad", np.asfortranarray),
    "stored": lambda: archive(members(dense()), zipfile.ZIP_STORED),
    "packed": packed(lambda data: data),
    "written by NumPy": lambda: saved(*dense()),
    "an array nobody asked for": member("unasked.npy", lambda: bomb(f"({2**21},)", 2**24)),
    "whole numbers as fractions": value("chain.modules", 8.0),
    "long numbers": text(lambda t: f'{t[:-1]}, "x": {"9" * 5000}}}'),
    "no certificate of pairs": value("certificate.exempt_pairs", None),
}
"""Ways to write plans that are true, by name."""


def saved(arrays: Arrays, meta: Meta) -> bytes:
    """Return a plan as NumPy writes it."""
    written = io.BytesIO()
    np.savez_compressed(written, plan=np.array(json.dumps(meta)), **arrays)
    return written.getvalue()


def write(way: Way, path: FilePath) -> FilePath:
    """Write a plan and return its path."""
    path.write_bytes(way())
    return path
