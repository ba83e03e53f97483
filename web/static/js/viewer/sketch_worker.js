// Draws a fold in 2D: convex parts from back to front (painter's algorithm), with shaded faces.
const SHADOW_SCALE = 1 / 6;
const SHADOW = 0.2;
const NEAREST = 0.05;
const EDGE = "rgb(20 22 26 / .38)";
const rgb = (/** @type {number[]} */ colour) => `rgb(${colour.join(" ")})`;
const EDGED_PX = 5;
const GAPPED_PX = 12; // minimum size of modules that show the gaps to their neighbours
const GAP = 0.6; // brightness of the gap

/**
 * @typedef {{ place: number[], stops: [at: number, colour: string][] }} Ground gradient, in
 *   fractions of the canvas
 */
/**
 * @typedef {Outline & { neighbours: Int32Array | null, rods: boolean, full: number,
 *   table: TableTold | null }} Drawn
 */
/**
 * One frame, in pitches: poses and colours of the modules, the camera, and the height of the
 * ground. Modules before `core` are folded,
 * those from `rod` on straight.
 * @typedef {{ positions: Floats, wxyzs: Floats, colours: Uint8Array, eye: Numbers, target: Numbers,
 *   floor: number, core: number, rod: number }} SketchFrame
 */
/** @typedef {{ top: Colour, edge: Colour }} Wood colours of a table */
/**
 * @typedef {OutlinePart & { reach: number[], middle: Vector, points: Places, around: Places }} Part
 *   distances of the faces' planes, mean of the corners, and places of the corners in the picture
 */
/** @typedef {[x: number, y: number][]} Places */
/** @typedef {{ i: number, part: number, count: number, hidden: number, far: number }} Piece */
/**
 * @typedef {(x: number, y: number, z: number, at: number[]) => number} See writes the projection of
 *   a point to `at` and returns its depth
 */
/**
 * Messages of the page.
 * @typedef {{ is: "begin", paper: OffscreenCanvas, size: typeof size, ground: Ground | null,
 *   wood: Wood }
 *   | { is: "dress", ground: Ground | null, wood: Wood }
 *   | { is: "size", size: typeof size }
 *   | { is: "outline", outline: Drawn }
 *   | { is: "frame", frame: SketchFrame }
 *   | { is: "picture", frame: SketchFrame, size: typeof size, ground: Ground | null }
 *   | { is: "texts", images: ImageBitmap[] }
 *   | { is: "film", frame: SketchFrame, size: typeof size, ground: Ground, labels: Label[] }}
 *   SketchTold
 */
/** @typedef {{ image: number, y: number }} Label one of the pictures of texts */
/**
 * @typedef {{ paper: OffscreenCanvas, pen: OffscreenCanvasRenderingContext2D, size: typeof size,
 *   ground: Ground | null, backdrop: OffscreenCanvas | null }} Surface canvas that is drawn on
 */

// Set by the message "begin".
/** @type {OffscreenCanvas} */
let paper;
/** @type {OffscreenCanvasRenderingContext2D} */
let pen;
/** @type {Wood} */
let wood;
let size = { width: 0, height: 0, scale: 1 };
/** @type {Ground | null} */
let ground = null;
/** @type {OffscreenCanvas | null} */
let backdrop = null;
/** @type {Drawn | null} */
let outline = null;
/** @type {SketchFrame | null} */
let latest = null;
let due = false;
/** @type {Surface | null} */
let filmSurface = null; // canvas of the film's pictures
/** @type {ImageBitmap[]} */
let texts = []; // that the film shows

onmessage = (/** @type {MessageEvent<SketchTold>} */ { data }) => {
  if (data.is === "picture") {
    picture(data);
    return;
  }
  if (data.is === "texts") {
    texts = data.images;
    return;
  }
  if (data.is === "film") {
    const image = filmed(data);
    postMessage(image, { transfer: [image] });
    return;
  }
  if (data.is === "outline") {
    [outline, latest] = [data.outline, null];
    return;
  }
  if (data.is === "begin") {
    ({ paper, size, ground, wood } = data);
    pen = penOf(paper, !ground);
  } else if (data.is === "dress") {
    ({ wood } = data);
    if (ground && data.ground) ({ ground } = data);
    backdrop = null;
  } else if (data.is === "size") ({ size } = data);
  else latest = data.frame;
  ask(data.is === "frame");
};

