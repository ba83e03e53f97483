"""Access rights: a table of actions, things and actors, with the status of each answer."""

from collections.abc import Callable, Iterator
from functools import partial

import pytest

from tests.server.api.owned_things import ACTORS, MOVIE_ID, TOUR, VALUES, Thing
from tests.server.rows import store_of
from tests.server.service_thread import ServiceThread

MATRIX = """
action        thing                         none     short    stranger asker    owner    heir
list-all      queued                        no       no       no       no       yes      no
list-all      verified+handed               no       no       no       no       no       yes
list-all      gallery+shared                yes      yes      yes      yes      yes      yes
cancel        queued                        401      401      403      403      202      403
cancel        queued+shared                 401      401      403      403      202      403
cancel        queued+handed                 401      401      403      403      403      202
cancel        queued+rekeyed                401      401      403      403      403      202
cancel        running                       401      401      403      403      202      403
cancel        verified                      401      401      403      403      202=     403
cancel        gallery                       401      401      403      403      202      403
cancel        gallery+shared                401      401      403      403      403      403
cancel        queued+deleted                404      404      404      404      404      404
rename        verified                      401      401      403      403      200      403
rename        verified+handed               401      401      403      403      403      200
rename        verified+rekeyed              401      401      403      403      403      200
rename        gallery                       401      401      403p     403p     403p     403p
rename        verified+deleted              404      404      404      404      404      404
ask-name      verified                      401      401      403      403      200=     403
hand-over     verified                      401      401      403      403      200      403
hand-over     verified+handed               401      401      403      403      403      200
hand-over     gallery                       401      401      403p     403p     403p     403p
hand-over     verified+deleted              404      404      404      404      404      404
delete        queued                        401      401      403      403      204      403
delete        running                       401      401      403      403      204      403
delete        verified+shared               401      401      403      403      204      403
delete        verified+handed               401      401      403      403      403      204
delete        verified+rekeyed              401      401      403      403      403      204
delete        gallery                       401      401      403p     403p     403p     403p
delete        verified+deleted              404      404      404      404      404      404
tour          verified+frames               401      401      403      403      200      403
tour          verified+frames+handed        401      401      403      403      403      200
tour          verified                      401      401      403      403      404      403
tour          gallery                       401      401      403p     403p     403p     403p
tour          verified+deleted              404      404      404      404      404      404
del-tour      verified+tour                 401      401      403      403      204      403
del-tour      verified                      401      401      403      403      204=     403
del-tour      gallery                       401      401      403p     403p     403p     403p
del-tour      verified+deleted              404      404      404      404      404      404
values        verified+frames               401      401      403      403      200      403
values        gallery                       401      401      403p     403p     403p     403p
del-values    verified+values               401      401      403      403      204      403
del-values    gallery                       401      401      403p     403p     403p     403p
del-movie     verified+movie                403      403      403      403      204      403
del-movie     verified+movie+handed         403      403      403      403      204      204
del-movie     verified+movie+rekeyed        403      403      403      403      403      204
del-movie     verified+asked-movie          403      403      403      204      204      403
del-movie     verified+asked-movie+handed   403      403      403      204      403      204
del-movie     verified+taken-movie          403      403      403      403      204      403
del-movie     verified+taken-movie+handed   403      403      403      403      403      204
del-movie     gallery+movie                 403      403      403      403      204      403
del-movie     gallery+asked-movie           403      403      403      204      403      403
del-movie     verified                      404      404      404      404      404      404
del-preview   verified+preview              401      401      403      403      204      403
del-preview   verified+preview+handed       401      401      403      403      204      403
del-preview   verified+preview+rekeyed      401      401      403      403      403      204
del-preview   verified                      401      401      403      403      403      403
list-folds    queued                        401      401      no       no       yes      no
list-folds    verified+handed               401      401      no       no       no       yes
list-folds    verified+rekeyed              401      401      no       no       no       yes
list-folds    gallery+shared                401      401      no       no       yes      no
list-folds    verified+deleted              401      401      no       no       no       no
list-movies   verified+movie                401      401      no       no       yes      no
list-movies   verified+movie+handed         401      401      no       no       yes      yes
list-movies   verified+movie+rekeyed        401      401      no       no       no       yes
list-movies   verified+asked-movie          401      401      no       yes      no       no
list-movies   verified+taken-movie+handed   401      401      no       no       no       yes
list-movies   gallery+asked-movie           401      401      no       yes      no       no
list-previews verified+preview              401      401      no       no       yes      no
list-previews verified+preview+rekeyed      401      401      no       no       no       yes
"""
"""Row: an action and its thing (see ``owned_things.py``). Column: an actor. Cell: status of the
answer; 401 has the code ``no-owner-token``, 403 ``not-owner``, 403p ``public``, 404 ``no-such-…``.
After a status with = nothing has changed, although the answer is no refusal. Lists: ``yes`` if they
contain the thing."""

