from __future__ import annotations

import json

import numpy as np

from bench.tables import Section


def test_a_section_is_plain_json_whatever_was_compared() -> None:
    section = Section(name="some")
    section.add("fast enough", "1 s", "< 2 s", bool(np.float64(1.0) < 2.0))
    section.add("also", "1 s", "< 2 s", np.float64(1.0) < 2.0)  # pyright: ignore
    section.add("reported", "1 s")
    found = json.loads(json.dumps(section.as_dict()))
    assert [figure["met"] for figure in found["figures"]] == [True, True, None]
