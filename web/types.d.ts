// What the pages' scripts hand to one another and get from the service; `tsc` checks them (jsconfig.json).
// Nothing of it is served. Lengths are in pitches and angles in radians unless a name says otherwise.

type Numbers = ArrayLike<number>;
type Vector = [x: number, y: number, z: number];
type Quaternion = [w: number, x: number, y: number, z: number];
type Floats = Float32Array<ArrayBuffer> | Float64Array<ArrayBuffer>;
type Column =
  | Floats
  | Uint8Array<ArrayBuffer>
  | Uint16Array<ArrayBuffer>
  | Uint32Array<ArrayBuffer>
  | Int32Array<ArrayBuffer>;

// Messages of web/timeline/columns.py.

interface ColumnTold {
  name: string;
  dtype: "<f8" | "<f4" | "|u1" | "<u2" | "<u4" | "<i4";
  shape: number[];
  at: number;
  size?: number;
  step?: number;
  differences?: number;
  short?: boolean;
}
interface Message<Header, Arrays> {
  header: Header;
  arrays: Arrays;
}

// Scene bundle: web/viser/scene_bundle.py.

interface Chain {
  name: string;
  module: string;
  modules: number;
  root: number;
  rigid_links: number;
  hinges: number;
  kinds: number[]; // rows of the following tables: module i has row kinds[i % kinds.length]
  anchor: Vector[];
  axes: Vector[][];
  turn: Quaternion[];
  offset: Vector[];
  radius: number;
  hinge_names: string[];
  cells: boolean;
  pitch_m: number;
  folded_wxyz: Quaternion; // of module 0 in the shape as it was drawn
  folded_root_wxyz: Quaternion;
}
// The pieces of the modules of a chain: web/pictures/meshes.py.
interface Pieces {
  modules: number;
  pieces: [from: number, to: number][]; // parts of each piece
  pattern: number[]; // pieces of the modules of a period
}
interface Hull extends Pieces {
  parts: { face_normals: Vector[]; vertices: Vector[] }[];
}
interface OutlinePart {
  corners: Vector[];
  faces: number[][];
  normals: Vector[];
}
interface Outline extends Pieces {
  parts: OutlinePart[];
  field_of_view_rad: number;
}
interface SceneMessage {
  type: string;
  name?: string;
  props?: Record<string, unknown>;
  [key: string]: unknown;
}
interface CameraConstants {
  field_of_view_rad: number;
  azimuth_rad: number;
  elevation_rad: number;
  turn_rad_s: number;
  stretch: number | null;
}
type Colour = [red: number, green: number, blue: number];
interface TableTold {
  height: number;
  thickness: number;
  outline: [x: number, y: number][];
}
interface BundleHeader {
  chain: Chain & Hull;
  messages: SceneMessage[];
  sketch: Outline;
  camera: CameraConstants;
  table: TableTold | null; // of a fold on one
  pitch: number;
  shown_size: number;
  nodes: string[]; // of the modules, one for each kind of piece in the chain
  ends: { at: Vector; wxyz: Quaternion }[]; // studs in the frames of the first and last module
  own_colours: Colour[]; // of the modules, in turn; none for most
  colours: Record<
    "neutral" | "unknown" | "error" | "selected" | "stuck" | "first" | "last",
    Colour
  >;
}
interface BundleArrays extends Record<string, Column> {
  folded_rad: Floats;
  folded_positions: Float32Array<ArrayBuffer>;
  ramp_error: Uint8Array<ArrayBuffer>;
  ramp_even: Uint8Array<ArrayBuffer>;
}
interface Bundle extends Message<BundleHeader, BundleArrays> {
  neighbours?: Int32Array; // of a long fold: see touching.js
}
// What a scene is built of, whatever else is told with it.
interface Staged extends Message<
  { messages: SceneMessage[]; camera: { field_of_view_rad: number } },
  Record<string, Column>
