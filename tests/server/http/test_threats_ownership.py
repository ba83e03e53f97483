"""Attacks on the ownership of a fold: by its link, by the same file, by the same shape."""

from foldback.server.store.owner import new_token
from tests.server.service_process import SNAKE, FinishedFold, Service, bearer, owner, path_file


def changes(idle: Service, fold_id: str, token: str) -> list[int]:
    """Return the status codes of a cancellation and of a deletion."""
    path, headers = f"/api/folds/{fold_id}", bearer(token)
    cancelled = idle.http.post(f"{path}/cancel", headers=headers)
    return [cancelled.status_code, idle.http.delete(path, headers=headers).status_code]


def test_link_to_a_fold_gives_no_ownership(idle: Service) -> None:
    my_fold, stranger = idle.fold(SNAKE, seed="101"), new_token()
    other_fold = idle.fold(fold=my_fold["id"], seed="101", token=stranger)
    assert (other_fold["id"], other_fold["existing"], other_fold["owner_token"]) == (
        my_fold["id"],
        True,
        None,
    )
    # Other options create a new fold; a stranger's request does not retain mine.
    other_fold = idle.fold(fold=my_fold["id"], seed="102", token=stranger)
    assert (other_fold["existing"], other_fold["owner_token"]) == (False, stranger)
    assert other_fold["id"] != my_fold["id"]
    assert changes(idle, my_fold["id"], my_fold["owner_token"]) == [202, 204]


def test_folds_made_by_strangers_from_one_fold_are_separate(finished: FinishedFold) -> None:
    for use, cells in (("smooth", None), ("refold", SNAKE[::-1])):
        smooth_form = {use: finished.id, "seed": "103"}
        folds = [finished.service.fold(cells, **smooth_form, token=new_token()) for _ in range(2)]
        for fold in folds:
            finished.http.delete(f"/api/folds/{fold['id']}", headers=owner(fold))
        assert [fold["existing"] for fold in folds] == [False, False]
        assert folds[0]["id"] != folds[1]["id"]


def test_same_file_of_another_visitor_reveals_nothing(idle: Service) -> None:
    data, me, stranger = path_file([[101, i, 0] for i in range(5)]), new_token(), new_token()
    my_upload = idle.upload("secret.json", data, token=me).json()
    for token in (stranger, None):
        their_upload = idle.upload("guess.json", data, token=token).json()
        assert their_upload["existing"] is False
        assert their_upload["id"] != my_upload["id"]
        assert their_upload["owner_token"] and (
            token is None or their_upload["owner_token"] == token
        )
        assert (idle.directory(their_upload["id"]) / "request.json").read_text().count(
            "secret"
        ) == 0
        assert changes(idle, their_upload["id"], their_upload["owner_token"]) == [202, 204]
    repeated_upload = idle.upload("again.json", data, token=me).json()
    other_fold = idle.fold(fold=my_upload["id"], module_size="0.9", token=me)
    assert other_fold["id"] != my_upload["id"]  # with other options
    assert (repeated_upload["id"], repeated_upload["existing"], repeated_upload["owner_token"]) == (
        my_upload["id"],
        True,
        me,
    )
    assert changes(idle, my_upload["id"], me) == [202, 204]


def test_gallery_fold_does_not_publish_an_equal_upload(idle: Service) -> None:
    my_upload = idle.upload("mine.json", idle.http.get("/api/shapes/mallet-24.json").content).json()
    gallery = idle.fold(shape="mallet-24")
    assert gallery["id"] != my_upload["id"]
    listed = {fold["id"] for fold in idle.http.get("/api/folds").json()["folds"]}
    assert gallery["id"] in listed and my_upload["id"] not in listed
    assert idle.state(my_upload["id"])["shape"] is None
    repeated_fold = idle.fold(shape="mallet-24")
    assert (repeated_fold["id"], repeated_fold["existing"], repeated_fold["owner_token"]) == (
        gallery["id"],
        True,
        None,
    )


def test_cancelled_folds_are_not_listed(idle: Service) -> None:
    fold = idle.fold(shape="hammer")
    cancelled = idle.http.post(f"/api/folds/{fold['id']}/cancel", headers=owner(fold))
    assert cancelled.json()["status"] == "cancelled"
    for page in ("/", "/gallery", "/api/folds"):
        assert fold["id"] not in idle.http.get(page).text
