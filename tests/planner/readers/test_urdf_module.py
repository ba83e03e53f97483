"""Modules from URDF: two links and a joint, and files of strangers."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest
import trimesh

from foldback.planner.chain.module_checks import check_module
from foldback.planner.chain.module_file import read_module
from foldback.planner.errors import InputError
from foldback.planner.readers.urdf_module import MAX_ELEMENTS, MAX_URDF_BYTES, read_urdf

BOX = '<collision><origin xyz="{x} 0 0"/><geometry>{geometry}</geometry></collision>'
SIDE = '<box size="0.02 0.016 0.016"/>'
LIMIT = '<limit lower="-1.2" upper="1.5" effort="1.5" velocity="4"/>'


def urdf(
    *,
    first: str = SIDE,
    second: str = SIDE,
    joint: str = "revolute",
    axis: str = "0 0 1",
    limit: str = LIMIT,
    more: str = "",
) -> bytes:
    """Return a robot of two slabs with a joint between them; lengths in metres."""
    mass = '<inertial><mass value="0.05"/></inertial>'
    return (
        f'<?xml version="1.0"?><robot name="Two Slabs">'
        f'<link name="a">{mass}{BOX.format(x=0, geometry=first)}</link>'
        f'<link name="b">{mass}{BOX.format(x=0.02, geometry=second)}</link>'
        f'<joint name="j" type="{joint}"><origin xyz="0.02 0 0" rpy="0 0 0"/>'
        f'<parent link="a"/><child link="b"/><axis xyz="{axis}"/>{limit}</joint>{more}</robot>'
    ).encode()


def module_of(data: bytes, meshes: dict[str, bytes] | None = None) -> Any:
    """Return the module, without faults."""
    module = read_module(read_urdf(data, meshes))
    check_module(module)
    return module


def stl_of(*boxes: tuple[float, float, float]) -> bytes:
    """Return an STL file of boxes about the origin."""
    mesh: Any = trimesh.util.concatenate([trimesh.creation.box(sides) for sides in boxes])
    return mesh.export(file_type="stl")


def test_two_links_and_a_joint_become_a_module() -> None:
    module = module_of(urdf())
    # From the front of the first slab to the end of the second: 60 mm.
    assert (module.name, module.pitch_m) == ("two-slabs", 0.06)
    assert (module.mass_kg, module.torque_nm, module.speed_rad_s) == (0.1, 1.5, 4.0)
    np.testing.assert_allclose(module.ranges_rad, [[[-1.2, 1.5]]])
    (piece,) = module.pieces
    assert len(piece.parts) == 2
    np.testing.assert_allclose(piece.volume, 2 * 0.02 * 0.016 * 0.016 / 0.06**3)
    np.testing.assert_allclose(np.abs(piece.axes @ np.array([0, 0, 1])), [1.0])


def test_continuous_joint_along_the_chain_is_a_twist() -> None:
    module = module_of(urdf(joint="continuous", axis="1 0 0", limit=""))
    assert module.pieces[0].joint_kind == "twist"
    assert np.isinf(module.ranges_rad).all()
    assert module.torque_nm is None


def test_convex_mesh_is_read_from_given_files_only(tmp_path: Path) -> None:
    stl = stl_of((20.0, 16.0, 16.0))
    (tmp_path / "side.stl").write_bytes(stl)
    named = f'<mesh filename="file://{tmp_path}/side.stl" scale="0.001 0.001 0.001"/>'
    module = module_of(urdf(first=named), {"side.stl": stl})
    np.testing.assert_allclose(module.volume, module_of(urdf()).volume, rtol=1e-6)
    with pytest.raises(InputError, match="'side.stl', which is not among the given files"):
        read_urdf(urdf(first=named))
    with pytest.raises(InputError, match="'passwd', which is not among"):
        read_urdf(urdf(first='<mesh filename="../../../etc/passwd"/>'))


def test_hollow_mesh_is_refused() -> None:
    bent = stl_of((20, 4, 4), (4, 20, 4))
    named = '<mesh filename="bent.stl"/>'
    with pytest.raises(InputError, match="of its convex hull, expected a convex body"):
        read_urdf(urdf(second=named), {"bent.stl": bent})


ENTITY = b'<!DOCTYPE r [<!ENTITY a "aaaaaaaaaa"><!ENTITY b "&a;&a;&a;&a;&a;&a;&a;&a;">]>'
EXTERNAL = b'<!DOCTYPE r SYSTEM "file:///etc/passwd">'


@pytest.mark.parametrize(
    ("data", "message"),
    [
        (ENTITY + b"<robot name='&b;'/>", "document type, which no URDF file needs"),
        (EXTERNAL + b"<robot/>", "document type"),
        (b"<robot>" + b"<a>" * 1000, "nested more than"),
        (b"<robot>" + b"<a/>" * (MAX_ELEMENTS + 1) + b"</robot>", f"more than {MAX_ELEMENTS}"),
        (b"<robot>" + b" " * MAX_URDF_BYTES + b"</robot>", "at most 1 MB"),
        (b"<robot name='a'", "not valid XML"),
        (b"<sdf/>", "expected <robot>"),
        (urdf(more="<link name='c'/>"), "3 links and 1 joints, expected two links"),
        (urdf(more="<xacro:property xmlns:xacro='x'/>"), "run xacro first"),
        (urdf(joint="prismatic"), "'prismatic', expected 'revolute' or 'continuous'"),
        (urdf(limit=""), "no limit"),
        (urdf(axis="0 0 0"), "axis of length 0"),
        (urdf(axis="0 0"), "expected 3 numbers"),
        (urdf(axis="0 0 1e99"), "expected 3 numbers up to 1000"),
        (urdf(first='<sphere radius="1"/>'), "<sphere>, expected <box>"),
        (urdf(first='<box size="1 1 x"/>'), "where a number is needed"),
        (
            urdf().replace(b'child link="b"', b'child link="z"'),
            "child link 'z', expected one of: a, b",
        ),
        (
            urdf()
            .replace(b"<collision>", b"<ignored>", 1)
            .replace(b"</collision>", b"</ignored>", 1),
            "without a collision body",
        ),
    ],
)
def test_bad_and_hostile_files_are_refused(data: bytes, message: str) -> None:
    with pytest.raises(InputError, match=message):
        read_urdf(data)


def test_hinge_that_collides_is_a_fault_of_the_module() -> None:
    with pytest.raises(InputError, match="collide at"):
        module_of(urdf(limit='<limit lower="-3" upper="3" effort="1" velocity="1"/>'))