// Draw one frame as a PNG, with or without background.
/** @param {SketchTold & { is: "picture" }} request */
async function picture({ frame, size: wanted, ground: behind }) {
  const surface = surfaceOf(wanted, behind);
  drawOn(surface, frame);
  postMessage(await surface.paper.convertToBlob({ type: "image/png" }));
}

// Draw one frame of a film with its labels, on a canvas that the next frames reuse.
/** @param {SketchTold & { is: "film" }} request */
function filmed({ frame, size: wanted, ground: behind, labels }) {
  if (filmSurface?.size.width !== wanted.width || filmSurface.size.height !== wanted.height)
    filmSurface = surfaceOf(wanted, behind);
  else if (JSON.stringify(filmSurface.ground) !== JSON.stringify(behind))
    Object.assign(filmSurface, { ground: behind, backdrop: null });
  drawOn(filmSurface, frame);
  for (const { image, y } of labels) filmSurface.pen.drawImage(texts[image], 0, y);
  return filmSurface.paper.transferToImageBitmap();
}

/**
 * @param {typeof size} wanted
 * @param {Ground | null} behind
 * @returns {Surface}
 */
function surfaceOf(wanted, behind) {
  const canvas = new OffscreenCanvas(1, 1);
  return {
    paper: canvas,
    pen: penOf(canvas, !behind),
    size: wanted,
    ground: behind,
    backdrop: null,
  };
}

// Draw a frame on a canvas other than that of the page.
/**
 * @param {Surface} surface
 * @param {SketchFrame} frame
 */
function drawOn(surface, frame) {
  const shown = { paper, pen, size, ground, backdrop };
  ({ paper, pen, size, ground, backdrop } = surface);
  clear();
  if (outline) draw(outline, frame);
  Object.assign(surface, { backdrop });
  ({ paper, pen, size, ground, backdrop } = shown);
}

// Return a context that draws on the CPU, which is faster with software rendering.
/**
 * @param {OffscreenCanvas} canvas
 * @param {boolean} alpha
 */
const penOf = (canvas, alpha) =>
  /** @type {OffscreenCanvasRenderingContext2D} */ (
    canvas.getContext("2d", { willReadFrequently: true, alpha })
  );

let owed = false;
/** @param {boolean} reports */
function ask(reports) {
  owed ||= reports;
  if (due) return;
  due = true;
  requestAnimationFrame(() => {
    due = false;
    if (size.width && size.height) {
      clear();
      if (outline && latest) draw(outline, latest);
    }
    if (owed) {
      owed = false;
      postMessage("drawn");
    }
  });
}

// Clear the canvas, or draw the background.
function clear() {
  const width = Math.round(size.width * size.scale);
  const height = Math.round(size.height * size.scale);
  if (paper.width !== width || paper.height !== height) {
    paper.width = width;
    paper.height = height;
  }
  if (!ground) {
    pen.clearRect(0, 0, width, height);
    return;
  }
  if (backdrop?.width !== width || backdrop.height !== height)
    backdrop = painted(ground, width, height);
  pen.drawImage(backdrop, 0, 0);
}

/**
 * @param {Ground} gradient
 * @param {number} width
 * @param {number} height
 */
function painted({ place, stops }, width, height) {
  const canvas = new OffscreenCanvas(width, height);
  const brush = penOf(canvas, false);
  const [wide, tall, x, y] = place;
  brush.translate(x * width, y * height);
  brush.scale(wide * width, tall * height);
  const gradient = brush.createRadialGradient(0, 0, 0, 0, 0, 1);
  for (const [at, colour] of stops) gradient.addColorStop(at, colour);
  brush.fillStyle = gradient;
  brush.fillRect(-x / wide, -y / tall, 1 / wide, 1 / tall);
  return canvas;
}

