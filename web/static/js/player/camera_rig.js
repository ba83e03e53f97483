// Camera of a player. With Follow on, it keeps the whole chain in view, from a direction and at a
// distance that the visitor chooses; with Follow off, it stays where the visitor puts it.
import {
  across,
  axesOf,
  blended,
  clamp,
  distanceNeeded,
  fewPoints,
  framing,
  glided,
  orbited,
  positionOf,
  steep,
} from "../viewer/camera.js";

const GOAL_EVERY = 12; // frames between two blended views
const GOAL_EVERY_S = 0.2; // the same in seconds of playback; the larger of both counts
const GOALS_ASIDE = 4; // blended views on each side of the playhead
const GOAL_SPREAD = 1.8; // larger values reduce the weight of distant views
const MAX_GOALS = 4000; // views in memory
// Minimum distance, as a multiple of that at which the chain touches the edge of the picture.
const ROOM = 1.08;
const USUAL_ASPECT = 1.6;
// Fraction of the picture's width that the chain fills at most, beside panels.
const FREE_WIDTH = 0.9;
const FREE_HEIGHT = 0.86; // fraction of the height between panels that the chain fills at most
const AROUND_PITCH = 3; // radius of the visible surroundings of each module of a group
const MAX_ZOOM = 8; // largest distance while following, as a multiple of the usual one
const NEAREST_PITCH = 1.5; // smallest distance from the target with Follow off
const FARTHEST = 40; // largest distance with Follow off, as a multiple of the usual one
const MIN_DEPTH = 0.02; // minimum distance in an address

/** @typedef {typeof import("../viewer/viewpoint.js").clearestSight} Sight */

/** @type {CameraAt} */
export const USUAL = Object.freeze({ azimuth: null, elevation: null, zoom: 1, offset: null });

export class CameraRig {
  /**
   * @param {import("./timeline.js").Timeline} timeline
   * @param {{ is: Switches, framesPerSecond: number }} playhead
   * @param {{ aspect: () => number, calm: boolean }} options
   */
  constructor(timeline, playhead, { aspect, calm }) {
    this.timeline = timeline;
    this.playhead = playhead;
    this.aspectNow = aspect;
    this.calm = calm; // true if the camera jumps to a frame that was sought, instead of gliding
    this.aspect = USUAL_ASPECT;
    /** @type {View | null} */
    this.view = null;
    /** @type {View | null} */
    this.goal = null; // view that the camera glides to
    /** @type {CameraAt} */
    this.choice = USUAL; // direction and distance while following
    this.minZoom = 1; // at which the whole chain is in view
    /** @type {CameraAt | null} */
    this.pending = null; // a camera relative to a frame that is not loaded yet
    /** @type {number[] | null} */
    this.group = null; // modules to follow instead of the whole chain
    /** @type {Sight | null} */
    this.sight = null; // finds the direction with the clearest sight of the group
    /** @type {Map<number, View>} */
    this.goals = new Map();
    this.covered = 0; // fraction of the picture's height that a panel covers, from below
    this.above = 0; // the same from above
    this.approximate = false; // true if the goal depends on frames that are not loaded yet
  }

  get is() {
    return this.playhead.is;
  }

  get pitch() {
    return this.timeline.bundle.header.pitch;
  }

  get eye() {
    const { view } = this;
    return view && { position: positionOf(view), target: view.target };
  }

  // Reset for another timeline; keep the visitor's direction and distance.
  begin() {
    this.view = this.goal = null;
    this.goals.clear();
  }

  // Target of Follow.

  /**
   * @param {number[]} modules empty for the whole chain
   * @param {Sight | null} sight
   */
  lookAt(modules, sight) {
    this.group = modules.length ? modules : null;
    this.sight = this.group && sight;
    this.choose(USUAL);
  }

  /** @param {CameraAt} choice */
  choose(choice) {
    this.choice = choice;
    this.pending = null;
    this.goals.clear();
  }

  // Choose the direction for a group; repeat it once the exact frame is loaded.
  /** @param {Snapshot} snapshot */
  turnToGroup(snapshot) {
    if (!this.sight) return;
    const { azimuth_rad: home, elevation_rad: rise } = this.timeline.bundle.header.camera;
    const [azimuth, elevation] = this.sight(snapshot.positions, this.group ?? [], [home, rise]);
    if (snapshot.exact) this.sight = null;
    this.choose({ ...USUAL, azimuth, elevation });
  }

  // Keep the followed chain between panels. Return true if they cover more or less than before.
  /**
   * @param {number} covered fraction of the picture's height, from below
   * @param {number} above the same from above
   */
  cover(covered, above = 0) {
    if (covered === this.covered && above === this.above) return false;
    this.covered = covered;
    this.above = above;
    this.goals.clear();
    return true;
  }

  // Switch Follow on, keeping the current direction, or off, keeping the current view.
  /** @param {boolean} on */
  follow(on) {
    const { view } = this;
    if (!view) return;
    if (on) this.choose({ ...USUAL, azimuth: view.azimuth, elevation: view.elevation });
    else this.goal = view;
  }

  // Input from pointers and keys.

