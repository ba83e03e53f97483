"""Page of licences: every package of an installation, in its tested version."""

from packaging.utils import canonicalize_name

from docs.make_licences import PAGE, ROOT, installed, rows


def test_licences_page_lists_every_installed_package_in_its_tested_version() -> None:
    lines = (ROOT / "constraints.txt").read_text().splitlines()
    tested = {
        canonicalize_name(line.split("==")[0]): line.split("==")[1]
        for line in lines
        if "==" in line
    }
    cells = [row.split(" | ") for row in PAGE.read_text().splitlines() if row.startswith("| ")][1:]
    listed = {row[0].removeprefix("| "): row[1] for row in cells}
    assert listed == {name: tested[name] for name in listed}
    assert set(installed("foldback")) - {"foldback"} <= set(listed)


def test_licences_of_all_installed_packages_are_stated() -> None:
    assert all(len(row.split(" | ")[2]) > 1 for row in rows())