/**
 * @param {Numbers} a
 * @param {Numbers} b
 */
const dot = (a, b) => a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
/**
 * @param {Vector} a
 * @param {Vector} b
 * @returns {Vector}
 */
const cross = (a, b) => [
  a[1] * b[2] - a[2] * b[1],
  a[2] * b[0] - a[0] * b[2],
  a[0] * b[1] - a[1] * b[0],
];
/**
 * @param {Vector} a
 * @returns {Vector}
 */
const unit = (a) => {
  const l = Math.hypot(...a) || 1;
  return [a[0] / l, a[1] / l, a[2] / l];
};
const SIDE = unit([-0.3, -1.0, 0.5]);

// Return the brightness of a face with this outward normal:
// ambient light, the sky, and a light from the side.
/**
 * @param {number} x
 * @param {number} y
 * @param {number} z
 */
function light(x, y, z) {
  const side = Math.max(0, x * SIDE[0] + y * SIDE[1] + z * SIDE[2]);
  return Math.min(1.2, 0.5 + 0.26 * (z * 0.5 + 0.5) + 0.36 * Math.max(0, z) + 0.3 * side);
}

const GROUPED_PX = 6; // smaller modules of the straight tail are drawn as one
const ALIKE = 48; // maximum difference between the colours of such modules

/** @type {{ of: Drawn, parts: Part[], radius: number } | null} */
let prepared = null;

// Return the parts of an outline with what all frames share, and the radius of a module.
/** @param {Drawn} outlined */
function partsOf(outlined) {
  if (prepared?.of === outlined) return prepared;
  const parts = outlined.parts.map(({ corners, faces, normals }) => ({
    corners,
    faces,
    normals,
    reach: normals.map((normal, f) => dot(normal, corners[faces[f][0]])),
    middle: /** @type {Vector} */ (
      [0, 1, 2].map((c) => corners.reduce((sum, corner) => sum + corner[c], 0) / corners.length)
    ),
    points: corners.map(() => /** @type {[number, number]} */ ([0, 0])),
    around: corners.map(() => /** @type {[number, number]} */ ([0, 0])),
  }));
  const radius = Math.max(...parts.flatMap((part) => part.corners.map((v) => Math.hypot(...v))));
  prepared = { of: outlined, parts, radius };
  return prepared;
}

/**
 * @param {Drawn} drawnOutline
 * @param {SketchFrame} frame
 */
