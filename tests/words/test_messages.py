"""Messages for people, which pages show of an error, and details for programs."""

from planner.errors import InputError
from server.errors import Unusable
from server.http.problems import Problem
from words.messages import message_for_people

MESSAGES = {
    "got 0 angles, expected a positive multiple of 1, one for each hinge.": (
        "Type at least one angle: 0, + or −."
    ),
    "got a after 0 angles, expected 0, + or - for each hinge.": (
        '"a" isn\'t an angle. Use 0, + or − for each hinge.'
    ),
    "this looks like a PDF document, expected a mesh (STL, OBJ) or cells.": (
        "This looks like a PDF document. Please use a mesh (STL, OBJ) or cells."
    ),
    "got 600 modules, expected at most 512; use a coarser shape.": (
        "Expected at most 512, but found 600 modules. Use a coarser shape."
    ),
    "The database does not answer.": "The database does not answer.",
}


def test_message_for_people_reads_as_sentences() -> None:
    for detail, message in MESSAGES.items():
        assert message_for_people(detail) == message


def test_problem_body_has_a_message_beside_the_detail() -> None:
    error = Unusable.of(InputError("empty", "got an empty file, expected a mesh."))
    body = Problem.of(error).body()
    assert body["detail"] == "got an empty file, expected a mesh."
    assert body["message"] == "This file is empty."
