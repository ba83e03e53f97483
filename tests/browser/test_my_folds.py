"""My folds as an owner uses them: renaming, transfer to another browser, deletion, forgetting."""

import re

import pytest
from playwright.sync_api import Page, expect

from foldback.server.store.owner import new_token
from tests.browser.conftest import Visit
from tests.server.service_process import SNAKE, STAIRS, Service, bearer

HOSTILE = '<img src=x onerror="document.title=1">'


def key_of(page: Page) -> str:
    return page.evaluate("localStorage.getItem('foldback:token')")


def open_my_folds(visit: Visit, token: str, **options: object) -> Page:
    """Open My folds in a browser that has a key."""
    page = visit("/health", view=False, **options)
    page.evaluate("key => localStorage.setItem('foldback:token', key)", token)
    page.goto("/my-folds")
    return page


def test_rename_transfer_and_delete_in_my_folds(visit: Visit, service: Service) -> None:
    token = new_token()
    fold = service.fold(STAIRS, token=token)["id"]
    service.wait_over(fold)
    page = open_my_folds(visit, token)
    card = page.locator(f'#folds [data-id="{fold}"]')
    expect(card.locator(".card-status")).to_have_text(re.compile("^Verified"))
    expect(card.locator(".card-count")).to_have_text(re.compile("^8 cubes · just now"))

    card.get_by_role("button", name="Rename").click()
    page.keyboard.type(HOSTILE)
    page.keyboard.press("Enter")
    expect(card.locator("h3")).to_have_text(HOSTILE)
    expect(card.get_by_role("button", name="Rename")).to_be_focused()
    page.reload()
    expect(card.locator("h3")).to_have_text(HOSTILE)
    assert page.locator("img[src=x]").count() == 0 and page.title() == "My folds · foldback"

    assert key_of(page) not in page.content()
    page.get_by_role("button", name="Show the key").click()
    key = page.get_by_role("textbox", name="Your access key").input_value()
    assert key == key_of(page)

    other_page = open_my_folds(visit, new_token(), width=390, height=844)
    expect(other_page.get_by_text("Nothing here yet")).to_be_visible()
    refused = (("wrench", "This is not a key"), (new_token(), "Nothing was found for this key"))
    for text, words in refused:
        other_page.get_by_label("A key from another browser").fill(text)
        other_page.get_by_role("button", name="Add", exact=True).click()
        expect(other_page.locator("#key-message")).to_contain_text(words)
    other_page.get_by_label("A key from another browser").fill(f"  {key} ")
    other_page.get_by_role("button", name="Add", exact=True).click()
    expect(other_page.locator("#folds h3")).to_have_text([HOSTILE])
    assert key_of(other_page) != key  # the other browser keeps its own key
    assert key not in other_page.url and key not in other_page.content()

    moved = other_page.locator(f'#folds [data-id="{fold}"]')
    moved.get_by_role("button", name="Delete").click()
    expect(other_page.locator("#confirm-no")).to_be_focused()
    other_page.keyboard.press("Escape")
    expect(moved).to_be_visible()
    moved.get_by_role("button", name="Delete").click()
    other_page.locator("#confirm-yes").click()
    expect(moved).to_have_count(0)
    assert service.http.get(f"/api/folds/{fold}").status_code == 404
    page.reload()
    expect(page.get_by_text("Nothing here yet")).to_be_visible()


@pytest.mark.long
def test_my_folds_are_paged_and_all_deleted(visit: Visit, service: Service) -> None:
    token = new_token()
    # They are cancelled immediately, so that no worker computes them.
    for seed in range(26):
        fold = service.fold(SNAKE, seed=str(900 + seed), token=token)
        service.http.post(f"/api/folds/{fold['id']}/cancel", headers=bearer(token))
    page = open_my_folds(visit, token)
    expect(page.locator("#found")).to_have_text("24 of 26 folds")
    page.get_by_role("button", name="Show more").click()
    expect(page.locator("#found")).to_have_text("26 folds")
    expect(page.locator("#folds li:nth-child(25) h3 a")).to_be_focused()
    expect(page.locator("#more")).to_be_hidden()

    delete = page.locator("#folds li").first.get_by_role("button", name="Delete")
    delete.click()
    page.locator("#confirm-yes").click()
    expect(page.locator("#found")).to_have_text("25 folds")
    expect(page.locator("#folds li").first.locator("h3 a")).to_be_focused()

    page.get_by_role("button", name="Delete all").click()
    page.locator("#confirm-yes").click()
    expect(page.get_by_text("Nothing here yet")).to_be_visible()
    assert service.http.get("/api/mine/folds", headers=bearer(token)).json()["total"] == 0


def test_browser_is_forgotten_and_its_folds_stay(visit: Visit, service: Service) -> None:
    token = new_token()
    fold = service.fold(SNAKE, seed="950", token=token)
    page = open_my_folds(visit, token)
    expect(page.locator("#folds li")).to_have_count(1)
    page.get_by_role("button", name="Forget the keys").click()
    expect(page.locator("#confirm-text")).to_contain_text("stay until they expire")
    page.locator("#confirm-yes").click()
    expect(page.get_by_text("Nothing here yet")).to_be_visible()
    keys = page.evaluate("Object.keys(localStorage)")
    assert keys == ["foldback:toured"]  # set by the tests; it names no fold
    assert service.http.get(f"/folds/{fold['id']}").status_code == 200


@pytest.mark.long
def test_leaked_key_is_replaced(visit: Visit, service: Service) -> None:
    leaked = new_token()
    fold = service.fold(SNAKE, seed="951", token=leaked)["id"]
    page = open_my_folds(visit, leaked)
    expect(page.locator("#folds li")).to_have_count(1)
    # If no answer comes, both keys are stored until one of them is known to hold the folds.
    page.route("**/api/mine/key", lambda route: route.abort())
    page.get_by_role("button", name="New key").click()
    page.locator("#confirm-yes").click()
    expect(page.locator("#key-message")).to_contain_text("may still work")
    expect(page.locator("#keys li")).to_have_count(1)
    assert key_of(page) == leaked
    page.get_by_role("button", name="Remove").click()
    page.unroute("**/api/mine/key")

    page.get_by_role("button", name="New key").click()
    page.locator("#confirm-yes").click()
    page.wait_for_function("old => localStorage.getItem('foldback:token') !== old", arg=leaked)
    expect(page.locator("#folds li")).to_have_count(1)
    expect(page.locator("#keys li")).to_have_count(0)
    key = key_of(page)
    assert key != leaked
    assert page.evaluate(f"localStorage.getItem('foldback:owner:{fold}')") == key
    listed = [
        service.http.get("/api/mine/folds", headers=bearer(token)).json()["total"]
        for token in (leaked, key)
    ]
    assert listed == [0, 1]
