"""Descriptions of a certificate's figures."""

from dataclasses import fields

from docs import make_figures
from foldback.planner.certificate.certificate import Certificate
from foldback.planner.certificate.figures import figures_of_certificates
from foldback.words import certificate as words


def test_each_figure_has_one_description_and_docs_list_it() -> None:
    figures = figures_of_certificates()
    assert set(figures) == {field.name for field in fields(Certificate)} | {"verified", "verdict"}
    labels = [figure.label for figure in figures.values()]
    assert len(set(labels)) == len(labels)
    for name, figure in figures.items():
        assert figure.help.endswith("."), name
        assert figure.unit or not name.endswith(("_rad", "_nm", "_s")), name
    page = make_figures.PAGE.read_text(encoding="utf-8")
    assert make_figures.page(page) == page


def test_pages_show_labels_of_the_descriptions() -> None:
    rows = dict(words.rows({"simulated": True, "module_size": 0.95, "frames": 3}))
    labels = {figure.label for figure in figures_of_certificates().values()}
    # A torque that is not that of the motors is no peak.
    assert set(rows) - labels == set()
    assert rows["Module size in the clearance check"] == "95 % of the spacing"
