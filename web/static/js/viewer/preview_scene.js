// The 3D scene of a preview: layers that can be toggled,
// and a highlighted module; see web/viser/preview_scene.py.
import { framing, membersOf, orbited, picked, pieceOf, positionOf, valuesOf } from "./camera.js";
import { decode } from "../lib/columns.js";
import { Hand, KEY_ORBITS, Scene, cameraTo, linear, update, visibility } from "./scene.js";

const MOST_TRIES = 8;
const RETRY_S = 2;
// Smallest and largest, as multiples of the usual one.
const DISTANCES = /** @type {const} */ ([0.1, 8]);
/** @type {Record<string, string>} */
// Keys with the same effect.
const ARROWS = { ArrowUp: "w", ArrowLeft: "a", ArrowDown: "s", ArrowRight: "d" };

/**
 * @typedef {object} PreviewHeard
 * @property {() => void} shown
 * @property {() => void} failed
 * @property {() => void} settled
 * @property {(module: number | null, cell: number[] | null) => void} pick
 */
/** @typedef {"solid" | "missing" | "cells" | "path"} Layer */

/** @extends {Scene<PreviewBundle>} */
export class PreviewStage extends Scene {
  // Listener methods: shown() when a scene is visible, failed() when it cannot be loaded, settled()
  // after either, and pick(module, cell), with null and null for a click on the background.
  /**
   * @param {HTMLIFrameElement} frame
   * @param {PreviewHeard} heard
   */
  constructor(frame, heard) {
    super(frame);
    const hand = new Hand((orbit) => this.orbit(orbit), {
      height: () => Math.max(1, frame.clientHeight),
      follows: () => false,
      tap: (x, y) => this.tap(x, y),
    });
    hand.cover(frame).onkeydown = (event) => {
      const orbit = KEY_ORBITS[ARROWS[event.key] ?? event.key.toLowerCase()];
      if (!orbit || event.ctrlKey || event.metaKey || event.altKey) return;
      event.preventDefault();
      this.orbit(orbit);
    };
    this.listener = heard;
    /** @type {Record<string, boolean>} */
    this.layers = { solid: true, missing: true, cells: true, path: true };
    /** @type {number | null} */
    this.selected = null;
    /** @type {View | null} */
    this.view = null;
    this.usual = 1; // distance at which the shape fits the view
    /** @type {Vector} */
    this.usualTarget = [0, 0, 0]; // what is in the middle of that view
    this.touched = false;
    /** @type {string | null} */
    this.address = null;
    this.waiting = false;
    new ResizeObserver(() => this.look()).observe(frame);
  }

  // Load and show the scene at an address, unless another one is requested meanwhile.
  /** @param {string} address */
  async show(address) {
    if (address === this.address) {
      this.select(null);
      return;
    }
    this.address = address;
    this.waiting = true;
    const bundle = await this.fetched(address);
    if (address !== this.address) return;
    this.waiting = false;
    if (bundle) this.set(bundle);
    else {
      this.address = null;
      this.listener.failed();
    }
    this.listener.settled();
  }

  /**
   * @param {string} address
   * @returns {Promise<PreviewBundle | null>}
   */
  async fetched(address) {
    for (let tries = 0; tries < MOST_TRIES && address === this.address; tries++) {
      const answer = await fetch(address).catch(() => null);
      if (answer?.ok)
        return answer
          .arrayBuffer()
          .then((bytes) => /** @type {Promise<PreviewBundle>} */ (decode(bytes)))
          .catch(() => null);
      if (answer && answer.status !== 503) return null;
      const wait = Number(answer?.headers.get("Retry-After")) || RETRY_S;
      await new Promise((done) => {
        setTimeout(done, 1000 * wait);
      });
    }
    return null;
  }

  /** @param {PreviewBundle} bundle */
  set(bundle) {
    this.selected = null;
    super.set(bundle);
  }

  build() {
    super.build();
    this.apply(Object.keys(this.layers).flatMap((name) => this.layered(name)));
    this.paint();
    this.look();
    this.listener.shown();
  }

  /**
   * @param {string} name
   * @param {boolean} on
   */
  layer(name, on) {
    this.layers[name] = on;
    if (!this.open) return;
    this.apply(this.layered(name));
    if (name === "path") this.paint();
  }