function draw(drawnOutline, frame) {
  const { full, table, field_of_view_rad: angle } = drawnOutline;
  const { positions, wxyzs, colours, eye, target } = frame;
  const { width, height } = paper;
  pen.lineJoin = "round";
  pen.lineWidth = size.scale;

  const out = unit([eye[0] - target[0], eye[1] - target[1], eye[2] - target[2]]);
  const right = unit(cross([0, 0, 1], out));
  const up = cross(out, right);
  const zoom = height / 2 / Math.tan(angle / 2);
  /** @type {See} */
  const see = (x, y, z, at) => {
    const [a, b, c] = [x - eye[0], y - eye[1], z - eye[2]];
    const depth = -(a * out[0] + b * out[1] + c * out[2]);
    const scale = zoom / Math.max(NEAREST, depth);
    at[0] = width / 2 + scale * (a * right[0] + b * right[1] + c * right[2]);
    at[1] = height / 2 - scale * (a * up[0] + b * up[1] + c * up[2]);
    return depth;
  };
  if (table && eye[2] > table.height) slab(table, see, [eye, out]);
  const { parts, radius } = partsOf(drawnOutline);
  const drawn = piecesOf({
    outline: drawnOutline,
    parts,
    frame,
    see,
    zoom,
    radius,
    width,
    height,
  });
  shadow(drawn, frame, see, width, height);
  drawn.sort((a, b) => b.far - a.far);

  const fill = (
    /** @type {number[]} */ face,
    /** @type {[number, number][]} */ at,
    /** @type {string} */ colour,
    line = colour,
  ) => {
    pen.beginPath();
    face.forEach((v, n) => (n ? pen.lineTo(...at[v]) : pen.moveTo(...at[v])));
    pen.closePath();
    pen.fillStyle = colour;
    pen.strokeStyle = line;
    pen.fill();
    pen.stroke();
  };
  const r = new Float64Array(9);
  for (const { i, part, count, hidden } of drawn) {
    const { corners, faces, normals, reach, points, around } = parts[part];
    const [x, y, z] = [positions[3 * i], positions[3 * i + 1], positions[3 * i + 2]];
    turn(wxyzs, i, r);
    // The eye in the frame of the module determines the visible faces.
    const e = [eye[0] - x, eye[1] - y, eye[2] - z];
    // Large modules have visible edges; on small ones the stroke covers hairlines between faces.
    const large = zoom / Math.max(NEAREST, dot(e, out)) / size.scale;
    const edged = large > EDGED_PX;
    // Through a gap, a hidden face is visible in the dark; without gaps there must be no holes.
    const gapped = hidden && large > GAPPED_PX;
    const local = [0, 1, 2].map((c) => r[c] * e[0] + r[3 + c] * e[1] + r[6 + c] * e[2]);
    const place = (/** @type {number} */ grown, /** @type {number[][]} */ into) =>
      corners.forEach(([front, left, top], v) => {
        const [a, b, c] = [
          front > 0 ? front * grown + count - 1 : front * grown,
          left * grown,
          top * grown,
        ];
        see(
          x + r[0] * a + r[1] * b + r[2] * c,
          y + r[3] * a + r[4] * b + r[5] * c,
          z + r[6] * a + r[7] * b + r[8] * c,
          into[v],
        );
      });
    place(hidden && !gapped ? full : 1, points);
    if (gapped) place(full, around);
    for (let f = 0; f < faces.length; f++) {
      const normal = normals[f];
      if (
        (hidden >> f) & 1 ||
        dot(normal, local) <= reach[f] + (normal[0] > 0 ? normal[0] * (count - 1) : 0)
      )
        continue;
      const [a, b, c] = normal;
      const bright = light(
        r[0] * a + r[1] * b + r[2] * c,
        r[3] * a + r[4] * b + r[5] * c,
        r[6] * a + r[7] * b + r[8] * c,
      );
      const shade = (/** @type {number} */ share) =>
        rgb([0, 1, 2].map((v) => Math.min(255, Math.round(colours[3 * i + v] * bright * share))));
      if (gapped) fill(faces[f], around, shade(GAP));
      fill(faces[f], points, shade(1), edged ? EDGE : undefined);
    }
  }
}

// Draw a table from above: its edge, then its top.
/**
 * @param {TableTold} table
 * @param {See} see
 * @param {[eye: Numbers, out: Vector]} from
 */
function slab({ height, thickness, outline: ring }, see, [eye, out]) {
  const fill = (/** @type {Vector[]} */ points) => {
    const visible = inFront(points, eye, out);
    const at = [0, 0];
    pen.beginPath();
    for (const [x, y, z] of visible) {
      see(x, y, z, at);
      pen.lineTo(at[0], at[1]);
    }
    pen.closePath();
    if (visible.length > 2) pen.fill();
    return visible.length > 2;
  };
  const low = height - thickness;
  pen.fillStyle = pen.strokeStyle = rgb(wood.edge);
  // The edge is drawn segment by segment; the top covers those that face away.
  if (fill(ring.map(([x, y]) => [x, y, low]))) {
    ring.forEach(([x, y], k) => {
      const [u, v] = ring[(k + 1) % ring.length];
      if (
        fill([
          [x, y, height],
          [u, v, height],
          [u, v, low],
          [x, y, low],
        ])
      )
        pen.stroke();
    });
  }
  pen.fillStyle = rgb(wood.top);
  fill(ring.map(([x, y]) => [x, y, height]));
}