> {}
// web/viser/preview_scene.py.
interface PreviewBundle extends Message<
  {
    messages: SceneMessage[];
    hull: Hull;
    corners: Vector[];
    radius: number;
    camera: Omit<CameraConstants, "stretch" | "turn_rad_s"> & { margin: [number, number] };
    colours: { selected: Colour; ghost: Colour; ghost_opacity: number };
  },
  Record<string, Column> & {
    cells: Int32Array<ArrayBuffer>;
    positions: Float32Array<ArrayBuffer>;
    wxyzs: Float32Array<ArrayBuffer>;
    colours: Uint8Array<ArrayBuffer>;
  }
> {}

// Frames: web/timeline/frame_batch.py, web/timeline/window_columns.py and js/player/frames.js.

interface Phase {
  name: string;
  from: number;
  to: number;
}
interface TimelineOutline {
  frames: number;
  growing: boolean;
  names: string[];
  phases: Phase[];
  errors: (number | null)[];
  error_scale_rad: number;
  end_s?: number;
}
interface BatchHeader {
  id: string;
  status: "growing" | "complete" | "failed";
  total: number;
  start: number;
  stop: number;
  stride: number;
  outline: TimelineOutline;
}
interface WholeArrays {
  time_s: Floats;
  phase: Numbers;
  root_position: Floats;
  root_wxyz: Floats;
  joint_angles_rad: Floats;
  joint_error_rad: Floats;
}
interface WindowArrays {
  time_s: Floats;
  phase: Numbers;
  base_position: Floats;
  base_wxyz: Floats;
  first: Numbers;
  counts: Numbers;
  steps: Int32Array; // unused where there are
  angles?: Floats; // the same in radians
  errors_rad?: Floats; // of simulated frames, which are those that are recorded
  recorded?: Numbers;
}
type Batch = Message<BatchHeader, WholeArrays | WindowArrays>;
interface BatchAsked {
  from?: number;
  to?: number | null;
  stride?: number;
  wait?: number;
}
interface TimelineSource {
  bundle(): Promise<Bundle | null>;
  batch(asked?: BatchAsked): Promise<Batch | null>;
}
interface Row {
  time_s: number;
  phase: number;
  position: Floats;
  wxyz: Floats;
  first: number; // the hinges from this one to before the last have `angles`
  last: number;
  angles: Floats;
  errors: Floats;
  foldedRad: Floats;
}
interface Poses {
  positions: Floats;
  wxyzs: Floats;
}
// Modules up to `core` are folded, those from `rod` on are straight.
interface WindowPoses extends Poses {
  core?: number;
  rod?: number;
}
// The moment at a frame.
interface Snapshot extends WindowPoses {
  frame: number;
  exact: boolean; // false for the nearest frame that is here in place of this one
  low: number;
  time_s: number;
  phase: string;
  angle: (hinge: number) => number;
  errors: Floats;
  framed: number; // modules, from the first on, that a camera should have in view
  points?: Vector[];
}

// The camera.

interface View {
  target: Vector;
  azimuth: number;
  elevation: number;
  distance: number;
}
interface Eye {
  position: Vector;
  target: Vector;
}
// A camera relative to that from which Follow shows the chain: its direction, null for Follow's own; its
// distance in that of Follow; and with Follow off how far beside the chain it looks, to the right and
// up, in that distance as well.
interface CameraAt {
  azimuth: number | null;
  elevation: number | null;
  zoom: number;
  offset: [right: number, up: number] | null;
}
// What a hand does to the view: turns the camera, multiplies its distance, moves the picture by shares of
// its height. Gently is in a glide.
interface Orbit {
  turn?: [azimuth: number, elevation: number];
  zoom?: number;
  move?: [x: number, y: number];
  gently?: boolean;
}
interface Seeing {
  radius: number;
  aspect: number;
  field: number;
  home?: number;
}

// What the address of a page says: see js/player/address.js. Frames and modules count from 0 here.

