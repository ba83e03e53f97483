"""A certificate in words, as pages and the command line show it.

Proved figures are rounded to the conservative side.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any, Final, TypedDict

from foldback.planner.certificate.figures import (
    CertificateFigures,
    MarginFigures,
    figures_of_certificates,
    verdict_text,
)
from foldback.planner.certificate.table_figures import TableCertificate
from foldback.planner.chain.module import DEFAULT_MODULE_SIZE
from foldback.planner.motion.record import TableRecord
from foldback.planner.parameters.parameters import BASELINE
from foldback.planner.reasons import Reader
from foldback.words.messages import PEOPLE, nearest_frame, reason_text
from foldback.words.quantities import (
    SIGNIFICANT_DIGITS,
    STRATEGY_LABELS,
    length_m,
    quantity,
    sentence,
    spacings,
)

if TYPE_CHECKING:
    from foldback.planner.servos.servos import Servo

CERTIFICATE_DIGITS: Final = 2
"""Number of significant digits to which pages round a certificate's figures, such as joint
errors."""
NOT_SIMULATED: Final = "not simulated"
MAX_NAMED_SERVOS: Final = 8
"""Maximum number of servos with sufficient torque that a fold's page lists, lightest first."""
NEAR_PITCH_FACTOR: Final = 1.1
"""Ratio between the smallest module pitch, above the requested one, for which a servo is suitable
and the largest pitch whose servos a fold's page lists too, if none suits the requested pitch; also
between the largest suitable pitch and smaller ones if all are below the requested one."""
ROUNDING_PITCH: Final = 1e-9
"""Overlap of two modules, in pitches, up to which a page does not report it, as it is only the
rounding error of a contact; torques, in w·p (module weight × pitch), are rounded up with the same
tolerance."""


FIGURES: Final = figures_of_certificates()
ERRORS: Final = ("max_angle_error_rad", "rms_position_error")
"""Figures that are shown with ``CERTIFICATE_DIGITS``."""
CLEARANCES: Final = (
    "module_size",
    "min_clearance",
    "min_clearance_playback",
    "min_clearance_record",
)
PLAYBACK_FIGURES: Final = ("rms_position_error", "max_joint_step_rad")


def verdict_words(certificate: CertificateFigures, reader: Reader = PEOPLE) -> str:
    """Return the verdict on a plan; empty without a verdict.

    Args:
        certificate: The certificate of the plan.
        reader: Style of the reason why a plan is not verified.
    """
    reason = certificate.get("reason")
    if reason is None and not certificate.get("verified"):
        return ""
    failure = reason and reason_text(reason, reader)
    return verdict_text(failure, simulated=certificate.get("simulated"))


def headline(certificate: CertificateFigures, reader: Reader = PEOPLE) -> str:
    """Return ``verdict_words``, with the proved clearance of a verified plan."""
    proved = clearance(certificate) if certificate.get("verified") else None
    return f"{verdict_words(certificate, reader)}{f': {proved}' if proved else ''}"


def safety(certificate: CertificateFigures, modules: str) -> str | None:
    """Return in plain words that no modules collide; None unless that is proved.

    Args:
        certificate: The certificate of the plan.
        modules: Number of its modules with their kind, for example "160 cubes".
    """
    bound = certificate.get("clearance_bound")
    if not certificate.get("verified") or bound is None or bound <= 0.0:
        return None
    size = certificate.get("module_size") or DEFAULT_MODULE_SIZE
    smaller = f" at {filled(size)} % of full size" if size != DEFAULT_MODULE_SIZE else ""
    gap = f"at least {rounded_down(100.0 * bound, 1)} % of the spacing"
    motors = ". Motors not simulated" if certificate.get("simulated") is False else ""
    return f"Safe{smaller}: the {modules} never collide. Smallest gap: {gap}{motors}"


def clearance(certificate: CertificateFigures) -> str | None:
    """Return the proved clearance in % of the spacing; None if nothing is proved.

    It names the size of the modules unless that is the default one.
    """
    bound = certificate.get("clearance_bound")
    if bound is None or _seen(certificate) is None:
        return None
    percent = rounded_down(100.0 * bound, 1)
    if bound < 0.0:
        return f"modules overlap by at most {percent.removeprefix('-')} % of the spacing"
    size = certificate.get("module_size") or DEFAULT_MODULE_SIZE
    if size == DEFAULT_MODULE_SIZE:
        return f"modules stay at least {percent} % of the spacing apart"
    return (
        f"modules that fill {filled(size)} % of the spacing stay at least {percent} % of it apart"
    )