// Clip a flat outline to the half-space in front of the eye.
/**
 * @param {Vector[]} points
 * @param {Numbers} eye
 * @param {Vector} out
 */
function inFront(points, eye, out) {
  const depth = (/** @type {Vector} */ p) =>
    -dot([p[0] - eye[0], p[1] - eye[1], p[2] - eye[2]], out) - NEAREST;
  /** @type {Vector[]} */
  const visible = [];
  points.forEach((p, k) => {
    const q = points[(k + 1) % points.length];
    const [a, b] = [depth(p), depth(q)];
    if (a >= 0) visible.push(p);
    if (a < 0 !== b < 0) {
      const share = a / (a - b);
      visible.push([
        p[0] + share * (q[0] - p[0]),
        p[1] + share * (q[1] - p[1]),
        p[2] + share * (q[2] - p[2]),
      ]);
    }
  });
  return visible;
}

// Return the visible pieces: single modules, and runs of `many` small modules of the straight tail.
// `hidden` has a bit for each face that a neighbour covers.
/**
 * @param {{ outline: Drawn, parts: Part[], frame: SketchFrame, see: See, zoom: number,
 *   radius: number, width: number, height: number }} drawn
 */
function piecesOf({ outline: outlined, parts, frame, see, zoom, radius, width, height }) {
  const { modules, pattern, pieces: ranges, neighbours, rods } = outlined;
  const { positions, colours, core } = frame;
  const [{ faces }] = parts; // the only part if there are neighbours
  // A straight run looks like one long module.
  const rod = rods ? Math.min(frame.rod, modules) : modules;
  const all = 2 ** faces.length - 1;
  /** @type {Piece[]} */
  const pieces = [];
  const at = [0, 0];
  const inside = (/** @type {number} */ depth) => {
    const around = (zoom * radius) / Math.max(NEAREST, depth);
    return (
      depth > -radius &&
      at[0] > -around &&
      at[0] < width + around &&
      at[1] > -around &&
      at[1] < height + around
    );
  };
  const project = (/** @type {number} */ i) =>
    see(positions[3 * i], positions[3 * i + 1], positions[3 * i + 2], at);
  for (let i = 0, next; i < modules; i = next) {
    next = i + 1;
    let hidden = 0;
    if (neighbours && i < core)
      for (let f = 0; f < faces.length; f++)
        if (neighbours[i * faces.length + f] < core) hidden |= 1 << f;
    if (hidden === all) continue;
    const depth = project(i);
    if (!inside(depth)) continue;
    const [left, top] = at;
    if (i >= rod && depth > NEAREST) {
      while (
        next < modules &&
        alike(colours, i, next) &&
        inside(project(next)) &&
        Math.hypot(at[0] - left, at[1] - top) < GROUPED_PX * size.scale
      )
        next++;
    }
    const [first, end] = ranges[pattern[i % pattern.length]];
    const count = next - i;
    if (end - first === 1)
      pieces.push({ i, part: first, count, hidden, far: farOf(frame, (i + next - 1) >> 1) });
    else
      for (let part = first; part < end; part++)
        pieces.push({ i, part, count, hidden, far: farOfPart(frame, i, parts[part].middle) });
  }
  return pieces;
}

/**
 * @param {SketchFrame} frame
 * @param {number} i
 */
const farOf = ({ positions, eye }, i) =>
  Math.hypot(...[0, 1, 2].map((c) => positions[3 * i + c] - eye[c]));

// Distance of the eye from a point of a module.
/**
 * @param {SketchFrame} frame
 * @param {number} i
 * @param {Vector} point
 */
function farOfPart({ positions, wxyzs, eye }, i, point) {
  turn(wxyzs, i, farTurn);
  return Math.hypot(
    ...[0, 1, 2].map(
      (c) => positions[3 * i + c] + dot(farTurn.subarray(3 * c, 3 * c + 3), point) - eye[c],
    ),
  );
}
const farTurn = new Float64Array(9);