interface AddressedView {
  frame: number | null;
  module: number | null;
  from: number | null;
  to: number | null;
  loop: boolean;
  camera: CameraAt | null;
  colour: string | null;
  path: boolean;
  follow: boolean;
  speed: number;
  play: boolean | null;
  stop: number | null; // of the tour
  named: boolean; // whether more than a moment is named, so that what is not is as usual
}
// A stop of a tour, and a tour: docs/tours.md. Frames and modules count from 1 here.
interface TourStop {
  caption: string;
  frame: number;
  modules?: number[];
  from?: number;
  to?: number;
  camera?: string;
  follow?: boolean;
  colour?: string;
  path?: boolean;
}
// A visitor's own numbers, kept with a fold: planner/plan/module_values.py.
interface KeptValues {
  format: string;
  name: string;
  unit: string;
  low: number;
  high: number;
  rows: number;
  data: string;
}
interface Tour {
  format: string;
  title: string;
  stops: TourStop[];
}
interface Addressed {
  player: Playing;
  view(): AddressedView | null;
  colour(key: string): void;
  path(on: boolean): void;
  seen?: Promise<void>; // until the view is in sight; nothing plays before
}

// What is told and asked on a page.

interface Switches {
  playing: boolean;
  speed: number;
  loop: boolean;
  reverse: boolean;
  follow: boolean;
  turn: boolean;
  live: boolean;
  real: boolean; // one second of the robot takes one second; "speed" does not count
  from: number | null; // frames that are looped over; null for those of the timeline
  to: number | null;
}
type Command =
  | { do: "play" | "pause" | "toggle" }
  | { do: "seek"; frame: number }
  | { do: "seek"; percent: number }
  | { do: "step"; by: number }
  | { do: "pass"; seconds: number }
  | { do: "change"; way: 1 | -1 }
  | { do: "fold"; percent: number }
  | ({ do: "set" } & Partial<Omit<Switches, "playing">>)
  | { do: "select"; module: number | null }
  | ({ do: "orbit" } & Orbit)
  | { do: "camera"; camera: CameraAt | null; gently?: boolean }; // null as usual
interface State extends Switches {
  frame: number;
  frames: number;
  growing: boolean;
  time_s: number | null;
  phase: string;
  error_rad: number | null;
  folded: number | null; // share, 0 to 1
  pace: number | null; // seconds of the robot in one second of playing; null where there is no robot
}
interface JointTold {
  name: string;
  column: number;
  angle_rad: number;
  target_rad: number;
  error_rad: number | null;
}
interface ModuleTold {
  index: number;
  modules: number;
  cell: number[] | null;
  joints: JointTold[];
  snapshot: Snapshot;
}
interface BarOutline {
  frames: number;
  phases: Phase[];
  errors: (number | null)[];
  error_scale_rad: number;
  growing: boolean;
}
// Who plays: a player, or two on one playhead.
interface Playing {
  usualColour?: string; // colouring before anybody chooses one; not of a pair
  send(message: Command): boolean;
  on(name: "waiting" | "begun", heard: () => void): void;
  on(name: "outline", heard: (outline: BarOutline) => void): void;
  on(name: "state", heard: (state: State) => void): void;
  on(name: "colouring" | "camera", heard: () => void): void;
  on(name: "module", heard: (told: ModuleTold) => void): void;
}
interface SceneHeard {
  open?: () => void;
  lost?: () => void; // its graphics, until it opens again
  pick?: (origin: Vector, direction: Vector) => void;
}
// What the frame of a 3D view says, or says nonsense instead: see bridge.js.
interface ViewTold {
  is?: unknown;
  id?: unknown;
}

// Figures: web/timeline/figures.py.

interface TableBounds {
  unit_nm: number;
  bound: number | null;
  kept: number | null;
  words: string;
}
interface PlotHeader {
  frames: number;
  rows: number;
  torque_at_some_frames: boolean;
  largest: Record<string, number>;
  table: TableBounds | null;
}
type PlotName =
  "max_error_rad" | "min_clearance" | "hinges_moving" | "peak_torque_nm" | "table_torque";