def filled(size: float) -> str:
    """Return a size of modules in %, rounded down: 80 or 80.6."""
    return rounded_down(100.0 * size, 1).removesuffix(".0")


def rows(certificate: CertificateFigures) -> list[tuple[str, str | None]]:
    """Return the figures of a plan as labels and values."""
    return [*main_rows(certificate), *further_rows(certificate), *motion_rows(certificate)]


def main_rows(certificate: CertificateFigures) -> list[tuple[str, str | None]]:
    """Return the most important figures of a motion."""
    return [
        (label_of("clearance_bound"), _at_least(certificate.get("clearance_bound"))),
        (label_of("fold_time_s"), _folding_time(certificate)),
        torque(certificate),
        (label_of("table"), _torque_of(certificate.get("table"))),
        _row(certificate, "max_angle_error_rad"),
    ]


def further_rows(certificate: CertificateFigures) -> list[tuple[str, str | None]]:
    """Return all figures besides ``main_rows`` and ``motion_rows``."""
    return [
        *(_row(certificate, name) for name in CLEARANCES),
        (label_of("robots"), robots(certificate)),
        (label_of("mujoco_robot"), robot_in_mujoco(certificate)),
        *margin_rows(certificate),
        *_sampled_row(certificate),
        *(_row(certificate, name) for name in PLAYBACK_FIGURES),
    ]


def motion_rows(certificate: CertificateFigures) -> list[tuple[str, str | None]]:
    """Return how far the hinges travel, how often they turn back, and how many move at once."""
    travel, reversals = certificate.get("travel_ratio"), certificate.get("reversals_mean")
    count, largest = certificate.get("detours"), certificate.get("largest_detour_rad")
    travel_words = None if travel is None else f"{travel:.2f} times the least possible"
    detours = None
    if count is not None and largest is not None:
        detours = f"{count}, by up to {math.degrees(largest):.0f}°" if count else "none"
    return [
        (label_of("travel_ratio"), travel_words),
        (label_of("reversals_mean"), quantity(reversals, "", CERTIFICATE_DIGITS)),
        (label_of("detours"), detours),
        _row(certificate, "hinges_moving_mean"),
        _row(certificate, "hinges_moving_most"),
    ]


def label_of(name: str) -> str:
    """Return the label of a figure."""
    return FIGURES[name].label


def _row(certificate: CertificateFigures, name: str) -> tuple[str, str | None]:
    """Return a figure's label and value, or why a simulated figure is missing."""
    figure = FIGURES[name]
    simulated = figure.source == "simulation"
    if simulated and certificate.get("simulated") is False:
        return figure.label, NOT_SIMULATED
    digits = CERTIFICATE_DIGITS if name in ERRORS else SIGNIFICANT_DIGITS
    value = certificate.get(name)
    if figure.unit == "pitch" and isinstance(value, int | float):
        return figure.label, spacings(value, digits)
    return figure.label, quantity(value, figure.unit, digits)


def margin_rows(certificate: CertificateFigures) -> list[tuple[str, str | None]]:
    """Return the errors that the plan is proved to tolerate, and what limits each."""
    margins = certificate.get("margins")
    if margins is None:
        return []
    size, one_hinge, all_hinges = (
        margins["module_size"],
        margins["one_hinge_rad"],
        margins["independent_rad"],
    )
    return [
        (
            "Tolerated module size (proved)",
            f"modules may fill up to {rounded_down(100.0 * size['value'], 1)} % of the spacing; "
            f"{_limit(size)}",
        ),
        (
            "Tolerated error of one hinge (proved)",
            f"up to {degrees_down(one_hinge['value'])} if all other hinges are exact; "
            f"{_limit(one_hinge)}",
        ),
        (
            "Tolerated errors of all hinges (proved)",
            f"up to {degrees_down(all_hinges['value'])} in all hinges; with such random errors, "
            f"modules touch in at most {100 * margins['failure_probability']:.0f} of 100 robots; "
            f"{_limit(all_hinges)}",
        ),
    ]