  /**
   * @param {Orbit} orbit
   * @param {Snapshot | null} snapshot
   */
  orbit({ turn, zoom, move, gently = false }, snapshot) {
    const {
      view,
      goal,
      is: { follow },
    } = this;
    if (!view || !snapshot) return;
    this.sight = null;
    this.pending = null;
    const from = (gently ? goal : null) ?? view;
    if (turn && follow)
      this.choose({
        ...this.choice,
        azimuth: from.azimuth + turn[0],
        elevation: steep(from.elevation + turn[1]),
      });
    if (zoom && follow) {
      const minZoom = Math.min(1, this.minZoom);
      this.choice = {
        ...this.choice,
        zoom: clamp(Math.max(this.choice.zoom, minZoom) * zoom, minZoom, MAX_ZOOM),
      };
    }
    if (follow && (gently || !turn)) return; // a camera that follows glides there by itself
    // Only a zoom changes the distance.
    const farthest = zoom ? FARTHEST * this.whole(snapshot, from).distance : Infinity;
    this.goal = orbited(from, follow ? { turn } : { turn, zoom, move }, this.seeing().field, [
      NEAREST_PITCH * this.pitch,
      farthest,
    ]);
    if (!gently) this.view = this.goal;
  }

  // Camera in an address.

  // True if Follow determines the camera, so that an address needs no position.
  get follows() {
    return this.is.follow && !this.group;
  }

  // Return the camera independently of the pitch and of the chain's position: with Follow, the
  // visitor's choice; otherwise the position relative to the camera that shows the whole chain.
  /**
   * @param {Snapshot | null} snapshot
   * @returns {CameraAt}
   */
  at(snapshot) {
    if (this.pending) return this.pending;
    if (this.follows) return this.choice;
    const view = this.goal ?? this.view;
    return view && snapshot ? this.relative(view, snapshot) : USUAL;
  }

  // Return a view relative to the one that shows the whole chain.
  /**
   * @param {View} view
   * @param {Snapshot} snapshot
   * @returns {CameraAt}
   */
  relative(view, snapshot) {
    const base = this.whole(snapshot, view);
    const [right, up, out] = axesOf(view.azimuth, view.elevation);
    const along = (/** @type {Vector} */ axis) =>
      axis.reduce((sum, v, k) => sum + v * (view.target[k] - base.target[k]), 0) / base.distance;
    return {
      azimuth: view.azimuth,
      elevation: view.elevation,
      zoom: Math.max(MIN_DEPTH, view.distance / base.distance + along(out)),
      offset: [along(right), along(up)],
    };
  }

  // Apply the camera of an address. A free camera is applied again once the exact frame is loaded.
  /**
   * @param {CameraAt} camera
   * @param {Snapshot | null} snapshot
   * @param {boolean} gently true if the view glides there
   */
  go(camera, snapshot, gently = false) {
    this.group = this.sight = null;
    this.choose({
      ...camera,
      elevation: camera.elevation === null ? null : steep(camera.elevation),
      offset: null,
    });
    const { view } = this;
    if (!gently) this.view = null;
    if (this.is.follow) return;
    this.pending = snapshot?.exact ? null : camera;
    if (!snapshot) return;
    this.goal = this.placed(camera, snapshot);
    this.view = gently && view ? view : this.goal;
  }

  /**
   * @param {CameraAt} camera
   * @param {Snapshot} snapshot
   * @returns {View}
   */
  placed({ azimuth, elevation, zoom, offset }, snapshot) {
    this.fit();
    const usual = this.framed(snapshot);
    const from = {
      ...usual,
      azimuth: azimuth ?? usual.azimuth,
      elevation: steep(elevation ?? usual.elevation),
    };
    const base = this.whole(snapshot, from);
    return { ...from, target: across(base, ...(offset ?? [0, 0])), distance: zoom * base.distance };
  }

  // Camera of Follow.

  // Return the view of the whole chain that Follow would choose in the direction of a view.
  /**
   * @param {Snapshot} snapshot
   * @param {{ azimuth: number | null, elevation: number }} view
   *   azimuth null for the side that shows most of the chain
   */
  whole(snapshot, { azimuth, elevation }) {
    return framing(this.points(snapshot, null), { ...this.seeing(null), azimuth, elevation });
  }

  // Return the points to keep in view, in units of the scene.
  // Those of the whole chain are cached in the snapshot.
  /**
   * @param {Snapshot} snapshot
   * @returns {Vector[]}
   */
  points(snapshot, group = this.group) {
    const scaled = (/** @type {number[]} */ point) =>
      /** @type {Vector} */ (point.map((v) => v * this.pitch));
    if (group) return group.map((i) => scaled([...snapshot.positions.subarray(3 * i, 3 * i + 3)]));
    snapshot.points ??= fewPoints(snapshot.positions, snapshot.framed).map(scaled);
    return snapshot.points;
  }

  seeing(group = this.group) {
    const { camera, chain } = this.timeline.bundle.header;
    const radius = group ? AROUND_PITCH : chain.radius;
    return {
      radius: radius * this.pitch,
      aspect: this.aspect,
      field: camera.field_of_view_rad,
      home: camera.azimuth_rad,
    };
  }