type Curves = PlotHeader & Partial<Record<PlotName, Floats>>;
type FigureName =
  "clearance" | "nearest" | "torque" | "position_error" | "joint_torque" | "pressed";
// Of peeled chains there are position errors alone.
interface FigurePart extends Message<
  { widths: Partial<Record<FigureName, number>> },
  Partial<Record<FigureName, Floats>>
> {}
type FigureRow = Partial<Record<FigureName, Floats>>;

// Facts that scripts use: `SCRIPT_FACTS` of server/pages/facts.py.

type Form = Record<string, string | number | boolean | Blob | null>;
interface Failing {
  frame: number | null;
  modules: number[];
}
interface PlanDot {
  label: string;
  time_s: number | null;
  torque_mnm: number | null;
  room: number | null;
  moving: number | null;
  verified: boolean;
  chosen: boolean;
}
interface Choice {
  prefer: string;
  seconds: number;
  columns: string[];
  plans: PlanDot[];
}
interface Again {
  text: string;
  form: Form;
}
interface Way {
  text: string;
  hint: string;
  form: Form;
  id?: string;
  settable?: string;
}
// A step of a plan that rests between steps: StepMoment in planner/plan/moments.py.
interface PlanStep {
  start: number; // frame
  end: number;
  text: string;
  joints: number[]; // modules
  moving: [first: number, last: number][];
  held?: HeldModule | null;
}
interface HeldModule {
  module: number;
  position: Vector;
  wxyz: Quaternion;
} // in the frame of the folded shape
type TurningPart = Pick<PlanStep, "joints" | "moving" | "held">;
// Whether turns lead to a fold's figure, at full size; without a text, it is not known yet.
interface FullSize {
  text: string;
  has_proof: boolean;
  hint: string;
}
interface Facts {
  id: string;
  name: string;
  running: boolean;
  verdict: { tone: string; text: string };
  failure: Failing | null;
  choice: Choice | null;
  again: Again | null;
  frames: number;
  tightest: number | null;
  steps: number;
  options: "all" | "owner" | null;
  compare: Way[];
  refold: Form;
  embed: string | null;
  editable: boolean;
  full_size: FullSize | null;
  build: { again: Again | null } | null;
}

// Answers of the API: api.d.ts. A refusal says more where a file could not be read.
type Refused = Partial<Api.Fault>;

// The editor. Cells are keys, as js/editor/painting.js says.