def _sampled_row(certificate: CertificateFigures) -> list[tuple[str, str]]:
    """Return the errors of all hinges that most sampled robots tolerate; they prove nothing."""
    errors = certificate.get("joint_errors")
    if errors is None or errors["tolerated_rad"] <= 0.0:
        return []
    kind = "sampled" if errors.get("swept", True) else "estimated"
    return [
        (
            f"Tolerated errors of all hinges ({kind})",
            f"up to {degrees_down(errors['tolerated_rad'])} in all hinges; with such random "
            f"errors, at most {errors['touching_with_error']} of {errors['robots']} robots touched "
            "themselves",
        )
    ]


def _limit(margin: MarginFigures) -> str:
    """Return the moment and the modules that limit a margin; both count from 1."""
    place = margin["limited_by"]
    modules = place["modules"]
    assert modules is not None
    first, second = (module + 1 for module in modules)
    frame = nearest_frame(place["frame"]) + 1
    return f"beyond that, modules {first} and {second} may touch near frame {frame} of the plan"


def degrees_down(angle_rad: float) -> str:
    """Return a positive angle in degrees, rounded down to two significant digits."""
    angle = math.degrees(angle_rad)
    digits = 1 - math.floor(math.log10(angle)) if angle > 0.0 else 0
    return f"{math.floor(angle * 10.0**digits) / 10.0**digits:.{max(digits, 0)}f}°"


def _folding_time(certificate: CertificateFigures) -> str | None:
    """Return the folding time and the joint speed that it assumes."""
    time = quantity(certificate.get("fold_time_s"), "s")
    speed = quantity(certificate.get("joint_speed_limit_rad_s"), "rad/s")
    return f"{time} at joint speeds of up to {speed}" if time and speed else time


class TableWords(TypedDict):
    """Texts about a certificate of a fold on a table."""

    good: bool
    text: str
    rows: list[tuple[str, str]]
    assumptions: list[str]
    servos: str
    named: list[dict[str, str]]


def on_table(certificate: CertificateFigures, record: TableRecord | None) -> TableWords | None:
    """Return the requirements of a fold on a table and suitable servos; None if it floats.

    Args:
        certificate: The fold's certificate.
        record: Figures of the explosion, if known.
    """
    table_figures = certificate.get("table")
    if table_figures is None:
        return None
    table = TableCertificate.from_dict(table_figures)
    friction = table.base_text
    largest = _torque(table.torque, table.unit_nm, friction)
    needs = (
        f"its hinges need at most {largest}"
        if table.torque
        else f"no hinge needs any torque ({friction})"
    )
    rests = f"the chain stays on the table; {needs}"
    text = sentence(rests if table.reason is None else reason_text(table.reason))
    rows: list[tuple[str, str | None]] = [
        ("Frame with the highest torque", None if table.frame is None else str(table.frame + 1)),
        ("1 w·p (module weight × spacing)", quantity(table.unit_nm, "N·m")),
        ("Torque limit", None if table.bound is None else f"{table.bound:g} w·p"),
        ("Friction", "none" if table.friction == 0.0 else f"μ = {table.friction:g}"),
        ("Base", _base(table)),
        ("Lowest corner of a module", _lowest(table.clearance)),
        ("Frames in which the chain would tip over", str(len(table.unbalanced) or "none")),
    ]
    if record is not None:
        rows += [
            (
                "How often the simulation of unfolding went back to an earlier frame",
                quantity(record.taken_back),
            ),
            ("Torque limit while unfolding", _rose(record)),
        ]
    servos, named = _servos(table) if table.torque is not None else ("", [])
    return {
        "good": table.rests,
        "text": text,
        "rows": [(label, value) for label, value in rows if value],
        "assumptions": list(table.assumptions),
        "servos": servos,
        "named": [{"name": f"{servo.maker} {servo.name}", "href": servo.url} for servo in named],
    }


def _base(table: TableCertificate) -> str:
    """Return how the chain is held, in words."""
    if table.base == "clamped":
        return "the first module is clamped to the table"
    if table.friction == 0.0:
        return (
            "not clamped (in the simulation, the first module is fixed, because "
            "without friction the chain would slide)"
        )
    return "not clamped; the chain may drift, and position errors do not include this drift"


