// The draft of the editor besides its cells: how they become modules, and the shape's name.
const STORED = "foldback:draft";
const LONGEST_NAME = 60;
const CHOICES = ["no", "yes", "path"];

export class Draft {
  /** @param {() => Pick<Storage, "getItem" | "setItem">} storage */
  constructor(storage) {
    this.storage = storage;
    this.how = "no";
    this.name = "";
    this.given = ""; // the name that a letter or a file has given
    try {
      const { how, name, given } = JSON.parse(storage().getItem(STORED) ?? "{}");
      if (CHOICES.includes(how)) this.how = how;
      if (typeof name === "string") this.name = name.slice(0, LONGEST_NAME);
      if (typeof given === "string") this.given = given;
    } catch { /* what was stored is no draft */ }
  }

  /** @param {{ how?: string, name?: string, given?: string }} changed */
  note(changed) {
    Object.assign(this, changed);
    const { how, name, given } = this;
    try { this.storage().setItem(STORED, JSON.stringify({ how, name, given })); } catch { /* no room, or none allowed */ }
  }

  // Note a name that a letter or a file gives.
  /** @param {string} name */
  give(name) { this.note({ name: name.slice(0, LONGEST_NAME), given: name.slice(0, LONGEST_NAME) }); }

  // Forget the name of what was cleared; one that the visitor has typed stays.
  clear() { if (this.name === this.given) this.note({ name: "", given: "" }); }
}