// What has been painted: whether each cell is filled, and the path drawn through them.
interface Painted {
  size: number;
  cells: Uint8Array;
  path: readonly number[];
}
// A path and the end of it that is drawn: its first cell or its last.
interface DrawnPath {
  path: readonly number[];
  atStart: boolean;
}
interface PathChecked {
  length: number;
  cells: number;
  gaps: number[]; // places in the path after which it leaps
  repeats: [first: number, second: number][]; // places that hold the same cell
  missing: number[];
  lost: number[]; // of the missing those that neither end leads to
  difference: number; // of the two colours of a chessboard
  complete: boolean;
}
// Elements of the pages that are more than an element, by their id.
interface Elements {
  again: HTMLButtonElement;
  angles: HTMLInputElement;
  back: HTMLButtonElement;
  "build-again": HTMLButtonElement;
  cancel: HTMLButtonElement;
  "check-bar": HTMLProgressElement;
  "check-dialog": HTMLDialogElement;
  "class-link": HTMLInputElement;
  "class-picture": HTMLImageElement;
  clear: HTMLButtonElement;
  "colour-by": HTMLSelectElement;
  "compare-dialog": HTMLDialogElement;
  "compare-form": HTMLFormElement;
  "compare-link": HTMLInputElement;
  compare: HTMLButtonElement;
  complete: HTMLButtonElement;
  confirm: HTMLDialogElement;
  "cover-button": HTMLButtonElement;
  cut: HTMLButtonElement;
  down: HTMLButtonElement;
  drawing: HTMLImageElement;
  drop: HTMLFormElement;
  file: HTMLInputElement;
  fold: HTMLButtonElement;
  folded: HTMLInputElement;
  follow: HTMLButtonElement;
  forward: HTMLButtonElement;
  frame: HTMLInputElement;
  "hero-folded": HTMLInputElement;
  "hero-pause": HTMLButtonElement;
  higher: HTMLButtonElement;
  inside_out: HTMLInputElement;
  jump: HTMLSelectElement;
  key: HTMLInputElement;
  "key-form": HTMLFormElement;
  "key-paste": HTMLInputElement;
  "keys-dialog": HTMLDialogElement;
  "keys-off": HTMLInputElement;
  live: HTMLButtonElement;
  loop: HTMLButtonElement;
  lower: HTMLButtonElement;
  "mesh-cells": HTMLInputElement;
  model: SVGSVGElement;
  notify: HTMLButtonElement;
  more: HTMLButtonElement;
  "module-after": HTMLButtonElement;
  "module-before": HTMLButtonElement;
  "module-number": HTMLInputElement;
  "modules-number": HTMLInputElement;
  "movie-bar": HTMLProgressElement;
  "movie-create": HTMLButtonElement;
  modules: HTMLInputElement;
  name: HTMLInputElement;
  open: HTMLButtonElement;
  options: HTMLFormElement;
  "paper-settings": HTMLDetailsElement;
  "robot-settings": HTMLDetailsElement;
  "play-icon": SVGUseElement;
  play: HTMLButtonElement;
  plot: SVGSVGElement;
  prefer: HTMLSelectElement;
  preset: HTMLSelectElement;
  preview: HTMLButtonElement;
  through: HTMLButtonElement;
  "own-file": HTMLInputElement;
  redo: HTMLButtonElement;
  "refold-dialog": HTMLDialogElement;
  "refold-file": HTMLInputElement;
  refold: HTMLButtonElement;
  "new-name": HTMLInputElement;
  renaming: HTMLDialogElement;
  repeat: HTMLButtonElement;
  reverse: HTMLButtonElement;
  "save-cells": HTMLButtonElement;
  "save-path": HTMLButtonElement;
  scrub: HTMLInputElement;
  seed: HTMLInputElement;
  "share-embed": HTMLTextAreaElement;
  "share-here": HTMLInputElement;
  "share-link": HTMLInputElement;
  sharing: HTMLDialogElement;
  sides: HTMLSelectElement;
  "picture-clear": HTMLInputElement;
  "picture-file": HTMLInputElement;
  "picture-scale": HTMLSelectElement;
  sieve: HTMLFormElement;
  size: HTMLSelectElement;
  sketch: HTMLCanvasElement;
  smooth: HTMLButtonElement;
  speed: HTMLSelectElement;
  "stuck-card": HTMLDetailsElement;
  "steps-before": HTMLButtonElement;
  "steps-next": HTMLButtonElement;
  thickness: HTMLInputElement;
  threshold: HTMLInputElement;
  "tour-after": HTMLButtonElement;
  "tour-before": HTMLButtonElement;
  "tour-save": HTMLButtonElement;
  "tour-undo": HTMLButtonElement;
  turn: HTMLButtonElement;
  undo: HTMLButtonElement;
  unpath: HTMLButtonElement;
  "typed-kind": HTMLSelectElement;
  up: HTMLButtonElement;
  view: HTMLIFrameElement;
  word: HTMLInputElement;
}
type ElementOf<Id extends string> = Id extends keyof Elements ? Elements[Id] : HTMLElement;

interface Window {
  foldback: {
    timeline: import("./static/js/player/timeline.js").Timeline;
    player: import("./static/js/player/player.js").Player;
    showing?: unknown;
  };
  foldbackScripts: { imports: string; worker: string }; // of a page without a server
  foldbackFilms: Record<string, Record<string, string>>;
  SwaggerUIBundle(options: Record<string, unknown>): void;
}
