from foldback.words.likeness import likeness_words, percent, reach_words


def test_likeness_names_what_is_missing_and_what_is_added() -> None:
    assert likeness_words({"iou": 0.71, "missing": 0.123, "added": 0.2}) == (
        "71 % like the model (overlap of both, divided by what either covers); "
        "12 % of the model is missing, 20 % of the modules' volume is outside of it"
    )
    assert likeness_words({"iou": 1.0, "missing": 0.0, "added": 0.0}) == (
        "100 % like the model (overlap of both, divided by what either covers)"
    )
    assert likeness_words(None) is None


def test_shares_are_rounded_but_never_to_all_or_nothing() -> None:
    shares = (0.0, 0.004, 0.126, 0.996, 1.0)
    assert [*map(percent, shares)] == ["0 %", "less than 1 %", "13 %", "99 %", "100 %"]


def test_reach_says_when_no_number_of_modules_is_enough() -> None:
    reach = [{"likeness": 0.6, "modules": 220}, {"likeness": 0.9, "modules": None}]
    assert reach_words(reach, 20_000) == "about 220 for 60 %, more than 20000 for 90 %"