ACTIONS: dict[str, tuple[str, str, object]] = {
    "list-all": ("GET", "/api/folds", None),
    "cancel": ("POST", "/api/folds/{id}/cancel", None),
    "rename": ("PATCH", "/api/folds/{id}", {"name": "Mine"}),
    "ask-name": ("PATCH", "/api/folds/{id}", {}),
    "hand-over": ("PATCH", "/api/folds/{id}", {"owner_token": "t" * 24}),
    "delete": ("DELETE", "/api/folds/{id}", None),
    "tour": ("PUT", "/api/folds/{id}/tour", TOUR),
    "del-tour": ("DELETE", "/api/folds/{id}/tour", None),
    "values": ("PUT", "/api/folds/{id}/values", VALUES),
    "del-values": ("DELETE", "/api/folds/{id}/values", None),
    "del-movie": ("DELETE", f"/api/folds/{{id}}/movies/{MOVIE_ID}", None),
    "del-preview": ("DELETE", "/api/mine/previews/{id}", None),
    "list-folds": ("GET", "/api/mine/folds", None),
    "list-movies": ("GET", "/api/mine/movies", None),
    "list-previews": ("GET", "/api/mine/previews", None),
}
"""Method, path and body of each action's request."""
CODES = {
    (401, "no-owner-token"): "401",
    (403, "not-owner"): "403",
    (403, "public"): "403p",
    (404, "no-such-fold"): "404",
    (404, "no-such-movie"): "404",
    (404, "no-such-artifact"): "404",
}


@pytest.fixture(scope="module")
def make(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Callable[[str], Thing]]:
    """Function that creates a thing from its words."""
    place = tmp_path_factory.mktemp("access-rights") / "data"
    with ServiceThread(place).start() as service, store_of(service) as store:
        yield partial(Thing, service, store)


def cells(make: Callable[[str], Thing], action: str, words: str) -> Iterator[str]:
    """Yield the outcome of an action for each actor; things that have changed are replaced."""
    method, path, body = ACTIONS[action]
    thing = make(words)
    before = thing.state()
    for actor in ACTORS:
        answer = thing.ask(actor, method, path.format(id=thing.fold_id), body)
        changed = thing.state() != before
        if answer.status_code >= 400:
            assert not changed
            code = answer.json()["code"]
            yield CODES.get((answer.status_code, code), f"{answer.status_code} {code}")
        elif action.startswith("list-"):
            yield "yes" if thing.fold_id in answer.text else "no"
        else:
            yield f"{answer.status_code}{'' if changed else '='}"
        if changed:
            thing = make(words)
            before = thing.state()


@pytest.mark.parametrize("action", ACTIONS)
def test_actions_of_clients_have_the_outcomes_of_the_table(
    make: Callable[[str], Thing], action: str
) -> None:
    header, *rows = MATRIX.strip("\n").split("\n")
    assert header.split() == ["action", "thing", *ACTORS]
    expected = [row for row in rows if row.startswith(f"{action} ")]
    assert expected
    for row in expected:
        words = row.split()[1]
        outcomes = "".join(f"{cell:9}" for cell in cells(make, action, words))
        assert f"{action:14}{words:30}{outcomes}".rstrip() == row