def _servos(table: TableCertificate) -> tuple[str, list[Servo]]:
    """Return the suitable servos in words and by name; if none, those for another width."""
    # Late: most folds are not on a table.
    from foldback.planner.servos.module_materials import CASINGS
    from foldback.planner.servos.servos import servos
    from foldback.planner.servos.sizing import find_suitable_servos, suitable_pitches

    torque, casing = table.torque or 0.0, CASINGS["pla"]
    modules = f"PLA modules that are {length_m(table.pitch_m)} wide"
    fits = find_suitable_servos(torque, pitch_m=table.pitch_m, casing=casing)
    would = [fit.servo for fit in fits if fit.would_do]
    if would:
        if len(would) == 1:
            text = f"This servo suits {modules}:"
        elif len(would) <= MAX_NAMED_SERVOS:
            text = f"These servos suit {modules}:"
        else:
            text = f"{len(would)} servos suit {modules}. The lightest {MAX_NAMED_SERVOS} are:"
        return text, would[:MAX_NAMED_SERVOS]
    ranges = [
        (suitable_pitches(s, torque, casing), s) for s in servos() if s.turns_enough is not False
    ]
    possible = sorted(
        ((pitches, servo) for pitches, servo in ranges if not pitches.empty),
        key=lambda candidate: candidate[1].name,
    )
    if not possible:
        return "No servo in our list suits PLA modules, however wide they are.", []
    wider = [
        (pitches.least_m, servo) for pitches, servo in possible if pitches.least_m > table.pitch_m
    ]
    if wider:
        smallest_m = min(pitch_m for pitch_m, _ in wider)
        none, width = modules, f"at least {length_m(smallest_m)} wide, but not much wider"
        near = [candidate for candidate in wider if candidate[0] <= NEAR_PITCH_FACTOR * smallest_m]
    else:
        largest_m = max(pitches.most_m for pitches, _ in possible)
        none, width = (
            f"{modules} or wider",
            f"at most {length_m(largest_m)} wide, but not much narrower",
        )
        limits = [(largest_m / pitches.most_m, servo) for pitches, servo in possible]
        near = [candidate for candidate in limits if candidate[0] <= NEAR_PITCH_FACTOR]
    suit = "this servo suits" if len(near) == 1 else "these servos suit"
    text = f"No servo in our list suits {none}. If the modules are {width}, {suit} them:"
    return text, [servo for _, servo in sorted(near, key=lambda candidate: candidate[0])]


def _torque_of(table: dict[str, Any] | None) -> str | None:
    if table is None:
        return None
    certificate = TableCertificate.from_dict(table)
    return _torque(certificate.torque, certificate.unit_nm, certificate.base_text)


def _torque(torque_wp: float | None, unit_nm: float, friction: str) -> str | None:
    """Return a torque and its friction in words, rounded up."""
    if torque_wp is None:
        return None
    in_nm, in_wp = _rounded_up(torque_wp * unit_nm), _rounded_up(torque_wp)
    return f"{quantity(in_nm, 'N·m')} ({in_wp:.3g} w·p) {friction}"


def _rounded_up(value: float) -> float:
    """Return a number rounded up to three digits."""
    if value <= 0.0:
        return 0.0
    digit = 10.0 ** (math.floor(math.log10(value)) - 2)
    return math.ceil(value / digit - ROUNDING_PITCH) * digit


def _lowest(clearance: float) -> str:
    if abs(clearance) < 1e-3:  # else rounding shows as a gap
        return "on the table top"
    side = "above" if clearance > 0.0 else "below"
    return f"{spacings(abs(clearance), CERTIFICATE_DIGITS)} {side} the table top"


def _rose(record: TableRecord) -> str:
    """Return how the torque bound of an explosion rose, in words."""
    bounds = [bound for _, bound in record.raised]
    if not bounds:
        return f"{record.bound:g} w·p throughout"
    raised = ", then ".join(
        f"to {bound:.3g} w·p at {time_s:.3g} s" for time_s, bound in record.raised
    )
    return f"raised {raised} of simulated time"


def robots(certificate: CertificateFigures) -> str | None:
    """Return the number of perturbed robots that folded the plan, and their smallest clearance."""
    playbacks = certificate.get("robots")
    if not playbacks:
        return None
    min_clearance = min(playback["min_clearance"] for playback in playbacks)
    smallest = rounded_down(100.0 * min_clearance, 1).replace("-", "−")
    return (
        f"{len(playbacks)} robot{'s' if len(playbacks) > 1 else ''} with random imperfections; "
        "the view shows the robot with the largest errors. "
        f"The smallest clearance is {smallest} % of the spacing"
    )