  /** @param {string} name */
  layered(name) {
    const nodes = name === "cells" ? this.nodesOf("/cells") : [`/${name}`];
    return nodes
      .filter((node) => this.nodes.has(node))
      .map((node) => visibility(node, this.layers[name]));
  }

  // Names of the nodes of the modules, one for each of the module's pieces.
  /** @param {string} name */
  nodesOf(name) {
    const pieces = this.bundle?.header.hull.pieces ?? [];
    return pieces.map((_, k) => (k ? `${name}_${k}` : name));
  }

  /** @param {number | null} module */
  select(module) {
    if (module === this.selected) return;
    this.selected = module;
    this.paint();
  }

  /**
   * @param {Vector} origin
   * @param {Vector} direction
   */
  pick(origin, direction) {
    const { bundle } = this;
    if (!bundle) return;
    const module = this.hasModules
      ? picked(bundle.header.hull, this.modules(), origin, direction)
      : null;
    this.select(module);
    this.listener.pick(
      module,
      module === null ? null : [...bundle.arrays.cells.subarray(3 * module, 3 * module + 3)],
    );
  }

  get hasModules() {
    return this.nodesOf("/cells").some((node) => this.nodes.has(node));
  }

  // Return the poses of the modules in the scene.
  modules() {
    const { positions, wxyzs } = /** @type {PreviewBundle} */ (this.bundle).arrays;
    return { positions, wxyzs };
  }

  // Colour the modules: transparent if the path is visible, except for the selected one.
  paint() {
    const { bundle } = this;
    if (!bundle || !this.open || !this.hasModules) return;
    const { selected: blue, ghost, ghost_opacity: opacity } = bundle.header.colours;
    const { selected } = this;
    const through = this.nodes.has("/path") && this.layers.path;
    const colours = bundle.arrays.colours.slice();
    if (through) for (let i = 0; i < colours.length; i++) colours[i] = ghost[i % 3];
    if (selected !== null) colours.set(blue, 3 * selected);
    const bytes = colours.map((byte) => linear[byte]);
    const { hull } = bundle.header;
    const { positions, wxyzs } = this.modules();
    this.apply(
      membersOf(hull).flatMap(([piece, members]) => {
        const [cells, mark] = [this.nodesOf("/cells")[piece], this.nodesOf("/selected")[piece]];
        const isMarked = selected !== null && pieceOf(hull, selected) === piece;
        const messages = [
          update(cells, {
            opacity: through ? opacity : null,
            batched_colors: valuesOf(bytes, members, 3),
          }),
          visibility(mark, isMarked),
        ];
        if (isMarked)
          messages.push(
            update(mark, {
              batched_positions: valuesOf(positions, [selected], 3),
              batched_wxyzs: valuesOf(wxyzs, [selected], 4),
            }),
          );
        return messages;
      }),
    );
  }

  // Keep the shape in view when the window or the shape changes, from where the visitor looks at
  // it.
  look() {
    const { clientWidth: wide, clientHeight: high } = this.frame;
    if (!this.open || !this.bundle || !wide || !high) return;
    const { corners, radius, camera } = this.bundle.header;
    const view = framing(corners, {
      radius,
      aspect: wide / high,
      field: camera.field_of_view_rad,
      azimuth: camera.azimuth_rad,
      elevation: camera.elevation_rad,
      margin: camera.margin,
    });
    const { usual, usualTarget } = this;
    Object.assign(this, { usual: view.distance, usualTarget: view.target });
    if (!this.touched || !this.view) {
      this.aim(view);
      return;
    }
    const { view: turned } = this;
    const size = view.distance / usual;
    const target = /** @type {Vector} */ (
      turned.target.map((v, k) => view.target[k] + size * (v - usualTarget[k]))
    );
    this.aim({ ...turned, target, distance: size * turned.distance });
  }

  /** @param {Orbit} orbit */
  orbit(orbit) {
    const { view, bundle, usual } = this;
    if (!view || !bundle) return;
    this.touched = true;
    this.aim(
      orbited(view, orbit, bundle.header.camera.field_of_view_rad, [
        DISTANCES[0] * usual,
        DISTANCES[1] * usual,
      ]),
    );
  }

  /** @param {View} view */
  aim(view) {
    this.view = view;
    this.eye = { position: positionOf(view), target: view.target };
    this.apply(cameraTo(this.eye));
  }
}
