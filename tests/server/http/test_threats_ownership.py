"""Attacks on the ownership of a fold: by its link, by the same file, by the same shape."""

from foldback.server.store.owner import new_token
from tests.server.service_process import SNAKE, FinishedFold, Service, bearer, owner, path_file


def changes(idle: Service, fold_id: str, token: str) -> list[int]:
    """Return the status codes of a cancellation and of a deletion."""
    path, headers = f"/api/folds/{fold_id}", bearer(token)
    cancelled = idle.http.post(f"{path}/cancel", headers=headers)
    return [cancelled.status_code, idle.http.delete(path, headers=headers).status_code]


def test_link_to_a_fold_gives_no_ownership(idle: Service) -> None:
    mine, stranger = idle.fold(SNAKE, seed="101"), new_token()
    other = idle.fold(fold=mine["id"], seed="101", token=stranger)
    assert (other["id"], other["existing"], other["owner_token"]) == (mine["id"], True, None)
    # Other options create a new fold; a stranger's request does not retain mine.
    other = idle.fold(fold=mine["id"], seed="102", token=stranger)
    assert (other["existing"], other["owner_token"]) == (False, stranger)
    assert other["id"] != mine["id"]
    assert changes(idle, mine["id"], mine["owner_token"]) == [202, 204]


def test_folds_made_by_strangers_from_one_fold_are_separate(finished: FinishedFold) -> None:
    for use, cells in (("smooth", None), ("refold", SNAKE[::-1])):
        wanted = {use: finished.id, "seed": "103"}
        folds = [finished.service.fold(cells, **wanted, token=new_token()) for _ in range(2)]
        for fold in folds:
            finished.http.delete(f"/api/folds/{fold['id']}", headers=owner(fold))
        assert [fold["existing"] for fold in folds] == [False, False]
        assert folds[0]["id"] != folds[1]["id"]


def test_same_file_of_another_visitor_reveals_nothing(idle: Service) -> None:
    data, me, stranger = path_file([[101, i, 0] for i in range(5)]), new_token(), new_token()
    mine = idle.upload("secret.json", data, token=me).json()
    for token in (stranger, None):
        theirs = idle.upload("guess.json", data, token=token).json()
        assert theirs["existing"] is False
        assert theirs["id"] != mine["id"]
        assert theirs["owner_token"] and (token is None or theirs["owner_token"] == token)
        assert (idle.directory(theirs["id"]) / "request.json").read_text().count("secret") == 0
        assert changes(idle, theirs["id"], theirs["owner_token"]) == [202, 204]
    again = idle.upload("again.json", data, token=me).json()
    other = idle.fold(fold=mine["id"], module_size="0.9", token=me)
    assert other["id"] != mine["id"]  # with other options
    assert (again["id"], again["existing"], again["owner_token"]) == (mine["id"], True, me)
    assert changes(idle, mine["id"], me) == [202, 204]


def test_gallery_fold_does_not_publish_an_equal_upload(idle: Service) -> None:
    mine = idle.upload("mine.json", idle.http.get("/api/shapes/mallet-24.json").content).json()
    gallery = idle.fold(shape="mallet-24")
    assert gallery["id"] != mine["id"]
    listed = {fold["id"] for fold in idle.http.get("/api/folds").json()["folds"]}
    assert gallery["id"] in listed and mine["id"] not in listed
    assert idle.state(mine["id"])["shape"] is None
    again = idle.fold(shape="mallet-24")
    assert (again["id"], again["existing"], again["owner_token"]) == (gallery["id"], True, None)


def test_cancelled_folds_are_not_listed(idle: Service) -> None:
    fold = idle.fold(shape="hammer")
    cancelled = idle.http.post(f"/api/folds/{fold['id']}/cancel", headers=owner(fold))
    assert cancelled.json()["status"] == "cancelled"
    for page in ("/", "/gallery", "/api/folds"):
        assert fold["id"] not in idle.http.get(page).text