def robot_in_mujoco(certificate: CertificateFigures) -> str | None:
    """Return which robot MuJoCo simulated, and how its joint errors compare with those of ours."""
    in_mujoco = certificate.get("mujoco_robot")
    if not in_mujoco:
        return None
    our_robots, number = certificate.get("robots") or [], in_mujoco["robot"]
    name = f"robot {number + 1} of {len(our_robots)}" if our_robots else "the robot"
    error, difference = (
        quantity(in_mujoco[figure], "rad", CERTIFICATE_DIGITS)
        for figure in ("max_angle_error_rad", "max_difference_rad")
    )
    own_error = ""
    if our_robots:
        our_error = quantity(our_robots[number]["max_angle_error_rad"], "rad", CERTIFICATE_DIGITS)
        own_error = f" ({our_error} in our simulation)"
    return (
        f"MuJoCo simulated {name} again, with the same imperfections. "
        f"Largest joint error: {error}{own_error}. "
        f"Largest difference between the joint angles of both simulations: {difference}"
    )


def torque(certificate: CertificateFigures) -> tuple[str, str | None]:
    """Return the largest torque and its source, which differs from that of the plot.

    It is called a peak only if it comes from the motors at every step of a simulation. Plots show
    torques that inverse dynamics computes from the recorded frames.
    """
    value = quantity(certificate.get("peak_torque_nm"), "N·m", CERTIFICATE_DIGITS)
    source = str(certificate.get("torque_source") or "")
    if value is None:
        return label_of("peak_torque_nm"), None
    if source.startswith("simulation"):
        return label_of("peak_torque_nm"), f"{value} in the simulated motors"
    of = certificate.get("torque_frames"), certificate.get("frames")
    checked_frames = "but it is unknown how many frames were checked"
    if None not in of:
        checked_frames = f"checked at {of[0]} of {of[1]} frames"
    return "Largest torque found", f"{value}, {checked_frames}"


def linked(certificate: CertificateFigures) -> str | None:
    """Return the unchecked pairs of modules in words, and the relief that they need."""
    exempt = certificate.get("exempt_pairs")
    if exempt is None:
        return None
    if exempt["apart"] < 2:
        return "All modules are checked against each other, including linked ones."
    text = "Linked modules share a joint and are not checked against each other"
    if (radius := exempt["relief_radius"]) is None:
        return f"{text}."
    if (bound := exempt["worst_overlap_bound"]) is not None:
        overlap = math.ceil(bound * 100) / 100
        text += f", because full cubes would overlap by up to {spacings(overlap, 2)}"
    return (
        f"{text}. Round the edges of real modules near each joint: no material may be more than "
        f"{spacings(radius)} from the joint. This removes "
        f"{100 * exempt['relief_share']:.0f} % of a module's volume."
    )


def record(certificate: CertificateFigures, *, limit_rad: float | None = None) -> str | None:
    """Return the flaws of the record that the plan was made from; None without flaws."""
    flaws: list[str] = []
    clearance = certificate.get("min_clearance_record")
    if clearance is not None and clearance < -ROUNDING_PITCH:
        flaws.append(f"modules overlap by {spacings(-clearance, CERTIFICATE_DIGITS)}")
    bent = certificate.get("max_angle_record_rad")
    if bent is not None and limit_rad is not None and bent > limit_rad + 1e-6:
        flaws.append(
            f"a joint turns to {math.degrees(bent):.1f}°, beyond its limit of "
            f"±{math.degrees(limit_rad):.4g}°"
        )
    if not flaws:
        return None
    plan = " This does not happen in the plan." if certificate.get("verified") else ""
    return f"During unfolding, {' and '.join(flaws)}.{plan}"


def baseline(strategy: object) -> str | None:
    """Return the note for a plan of the baseline strategy; None for others."""
    return STRATEGY_LABELS[BASELINE].lower() if strategy == BASELINE else None


def _seen(certificate: CertificateFigures) -> float | None:
    clearances = [certificate.get(name) for name in ("min_clearance", "min_clearance_playback")]
    return min((float(value) for value in clearances if value is not None), default=None)


def _at_least(value: float | None) -> str | None:
    if value is None or value <= 0.0:
        return None
    return f"at least {rounded_down(100.0 * value, 1)} % of the spacing"


def rounded_down(value: float, digits: int = 3) -> str:
    """Return a length rounded down to some decimals; a smaller one to two significant digits."""
    if value == 0.0:
        return "0"
    if abs(value) < 10**-digits:
        digits = 1 - math.floor(math.log10(abs(value)))
    # A value such as 0.049 must keep its digits despite rounding errors.
    return f"{math.floor(value * 10**digits + 1e-9) / 10**digits:.{digits}f}"
