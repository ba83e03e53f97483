"""Error messages: texts that pages show to people, and details for programs."""

from foldback.planner.errors import InputError
from foldback.planner.readers.formats import READABLE_FORMATS
from foldback.server.errors import Unusable
from foldback.server.http.problems import Problem
from foldback.words.certificate import headline
from foldback.words.messages import message_for_people, verdict_for_people

MESSAGES = {
    "got 0 angles, expected at least 1.": "Type at least one 0 (straight), + or − (bent).",
    "got a after 0 angles, expected 0, + or - for each hinge.": (
        '"a" isn\'t an angle. Use 0 (straight), + or − (bent) for each hinge.'
    ),
    "this looks like a PDF document, expected a mesh (STL, OBJ) or cells.": (
        "This looks like a PDF document. Please use a mesh (STL, OBJ) or cells."
    ),
    f"this looks like a PDF document, expected {READABLE_FORMATS}.": (
        "This looks like a PDF document. Please use a mesh (STL, OBJ, PLY, OFF, GLB or 3MF), "
        "a voxel model, a path or a chain."
    ),
    "got a mesh without triangles, expected a closed surface.": (
        "This mesh has no triangles. Save it again as a closed surface."
    ),
    "got 600 modules, expected at most 512; use a coarser shape.": (
        "Expected at most 512, but found 600 modules. Use a coarser shape."
    ),
    "Not Found": "There is nothing at this address.",
    "The database does not answer.": "The database does not answer.",
}
VERDICTS = {
    "rests on a table within 3.2 w·p in frame 4 (friction 0.2, free base)": (
        "stays on the table; its hinges need at most 3.2 w·p in frame 5 (with friction μ = 0.2 and "
        "no clamped module)"
    ),
    "rests on a table within 3.2 w·p in frame 4 (without friction)": (
        "stays on the table; its hinges need at most 3.2 w·p in frame 5 (without friction)"
    ),
    "failed: the playback missed: the chain ended 1 pitches (RMS) from its target.": (
        "failed: the modules ended one spacing from their targets on average (root mean square)."
    ),
    "failed: the explosion stalled: modules 1 and 2 block each other": (
        "failed: modules 2 and 3 block each other"
    ),
    "failed: the chain floats and does not rest on a table; laid down in each frame, it needs "
    "2 w·p": (
        "failed: the chain floats, so a table does not support it. "
        "If the chain rested on a table in each frame, the largest torque of a hinge would be 2 w·p"
    ),
    "failed: the chain needs 3.2 w·p in frame 4 (without friction), expected at most 2 w·p": (
        "failed: a hinge needs a torque of 3.2 w·p in frame 5 (without friction), but the limit is "
        "2 w·p"
    ),
    "the chain is knotted (determinant 3): drawn as it stalled, with its ends extended outwards, "
    "it has 3 crossings": (
        "the chain is knotted (the knot's determinant is 3; that of a chain without a knot is 1): "
        "a drawing of the stalled chain, with both ends extended outwards, has 3 crossings"
    ),
    "the chain is knotted (determinant 1): drawn as it stalled, with its ends extended outwards, "
    "it has 11 crossings": (
        "the chain is knotted: a drawing of the stalled chain, with both ends extended outwards, "
        "has 11 crossings"
    ),
    "1\u00a0000 random pushes in a row, the limit, made no progress; 2 hinges were still bent": (
        "the limit of 1\u00a0000 random pushes in a row without progress was reached; "
        "2 hinges were still bent"
    ),
    "the torque limit was exceeded 41 times; 40 times are allowed": (
        "the torque limit was exceeded 41 times, but only 40 times are allowed"
    ),
    "failed: modules sink 0.1 pitch into the table in frame 3, expected at most 0.02": (
        "failed: modules sink 10 % of the spacing into the table in frame 4, but at most 2 % of "
        "the spacing is allowed"
    ),
    "the 4 hinges bent by more than 6° at modules 1, 2 and 3 more cannot straighten, each by "
    "itself: module 1 against 9, module 2 against 8, and 1 pairs more; modules 5 to 7, which come "
    "next, cannot move in any of the six directions: module 5 against 2": (
        "none of the 4 hinges bent by more than 6° (at modules 2, 3 and 3 more) can straighten by "
        "itself, because modules would overlap: modules 2 and 10, modules 3 and 9, and 1 more "
        "pair; the part that would unfold next (modules 6 to 8) cannot move in any of the six "
        "directions, because modules would overlap: modules 6 and 3"
    ),
    "the hinge at module 4 cannot straighten: module 4 against 9": (
        "the hinge at module 5 cannot straighten, because modules would overlap: modules 5 and 10"
    ),
    "failed: in the plan, modules 82 and 112 touch (frame 1413.5 of the plan)": (
        "failed: in the plan, modules 83 and 113 touch (frame 1415 of the plan)"
    ),
    "failed: the plan does not start folded as hairpin": (
        "failed: the plan does not start in the folded shape of hairpin"
    ),
    "failed: the playback passes 0.2 pitch (RMS) from straight": (
        "failed: at the straight shape, the modules are 20 % of the spacing on average (root mean "
        "square) from their places"
    ),
    "failed: the plan has numbers that are not finite": (
        "failed: the plan contains infinite or undefined numbers"
    ),
    "failed: in the plan, the clearance between two frames could not be bounded": (
        "failed: in the plan, it could not be proved that the modules stay apart between one frame "
        "and the next"
    ),
    "failed: the frames have no plan": "failed: there is no plan for these frames",
    "failed: modules 2 and 9 overlap by 1.03 pitch at module size 0.95": (
        "failed: modules 3 and 10 overlap by 1.03 times the spacing at module size 0.95"
    ),
    "failed: modules 2 and 9 overlap by 1 pitch, 5e-05 pitch before that": (
        "failed: modules 3 and 10 overlap by one spacing, 0.005 % of the spacing before that"
    ),
    "failed: the playback missed: a robot lost its target: joint_4 is off by 0.3 rad, more than "
    "its motor can correct, 40 % into the fold.": (
        "failed: a robot could not follow the motion: after 40 % of the motion, the angle of "
        "joint_4 was off by 0.3 rad, more than its motor could correct."
    ),
    "failed: the playback missed: joint_4 yielded: it is off by 0.3 rad with motors of 8 w·p, "
    "40 % into the fold.": (
        "failed: the motor of joint_4 is too weak: it supplies at most 8 w·p (module weight × "
        "spacing). After 40 % of the motion, the angle of this joint was off by 0.3 rad."
    ),
    "failed: the explosion stalled: ": "failed: the explosion stalled: ",
    "verified (simulated)": "verified (simulated)",
}


def test_message_for_people_reads_as_sentences() -> None:
    for detail, message in MESSAGES.items():
        assert message_for_people(detail) == message


def test_stored_verdicts_read_as_sentences() -> None:
    for verdict, words in VERDICTS.items():
        assert verdict_for_people(verdict) == words
    assert headline({"verdict": "failed: the playback timeout: it is late"}) == "failed: it is late"


def test_problem_body_has_a_message_beside_the_detail() -> None:
    error = Unusable.of(InputError("empty", "got an empty file, expected a mesh."))
    body = Problem.of(error).body()
    assert body["detail"] == "got an empty file, expected a mesh."
    assert body["message"] == "This file is empty."
