// Colouring by the visitor's own values, from a dropped or chosen file, or stored with the fold.
import { Refusal, ask, tokenOf } from "../lib/api.js";
import { get, number, wordsOf } from "../lib/text.js";
import { addStyle } from "../lib/lazy_styles.js";
import { Colouring, USUAL_COLOURING } from "../player/colours.js";
import { MAX_FILE_BYTES, keptRows, packed, readValues, unpacked, valuesAt } from "./reading.js";

const STYLE = "/static/css/tour.css";
const DIGITS = 3;

/**
 * @typedef {object} Owned
 * @property {import("../player/player.js").Player} player
 * @property {import("../panels/legend.js").Legend} legend
 * @property {KeptValues | null} values that are stored with the fold
 * @property {string | null} id of the fold, if values can be stored with it
 */

export class OwnPanel {
  /** @param {Owned} owned */
  constructor({ player, legend, values, id }) {
    this.player = player;
    this.legend = legend;
    this.id = id;
    this.token = id && tokenOf(id);
    /** @type {import("./reading.js").OwnValues | null} */
    this.ownValues = values?.data ? unpacked(values, player.timeline.chain.modules) : null;
    this.saved = Boolean(this.ownValues);
    this.box = get("own-values");
    this.error = get("own-error");
    const file = get("own-file");
    file.onchange = () => {
      if (file.files?.[0]) this.take(file.files[0]);
      file.value = "";
    };
    get("own-choose").onclick = () => file.click();
    get("own-keep").onclick = () => this.change("PUT");
    get("own-remove").onclick = () => this.change("DELETE");
    get("own-close").onclick = () => this.close();
    addStyle(STYLE);
    player.on("begun", () => {
      if (player.colouring?.key === "own") this.show();
    });
  }

  open() {
    this.box.hidden = false;
    this.show();
    this.say();
  }

  close() {
    this.box.hidden = true;
    get("colour-by").focus();
  }

  // Read a file; if it is invalid, show the reason and keep the colours.
  /** @param {File} file */
  async take(file) {
    this.box.hidden = false;
    this.error.textContent = "";
    const { timeline } = this.player;
    try {
      if (file.size > MAX_FILE_BYTES)
        throw new Error(
          `This file is ${Math.ceil(file.size / 2 ** 20)} MB. The limit is ` +
            `${MAX_FILE_BYTES / 2 ** 20} MB. Use fewer digits or frames.`,
        );
      const frames = timeline.growing ? 0 : timeline.total;
      this.ownValues = readValues(await file.text(), file.name, {
        modules: timeline.chain.modules,
        frames,
      });
      this.saved = false;
      this.show();
    } catch (error) {
      this.error.textContent = wordsOf(error);
    }
    this.say();
  }

  // Colour by the values, if there are any.
  show() {
    const {
      ownValues,
      player: { timeline },
    } = this;
    this.legend.offer(ownValues?.name ?? null);
    if (!ownValues) return;
    const text = (/** @type {number} */ value) =>
      `${number(value, DIGITS)}${ownValues.unit && ` ${ownValues.unit}`}`;
    this.player.colourBy(
      new Colouring("own", timeline, {
        values: ({ frame }) => valuesAt(ownValues, timeline.last ? frame / timeline.last : 0),
        low: ownValues.low,
        high: ownValues.high,
        text,
        none: ownValues.values.some(Number.isNaN) ? "no value" : null,
      }),
    );
  }

  say() {
    const {
      ownValues,
      saved,
      token,
      player: {
        timeline: { chain, total, growing },
      },
    } = this;
    const rows = growing
      ? ""
      : `, or ${total} rows of ${chain.modules} numbers, one row for each frame`;
    const counts =
      ownValues && ownValues.rows > 1
        ? `${ownValues.rows} rows with ${chain.modules} numbers each`
        : `${chain.modules} numbers`;
    const audience = saved
      ? "Everyone with a link to this fold can see these numbers."
      : "The numbers stay in this browser.";
    const fewer =
      ownValues && token && keptRows(ownValues) < ownValues.rows
        ? ` Only ${keptRows(ownValues)} of these rows, evenly spaced, can be saved with the fold.`
        : "";
    get("own-words").textContent = ownValues
      ? `${ownValues.name}${ownValues.unit && ` (${ownValues.unit})`}: ${counts}. ` +
        `${audience}${fewer}`
      : `Colour the modules by your own numbers: drop a CSV or JSON file here, or choose one. ` +
        `The file must contain ${chain.modules} numbers, one for each module${rows}. The file ` +
        `stays in this browser.`;
    get("own-keep").hidden = !ownValues || saved || !token;
    get("own-remove").hidden = !ownValues || (saved && !token);
  }

  // Store the values with the fold, or remove them from the fold and from this page.
  /** @param {"PUT" | "DELETE"} method */
  async change(method) {
    const { ownValues, token } = this;
    const remove = method === "DELETE";
    this.error.textContent = "";
    try {
      if (ownValues && token && (!remove || this.saved))
        await ask(`/api/folds/${this.id}/values`, {
          method,
          token,
          body: remove ? null : packed(ownValues),
        });
      this.saved = !remove;
      if (remove) {
        this.ownValues = null;
        this.legend.offer(null);
        this.legend.choose(USUAL_COLOURING);
      }
    } catch (error) {
      this.error.textContent =
        error instanceof Refusal && error.gone
          ? "Only the owner of this fold can save numbers with it."
          : wordsOf(error);
    }
    this.say();
  }
}
