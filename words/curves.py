"""Curves: the labels of figures that a page plots over the frames."""

from __future__ import annotations

from typing import Final

from foldback.words.certificate import label_of

CURVE_LABELS: Final = {
    "max_error_rad": label_of("max_angle_error_rad"),
    "min_clearance": "Smallest clearance",
    "hinges_moving": "Hinges moving",
    "peak_torque_nm": "Largest torque",
    "table_torque": "Largest torque on the table",
}
"""Labels of the curves of ``web.timeline.figures``."""
EXTREMES: Final = ("max_error_rad", "min_clearance", "peak_torque_nm")
"""Curves to whose worst frame visitors can jump; on a table, the torque is that on the table."""
