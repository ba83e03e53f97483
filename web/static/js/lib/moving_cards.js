// Cards whose drawing moves while a mouse points at them, or while they have the keyboard's focus.
// A touch moves none, because it opens the card. Static sites contain this script as a text.

/**
 * The card that moves or is about to, its drawing, and the moving one.
 * @typedef {{ card: HTMLAnchorElement, still: HTMLImageElement, moving: HTMLImageElement }} Shown
 */
/** Time for which a card must be pointed at; a mouse that only passes loads nothing. */
const DWELL_MS = 80;
const calm = matchMedia("(prefers-reduced-motion: reduce)");
const POINTED = ".card:is(:hover, :focus-visible)";
/** @type {Shown | null} */
let shown = null;

// Return the address of the moving drawing: of the fold that a card opens, or of its shape.
/**
 * @param {HTMLAnchorElement} card
 * @param {HTMLImageElement} still
 */
const addressOf = (card, still) =>
  /\/folds\/[^/.]+$/.test(card.pathname)
    ? `${card.href}/motion.svg`
    : still.src.replace(/(\/drawing)?\.svg$/, "/motion.svg");

function rest() {
  if (!shown) return;
  shown.moving.remove();
  shown.still.hidden = false;
  shown = null;
}

function look() {
  const card = /** @type {HTMLAnchorElement | null} */ (document.querySelector(POINTED));
  if (card === (shown?.card ?? null)) return;
  rest();
  const still = card?.querySelector("img");
  if (!card || !still || calm.matches) return;
  const next = { card, still, moving: new Image() };
  shown = next;
  setTimeout(() => {
    if (shown === next) begin(next);
  }, DWELL_MS);
}

/** @param {Shown} next */
async function begin(next) {
  const { card, still, moving } = next;
  moving.alt = "";
  moving.src = addressOf(card, still);
  try {
    await moving.decode();
  } catch {
    return; // this card has no moving drawing
  }
  if (shown !== next) return;
  still.after(moving);
  still.hidden = true;
}

addEventListener("pointerover", ({ pointerType }) => {
  if (pointerType === "mouse") look();
});
for (const name of ["pointerout", "focusin", "focusout"])
  addEventListener(name, () => setTimeout(look));
look();

export {};