  /**
   * @param {Snapshot} snapshot
   * @param {number | null} azimuth
   */
  framed(snapshot, azimuth = null) {
    const { choice, covered, above } = this;
    const elevation = choice.elevation ?? this.timeline.bundle.header.camera.elevation_rad;
    const seeing = { ...this.seeing(), azimuth: azimuth ?? choice.azimuth, elevation };
    if (!covered && !above) return framing(this.points(snapshot), seeing);
    const view = framing(this.points(snapshot), {
      ...seeing,
      margin: [FREE_WIDTH, FREE_HEIGHT * (1 - covered - above)],
    });
    return { ...view, target: across(view, 0, (above - covered) * Math.tan(seeing.field / 2)) };
  }

  get goalEvery() {
    return Math.max(GOAL_EVERY, Math.round(GOAL_EVERY_S * this.playhead.framesPerSecond));
  }

  // Return the cached goal view at an index, where index × goalEvery is the frame.
  /** @param {number} index */
  goalAt(index) {
    let view = this.goals.get(index);
    if (!view) {
      const snapshot = this.timeline.peek(index * this.goalEvery);
      if (!snapshot) return null;
      view = this.framed(snapshot);
      if (!snapshot.exact) {
        this.approximate = true;
        return view;
      }
      if (this.goals.size > MAX_GOALS) this.goals.clear();
      this.goals.set(index, view);
    }
    return view;
  }

  // Adopt the aspect ratio of the window.
  fit() {
    const aspect = this.aspectNow();
    if (!(aspect > 0) || aspect === this.aspect) return;
    this.aspect = aspect;
    this.goals.clear();
  }

  // Set the goal view, if Follow is on.
  /** @param {Snapshot} snapshot */
  aim(snapshot) {
    const { is, view, choice } = this;
    if (this.pending) {
      this.go(this.pending, snapshot);
      return;
    }
    if (!is.follow) return;
    this.fit();
    const still = !(is.playing || is.live || is.turn);
    const nearest = this.framed(snapshot, is.turn && view ? view.azimuth : null);
    // Only frames around the playhead of a long timeline are loaded;
    // blending them at rest would make the camera move as they arrive.
    const goal =
      is.turn || (still && this.timeline.windowed) ? nearest : this.among(snapshot, nearest);
    const minDistance = ROOM * this.needed(snapshot, goal);
    this.minZoom = (this.group ? NEAREST_PITCH * this.pitch : minDistance) / goal.distance;
    const distance =
      this.group && choice.zoom < 1
        ? goal.distance * choice.zoom
        : Math.max(goal.distance * choice.zoom, minDistance);
    this.goal = { ...goal, distance };
    if (!view || (this.calm && still)) this.view = this.goal;
  }

  // Blend the views before and after a frame, so that the camera moves smoothly and in time.
  /**
   * @param {Snapshot} snapshot
   * @param {View} nearest
   */
  among(snapshot, nearest) {
    const { timeline } = this;
    const position = snapshot.frame / this.goalEvery;
    const end = timeline.last / this.goalEvery;
    // Near both ends of a complete timeline the range
    // shrinks, so that the end frames are framed exactly.
    const reach = timeline.growing ? GOALS_ASIDE : Math.min(GOALS_ASIDE, position, end - position);
    this.approximate = false;
    if (reach <= 1e-6) return nearest;
    const views = [nearest];
    const weights = [1];
    const middle = Math.round(position);
    for (
      let k = Math.max(middle - GOALS_ASIDE, 0);
      k <= Math.min(middle + GOALS_ASIDE, Math.floor(end));
      k++
    ) {
      const view = this.goalAt(k);
      if (!view) continue;
      views.push(view);
      weights.push(Math.exp(-((((k - position) / reach) * GOAL_SPREAD) ** 2)));
    }
    return blended(views, weights, nearest);
  }

  // Return the minimum distance at which all points are in view.
  /**
   * @param {Snapshot} snapshot
   * @param {View} view
   */
  needed(snapshot, view) {
    return distanceNeeded(this.points(snapshot), view, this.seeing());
  }

  // Advance the glide of the camera. Return true while it moves.
  /**
   * @param {number} passed in seconds
   * @param {Snapshot} snapshot
   */
  glide(passed, snapshot) {
    const { is } = this;
    if (is.follow && this.aspectNow() !== this.aspect) {
      this.view = null;
      this.aim(snapshot);
    }
    if (is.follow && is.turn && this.view) {
      this.view = {
        ...this.view,
        azimuth: this.view.azimuth + this.timeline.bundle.header.camera.turn_rad_s * passed,
      };
      this.aim(snapshot);
    }
    const { view, goal } = this;
    if (!view || !goal) return false;
    const moves = view !== goal || (is.follow && is.turn);
    if (view !== goal) this.view = glided(view, goal, passed);
    if (moves && this.view && is.follow && !(this.group && this.choice.zoom < 1)) {
      const minDistance = this.needed(snapshot, this.view);
      if (this.view.distance < minDistance) this.view = { ...this.view, distance: minDistance };
    }
    return moves;
  }
}
