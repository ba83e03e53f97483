// Access keys: show, copy and renew the key of this
// browser, and add or remove keys of other browsers.
import {
  MOST_KEYS,
  Refusal,
  ask,
  bring,
  broughtKeys,
  dropKey,
  forgetKeys,
  isKey,
  keysHere,
  newKey,
  ownKey,
  replaceOwn,
  useKey,
} from "../lib/api.js";
import { deleteMade } from "../lib/owned_items.js";
import { button, copyText, element, get, toast, wordsOf } from "../lib/text.js";
import { confirmed } from "./dialogs.js";

const SHOWN = 6;
const LISTS = ["folds?limit=1", "previews", "movies"];

export class KeyPanel {
  /** @param {() => Promise<void>} changed */
  constructor(changed) {
    this.changed = changed;
    get("key-show").onclick = () => this.show(Boolean(get("key-shown").hidden));
    get("key-copy").onclick = () =>
      copyText(
        get("key").value,
        () => toast("Key copied"),
        () => get("key").select(),
      );
    get("key-form").onsubmit = (event) => {
      event.preventDefault();
      this.add(get("key-paste").value.trim());
    };
    get("key-new").onclick = () => this.renew();
    get("delete-all").onclick = () => this.deleteAll();
    get("forget").onclick = () => this.forget();
    this.list();
  }

  // Show or hide the key; the page contains it only while it is visible.
  /** @param {boolean} on */
  show(on) {
    const key = on ? ownKey() : "";
    if (key === null) {
      this.say("This browser does not store data for this site, so it has no key.");
      return;
    }
    get("key-shown").hidden = !on;
    get("key-show").textContent = on ? "Hide the key" : "Show the key";
    get("key-show").setAttribute("aria-expanded", String(on));
    get("key").value = key;
    if (on) get("key").select();
  }

  /** @param {string} text */
  say(text) {
    get("key-message").textContent = text;
  }

  // Add a key of another browser. Nothing of this browser is shared with other holders of the key.
  /** @param {string} key */
  async add(key) {
    if (!isKey(key)) {
      this.say("This is not a key. A key has at least 24 letters, digits, - or _, and no spaces.");
      return;
    }
    if (keysHere().includes(key)) {
      this.say("You already added this key.");
      return;
    }
    if (broughtKeys().length >= MOST_KEYS) {
      this.say(`You have added ${MOST_KEYS} keys, which is the limit. Remove one first.`);
      return;
    }
    this.say("Checking…");
    try {
      /** @type {{ total?: number, folds?: [], previews?: [], movies?: [] }[]} */
      const bodies = await Promise.all(
        LISTS.map((list) => ask(`/api/mine/${list}`, { token: key })),
      );
      const count = bodies.reduce(
        (sum, { total, previews, movies }) =>
          sum + (total ?? 0) + (previews?.length ?? 0) + (movies?.length ?? 0),
        0,
      );
      if (!count) {
        this.say("Nothing was found for this key. Did you copy the whole key?");
        return;
      }
      if (!bring(key)) {
        this.say("This browser does not store data for this site, so the key cannot be added.");
        return;
      }
    } catch (error) {
      this.say(wordsOf(error));
      return;
    }
    get("key-paste").value = "";
    this.say("Key added. Its folds are listed above.");
    await this.again();
  }

  list() {
    get("keys").replaceChildren(
      ...broughtKeys().map((key) => {
        const name = `Key ${key.slice(0, SHOWN)}…`;
        const use = button(
          "way",
          "Use for new folds",
          async () => {
            const sure = await confirmed(
              "Use this key for new folds?",
              "Anyone else who has this key can see, rename and delete your new folds. Your " +
                "earlier folds stay with your own key.",
              "Use it",
            );
            if (sure) {
              useKey(key);
              await this.again();
            }
          },
          { "aria-label": `Use for new folds: ${name}` },
        );
        const remove = button(
          "way",
          "Remove",
          async () => {
            dropKey(key);
            await this.again();
          },
          { "aria-label": `Remove: ${name}` },
        );
        return element(
          "li",
          {},
          element("code", {}, name),
          element("div", { class: "ways" }, use, remove),
        );
      }),
    );
    get("brought").hidden = !broughtKeys().length;
  }

  async again() {
    this.show(false);
    this.list();
    await this.changed();
  }

  // Replace a leaked key. The new key is stored before the request,
  // so that moved items are still listed if the answer is lost.
  async renew() {
    const old = ownKey();
    if (old === null) {
      this.say("This browser does not store data for this site, so it has no key.");
      return;
    }
    if (broughtKeys().length >= MOST_KEYS) {
      this.say(`You have added ${MOST_KEYS} keys, which is the limit. Remove one first.`);
      return;
    }
    const sure = await confirmed(
      "Create a new key?",
      "Your folds move to a new key. The old key stops working everywhere. Add the new key to " +
        "your other browsers.",
      "New key",
    );
    if (!sure) return;
    const key = newKey();
    bring(key);
    try {
      await ask("/api/mine/key", { token: old, body: { owner_token: key } });
      replaceOwn(key);
      this.say("Done. The old key no longer works.");
    } catch (error) {
      if (error instanceof Refusal && error.final) dropKey(key);
      this.say(`The old key may still work. ${wordsOf(error)}`);
    }
    await this.again();
  }

  async deleteAll() {
    const keys = keysHere();
    const sure = await confirmed(
      "Delete everything?",
      "This permanently deletes all folds, previews and movies listed here, also in your other " +
        "browsers. Their links stop working for everyone. Gallery folds stay.",
      "Delete all",
      true,
    );
    if (!sure) return;
    this.say("Deleting…");
    try {
      for (const key of keys) await deleteMade(key);
      this.say("Everything was deleted.");
    } catch (error) {
      this.say(`Some items could not be deleted. ${wordsOf(error)}`);
    }
    await this.again();
  }

  async forget() {
    const sure = await confirmed(
      "Forget the keys?",
      "This removes the keys from this browser. Your folds and links stay until they expire, but " +
        "without the keys you cannot list, rename or delete them. Copy your access key first if " +
        "you may need it again.",
      "Forget",
      true,
    );
    if (!sure) return;
    forgetKeys();
    this.say("Keys removed. You will get a new key with your next fold.");
    await this.again();
  }
}