/**
 * @param {Uint8Array} colours
 * @param {number} i
 * @param {number} j
 */
function alike(colours, i, j) {
  let apart = 0;
  for (let c = 0; c < 3; c++) apart += Math.abs(colours[3 * i + c] - colours[3 * j + c]);
  return apart <= ALIKE;
}

// Draw a soft shadow on the ground: small footprints, which enlarging blurs.
/** @type {OffscreenCanvas | null} */
let small = null;
/**
 * @param {Piece[]} drawn
 * @param {SketchFrame} frame
 * @param {See} see
 * @param {number} width
 * @param {number} height
 */
function shadow(drawn, { positions, floor }, see, width, height) {
  let [w, h] = [Math.ceil(width * SHADOW_SCALE), Math.ceil(height * SHADOW_SCALE)];
  small ??= new OffscreenCanvas(w, h);
  if (small.width !== w || small.height !== h) {
    small.width = w;
    small.height = h;
  }
  const brush = penOf(small, true);
  brush.clearRect(0, 0, w, h);
  brush.fillStyle = "#000";
  const at = [0, 0];
  let [left, top, beyond, below] = [w, h, 0, 0];
  for (const { i, count } of drawn) {
    const k = 3 * i;
    const e = 3 * (i + count - 1);
    const [x, y] = [
      Math.min(positions[k], positions[e]),
      Math.min(positions[k + 1], positions[e + 1]),
    ];
    const [u, v] = [
      Math.max(positions[k], positions[e]),
      Math.max(positions[k + 1], positions[e + 1]),
    ];
    brush.beginPath();
    for (const [px, py] of [
      [x - 0.6, y - 0.6],
      [u + 0.6, y - 0.6],
      [u + 0.6, v + 0.6],
      [x - 0.6, v + 0.6],
    ]) {
      see(px, py, floor, at);
      const [a, b] = [at[0] * SHADOW_SCALE, at[1] * SHADOW_SCALE];
      [left, top, beyond, below] = [
        Math.min(left, a),
        Math.min(top, b),
        Math.max(beyond, a),
        Math.max(below, b),
      ];
      brush.lineTo(a, b);
    }
    brush.fill();
  }
  // Enlarge only the part with a shadow: the whole would take longer than the modules.
  [left, top] = [Math.max(0, Math.floor(left) - 1), Math.max(0, Math.floor(top) - 1)];
  [w, h] = [Math.min(w, Math.ceil(beyond) + 1) - left, Math.min(h, Math.ceil(below) + 1) - top];
  if (w <= 0 || h <= 0) return;
  pen.globalAlpha = SHADOW;
  pen.imageSmoothingEnabled = true;
  pen.imageSmoothingQuality = "medium"; // "high" takes more than twice as long and looks the same
  pen.drawImage(
    small,
    left,
    top,
    w,
    h,
    left / SHADOW_SCALE,
    top / SHADOW_SCALE,
    w / SHADOW_SCALE,
    h / SHADOW_SCALE,
  );
  pen.globalAlpha = 1;
}

// Write the rotation matrix of a module to r, in row-major order.
/**
 * @param {Floats} wxyzs
 * @param {number} i
 * @param {Float64Array} r
 */
function turn(wxyzs, i, r) {
  const [w, x, y, z] = wxyzs.subarray(4 * i, 4 * i + 4);
  r[0] = 1 - 2 * (y * y + z * z);
  r[1] = 2 * (x * y - w * z);
  r[2] = 2 * (x * z + w * y);
  r[3] = 2 * (x * y + w * z);
  r[4] = 1 - 2 * (x * x + z * z);
  r[5] = 2 * (y * z - w * x);
  r[6] = 2 * (x * z - w * y);
  r[7] = 2 * (y * z + w * x);
  r[8] = 1 - 2 * (x * x + y * y);
}
